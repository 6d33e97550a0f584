"""What the service reports about itself: status, metrics, logs, systemd."""
