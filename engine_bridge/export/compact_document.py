"""Documents with quantised arrays (KHR_mesh_quantization).

Morph targets and rest positions are those of `quantized_targets`. Normals and tangents become bytes. Texture
coordinates and colours of floats within [0, 1] become integers of 16 bits. Everything else stays as it is.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.character import Character
from engine_bridge.character.document import ARRAY_BUFFER, Document, index_type
from engine_bridge.character.meshopt_codec import octahedral_rounded
from engine_bridge.character.schema import Primitive
from engine_bridge.export.animation import animate
from engine_bridge.export.quantized_targets import MAX_WEIGHT, QuantizedTargets, stored_weights

QUANTIZATION = "KHR_mesh_quantization"

MAX_BYTE, MAX_INT16, MAX_UINT16 = 127, 32767, 65535

ACCESSOR_BYTES = 150
"""Approximate number of bytes by which the description of a sparse accessor is larger than that of a dense one."""

FLOAT = 5126
"""Code of float32."""


def animate_compact(character: Character, targets: QuantizedTargets, *, for_meshopt: bool) -> Document:
    """Add quantised morph targets and their animation to a copy of a character's document.

    Parameters
    ----------
    character : Character
    targets : QuantizedTargets
    for_meshopt : bool
        Whether the arrays will be compressed, so that they suit its filters.

    Returns
    -------
    Document
    """
    document = animate(character, targets.keyframes, _Writer(targets, for_meshopt))
    rewriting = Rewriting(document)
    numbers = {(part.node, part.primitive): number for number, part in enumerate(character.parts)}
    for node, grid in targets.grids.items():
        scale = grid.step if grid.is_scale else 1.0
        for index, primitive in enumerate(document.gltf["meshes"][document.gltf["nodes"][node]["mesh"]]["primitives"]):
            part = numbers.get((node, index))
            own = len(primitive.get("targets", [])) - targets.keyframes.weights.shape[1]
            if part is not None:
                rest = targets.parts[part].rest(grid) * np.float32(grid.step / scale)
                rewriting.plan(primitive["attributes"], "POSITION", (part, grid), partial(_given, Array(rest)))
                quantize_attributes(rewriting, primitive, for_meshopt=for_meshopt)
            elif "POSITION" in primitive["attributes"]:
                rewriting.plan(primitive["attributes"], "POSITION", scale, partial(_divided, scale))
            for target in primitive.get("targets", [])[:own]:
                if "POSITION" in target:
                    rewriting.plan(target, "POSITION", scale, partial(_divided, scale))
        if grid.is_scale:
            _scale_node(document, node, scale)
    rewriting.run()
    return document


def compact_skin(document: Document, character: Character, *, for_meshopt: bool) -> float:
    """Quantise the meshes of a document that `rigged_document` has made.

    Players use the matrices of joints to scale the integers, because a skinned mesh ignores the scale of its node.

    Parameters
    ----------
    document : Document
    character : Character
        The character of the document.
    for_meshopt : bool
        Whether the arrays will be compressed, so that they suit its filters.

    Returns
    -------
    float
        Upper bound of the distance of a vertex from its position before quantisation, world units.
    """
    gltf = document.gltf
    nodes = list(dict.fromkeys(part.node for part in character.parts))
    skin = gltf["skins"][gltf["nodes"][nodes[0]]["skin"]]
    primitives = [
        primitive
        for node in nodes
        for primitive in gltf["meshes"][gltf["nodes"][node]["mesh"]]["primitives"]
        if "POSITION" in primitive["attributes"]
    ]
    rest = [document.array(primitive["attributes"]["POSITION"]) for primitive in primitives]
    low = np.min([each.min(axis=0) for each in rest], axis=0).astype(np.float64)
    high = np.max([each.max(axis=0) for each in rest], axis=0).astype(np.float64)
    middle, scale = (low + high) / 2, float((high - low).max()) / (2 * MAX_INT16)
    rewriting = Rewriting(document)
    for primitive in primitives:
        attributes = primitive["attributes"]
        rewriting.plan(attributes, "POSITION", None, partial(_on_grid, middle, scale))
        shares = _shares(document.array(attributes["WEIGHTS_0"]))
        rewriting.plan(attributes, "WEIGHTS_0", None, partial(_given, shares))
        rewriting.plan(attributes, "JOINTS_0", None, partial(_where, shares.values > 0))
        for target in primitive.get("targets", []):
            if "POSITION" in target:
                rewriting.plan(target, "POSITION", scale, partial(_divided, scale))
        quantize_attributes(rewriting, primitive, for_meshopt=for_meshopt)
    rewriting.run()
    back = document.array(skin["inverseBindMatrices"]).reshape(-1, 4, 4).astype(np.float64)
    to_rest = np.diag([scale, scale, scale, 1.0])
    to_rest[3, :3] = middle  # matrices are stored by columns
    document.replace(skin["inverseBindMatrices"], (to_rest @ back).astype(np.float32).reshape(-1, 16))
    document.repack()
    # half a step in each direction; each of four shares by half a step, between bones at most the size apart
    return float(np.sqrt(3) / 2 * scale + 4 / (2 * MAX_WEIGHT) * np.linalg.norm(high - low))


@dataclass(frozen=True)
class Array:
    """An array to store: values, and whether integers are fractions of the largest one."""

    values: NDArray[Any]
    normalized: bool = False


class Rewriting:
    """Replacement of vertex attributes by other arrays, which does not leave unused ones behind.

    An array is replaced in place if all references to it have the same change. Otherwise, each change adds an array.
    """

    def __init__(self, document: Document) -> None:
        self._document = document
        self._planned: dict[int, dict[Any, tuple[list[tuple[Any, str]], Callable[[NDArray[Any]], Array | None]]]] = {}

    def plan(
        self, attributes: dict[str, int], name: str, key: Any, change: Callable[[NDArray[Any]], Array | None]
    ) -> None:
        """Plan to change an attribute; equal keys mean equal changes. `change` returns None to keep an array."""
        planned = self._planned.setdefault(attributes[name], {})
        planned.setdefault((name, key), ([], change))[0].append((attributes, name))

    def is_float(self, accessor: int) -> bool:
        """Return whether an array has floats."""
        return self._document.gltf["accessors"][accessor]["componentType"] == FLOAT

    def run(self) -> None:
        """Replace all planned arrays, and drop their old bytes."""
        document, is_used = self._document, _references(self._document)
        for accessor, planned in self._planned.items():
            alone = len(planned) == 1 and len(next(iter(planned.values()))[0]) == is_used[accessor]
            values = document.array(accessor)
            for (name, _), (places, change) in planned.items():
                new = change(values)
                if new is None:
                    continue
                bounds = name == "POSITION"
                if alone:
                    document.replace(accessor, new.values, ARRAY_BUFFER, bounds=bounds, normalized=new.normalized)
                    continue
                added = document.add(new.values, ARRAY_BUFFER, bounds=bounds, normalized=new.normalized)
                for attributes, key in places:
                    attributes[key] = added
        document.repack()
        require_quantization(document)


def _references(document: Document) -> dict[int, int]:
    """Return how many attributes of vertices and morph targets refer to each accessor."""
    counts: dict[int, int] = {}
    for mesh in document.gltf["meshes"]:
        for primitive in mesh["primitives"]:
            for attributes in (primitive["attributes"], *primitive.get("targets", [])):
                for accessor in attributes.values():
                    counts[accessor] = counts.get(accessor, 0) + 1
    return counts


def require_quantization(document: Document) -> None:
    """List the extension that allows integers in vertex attributes in a document."""
    for names in (document.gltf["extensionsUsed"], document.gltf["extensionsRequired"]):
        if QUANTIZATION not in names:
            names.append(QUANTIZATION)


def quantize_attributes(rewriting: Rewriting, primitive: Primitive, *, for_meshopt: bool) -> None:
    """Plan to quantise a primitive's normals, tangents, texture coordinates and colours."""
    attributes = primitive["attributes"]
    for name, accessor in attributes.items():
        if not rewriting.is_float(accessor):
            continue
        if name in ("NORMAL", "TANGENT"):
            rewriting.plan(attributes, name, None, partial(_directions, for_meshopt=for_meshopt))
        elif name.startswith(("TEXCOORD_", "COLOR_")):
            rewriting.plan(attributes, name, None, _fractions)


