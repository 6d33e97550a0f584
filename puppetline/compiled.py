"""The decorator of functions that Numba compiles."""

from collections.abc import Callable
from typing import Any

import numba


def compiled(function: Callable[..., Any] | None = None, *, inner: bool = False, **options: Any) -> Any:
    """Compile a function when it is first called.

    The compiled code is cached on disk for other processes, and runs without the interpreter's lock.

    Parameters
    ----------
    function : callable, optional
        Its parameters have no type hints: Numba infers their types from a call. Without a function, the result is a
        decorator.
    inner : bool
        Whether only compiled functions call this one. It is compiled with them, and not cached separately. A call
        from Python would crash the process.
    **options
        Further options of `numba.njit`, such as `fastmath` and `error_model`.
    """
    # a wrapper, with which Python or C calls a function, can take as long to compile as the function
    options |= {"no_cpython_wrapper": True, "no_cfunc_wrapper": True} if inner else {"cache": True, "nogil": True}
    decorator: Any = numba.njit(**options)
    return decorator if function is None else decorator(function)
