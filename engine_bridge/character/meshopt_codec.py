"""Encoding of the arrays in buffer views by EXT_meshopt_compression: bytes only, no documents.

Rows of vertex attributes and of keyframes are encoded by differences of bytes between consecutive rows, triangles by
their connectivity. A filter is a conversion that a reader applies after decompression.

Source: glTF extension EXT_meshopt_compression, with version 0 of the encoding of attributes and 1 of the others.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from puppetline.errors import OutputError

MANTISSA_LIMIT = 2**23
"""Limit of the mantissas of the exponential filter, which have 24 bits with their sign."""

EXPONENT_LIMIT = 100
"""Maximum absolute exponent of the exponential filter."""

MAX_RATIO = 100
"""Maximum ratio of decompressed to compressed bytes; no valid encoding reaches it."""

STRIDES = {"OCTAHEDRAL": (4, 8), "QUATERNION": (8,)}
"""Sizes of rows in bytes that a filter accepts; filters that are not listed accept all sizes."""

MAX_INT16 = 32767
"""Integer that stands for 1 in a unit vector."""

OCTAHEDRON_STEPS = 511
"""Number of steps from the middle of the octahedron to a corner: 10 bits, which are about as small as plain bytes."""

Mode = Literal["ATTRIBUTES", "TRIANGLES", "INDICES"]
Filter = Literal["OCTAHEDRAL", "EXPONENTIAL"]
Bytes = NDArray[np.uint8]


@dataclass(frozen=True)
class Encoded:
    """A compressed buffer view: its bytes, and how to decompress them."""

    content: bytes
    mode: Mode
    stride: int
    filter: Filter | None = None


def is_installed() -> bool:
    """Return whether the package meshoptimizer is installed."""
    return find_spec("meshoptimizer") is not None


def require_meshoptimizer() -> None:
    """Check that meshoptimizer is installed.

    Raises
    ------
    OutputError
    """
    if not is_installed():
        raise OutputError(
            "--meshopt",
            found="no installation of meshoptimizer",
            expected="the Python package meshoptimizer",
            fix="Install it: pip install 'puppetline[compact]'. Without it, use --compact alone.",
        )


def rows(content: Bytes, stride: int) -> Encoded:
    """Encode rows of `stride` bytes."""
    return Encoded(_encode_rows(content, stride), "ATTRIBUTES", stride)


def exponential(content: Bytes, stride: int) -> Encoded | None:
    """Encode rows of floats as mantissas with one exponent per column; None if these are not exact."""
    packed = _mantissas(content.view(np.float32).reshape(-1, stride // 4))
    return None if packed is None else Encoded(_encode_rows(packed, stride), "ATTRIBUTES", stride, "EXPONENTIAL")


def octahedral(content: Bytes) -> Encoded | None:
    """Encode rows of four normalised integers of 16 bits as points of an octahedron; None if these are not exact."""
    values = content.view(np.int16).reshape(-1, 4)
    packed = _on_octahedron(values)
    if not np.array_equal(_from_octahedron(packed), values):
        return None
    return Encoded(_encode_rows(packed.view(np.uint8).ravel(), 8), "ATTRIBUTES", 8, "OCTAHEDRAL")


def indices(content: Bytes, size: int) -> Encoded:
    """Encode integers of 2 or 4 bytes."""
    import meshoptimizer

    meshoptimizer.encode_index_version(1)
    return Encoded(meshoptimizer.encode_index_sequence(_integers(content, size)), "INDICES", size)


def triangles(content: Bytes, size: int) -> Encoded:
    """Encode the corners of triangles, integers of 2 or 4 bytes; the first corner of a triangle may become another."""
    import meshoptimizer

    meshoptimizer.encode_index_version(1)
    return Encoded(meshoptimizer.encode_index_buffer(_integers(content, size)), "TRIANGLES", size)


def _integers(content: Bytes, size: int) -> NDArray[np.uint32]:
    return content.view(f"<u{size}").astype(np.uint32)


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


def _encode_rows(content: Bytes, stride: int) -> bytes:
    import meshoptimizer

    return meshoptimizer.encode_vertex_buffer(content, len(content) // stride, stride)


def _mantissas(values: NDArray[np.float32]) -> Bytes | None:
    """Return floats (n, width) as mantissas and exponents in 32 bits, or None if they are not exact.

    A value is m · 2^e with m in the lower 24 bits and e in the upper 8; a column has one e.
    """
    if not np.isfinite(values).all() or (np.signbit(values) & (values == 0)).any():
        return None
    fractions, exponents = np.frexp(values)  # of 24 bits
    numbers = (fractions * np.float32(2**24)).astype(np.int64)
    lowest = np.where(numbers == 0, 2**24, numbers & -numbers)  # the last bit that is set
    steps = np.where(numbers == 0, EXPONENT_LIMIT, exponents - 24 + np.log2(lowest).astype(np.int64))
    shared = np.clip(steps.min(axis=0), -EXPONENT_LIMIT, EXPONENT_LIMIT)
    mantissas = np.ldexp(values.astype(np.float64), -shared)
    if not (np.abs(mantissas) < MANTISSA_LIMIT).all() or (mantissas != np.round(mantissas)).any():
        return None
    packed = (mantissas.astype(np.int64) & 0xFFFFFF) | ((shared & 0xFF) << 24)
    return packed.astype(np.uint32).view(np.uint8).ravel()


def octahedral_rounded(vectors: NDArray[np.floating]) -> NDArray[np.int16]:
    """Return unit vectors (n, 3) or (n, 4) as normalised integers that the octahedral filter stores exactly.

    Their error is up to 0.3°. A fourth component is 1 or −1 and does not change.
    """
    values = np.zeros((len(vectors), 4))
    values[:, : vectors.shape[1]] = MAX_INT16 * np.clip(vectors, -1, 1)
    return np.ascontiguousarray(_from_octahedron(_on_octahedron(values))[:, : vectors.shape[1]])


def _on_octahedron(values: NDArray[Any]) -> NDArray[np.int16]:
    """Return vectors (n, 4) as points of an unfolded octahedron: x, y, the integer that stands for 1, and w."""
    x, y, z = values[:, :3].T.astype(np.float64)
    size = np.maximum(np.abs(x) + np.abs(y) + np.abs(z), 1e-9)
    x, y = x / size, y / size
    folded_x = (1 - np.abs(y)) * np.where(x >= 0, 1, -1)
    folded_y = (1 - np.abs(x)) * np.where(y >= 0, 1, -1)
    packed = np.empty(values.shape, dtype=np.int16)
    packed[:, 0] = np.round(OCTAHEDRON_STEPS * np.where(z >= 0, x, folded_x))
    packed[:, 1] = np.round(OCTAHEDRON_STEPS * np.where(z >= 0, y, folded_y))
    packed[:, 2] = OCTAHEDRON_STEPS
    packed[:, 3] = np.round(values[:, 3])
    return packed


def _from_octahedron(packed: NDArray[np.int16]) -> NDArray[np.int16]:
    import meshoptimizer

    return meshoptimizer.decode_filter_oct(packed, len(packed), 8)
