"""Compiled functions as they were before they were compiled, for Python to run."""

from collections.abc import Callable
from types import FunctionType, ModuleType
from typing import Any

from numba.core.dispatcher import Dispatcher


def as_python(function: Dispatcher) -> Callable[..., Any]:
    """Return what a compiled function was before, which calls what other compiled functions were before."""
    return _before(function, {})


def _before(function: Dispatcher, done: dict[int, dict[str, Any]]) -> Callable[..., Any]:
    """Return what a compiled function was before; `done` has the names of modules for which this has been asked."""
    was = function.py_func
    names = _names_before(was.__globals__, done)
    return FunctionType(was.__code__, names, was.__name__, was.__defaults__, was.__closure__)


def _names_before(names: dict[str, Any], done: dict[int, dict[str, Any]]) -> dict[str, Any]:
    """Return the names of a module, for functions that were compiled what they were before."""
    if id(names) in done:
        return done[id(names)]
    found = done[id(names)] = dict(names)
    for name, value in names.items():
        if isinstance(value, Dispatcher):
            found[name] = _before(value, done)
        elif isinstance(value, ModuleType) and any(isinstance(each, Dispatcher) for each in vars(value).values()):
            found[name] = ModuleType(name)
            vars(found[name]).update(_names_before(vars(value), done))
    return found
