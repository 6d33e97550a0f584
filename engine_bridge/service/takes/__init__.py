"""Takes that the service records."""
