"""Poses of a character: what its handles and bones are moved to, and what the solver makes of it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from solver.model.bones import Bones
from solver.model.reduced_model import Controls, ReducedModel
from solver.motion.deformer import to_file_units
from solver.motion.motion_blend import difference, moved_by


@dataclass(frozen=True, eq=False)
class TargetPose:
    """Pose that a character's handles and bones are moved to.

    Attributes
    ----------
    targets : (h, 3) float64
        Positions of the handles without the root's motion, mesh file's coordinates.
    bones : (b, 4, 3) float64
        Motions of the bones for row vectors, mesh file's coordinates, without the root's motion.
    root : (3,) float64
        Translation of the whole character, mesh file's coordinates; zero if the puppet has no root.
    """

    targets: NDArray[Any]
    bones: NDArray[Any]
    root: NDArray[Any]


@dataclass(frozen=True, eq=False)
class Pose(TargetPose):
    """Solved pose of a character.

    Attributes
    ----------
    R : (4m, 3) float64
        Control variables without the root, model units.
    model : ReducedModel
    channels : mapping of str to float or None
        Values of the performer's channels, left and right as the character has them; None without a performer.
    """

    R: NDArray[Any]
    model: ReducedModel
    channels: Mapping[str, float] | None = None

    @cached_property
    def controls(self) -> Controls:
        """(m, 3, 4) float32: transforms of rest positions in the mesh file's coordinates, the root included."""
        controls = to_file_units(self.R, self.model)
        controls[:, :, 3] += self.root
        return controls


P = TypeVar("P", bound=TargetPose)
"""A pose that is solved, or one that is not."""


def difference_of(bones: Bones, start: TargetPose, end: TargetPose) -> NDArray[np.float64]:
    """Return the difference (b, 6) between the motions of bones in two poses, see `motion_blend.difference`."""
    return difference(bones, start.bones.astype(np.float64), end.bones.astype(np.float64))


def between(bones: Bones, start: P, end: P, share: float, apart: NDArray[np.float64] | None = None) -> P:
    """Return the pose after a share of the way from one to another, in which bones turn the shortest way.

    Parameters
    ----------
    bones : Bones
    start, end : TargetPose or Pose
    share : float
        From 0 to 1.
    apart : (b, 6) float64, optional
        `difference_of` the end and the start. If these move on the way, it must be computed once for the whole way;
        otherwise a bone would jump when the rotation that it follows passes a half turn.
    """
    apart = difference_of(bones, end, start) if apart is None else apart
    way: dict[str, Any] = {
        "targets": start.targets + share * (end.targets - start.targets),
        "bones": moved_by(bones, end.bones.astype(np.float64), apart, 1.0 - share),
        "root": start.root + share * (end.root - start.root),
    }
    if isinstance(start, Pose) and isinstance(end, Pose):
        way["R"] = start.R + share * (end.R - start.R)
        was, becomes = start.channels or {}, end.channels or {}
        way["channels"] = {
            name: (1 - share) * was.get(name, 0.0) + share * becomes.get(name, 0.0) for name in {**was, **becomes}
        }
    return replace(end, **way)


def smoothstep(share: float) -> float:
    """Return a share of the way with a soft start and end."""
    return share * share * (3.0 - 2.0 * share)
