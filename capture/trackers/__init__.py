"""Trackers: joints of performers from the images of a sensor."""
