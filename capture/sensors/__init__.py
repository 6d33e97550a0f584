"""Sensors and cameras: devices that give pictures."""
