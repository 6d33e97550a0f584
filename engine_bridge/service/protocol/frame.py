"""Frames, which stages produce and outputs send: one character at one moment.

Each property is computed when it is first used, and once.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from capture.skeleton import SkeletonFrame
from engine_bridge.performance.channels import weights_at
from engine_bridge.performance.pose import Pose
from engine_bridge.service.protocol.header import Kind
from engine_bridge.service.protocol.scene import StreamedCharacter
from solver.model.reduced_model import Controls
from solver.motion.deformer import to_file_units

if TYPE_CHECKING:
    from engine_bridge.export.live_basis import Projection


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
        `puppetline.clock.now_ns` at which the skeleton that moved it arrived.
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

    @classmethod
    def of_pose(
        cls,
        character: StreamedCharacter,
        sequence: int,
        time: float,
        received: int,
        state: str,
        user: int | None,
        pose: Pose,
        seen: SkeletonFrame | None,
    ) -> Self:
        """Return the frame of a pose, and of the performer's filtered and corrected joints if there is one."""
        joints, confidence = (None, None) if seen is None else (seen.positions, seen.confidence)
        moved = pose.R, pose.root, pose.targets + pose.root, joints, confidence, pose.bones, pose.channels
        return cls(character, sequence, time, received, state, user, *moved)

    @cached_property
    def targets_moved(self) -> NDArray[np.float32]:
        """(k,): weights of the mesh's own morph targets that channels move, in the order of `Puppet.targets`."""
        return weights_at(self.character.prepared.puppet, self.channels)

    @cached_property
    def controls(self) -> Controls:
        """(m, 3, 4) float32: transforms of rest positions, the root included."""
        controls = to_file_units(self.R, self.character.prepared.model)
        controls[:, :, 3] += self.root
        return controls

    @cached_property
    def vertices_and_normals(self) -> NDArray[np.float32]:
        """(2, n, 3) float32: positions, mesh file's coordinates, and unit normals."""
        return self.character.vertices_and_normals(self.controls, self.targets_moved)

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
