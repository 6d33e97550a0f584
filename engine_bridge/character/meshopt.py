"""Lossless compression of a document's arrays by EXT_meshopt_compression.

Each buffer view is compressed alone: triangles by their connectivity, other arrays by differences of bytes between
consecutive rows. A *filter* is a conversion that a reader applies after decompression. A filter is used only if its
result is the same bytes. Values for a filter must therefore be rounded before: floats to multiples of a power of two
(exponential), unit vectors by `meshopt_codec.octahedral_rounded` (octahedral).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from engine_bridge.character import meshopt_codec as codec
from engine_bridge.character.document import COMPONENTS, MESHOPT, TYPE_WIDTHS, Document
from engine_bridge.character.schema import BufferView

MAX_STRIDE = 256
"""Maximum size of a row in bytes."""

MIN_SAVED_BYTES = 256
"""Minimum number of bytes that a compressed buffer view must save, because its description is longer."""


@dataclass(frozen=True)
class Use:
    """An array in a buffer view.

    Attributes
    ----------
    kind : dtype
        Type of a component.
    width : int
        Number of components.
    role : {"triangles", "indices", "attribute"}
    keys : int
        Number of key times, if the array is a property over time; else 0.
    normalized : bool
    """

    kind: np.dtype[Any]
    width: int
    role: Literal["triangles", "indices", "attribute"] = "attribute"
    keys: int = 0
    normalized: bool = False

    @property
    def size(self) -> int:
        """Size of a row in bytes."""
        return self.kind.itemsize * self.width


def compress(document: Document) -> None:
    """Compress all buffer views of a document that become smaller; images stay as they are.

    The result requires EXT_meshopt_compression, because it does not contain the uncompressed arrays.

    Raises
    ------
    OutputError
        The package meshoptimizer is not installed.
    """
    codec.require_meshoptimizer()
    uses = _uses(document)
    blob, unpacked = bytearray(), 0
    for index, view in enumerate(document.gltf["bufferViews"]):
        content = np.frombuffer(document.view(index), np.uint8)
        encoded = min(_encodings(view, content, uses.get(index, [])), key=lambda each: len(each.content), default=None)
        blob += bytes(-len(blob) % 4)
        if encoded is None or len(encoded.content) + MIN_SAVED_BYTES > len(content):
            view["byteOffset"] = len(blob)
            blob += content.tobytes()
            continue
        about: dict[str, Any] = {
            "buffer": 0,
            "byteOffset": len(blob),
            "byteLength": len(encoded.content),
            "byteStride": encoded.stride,
            "mode": encoded.mode,
            "count": len(content) // encoded.stride,
        }
        if encoded.filter is not None:
            about["filter"] = encoded.filter
        view["buffer"], view["byteOffset"] = 1, unpacked
        view["extensions"] = {**view.get("extensions", {}), MESHOPT: about}
        blob += encoded.content
        unpacked += len(content) + -len(content) % 4
    if unpacked:
        document.blob, document.unpacked_size = blob, unpacked
        for names in (document.gltf["extensionsUsed"], document.gltf["extensionsRequired"]):
            names.append(MESHOPT)


def _uses(document: Document) -> dict[int, list[Use]]:
    """Return the arrays in each buffer view."""
    gltf = document.gltf
    triangles, indices = set[int](), set[int]()
    for mesh in gltf["meshes"]:
        for primitive in mesh["primitives"]:
            if "indices" in primitive:
                (triangles if primitive.get("mode", 4) == 4 else indices).add(primitive["indices"])
    samplers = [sampler for animation in gltf["animations"] for sampler in animation["samplers"]]
    keys = {sampler["output"]: gltf["accessors"][sampler["input"]]["count"] for sampler in samplers}
    uses: dict[int, list[Use]] = {}
    for index, accessor in enumerate(gltf["accessors"]):
        kind, width = np.dtype(COMPONENTS[accessor["componentType"]]), TYPE_WIDTHS[accessor["type"]]
        role: Any = "indices" if index in indices else "triangles" if index in triangles else "attribute"
        if "bufferView" in accessor:
            use = Use(kind, width, role, keys.get(index, 0), accessor.get("normalized", False))
            uses.setdefault(accessor["bufferView"], []).append(use)
        if "sparse" in accessor:
            rows = np.dtype(COMPONENTS[accessor["sparse"]["indices"]["componentType"]])
            uses.setdefault(accessor["sparse"]["indices"]["bufferView"], []).append(Use(rows, 1, "indices"))
            uses.setdefault(accessor["sparse"]["values"]["bufferView"], []).append(Use(kind, width))
    return uses


def _encodings(view: BufferView, content: codec.Bytes, uses: list[Use]) -> Iterator[codec.Encoded]:
    """Yield the ways to compress a buffer view."""
    if not uses:
        return
    kind = uses[0].kind
    if any(use.role != "attribute" for use in uses):
        if len(uses) == 1 and kind.itemsize in (2, 4) and not len(content) % kind.itemsize and "byteStride" not in view:
            yield codec.indices(content, kind.itemsize)
            if uses[0].role == "triangles" and not len(content) % (3 * kind.itemsize):
                yield codec.triangles(content, kind.itemsize)
        return
    for stride in _strides(view, len(content), uses):
        yield codec.rows(content, stride)
        if all(use.kind == np.float32 for use in uses) and (packed := codec.exponential(content, stride)):
            yield packed
        if len(uses) == 1 and uses[0].normalized and kind == np.int16 and stride == 8:
            packed = codec.octahedral(content)
            if packed:
                yield packed


def _strides(view: BufferView, length: int, uses: list[Use]) -> list[int]:
    """Return the sizes of rows in bytes with which a buffer view can be compressed.

    Properties over time are best compressed by keyframes, all of which have the same values.
    """
    if "byteStride" in view:
        sizes = {view["byteStride"]}
    else:
        sizes = {use.size for use in uses} | {length // use.keys for use in uses if use.keys}
        sizes |= {2 * size for size in sizes} | {4}
    return sorted(size for size in sizes if 0 < size <= MAX_STRIDE and not size % 4 and not length % size)
