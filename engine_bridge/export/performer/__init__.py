"""Animations of a performer's own skeleton, without a character."""