def _given(new: Array, _old: NDArray[Any]) -> Array:
    return new


def _where(used: NDArray[np.bool_], old: NDArray[Any]) -> Array:
    """Return the joint numbers of vertices, 0 for those without a weight, as glTF requires."""
    return Array(np.where(used, old, 0).astype(old.dtype))


def _divided(scale: float, old: NDArray[Any]) -> Array | None:
    return None if scale == 1 else Array(old.astype(np.float32) / np.float32(scale))


def _on_grid(middle: NDArray[np.float64], scale: float, old: NDArray[Any]) -> Array:
    return Array(np.round((old - middle) / scale).astype(np.int16))


def _shares(old: NDArray[Any]) -> Array:
    """Return skin weights as normalised integers of 16 bits, whose sum is 1; the largest is adjusted for this."""
    shares = np.round(MAX_WEIGHT * old).astype(np.int64)
    rows = np.arange(len(shares))
    shares[rows, shares.argmax(axis=1)] += MAX_WEIGHT - shares.sum(axis=1)
    return Array(shares.astype(np.uint16), normalized=True)


def _directions(old: NDArray[Any], *, for_meshopt: bool) -> Array:
    """Return unit vectors as normalised integers: bytes, or the 16 bits of the octahedral filter."""
    if for_meshopt:
        return Array(octahedral_rounded(old), normalized=True)
    return Array(np.round(MAX_BYTE * np.clip(old, -1, 1)).astype(np.int8), normalized=True)


