"""A streamed character: the constant part of its frames, and the scene message, with which a client draws it.

A scene is a description in JSON, followed by arrays. Isoline coordinates (array ``ladder``) and their slopes represent
the reduced model: with them a client turns controls into positions and normals (docs/protocol.md).
"""

import hashlib
import struct
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from math import prod
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from capture.bone_names import FINGER_BONES
from capture.skeleton import JOINTS
from engine_bridge.character import own_targets
from engine_bridge.character.character import CharacterMesh
from engine_bridge.character.materials import drawn_normals, preview_colors
from engine_bridge.character.schema import Primitive
from engine_bridge.export.finger_animation import FingerBends, with_fingers
from engine_bridge.performance.prepared_character import PreparedCharacter
from engine_bridge.puppet.humanoid_bones import HUMANOID_BONES
from engine_bridge.puppet.puppet import Puppet
from engine_bridge.rigging.humanoid import humanoid_of, is_humanoid
from engine_bridge.rigging.skeleton import Skeleton, from_t_pose
from engine_bridge.service.protocol.header import WireError, read_json, write_json
from engine_bridge.service.protocol.quantisation import quantised
from solver.model.binding import ShadedBinding
from solver.model.reduced_model import Controls
from solver.motion import quaternions as quat
from solver.motion.deformer import to_file_units
from solver.motion.handle_motion import HandleMotions
from solver.surface import tangents

if TYPE_CHECKING:
    from engine_bridge.export.live_basis import LiveBasis

Array = NDArray[Any]
"""An array of one of the `TYPES`."""

TYPES: dict[str, np.dtype[Any]] = {"f32": np.dtype("<f4"), "u32": np.dtype("<u4")}
"""Types of array elements by their names in the description."""

_LENGTH = struct.Struct("<I")


