"""Who may connect to the service, and how that is checked."""
