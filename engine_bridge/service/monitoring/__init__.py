"""Monitoring of the service: status, metrics, logs and notifications to systemd."""
