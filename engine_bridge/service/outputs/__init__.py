"""What carries a service's frames out: a module a wire."""
