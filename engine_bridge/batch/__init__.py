"""Conversion of many recordings with several characters, on many cores or machines, that can be resumed at any time."""
