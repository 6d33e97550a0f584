"""Measurements behind the numbers in the documentation; each prints what it measured."""
