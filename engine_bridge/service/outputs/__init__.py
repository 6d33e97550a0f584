"""Outputs, which send the service's frames: one module per wire."""