@dataclass(frozen=True, eq=False, repr=False)
class StreamedCharacter:
    """The part of a character that does not change from frame to frame.

    Attributes
    ----------
    name : str
        Name in topics: ``[A-Za-z0-9_-]{1,32}``.
    prepared : PreparedCharacter
    revision : int
        32 bits of a hash of the scene and the morph targets. A new mapping does not change it, see `remapped`.
    basis : LiveBasis or None
        Morph targets that poses are projected on.
    """

    name: str
    prepared: PreparedCharacter
    revision: int
    basis: "LiveBasis | None" = None

    @classmethod
    def of(cls, name: str, prepared: PreparedCharacter, basis: "LiveBasis | None" = None) -> Self:
        """Return a character with the revision that follows from its scene and its morph targets."""
        digest = hashlib.sha256(cls(name, prepared, 0, basis).scene)
        if basis is not None:
            digest.update(basis.targets.tobytes())
        return cls(name, prepared, int.from_bytes(digest.digest()[:4], "little"), basis)

    @cached_property
    def rest(self) -> NDArray[np.float64]:
        """(n, 3): rest positions, mesh file's coordinates."""
        return self.prepared.character.vertices

    @cached_property
    def triangles(self) -> NDArray[np.int64]:
        """(t, 3)."""
        return self.prepared.character.triangles

    @cached_property
    def normals(self) -> NDArray[np.float64]:
        """(n, 3): unit rest normals, rounded as clients receive them, so that clients compute the same tangents."""
        return drawn_normals(self.prepared.character).astype(np.float32).astype(np.float64)

    @cached_property
    def binding(self) -> ShadedBinding:
        """The binding that turns controls into positions and normals."""
        return ShadedBinding(self.prepared.model, self.rest, self.prepared.mesh.of_render, self.normals, self.triangles)

    def vertices_and_normals(self, controls: Controls, weights: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the positions, mesh file's coordinates, and the unit normals of a pose.

        Parameters
        ----------
        controls : (m, 3, 4) float32
        weights : (k,) float32
            Of the mesh's own morph targets that channels move, in the order of `Puppet.targets`.

        Returns
        -------
        (2, n, 3) float32
        """
        binding = self.binding
        both = np.empty((2, *binding.rest.shape), dtype=np.float32)
        if weights.any():
            binding = copy(binding)
            binding.rest = binding.rest + np.tensordot(weights, self.displacements, 1)
        binding.vertices_and_normals(controls, both[0], both[1])
        return both

    @cached_property
    def humanoid(self) -> Skeleton | None:
        """Its limbs as bones of a humanoid; None if it is not a humanoid."""
        return humanoid_of(self.prepared.puppet, self.rest) if is_humanoid(self.prepared.puppet) else None

    @property
    def skeleton(self) -> Skeleton | None:
        """Its named joints, with axes along the bones, and those of its file's fingers; None without limbs."""
        return None if self._with_fingers is None else self._with_fingers[0]

    @property
    def finger_bends(self) -> FingerBends | None:
        """How channels bend the joints of its fingers; None without limbs."""
        return None if self._with_fingers is None else self._with_fingers[1]

    @cached_property
    def _with_fingers(self) -> tuple[Skeleton, FingerBends] | None:
        made = Skeleton.along_bones(self.prepared.puppet) if self.prepared.puppet.limb else None
        return None if made is None else with_fingers(made, self.prepared.character.document)

    @cached_property
    def handle_motions(self) -> HandleMotions | None:
        """Rigid motions of its handles; None if it has none."""
        handles = self.prepared.puppet.handle_positions
        return HandleMotions(self.prepared.model, self.prepared.mesh, handles) if len(handles) else None

    @cached_property
    def displacements(self) -> NDArray[np.float32]:
        """(k, n, 3): displacements by the mesh's own morph targets that channels move."""
        moved = [own_targets.displacements(self.prepared.character, name) for name in self.prepared.puppet.targets]
        return np.array(moved, np.float32).reshape(-1, len(self.rest), 3)

    @cached_property
    def scene(self) -> bytes:
        """The payload of its scene message."""
        return encode_scene(self)

    @property
    def digest(self) -> str:
        """The digest of its scene (docs/protocol.md, "Keep scenes"), in hexadecimal digits."""
        description = self.scene[: arrays_start(self.scene)]
        return hashlib.sha256(description + self._arrays_digest).hexdigest()

    @cached_property
    def _arrays_digest(self) -> bytes:
        return hashlib.sha256(memoryview(self.scene)[arrays_start(self.scene) :]).digest()

    def remapped(self, puppet: Puppet) -> "StreamedCharacter":
        """Return the same character with another mapping, and keep all that was computed from its mesh and model.

        The description of its scene changes; its arrays and its revision stay.
        """
        other = copy(self)
        vars(other)["prepared"] = replace(self.prepared, puppet=puppet)
        for name in ("_with_fingers", "humanoid", "handle_motions", "displacements"):
            vars(other).pop(name, None)
        vars(other)["scene"] = with_description(self.scene, other)
        return other

    def prepare(self) -> None:
        """Compute what the first frame and the first client would wait for, compiled code included."""
        controls = to_file_units(self.prepared.model.rest_controls, self.prepared.model)
        quantised(*self.binding.vertices_and_normals(controls))
        self.digest, self.humanoid, self.handle_motions, self.displacements  # noqa: B018
        if self.skeleton is not None:
            self.skeleton.rest  # noqa: B018


def encode_scene(character: StreamedCharacter) -> bytes:
    """Return a character's scene payload."""
    arrays = scene_arrays(character)
    directory: dict[str, Any] = {}
    offset = 0
    for name, array in arrays.items():
        kind = next(kind for kind, dtype in TYPES.items() if dtype == array.dtype)
        directory[name] = {"type": kind, "shape": list(array.shape), "offset": offset}
        offset += array.nbytes
    return _described(character, directory, *(array.data for array in arrays.values()))


def with_description(scene: bytes, character: StreamedCharacter) -> bytes:
    """Return a scene payload with the same arrays and a new description."""
    view = memoryview(scene)
    start = arrays_start(scene)
    return _described(character, read_json(view[_LENGTH.size : start])["arrays"], view[start:])


def arrays_start(scene: bytes) -> int:
    """Return the offset of the arrays in a scene payload, in bytes."""
    length: int = _LENGTH.unpack_from(scene)[0]
    return _LENGTH.size + length


def _described(character: StreamedCharacter, directory: dict[str, Any], *arrays: memoryview) -> bytes:
    text = write_json({**describe(character), "arrays": directory})
    text += b" " * (-len(text) % 8)
    return b"".join((_LENGTH.pack(len(text)), text, *arrays))


def describe(character: StreamedCharacter) -> dict[str, Any]:
    """Return the description of a character, in JSON's types."""
    prepared, puppet = character.prepared, character.prepared.puppet
    return {
        "character": character.name,
        "revision": character.revision,
        "vertices": len(character.rest),
        "triangles": len(character.triangles),
        "fields": len(prepared.model.weights),
        "isolines": prepared.model.isolines,
        "weights": prepared.model.weights.tolist(),
        "diagonal": float(prepared.model.diagonal),
        "bounds": [character.rest.min(axis=0).tolist(), character.rest.max(axis=0).tolist()],
        "up": puppet.character.up,
        "front": puppet.character.front,
        "metres_a_unit": puppet.character.scale,
        "handles": [
            {"name": handle.name, "position": list(handle.position), "joints": list(handle.driven_by)}
            for handle in puppet.handle
        ],
        "limbs": [{"name": limb.name, "points": [list(point) for point in limb.points]} for limb in puppet.limb],
        "bones": None if character.skeleton is None else bones(character.skeleton, puppet),
        "joints": list(JOINTS),
        "morphs": None if character.basis is None else list(character.basis.names),
        **({"turn": puppet.character.turn} if puppet.character.turn else {}),
        **({"targets": list(puppet.targets)} if puppet.targets else {}),
        "parts": parts(prepared.character),
    }


def bones(skeleton: Skeleton, puppet: Puppet) -> list[dict[str, Any]]:
    """Return the name, parent and rest pose of each joint, and its rotation from the T-pose to rest.

    All are in the mesh file's axes. Joints that a VRM humanoid does not have have no T-pose.
    """
    basis = puppet.character.basis
    turns = quat.of_matrices(basis.T @ from_t_pose(puppet, skeleton.joints) @ basis)
    rows = zip(skeleton.joints, *skeleton.rest, skeleton.travelling.tolist(), turns.tolist(), strict=True)
    return [
        {
            "name": joint.name,
            "parent": joint.parent,
            "position": position.tolist(),
            "rotation": rotation.tolist(),
            "travels": travels,
            "from_t_pose": turn if joint.name in (*HUMANOID_BONES, *FINGER_BONES.values()) else None,
        }
        for joint, position, rotation, travels, turn in rows
    ]


def scene_arrays(character: StreamedCharacter) -> dict[str, Array]:
    """Return a character's arrays by name, C-contiguous."""
    prepared, normals = character.prepared, character.normals
    isoline_coordinates = prepared.model.isoline_coordinates[prepared.mesh.of_render]
    slopes = tangents.slopes(
        character.rest,
        character.triangles,
        isoline_coordinates,
        prepared.mesh.of_render,
        normals,
        tangents.tangents(normals),
    )
    floats = {
        "positions": character.rest,
        "normals": normals,
        "ladder": isoline_coordinates,
        "slopes": slopes,
        "uv": uv(prepared.character),
        "colors": preview_colors(prepared.character),
        "displacements": character.displacements if prepared.puppet.targets else None,
    }
    return {
        "triangles": np.ascontiguousarray(character.triangles, dtype=TYPES["u32"]),
        **{
            name: np.ascontiguousarray(values, dtype=TYPES["f32"])
            for name, values in floats.items()
            if values is not None
        },
    }


def uv(character: CharacterMesh) -> NDArray[np.float32] | None:
    """Return the first texture coordinates (n, 2) of all parts, zeros for parts without; None if no part has any."""
    found = [
        character.document.attribute(character.primitive(part), "TEXCOORD_0", len(part.vertices), 2)
        for part in character.parts
    ]
    if all(own is None for own in found):
        return None
    none = [np.zeros((len(part.vertices), 2)) for part in character.parts]
    return np.concatenate([empty if own is None else own for own, empty in zip(found, none, strict=True)]).astype("<f4")


def parts(character: CharacterMesh) -> list[dict[str, Any]]:
    """Return the vertices, triangles, name and material of each part."""
    gltf = character.document.gltf
    described = []
    first_triangle = 0
    for index, (part, place) in enumerate(zip(character.parts, character.vertex_slices, strict=True)):
        node = gltf["nodes"][part.node]
        described.append(
            {
                "name": node.get("name") or gltf["meshes"][node["mesh"]].get("name") or f"part {index}",
                "vertices": [place.start, len(part.vertices)],
                "triangles": [first_triangle, len(part.triangles)],
                "material": _material(character, character.primitive(part)),
            }
        )
        first_triangle += len(part.triangles)
    return described


def _material(character: CharacterMesh, primitive: Primitive) -> dict[str, Any]:
    """Return a material's numbers, with glTF's defaults for what the file omits."""
    material = character.document.gltf["materials"][primitive["material"]] if "material" in primitive else {}
    surface = material.get("pbrMetallicRoughness", {})
    return {
        "name": material.get("name", ""),
        "base_color": surface.get("baseColorFactor", [1.0] * 4),
        "metallic": surface.get("metallicFactor", 1.0),
        "roughness": surface.get("roughnessFactor", 1.0),
        "emissive": material.get("emissiveFactor", [0.0] * 3),
        "alpha_mode": material.get("alphaMode", "OPAQUE"),
        "double_sided": material.get("doubleSided", False),
    }


@dataclass(frozen=True, eq=False)
class DecodedScene:
    """A decoded scene.

    Attributes
    ----------
    facts : dict
        The description.
    arrays : dict of array
        float32 or uint32 by name; the shapes of those that every scene has are consistent.
    """

    facts: dict[str, Any]
    arrays: dict[str, Array]

    @classmethod
    def decode(cls, payload: bytes | memoryview) -> "DecodedScene":
        """Read a scene payload.

        Raises
        ------
        WireError
            A length, offset or number that is inconsistent with the payload.
        """
        view = memoryview(payload)
        if len(view) < 4:
            raise WireError("a scene without a description")
        start = 4 + _LENGTH.unpack(view[:4])[0]
        if start > len(view):
            raise WireError(f"a description of {start - 4} bytes in a scene of {len(view)}")
        facts = read_json(view[4:start])
        if not isinstance(facts, dict) or not isinstance(facts.get("arrays"), dict):
            raise WireError("a scene without a list of its arrays")
        arrays = {name: _array(view[start:], entry, name) for name, entry in facts["arrays"].items()}
        scene = cls(facts, arrays)
        scene._check()
        return scene

    def _check(self) -> None:
        """Refuse numbers that would make a client read beyond an array."""
        facts = self.facts
        n, t, fields, isolines = (_count(facts, name) for name in ("vertices", "triangles", "fields", "isolines"))
        weights = facts.get("weights")
        if not isinstance(weights, list) or len(weights) != fields or not all(type(w) is float for w in weights):
            raise WireError(f"a scene whose {fields} fields have no weights")
        shapes = {
            "positions": (n, 3),
            "normals": (n, 3),
            "triangles": (t, 3),
            "ladder": (n, fields),
            "slopes": (n, fields, 2),
        }
        if "displacements" in self.arrays:
            targets = facts.get("targets")
            shapes["displacements"] = (len(targets) if isinstance(targets, list) else 0, n, 3)
        for name, shape in shapes.items():
            array = self.arrays.get(name)
            if array is None or array.shape != shape or (array.dtype.kind == "u") != (name == "triangles"):
                raise WireError(f"a scene whose {name} are missing or inconsistent with its description")
        if self.arrays["triangles"].max() >= n:
            raise WireError("a triangle with a vertex that does not exist")
        if not ((self.arrays["ladder"] >= 0) & (self.arrays["ladder"] <= isolines - 1)).all():
            raise WireError("an isoline coordinate beyond the isolines")


def _count(facts: dict[str, Any], name: str) -> int:
    count = facts.get(name)
    if type(count) is not int or count < 1:
        raise WireError(f"a scene without {name}")
    return count


def _array(data: memoryview, entry: Any, name: str) -> Array:
    """Return the array of an entry of the description."""
    if not isinstance(entry, dict) or not isinstance(entry.get("shape"), list):
        raise WireError(f"an array {name!r:.40} without a shape")
    dtype, shape, offset = TYPES.get(str(entry.get("type"))), entry["shape"], entry.get("offset", -1)
    if dtype is None:
        raise WireError(f"an array {name!r:.40} of an unknown type")
    counts = [type(number) is int and 0 < number <= len(data) for number in shape]
    if not 0 < len(counts) <= 3 or not all(counts) or type(offset) is not int or offset < 0:
        raise WireError(f"an array {name!r:.40} of a shape that the scene cannot hold")
    count = prod(shape)
    if offset % 4 or offset + count * dtype.itemsize > len(data):
        raise WireError(f"an array {name!r:.40} that goes beyond the scene")
    return np.frombuffer(data, dtype, count, offset).reshape(shape)
