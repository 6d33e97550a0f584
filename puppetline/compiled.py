"""The decorator of functions that Numba compiles."""

from collections.abc import Callable
from typing import Any

import numba


def compiled(function: Callable[..., Any] | None = None, *, inner: bool = False, **options: Any) -> Any:
    """Compile a function when it is first called.

    The compiled code is kept on disk for other processes, and runs without the interpreter's lock.

    Parameters
    ----------
    function : callable, optional
        Its parameters have no type hints: Numba infers their types from a call. Without a function, a decorator is
        returned.
    inner : bool
        Whether only compiled functions call this one. Its code becomes part of theirs, so it is not kept by itself.
    **options
        Further options of `numba.njit`, such as `fastmath` and `error_model`.
    """
    if not inner:
        options |= {"cache": True, "nogil": True}
    decorator: Any = numba.njit(**options)
    return decorator if function is None else decorator(function)
