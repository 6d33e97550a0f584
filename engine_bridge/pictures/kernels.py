"""Decorators of the compiled functions that draw films, which take tuples of arrays."""

from puppetline.compiled import compiled

kernel = compiled(counts=False)
"""Of a function that Python calls."""

inner = compiled(inner=True, counts=False, forceinline=True)
"""Of a function that a kernel calls; it becomes part of it, because to pass the tuples costs more than what it does."""
