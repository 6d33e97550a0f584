"""Measurements behind the numbers in the documentation; each prints what it measured."""

import os

# an installed program keeps what Python has compiled; without it, each process would compile all modules for seconds
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
