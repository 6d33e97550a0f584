"""Rigs that are made for characters: named joints, skin weights, and documents with both."""