def _fractions(old: NDArray[Any]) -> Array | None:
    """Return values within [0, 1] as normalised integers, None for others."""
    if not 0 <= old.min() <= old.max() <= 1:
        return None
    return Array(np.round(MAX_UINT16 * old).astype(np.uint16), normalized=True)


@dataclass(frozen=True)
class _Writer:
    """Writer of quantised targets and weights."""

    targets: QuantizedTargets
    for_meshopt: bool

    def add_targets(self, document: Document, number: int, primitive: Primitive) -> None:
        """Append a part's targets to its primitive, each in the smallest type that fits."""
        part = self.targets.parts[number]
        grid = self.targets.grids[part.node]
        integers = part.integers(grid)
        arrays = {
            "POSITION": [Array(_smallest(each) if grid.is_scale else each * np.float32(grid.step)) for each in integers]
        }
        if part.normals is not None:
            arrays["NORMAL"] = [_quantized_normals(each) for each in part.normals]
        targets: list[dict[str, int]] = [{} for _ in integers]
        for name, values in arrays.items():
            for target, accessor in zip(targets, self._add(document, values, bounds=name == "POSITION"), strict=True):
                target[name] = accessor
        primitive.setdefault("targets", []).extend(targets)

    def _add(self, document: Document, arrays: list[Array], *, bounds: bool) -> list[int]:
        """Add an attribute of all targets, and return its accessors; dense arrays of a type share a buffer view."""
        made: dict[int, int] = {}
        groups: dict[tuple[Any, bool], list[int]] = {}
        for k, array in enumerate(arrays):
            if not self.for_meshopt and _is_smaller_sparse(array.values):
                made[k] = document.add_sparse(array.values, bounds=bounds, normalized=array.normalized)
            else:
                groups.setdefault((array.values.dtype, array.normalized), []).append(k)
        for (_, normalized), members in groups.items():
            rows = [arrays[k].values for k in members]
            added = document.add_all(rows, ARRAY_BUFFER, bounds=bounds, normalized=normalized)
            made.update(zip(members, added, strict=True))
        return [made[k] for k in range(len(arrays))]

    def add_weights(self, document: Document, node: int, weights: NDArray[np.float32]) -> int:  # noqa: ARG002
        """Add weights in 16 bits, or as floats if integers do not hold the weights of the mesh's own targets."""
        own = weights.shape[1] - self.targets.keyframes.weights.shape[1]
        stored = np.hstack([weights[:, :own], stored_weights(weights[:, own:])])
        integers = np.round(stored * np.float32(MAX_WEIGHT))
        if np.array_equal(integers / np.float32(MAX_WEIGHT), stored) and 0 <= stored.min() <= stored.max() <= 1:
            return document.add(integers.astype(np.uint16).ravel(), normalized=True)
        return document.add(stored.ravel())


def _smallest(integers: NDArray[np.float32]) -> NDArray[Any]:
    """Return integers in the smallest type that holds them; float32 if none does."""
    largest = float(np.abs(integers).max(initial=0))
    kinds = (kind for kind in (np.int8, np.int16) if largest <= np.iinfo(kind).max)
    return integers.astype(next(kinds, np.float32))


def _quantized_normals(displacements: NDArray[np.float32]) -> Array:
    """Return displacements of normals as normalised bytes, or beyond their range as rounded floats."""
    if np.abs(displacements).max(initial=0) <= 1:
        return Array(np.round(displacements * np.float32(MAX_BYTE)).astype(np.int8), normalized=True)
    steps = np.round(displacements * np.float32(MAX_BYTE + 1)) + np.float32(0)
    return Array(steps / np.float32(MAX_BYTE + 1))


def _is_smaller_sparse(values: NDArray[Any]) -> bool:
    """Return whether an array is smaller without its rows of zeros."""
    size = values.itemsize * values.shape[1]
    row = np.dtype(index_type(len(values))).itemsize + size
    return max(1, int(values.any(axis=1).sum())) * row + ACCESSOR_BYTES < len(values) * (size + -size % 4)


def _scale_node(document: Document, index: int, scale: float) -> None:
    """Scale what a node shows."""
    node = document.gltf["nodes"][index]
    if "matrix" in node:
        node["matrix"] = [value * scale if at < 12 else value for at, value in enumerate(node["matrix"])]
    else:
        node["scale"] = [value * scale for value in node.get("scale", [1.0, 1.0, 1.0])]
