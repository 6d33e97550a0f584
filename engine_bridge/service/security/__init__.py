"""Security of the service: addresses, credentials and the checks of clients."""
