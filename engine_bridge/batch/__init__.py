"""Conversion of many recordings with several characters, on many cores or machines; it can be resumed at any time."""
