"""Anatomy of a character, detected from its shape: ends of limbs, curve skeleton, limbs and orientation."""
