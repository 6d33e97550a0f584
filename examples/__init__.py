"""Characters and performances made by code: what Puppetline shows when it is given nothing."""
