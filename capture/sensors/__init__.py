"""Sensors and cameras: devices that give pictures, and trackers that find people in them."""
