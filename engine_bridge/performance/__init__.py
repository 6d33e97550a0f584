"""Conversion of a performer's frames to a character's controls, live and offline."""
