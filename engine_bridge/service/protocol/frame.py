"""Frames, which stages produce and outputs send: one character at one moment.

Each property is computed when it is first used, and once.
"""

import hashlib
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character import own_targets
from engine_bridge.character.materials import drawn_normals
from engine_bridge.export.finger_animation import FingerBends, with_fingers
from engine_bridge.performance.channels import ChannelMotion, weights_at
from engine_bridge.performance.rig import Rig
from engine_bridge.puppet.puppet import Puppet
from engine_bridge.rigging.humanoid import humanoid_of, is_humanoid
from engine_bridge.rigging.skeleton import Skeleton
from engine_bridge.service.protocol.header import Kind
from engine_bridge.service.protocol.quantisation import quantised
from engine_bridge.service.protocol.scene import arrays_start, encode_scene, with_description
from solver.model.binding import ShadedBinding
from solver.model.reduced_model import Controls
from solver.motion.deformer import to_file_units
from solver.motion.handle_motion import HandleMotions
from solver.motion.limbs import bones_of

if TYPE_CHECKING:
    from engine_bridge.export.live_basis import LiveBasis, Projection


@dataclass(frozen=True, eq=False, repr=False)
class StreamedCharacter:
    """The part of a character that does not change from frame to frame.

    Attributes
    ----------
    name : str
        Name in topics: ``[A-Za-z0-9_-]{1,32}``.
    rig : Rig
    revision : int
        32 bits of a hash of the scene and the morph targets. A new mapping does not change it, see `remapped`.
    basis : LiveBasis or None
        Morph targets that poses are projected on.
    """

    name: str
    rig: Rig
    revision: int
    basis: "LiveBasis | None" = None

    @classmethod
    def of(cls, name: str, rig: Rig, basis: "LiveBasis | None" = None) -> Self:
        """Return a character with the revision that follows from its scene and its morph targets."""
        digest = hashlib.sha256(cls(name, rig, 0, basis).scene)
        if basis is not None:
            digest.update(basis.targets.tobytes())
        return cls(name, rig, int.from_bytes(digest.digest()[:4], "little"), basis)

    @cached_property
    def rest(self) -> NDArray[np.float64]:
        """(n, 3): rest positions, mesh file's coordinates."""
        return self.rig.character.vertices

    @cached_property
    def triangles(self) -> NDArray[np.int64]:
        """(t, 3)."""
        return self.rig.character.triangles

    @cached_property
    def normals(self) -> NDArray[np.float64]:
        """(n, 3): unit rest normals, rounded as clients receive them, so that clients compute the same tangents."""
        return drawn_normals(self.rig.character).astype(np.float32).astype(np.float64)

    @cached_property
    def binding(self) -> ShadedBinding:
        """The binding that turns controls into positions and normals."""
        return ShadedBinding(self.rig.model, self.rest, self.rig.mesh.of_render, self.normals, self.triangles)

    @cached_property
    def humanoid(self) -> Skeleton | None:
        """Its limbs as bones of a humanoid; None if it is not a humanoid."""
        return humanoid_of(self.rig.puppet, self.rest) if is_humanoid(self.rig.puppet) else None

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
        made = Skeleton.along_bones(self.rig.puppet) if self.rig.puppet.limb else None
        return None if made is None else with_fingers(made, self.rig.character.document)

    @cached_property
    def handle_motions(self) -> HandleMotions | None:
        """Rigid motions of its handles; None if it has none."""
        handles = self.rig.puppet.handle_positions
        return HandleMotions(self.rig.model, self.rig.mesh, handles) if len(handles) else None

    @cached_property
    def channel_motion(self) -> ChannelMotion:
        """How channels bend its limbs and move its handles."""
        return ChannelMotion(self.rig.puppet, bones_of(self.rig.puppet.limbs))

    @cached_property
    def displacements(self) -> NDArray[np.float32]:
        """(k, n, 3): displacements by the mesh's own morph targets that channels move."""
        moved = [own_targets.displacements(self.rig.character, name) for name in self.rig.puppet.targets]
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
        vars(other)["rig"] = replace(self.rig, puppet=puppet)
        for name in ("_with_fingers", "humanoid", "handle_motions", "channel_motion", "displacements"):
            vars(other).pop(name, None)
        vars(other)["scene"] = with_description(self.scene, other)
        return other

    def prepare(self) -> None:
        """Compute what the first frame and the first client would wait for, compiled code included."""
        controls = to_file_units(self.rig.model.rest_controls, self.rig.model)
        quantised(*self.binding.vertices_and_normals(controls))
        self.digest, self.humanoid, self.handle_motions, self.displacements  # noqa: B018
        if self.skeleton is not None:
            self.skeleton.rest  # noqa: B018


