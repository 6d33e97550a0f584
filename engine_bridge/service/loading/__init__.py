"""Loading of the service file, its stages and its characters."""
