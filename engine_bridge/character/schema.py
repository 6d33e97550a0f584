"""The part of a glTF 2.0 description that is read, as typed plain JSON.

A description stays the dictionary from the file, including properties that are not named here. `checked` checks the
types of named properties and the range of all indices.
"""

import json
from collections.abc import Iterator
from typing import Annotated, Any, Literal, NotRequired, TypeVar

from pydantic import ConfigDict, FailFast, Field, TypeAdapter, ValidationError, with_config
from typing_extensions import TypedDict, is_typeddict  # pydantic asks for these below Python 3.12

T = TypeVar("T")

Index = Annotated[int, Field(ge=0)]
Number = Annotated[float, Field(allow_inf_nan=False)]
Numbers3 = Annotated[list[Number], Field(min_length=3, max_length=3)]
Numbers4 = Annotated[list[Number], Field(min_length=4, max_length=4)]
Matrix = Annotated[list[Number], Field(min_length=16, max_length=16)]
Many = Annotated[list[T], FailFast()]  # a list of all errors could be larger than the file
Attributes = dict[str, Index]
Kind = Literal["SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT3", "MAT4"]


class Named(TypedDict):
    """Properties that almost all objects may have."""

    name: NotRequired[str]
    extras: NotRequired[Any]
    extensions: NotRequired[dict[str, Any]]


class AssetTable(TypedDict):
    """Version of glTF, and the program that wrote the file."""

    version: str
    generator: NotRequired[str]


class Scene(Named):
    """Top nodes of a scene."""

    nodes: NotRequired[Many[Index]]


class Node(Named):
    """A node of the tree with its transform and mesh."""

    children: NotRequired[Many[Index]]
    mesh: NotRequired[Index]
    skin: NotRequired[Index]
    matrix: NotRequired[Matrix]
    translation: NotRequired[Numbers3]
    rotation: NotRequired[Numbers4]
    scale: NotRequired[Numbers3]
    weights: NotRequired[Many[Number]]


class Primitive(Named):
    """Triangles of one material, or lines or points."""

    attributes: Attributes
    indices: NotRequired[Index]
    material: NotRequired[Index]
    mode: NotRequired[Index]
    targets: NotRequired[Many[Attributes]]


class Mesh(Named):
    """Primitives with common weights of morph targets."""

    primitives: Many[Primitive]
    weights: NotRequired[Many[Number]]


class Skin(Named):
    """The joints that vertices follow."""

    joints: Many[Index]
    inverseBindMatrices: NotRequired[Index]
    skeleton: NotRequired[Index]


class SparseIndices(TypedDict):
    """Indices of the values in a sparse accessor."""

    bufferView: Index
    componentType: Index
    byteOffset: NotRequired[Index]


class SparseValues(TypedDict):
    """Values in a sparse accessor."""

    bufferView: Index
    byteOffset: NotRequired[Index]


class Sparse(TypedDict):
    """Values that replace some of an accessor's."""

    count: Index
    indices: SparseIndices
    values: SparseValues


class Accessor(Named):
    """An array."""

    componentType: Index
    count: Index
    type: Kind
    bufferView: NotRequired[Index]
    byteOffset: NotRequired[Index]
    normalized: NotRequired[bool]
    sparse: NotRequired[Sparse]
    min: NotRequired[Many[Number]]
    max: NotRequired[Many[Number]]


class BufferView(Named):
    """A range of bytes in a buffer."""

    buffer: Index
    byteLength: Index
    byteOffset: NotRequired[Index]
    byteStride: NotRequired[Index]
    target: NotRequired[Index]


class Buffer(Named):
    """A file of bytes, or the binary part of a .glb."""

    byteLength: Index
    uri: NotRequired[str]


class Image(Named):
    """An image."""

    uri: NotRequired[str]
    mimeType: NotRequired[str]
    bufferView: NotRequired[Index]


class Texture(Named):
    """An image and its sampler."""

    source: NotRequired[Index]


class TextureInfo(TypedDict):
    """A texture and its set of texture coordinates."""

    index: Index
    texCoord: NotRequired[Index]


class Surface(TypedDict):
    """Colour and roughness of a material."""

    baseColorFactor: NotRequired[Numbers4]
    baseColorTexture: NotRequired[TextureInfo]
    metallicFactor: NotRequired[Number]
    roughnessFactor: NotRequired[Number]


class Material(Named):
    """Appearance of a surface."""

    pbrMetallicRoughness: NotRequired[Surface]
    normalTexture: NotRequired[TextureInfo]
    emissiveFactor: NotRequired[Numbers3]
    alphaMode: NotRequired[str]
    doubleSided: NotRequired[bool]


class ChannelTarget(TypedDict):
    """The property that a channel animates."""

    path: str
    node: NotRequired[Index]


class Channel(TypedDict):
    """A property and the sampler that animates it."""

    sampler: Index
    target: ChannelTarget


class Sampler(TypedDict):
    """Times and values of keyframes."""

    input: Index
    output: Index
    interpolation: NotRequired[str]


class Animation(Named):
    """Channels that are played together."""

    channels: Many[Channel]
    samplers: Many[Sampler]


class Gltf(Named):
    """A description; lists that the file omits are empty."""

    asset: AssetTable
    scene: NotRequired[Index]
    scenes: Many[Scene]
    nodes: Many[Node]
    meshes: Many[Mesh]
    skins: Many[Skin]
    accessors: Many[Accessor]
    bufferViews: Many[BufferView]
    buffers: Many[Buffer]
    images: Many[Image]
    textures: Many[Texture]
    materials: Many[Material]
    animations: Many[Animation]
    extensionsUsed: Many[str]
    extensionsRequired: Many[str]