class BonePose(NamedTuple):
    """A character's joints relative to their parents.

    Attributes
    ----------
    rotations : (j, 4) float32
        Unit quaternions x, y, z, w.
    translations : (t, 3) float32
        Positions of the joints that are not at a constant position (`Skeleton.travelling`), mesh file's units.
    """

    rotations: NDArray[np.float32]
    translations: NDArray[np.float32]


@dataclass(frozen=True, eq=False, repr=False)
class Frame:
    """One character at one moment.

    Attributes
    ----------
    character : StreamedCharacter
    sequence : int
        Increases by one with each frame of the character.
    time : float
        Seconds, the source's clock.
    received : int
        `time.monotonic_ns` at which the skeleton that moved it arrived.
    state : str
        One of `engine_bridge.service.states.STATES`.
    user : int or None
        The performer.
    R : (4m, 3) float64
        Control variables without the root, model units.
    root : (3,) float64
        Translation of the whole character, mesh file's coordinates.
    targets : (h, 3) float64
        Target positions of the handles, with the root, mesh file's coordinates.
    joints : (20, 3) float64 or None
        The performer's joints, filtered and corrected for the sensor's tilt: metres, sensor coordinates, NaN if never
        tracked; None without a performer.
    confidence : (20,) float32 or None
    motions : (b, 4, 3) float64 or None
        Motions of the bones for row vectors, without the root, mesh file's coordinates.
    channels : mapping of str to float or None
        Values of the performer's channels, left and right as the character has them; None without a performer.
    """

    character: StreamedCharacter
    sequence: int
    time: float
    received: int
    state: str
    user: int | None
    R: NDArray[np.float64]
    root: NDArray[np.float64]
    targets: NDArray[np.float64]
    joints: NDArray[np.float64] | None = None
    confidence: NDArray[np.float32] | None = None
    motions: NDArray[np.float64] | None = None
    channels: Mapping[str, float] | None = None

    @cached_property
    def targets_moved(self) -> NDArray[np.float32]:
        """(k,): weights of the mesh's own morph targets that channels move, in the order of `Puppet.targets`."""
        return weights_at(self.character.rig.puppet, self.channels)

    @cached_property
    def controls(self) -> Controls:
        """(m, 3, 4) float32: transforms of rest positions, the root included."""
        controls = to_file_units(self.R, self.character.rig.model)
        controls[:, :, 3] += self.root
        return controls

    @cached_property
    def vertices_and_normals(self) -> NDArray[np.float32]:
        """(2, n, 3) float32: positions, mesh file's coordinates, and unit normals."""
        binding = self.character.binding
        both = np.empty((2, *binding.rest.shape), dtype=np.float32)
        if self.targets_moved.any():
            binding = copy(binding)
            binding.rest = binding.rest + np.tensordot(self.targets_moved, self.character.displacements, 1)
        binding.vertices_and_normals(self.controls, both[0], both[1])
        return both

    @cached_property
    def morphs(self) -> "Projection | None":
        """The pose on the character's morph basis; None without a basis."""
        basis = self.character.basis
        return None if basis is None else basis.project(self.R)

    @cached_property
    def bones(self) -> "BonePose | None":
        """The pose of its joints, the root included; None without limbs or motions."""
        skeleton = self.character.skeleton
        if skeleton is None or self.motions is None:
            return None
        motions = self.motions
        if self.character.handle_motions is not None:
            motions = np.concatenate([motions, self.character.handle_motions.of(self.R[None])[0]])
        positions, rotations = skeleton.pose(motions, self.root)
        if self.channels and self.character.finger_bends is not None:
            self.character.finger_bends.bend(rotations, self.channels)
        return BonePose(rotations.astype("<f4"), positions[skeleton.travelling].astype("<f4"))

    @cached_property
    def messages(self) -> dict[Kind, bytes | None]:
        """Its messages so far, by kind; see `engine_bridge.service.protocol.payloads.message`."""
        return {}
