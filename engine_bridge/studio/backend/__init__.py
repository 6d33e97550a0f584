"""What the API does: requests of pages, and the state that all pages show."""
