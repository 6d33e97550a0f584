"""Sensors and cameras: devices that deliver images, with a tracker each."""