LISTS = tuple(name for name in Gltf.__annotations__ if name in Gltf.__required_keys__ and name != "asset")

REFERENCES = {
    "scene": "scenes",
    "scenes.*.nodes.*": "nodes",
    "nodes.*.children.*": "nodes",
    "nodes.*.mesh": "meshes",
    "nodes.*.skin": "skins",
    "meshes.*.primitives.*.attributes.*": "accessors",
    "meshes.*.primitives.*.targets.*.*": "accessors",
    "meshes.*.primitives.*.indices": "accessors",
    "meshes.*.primitives.*.material": "materials",
    "skins.*.joints.*": "nodes",
    "skins.*.skeleton": "nodes",
    "skins.*.inverseBindMatrices": "accessors",
    "accessors.*.bufferView": "bufferViews",
    "accessors.*.sparse.indices.bufferView": "bufferViews",
    "accessors.*.sparse.values.bufferView": "bufferViews",
    "bufferViews.*.buffer": "buffers",
    "images.*.bufferView": "bufferViews",
    "textures.*.source": "images",
    "materials.*.pbrMetallicRoughness.baseColorTexture.index": "textures",
    "animations.*.channels.*.target.node": "nodes",
    "animations.*.samplers.*.input": "accessors",
    "animations.*.samplers.*.output": "accessors",
}
"""Paths of indices, with a star for any number or name, and the lists to which they refer."""

_TABLES = [table for table in list(globals().values()) if is_typeddict(table)]

for _table in _TABLES:
    with_config(ConfigDict(extra="allow", strict=True, hide_input_in_errors=True))(_table)

_ADAPTER = TypeAdapter(Gltf)

_NAMES = frozenset(name for table in _TABLES for name in table.__annotations__)
"""Names of all properties that are checked; others pass through unchanged."""


def empty() -> Gltf:
    """Return an empty description."""
    return checked({"asset": {"version": "2.0", "generator": "puppetline"}})


def checked(values: dict[str, Any]) -> Gltf:
    """Check a description.

    Parameters
    ----------
    values : dict
        Parsed JSON; empty lists are added for missing ones.

    Returns
    -------
    Gltf
        The same dictionary.

    Raises
    ------
    ValueError
        The description has an error; the message has the path of the first one.
    """
    for name in LISTS:
        values.setdefault(name, [])
    try:
        _ADAPTER.validate_python(values)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        raise ValueError(f"{_place(first['loc'])}: {first['msg']}") from error
    gltf: Gltf = values  # type: ignore[assignment]  # checked above
    for path, name in REFERENCES.items():
        steps, count = path.split("."), len(values[name])
        if max(found_at(gltf, steps), default=-1) >= count:
            place, index = next((place, index) for place, index in _placed(gltf, steps) if index >= count)
            raise ValueError(f"{_place(place)}: number {index} of {count} {name}")
    _check_samplers(gltf)
    return gltf


def drop_nulls(values: dict[str, Any]) -> list[str]:
    """Remove properties that are null, which some programs write for missing ones, except in `extras` and extensions.

    Parameters
    ----------
    values : dict
        Parsed JSON.

    Returns
    -------
    list of str
        Their names, sorted, without duplicates.
    """
    dropped = set()
    left: list[Any] = [values]
    while left:  # not by recursion, which supports less nesting than the parser
        value = left.pop()
        if isinstance(value, dict):
            nulls = [name for name, item in value.items() if item is None and name in _NAMES]
            dropped.update(nulls)
            for name in nulls:
                del value[name]
            left += [item for name, item in value.items() if name not in ("extras", "extensions")]
        elif isinstance(value, list):
            left += value
    return sorted(dropped)


def copied(value: T) -> T:
    """Return a deep copy of JSON; `copy.deepcopy` supports less nesting than the parser."""
    return json.loads(json.dumps(value))


def compact(gltf: Gltf) -> dict[str, Any]:
    """Return a description without empty lists, which a file may not contain."""
    return {name: value for name, value in gltf.items() if value or name not in LISTS}


def _place(location: tuple[int | str, ...]) -> str:
    """Return a location in JSON as a path: ``nodes[3].mesh``."""
    return "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in location).lstrip(".")


def found_at(value: Any, steps: list[str]) -> list[Any]:
    """Return the values at a path in JSON, with a star for all items."""
    found = [value]
    for step in steps:
        if step == "*":
            found = [item for value in found for item in (value.values() if isinstance(value, dict) else value)]
        else:
            found = [value[step] for value in found if step in value]
    return found


def _placed(value: Any, steps: list[str], *place: int | str) -> Iterator[tuple[tuple[int | str, ...], Any]]:
    """Yield the locations and values at a path as in `_found`."""
    if not steps:
        yield place, value
        return
    every = value if isinstance(value, dict) else range(len(value))
    for key in every if steps[0] == "*" else [steps[0]] if steps[0] in value else []:
        yield from _placed(value[key], steps[1:], *place, key)


def _check_samplers(gltf: Gltf) -> None:
    """Check that each channel's sampler exists in its animation."""
    for number, animation in enumerate(gltf["animations"]):
        there = len(animation["samplers"])
        for channel in animation["channels"]:
            if channel["sampler"] >= there:
                raise ValueError(f"animations[{number}].channels: number {channel['sampler']} of {there} samplers")
