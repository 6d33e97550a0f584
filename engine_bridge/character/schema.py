"""glTF 2.0's description, as far as it is read here, as typed plain JSON.

A description stays the dictionary that the file holds: what is not named here passes through untouched. `checked` makes
sure that what is named has the right kind and that every index leads somewhere.
"""

import json
from collections.abc import Iterator
from typing import Annotated, Any, Literal, NotRequired, TypeVar

from pydantic import ConfigDict, FailFast, Field, TypeAdapter, ValidationError, with_config
from typing_extensions import TypedDict, is_typeddict  # pydantic asks for these below Python 3.12

T = TypeVar("T")

_OPEN = ConfigDict(extra="allow", strict=True, hide_input_in_errors=True)

Index = Annotated[int, Field(ge=0)]
Number = Annotated[float, Field(allow_inf_nan=False)]
Numbers2 = Annotated[list[Number], Field(min_length=2, max_length=2)]
Numbers3 = Annotated[list[Number], Field(min_length=3, max_length=3)]
Numbers4 = Annotated[list[Number], Field(min_length=4, max_length=4)]
Matrix = Annotated[list[Number], Field(min_length=16, max_length=16)]
Many = Annotated[list[T], FailFast()]  # one fault is enough: a list of them all would outgrow the file
Attributes = dict[str, Index]
Kind = Literal["SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT3", "MAT4"]


@with_config(_OPEN)
class Named(TypedDict):
    """What nearly everything in a file may have."""

    name: NotRequired[str]
    extras: NotRequired[Any]
    extensions: NotRequired[dict[str, Any]]


@with_config(_OPEN)
class AssetTable(TypedDict):
    """Which glTF this is."""

    version: str
    generator: NotRequired[str]


@with_config(_OPEN)
class Scene(Named):
    """The nodes at the top."""

    nodes: NotRequired[Many[Index]]


@with_config(_OPEN)
class Node(Named):
    """A place in the tree, and what is shown there."""

    children: NotRequired[Many[Index]]
    mesh: NotRequired[Index]
    skin: NotRequired[Index]
    matrix: NotRequired[Matrix]
    translation: NotRequired[Numbers3]
    rotation: NotRequired[Numbers4]
    scale: NotRequired[Numbers3]
    weights: NotRequired[Many[Number]]


@with_config(_OPEN)
class Primitive(Named):
    """Triangles of one material, or lines or points."""

    attributes: Attributes
    indices: NotRequired[Index]
    material: NotRequired[Index]
    mode: NotRequired[Index]
    targets: NotRequired[Many[Attributes]]


@with_config(_OPEN)
class Mesh(Named):
    """Primitives with one set of morph target weights."""

    primitives: Many[Primitive]
    weights: NotRequired[Many[Number]]


@with_config(_OPEN)
class Skin(Named):
    """The joints that vertices follow."""

    joints: Many[Index]
    inverseBindMatrices: NotRequired[Index]
    skeleton: NotRequired[Index]


@with_config(_OPEN)
class SparseIndices(TypedDict):
    """Which values of a sparse accessor differ."""

    bufferView: Index
    componentType: Index
    byteOffset: NotRequired[Index]


@with_config(_OPEN)
class SparseValues(TypedDict):
    """What they are."""

    bufferView: Index
    byteOffset: NotRequired[Index]


@with_config(_OPEN)
class Sparse(TypedDict):
    """A few values that differ from the rest of an accessor."""

    count: Index
    indices: SparseIndices
    values: SparseValues


@with_config(_OPEN)
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


@with_config(_OPEN)
class BufferView(Named):
    """A run of bytes."""

    buffer: Index
    byteLength: Index
    byteOffset: NotRequired[Index]
    byteStride: NotRequired[Index]
    target: NotRequired[Index]


@with_config(_OPEN)
class Buffer(Named):
    """A file of bytes, or the binary part of a .glb."""

    byteLength: Index
    uri: NotRequired[str]


@with_config(_OPEN)
class Image(Named):
    """A picture."""

    uri: NotRequired[str]
    mimeType: NotRequired[str]
    bufferView: NotRequired[Index]


@with_config(_OPEN)
class Texture(Named):
    """A picture and how it is sampled."""

    source: NotRequired[Index]


@with_config(_OPEN)
class TextureInfo(TypedDict):
    """A texture and the UV set that it is laid out on."""

    index: Index
    texCoord: NotRequired[Index]


@with_config(_OPEN)
class Surface(TypedDict):
    """A material's colour and finish."""

    baseColorFactor: NotRequired[Numbers4]
    baseColorTexture: NotRequired[TextureInfo]
    metallicFactor: NotRequired[Number]
    roughnessFactor: NotRequired[Number]


