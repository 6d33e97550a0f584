"""Frames, which stages produce and outputs send: one character at one moment.

Each property is computed when it is first used, and once.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from capture.skeleton import SkeletonFrame
from engine_bridge.performance.channels import weights_at
from engine_bridge.performance.pose import Pose
from engine_bridge.service.protocol.header import Kind
from engine_bridge.service.protocol.scene import StreamedCharacter

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
    pose : Pose
        Without the root's translation but in its `controls`.
    seen : SkeletonFrame or None
        The performer's joints, filtered and corrected for the sensor's tilt, in metres, sensor coordinates; None
        without one.
    """

    character: StreamedCharacter
    sequence: int
    time: float
    received: int
    state: str
    user: int | None
    pose: Pose
    seen: SkeletonFrame | None = None

    @cached_property
    def handles(self) -> NDArray[np.float64]:
        """(h, 3) float64: positions that the handles are moved to, the root included, mesh file's coordinates."""
        return self.pose.targets + self.pose.root

    @cached_property
    def targets_moved(self) -> NDArray[np.float32]:
        """(k,): weights of the mesh's own morph targets that channels move, in the order of `Puppet.targets`."""
        return weights_at(self.character.prepared.puppet, self.pose.channels)

    @cached_property
    def vertices_and_normals(self) -> NDArray[np.float32]:
        """(2, n, 3) float32: positions, mesh file's coordinates, and unit normals."""
        return self.character.vertices_and_normals(self.pose.controls, self.targets_moved)

    @cached_property
    def morphs(self) -> "Projection | None":
        """The pose on the character's morph basis; None without a basis."""
        basis = self.character.basis
        return None if basis is None else basis.project(self.pose.R)

    @cached_property
    def bones(self) -> "BonePose | None":
        """The pose of its joints, the root included; None without limbs."""
        skeleton, motions = self.character.skeleton, self.pose.bones
        if skeleton is None:
            return None
        if self.character.handle_motions is not None:
            motions = np.concatenate([motions, self.character.handle_motions.of(self.pose.R[None])[0]])
        positions, rotations = skeleton.pose(motions, self.pose.root)
        if self.pose.channels and self.character.finger_bends is not None:
            self.character.finger_bends.bend(rotations, self.pose.channels)
        return BonePose(rotations.astype("<f4"), positions[skeleton.travelling].astype("<f4"))

    @cached_property
    def messages(self) -> dict[Kind, bytes | None]:
        """Its messages so far, by kind; see `engine_bridge.service.protocol.payloads.message`."""
        return {}
