"""Work that takes long: jobs with progress, and the process that does them."""
