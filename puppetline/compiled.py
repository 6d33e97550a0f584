"""The decorator of functions that Numba compiles."""

import gc
import hashlib
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import IO, Any

import numba
import numpy as np
from numba.core import event
from numba.core.caching import FunctionCache, IndexDataCacheFile

from puppetline.as_python import as_python
from puppetline.compiling import begin, is_compiled_elsewhere

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

GARBAGE_THRESHOLD = 100_000
"""Number of new objects after which garbage is searched for while Numba compiles, which makes few cycles of objects.
Compiling takes a tenth less time than with Python's threshold of 700."""


def compiled(
    function: Callable[..., Any] | None = None,
    *,
    inner: bool = False,
    waits: bool = True,
    counts: bool = True,
    **options: Any,
) -> Any:
    """Compile a function when it is first called.

    The compiled code is cached on disk for other processes, and runs without the interpreter's lock. Of several
    processes that call the function, one compiles it, and the others wait for the result.

    These take long to compile, and have quick counterparts: an assignment to a part of an array, such as a row (a loop
    over its numbers); expressions and methods of arrays, such as sums (loops); ``inline="always"`` (`forceinline`).

    Parameters
    ----------
    function : callable, optional
        Its parameters have no type hints: Numba infers their types from a call. Without a function, the result is a
        decorator.
    inner : bool
        Whether only compiled functions call this one. It is compiled with them, and not cached separately. A call
        from Python would crash the process.
    waits : bool
        Whether a call waits until the function is compiled. If not, Python runs the function with all that it calls
        while another process compiles it (`puppetline.compiling.others`): some thirty times slower, but at once. Only
        Python may call it.
    counts : bool
        Whether references to arrays are counted. Without, functions that take tuples of arrays are some three times as
        fast, and are compiled in half the time, but they can make no arrays.
    **options
        Further options of `numba.njit`, such as `fastmath`, `error_model` and `forceinline`.
    """
    # a wrapper, with which Python or C calls a function, can take as long to compile as the function
    options |= {"no_cpython_wrapper": True, "no_cfunc_wrapper": True} if inner else {"cache": True, "nogil": True}
    options |= {} if counts else {"_nrt": False}  # Numba's runtime, which counts references

    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher = numba.njit(**options)(function)
        if isinstance(getattr(dispatcher, "_cache", None), FunctionCache):  # not where compiling is switched off
            dispatcher._cache = _SharedCache(function)
            if not waits:
                return InPythonMeanwhile(dispatcher)
        return dispatcher

    return decorate if function is None else decorate(function)


def is_compiled(function: Any) -> bool:
    """Return whether the code of a compiled function is on disk, for arguments of any types."""
    return bool(function._cache._cache_file._load_index())


class InPythonMeanwhile:
    """A compiled function that Python runs while another process compiles it."""

    def __init__(self, dispatcher: Any) -> None:
        self.compiled = dispatcher
        self._in_python: Callable[..., Any] | None = None
        self._is_ready = False

    def __call__(self, *arguments: Any) -> Any:
        """Call the function, in Python while another process compiles."""
        if not self._is_ready and not is_compiled(self.compiled):
            begin()
            if is_compiled_elsewhere():
                self._in_python = self._in_python or as_python(self.compiled)
                with np.errstate(all="ignore"):  # compiled code does not warn
                    return self._in_python(*arguments)
        self._is_ready = True
        return self.compiled(*arguments)


@cache
def _digest(folder: Path, pattern: str) -> bytes:
    """Return a digest of the sources in a folder."""
    return hashlib.sha256(b"".join(path.read_bytes() for path in sorted(folder.glob(pattern)))).digest()


def _stamp(function: Callable[..., Any]) -> tuple[bytes, ...]:
    """Return what changes with all sources that may be part of a compiled function.

    Numba looks at the file of the function alone. Compiled with it are functions and constants of its folder and of the
    solver.
    """
    solver = find_spec("solver")
    folders = [(Path(function.__code__.co_filename).parent, "*.py")]
    folders += [(Path(place), "**/*.py") for place in (solver and solver.submodule_search_locations) or ()]
    return tuple(_digest(*each) for each in folders)


class _CacheFiles(IndexDataCacheFile):  # type: ignore[misc]
    """The files of a function's code. Those that a power cut has left empty or incomplete count as missing."""

    def load(self, key: Any) -> Any:
        try:
            return super().load(key)
        except Exception:  # damaged data can raise any error
            return None

    def _load_index(self) -> Any:
        try:
            return super()._load_index()
        except Exception:
            return {}


class _SharedCache(FunctionCache):  # type: ignore[misc]
    """The compiled code of a function on disk, which no two processes compile at the same time.

    Numba asks for the code, compiles the function if there is none, and saves it unless that fails, under a lock of the
    process.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        name = f"{self._impl.filename_base}.numpy-{np.__version__}"  # environments of one clone may have different ones
        self._cache_file = _CacheFiles(self.cache_path, name, _stamp(function))
        self._path = Path(self.cache_path) / f"{name}.lock"
        self._lock: IO[bytes] | None = None

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        found = super().load_overload(sig, target_context)
        if found is None and self._lock is None:
            self._wait()
            found = super().load_overload(sig, target_context)  # another process may have saved it meanwhile
            if found is not None:
                self.release()
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            super().save_overload(sig, data)
        finally:
            self.release()

    def _wait(self) -> None:
        """Take the lock; where that is impossible, two processes may compile the same."""
        with suppress(OSError):
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._lock = self._path.open("wb")
            if sys.platform == "win32":
                msvcrt.locking(self._lock.fileno(), msvcrt.LK_LOCK, 1)  # for up to ten seconds
            else:
                fcntl.flock(self._lock, fcntl.LOCK_EX)

    def release(self) -> None:
        """Let other processes compile the function, if this one has the lock."""
        if self._lock is not None:
            with suppress(OSError):
                self._path.unlink()
            self._lock.close()
            self._lock = None


class _Compiling(event.Listener):  # type: ignore[misc]
    """Says that compiling has begun, and makes Python search for garbage less often meanwhile."""

    def __init__(self) -> None:
        self._depth, self._before = 0, gc.get_threshold()

    def on_start(self, _: Any) -> None:
        if self._depth == 0:
            begin()
            self._before = gc.get_threshold()
            gc.set_threshold(max(self._before[0], GARBAGE_THRESHOLD) if self._before[0] else 0, *self._before[1:])
        self._depth += 1

    def on_end(self, end: Any) -> None:
        self._depth -= 1
        if self._depth == 0:
            gc.set_threshold(*self._before)
        dispatcher = end.data["dispatcher"]
        if tuple(end.data["args"]) not in dispatcher.overloads and isinstance(dispatcher._cache, _SharedCache):
            dispatcher._cache.release()  # it has failed: nothing will be saved


event.register("numba:compile", _Compiling())
