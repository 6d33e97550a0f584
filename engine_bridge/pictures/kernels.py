"""Decorators of the compiled functions that draw, which take tuples of arrays."""

from puppetline.compiled import compiled

kernel = compiled(counts=False, error_model="numpy")
"""Of a function that Python calls."""

inner = compiled(inner=True, counts=False, error_model="numpy", forceinline=True)
"""Of a function that kernels call; it becomes part of each, because to pass the tuples costs more than what it does."""

shared = compiled(inner=True, counts=False, error_model="numpy")
"""Of a function that kernels call, and that is long or rarely called: it is compiled once for all of them."""
