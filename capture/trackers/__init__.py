"""Trackers: a sensor's pictures become a body's joints."""