@with_config(_OPEN)
class Material(Named):
    """How a surface looks."""

    pbrMetallicRoughness: NotRequired[Surface]
    normalTexture: NotRequired[TextureInfo]
    emissiveFactor: NotRequired[Numbers3]
    alphaMode: NotRequired[str]
    doubleSided: NotRequired[bool]


@with_config(_OPEN)
class ChannelTarget(TypedDict):
    """The property that a channel moves."""

    path: str
    node: NotRequired[Index]


@with_config(_OPEN)
class Channel(TypedDict):
    """A property and the sampler that moves it."""

    sampler: Index
    target: ChannelTarget


@with_config(_OPEN)
class Sampler(TypedDict):
    """Key times and values."""

    input: Index
    output: Index
    interpolation: NotRequired[str]


@with_config(_OPEN)
class Animation(Named):
    """Channels that play together."""

    channels: Many[Channel]
    samplers: Many[Sampler]


@with_config(_OPEN)
class Gltf(Named):
    """A whole description; lists that a file leaves out are empty."""

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
"""Where indices stand, a star for any number or name, and the list that they lead into."""

_ADAPTER = TypeAdapter(Gltf)

_NAMES = frozenset(name for table in list(globals().values()) if is_typeddict(table) for name in table.__annotations__)
"""All that is named here; what is not passes through as it is."""


def empty() -> Gltf:
    """Return a description of nothing."""
    return checked({"asset": {"version": "2.0", "generator": "puppetline"}})


def checked(values: dict[str, Any]) -> Gltf:
    """Make sure that a description can be relied on.

    Parameters
    ----------
    values : dict
        Parsed JSON; lists that are left out are put in, empty.

    Returns
    -------
    Gltf
        The same dictionary.

    Raises
    ------
    ValueError
        With the place of the first fault.
    """
    for name in LISTS:
        values.setdefault(name, [])
    try:
        _ADAPTER.validate_python(values)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        raise ValueError(f"{_place(first['loc'])}: {first['msg']}") from error
    gltf: Gltf = values  # type: ignore[assignment]  # checked just now
    for path, name in REFERENCES.items():
        steps, count = path.split("."), len(values[name])
        if max(_found(gltf, steps), default=-1) >= count:
            place, index = next((place, index) for place, index in _placed(gltf, steps) if index >= count)
            raise ValueError(f"{_place(place)}: number {index} of {count} {name}")
    _check_samplers(gltf)
    return gltf


def drop_nulls(values: dict[str, Any]) -> list[str]:
    """Remove the properties that are null, as some programs write those that they have not, but for `extras` and such.

    Parameters
    ----------
    values : dict
        Parsed JSON.

    Returns
    -------
    list of str
        Their names, each once, sorted.
    """
    dropped = set()
    left: list[Any] = [values]
    while left:  # not by recursion, which ends long before the parser's
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
    """Return a deep copy of JSON, however deep it is: `copy.deepcopy` gives up far sooner than the parser does."""
    return json.loads(json.dumps(value))


def compact(gltf: Gltf) -> dict[str, Any]:
    """Return a description without its empty lists, which a file may not hold."""
    return {name: value for name, value in gltf.items() if value or name not in LISTS}


def _place(location: tuple[int | str, ...]) -> str:
    """Write a place as a path into the JSON: ``nodes[3].mesh``."""
    return "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in location).lstrip(".")


def _found(value: Any, steps: list[str]) -> list[Any]:
    """Follow a path into JSON, along all items where it has a star, and return the values that are there."""
    found = [value]
    for step in steps:
        if step == "*":
            found = [item for value in found for item in (value.values() if isinstance(value, dict) else value)]
        else:
            found = [value[step] for value in found if step in value]
    return found


def _placed(value: Any, steps: list[str], *place: int | str) -> Iterator[tuple[tuple[int | str, ...], Any]]:
    """Follow a path like `_found` does, and tell where each value is."""
    if not steps:
        yield place, value
        return
    every = value if isinstance(value, dict) else range(len(value))
    for key in every if steps[0] == "*" else [steps[0]] if steps[0] in value else []:
        yield from _placed(value[key], steps[1:], *place, key)


def _check_samplers(gltf: Gltf) -> None:
    """Make sure that each channel's sampler is there; they count within their animation."""
    for number, animation in enumerate(gltf["animations"]):
        there = len(animation["samplers"])
        for channel in animation["channels"]:
            if channel["sampler"] >= there:
                raise ValueError(f"animations[{number}].channels: number {channel['sampler']} of {there} samplers")
