"""What a Python program needs to follow a service."""
