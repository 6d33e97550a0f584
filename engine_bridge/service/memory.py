"""What a stage carries from frame to frame as JSON and back, bit by bit.

Arrays become ``{"type": "<f8", "shape": […], "data": base64}``: exact, and at home with NaN, which JSON is not.
"""

import base64
import math
from typing import Any, Protocol

import numpy as np

ARRAY = {"type", "shape", "data"}

TYPES = ("<f8", "<f4", "<i8")


def pack(value: Any) -> Any:
    """Turn nested dicts and lists of arrays, numbers, text and None into what JSON has."""
    if isinstance(value, dict):
        return {key: pack(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [pack(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        array = np.asarray(value)
        array = array.astype(array.dtype.newbyteorder("<"))
        data = base64.b64encode(array.tobytes()).decode()
        return {"type": array.dtype.str, "shape": list(array.shape), "data": data}
    if isinstance(value, float) and not math.isfinite(value):
        return pack(np.array(value))
    return value


def unpack(value: Any) -> Any:
    """Turn what `pack` has made back.

    Raises
    ------
    ValueError
        An array of another type, or with less or more data than its shape says.
    """
    if isinstance(value, list):
        return [unpack(item) for item in value]
    if not isinstance(value, dict):
        return value
    if value.keys() != ARRAY:
        return {key: unpack(item) for key, item in value.items()}
    if value["type"] not in TYPES or not isinstance(value["data"], str):
        raise ValueError(f"an array of type {value['type']!r}")
    array = np.frombuffer(base64.b64decode(value["data"], validate=True), dtype=value["type"])
    array = array.reshape(value["shape"]).astype(array.dtype.newbyteorder("="))
    return array if array.ndim else array[()].item()


class _Remembers(Protocol):
    memory: dict[str, Any]


def restore(one: _Remembers, memory: dict[str, Any]) -> None:
    """Set a memory after making sure that it is built as the one that is there: compiled loops do not look.

    Raises
    ------
    ValueError
        It is built otherwise.
    """
    _compare(one.memory, memory)
    one.memory = memory


def _compare(now: Any, then: Any) -> None:
    if isinstance(now, dict):
        if not isinstance(then, dict) or now.keys() != then.keys():
            raise ValueError(f"{then!r:.60} in place of {sorted(now)}")
        for key, value in now.items():
            _compare(value, then[key])
    elif np.shape(now) != np.shape(then) or np.asarray(now).dtype != np.asarray(then).dtype:
        raise ValueError(f"an array of shape {np.shape(then)}, expected {np.shape(now)}")
