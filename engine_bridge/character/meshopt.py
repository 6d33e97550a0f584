"""Decoding of the arrays in buffer views that are compressed by EXT_meshopt_compression: bytes only, no documents."""

from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

MAX_RATIO = 100
"""Maximum ratio of decompressed to compressed bytes; no valid encoding reaches it."""

STRIDES = {"OCTAHEDRAL": (4, 8), "QUATERNION": (8,)}
"""Sizes of rows in bytes that a filter accepts; filters that are not listed accept all sizes."""

Bytes = NDArray[np.uint8]


def is_installed() -> bool:
    """Return whether the package meshoptimizer is installed."""
    return find_spec("meshoptimizer") is not None


def decode(content: bytes, about: dict[str, Any]) -> bytes:
    """Return the bytes of a compressed buffer view.

    Parameters
    ----------
    content : bytes
        Compressed bytes.
    about : dict
        The extension of the buffer view.

    Raises
    ------
    ValueError
        The bytes are damaged, or the description does not match them.
    """
    import meshoptimizer

    count, stride, mode, name = (about.get(key) for key in ("count", "byteStride", "mode", "filter"))
    if type(count) is not int or type(stride) is not int or not 0 < count * stride <= MAX_RATIO * len(content):
        raise ValueError(f"{count} rows of {stride} bytes in {len(content)} compressed bytes")
    decoders = {"TRIANGLES": meshoptimizer.decode_index_buffer, "INDICES": meshoptimizer.decode_index_sequence}
    filters: dict[str | None, Callable[[Bytes], Bytes]] = {
        None: lambda values: values,
        "NONE": lambda values: values,
        "OCTAHEDRAL": lambda values: meshoptimizer.decode_filter_oct(values, count, stride),
        "QUATERNION": lambda values: meshoptimizer.decode_filter_quat(values, count, stride),
        "EXPONENTIAL": lambda values: meshoptimizer.decode_filter_exp(values, count, stride),
    }
    try:
        if mode in decoders and stride in (2, 4):
            return decoders[mode](count, 4, content).astype(f"<u{stride}").tobytes()
        if (
            mode != "ATTRIBUTES"
            or name not in filters
            or stride % 4
            or stride not in STRIDES.get(name or "", (stride,))
        ):
            raise ValueError(f"mode {mode}, filter {name} and rows of {stride} bytes")
        values = meshoptimizer.decode_vertex_buffer(count, stride, content, dtype=np.dtype((np.uint8, stride)))
        return filters[name](values).tobytes()
    except RuntimeError as error:
        raise ValueError(str(error)) from error
