"""The motion of a performer's own skeleton: rotations of its joints, and positions of its hips.

Joints are smoothed as for a character (`capture.smoothing`), and bones follow their directions by the same mathematics
(`solver.motion.limb_motion`). Hips are where the performer's are. The floor is at y = 0: the feet, which sensors see
with errors of some centimetres, are at their usual height when they are low. The origin of x and z is below the hips at
the start of the recording.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from capture import orientations
from capture.body import ANKLE_HEIGHT_METRES
from capture.skeleton import JOINT_INDEX, LOST, to_character_axes
from capture.smoothing import JointFilter, Smoothing
from capture.timeline import Timeline
from engine_bridge.export.performer.skeleton import PerformerSkeleton, skeleton_of
from engine_bridge.performance.retargeting import PERFORMER
from engine_bridge.puppet.humanoid_bones import SIDES
from solver.motion.limb_motion import LimbMotion
from solver.motion.retarget import SmoothReturn

FLOOR_PERCENTILE = 10
"""Percentile of the lower ankle's height at which it stands on the floor, because some frames are noise."""

HIPS = JOINT_INDEX["hip_center"]


@dataclass(frozen=True, eq=False)
class PerformerMotion:
    """A performer's motion.

    Attributes
    ----------
    body : PerformerSkeleton
    fps : float
        Frames per second; the first frame is at 0 s.
    hips : (F, 3) float64
        Positions of the hips, metres, character axes.
    rotations : (F, n, 4) float64
        Rotations of the joints from the T-pose relative to their parents, unit quaternions x, y, z, w. Neighbouring
        frames have the same sign.
    """

    body: PerformerSkeleton
    fps: float
    hips: NDArray[np.float64]
    rotations: NDArray[np.float64]

    def part(self, first: int, end: int) -> "PerformerMotion":
        """Return the frames from number `first` to before number `end`."""
        return PerformerMotion(self.body, self.fps, self.hips[first:end], self.rotations[first:end])


def motion_of(timeline: Timeline, origin: NDArray[np.float64]) -> PerformerMotion:
    """Compute the motion of a performer's skeleton.

    Parameters
    ----------
    timeline : Timeline
    origin : (3,) float64
        Point below or above which x and z are 0, sensor coordinates.
    """
    body = skeleton_of(timeline)
    skeleton, feet = body.skeleton, [body.skeleton.names.index(f"{side}Foot") for side in SIDES]
    smoothing, limbs, hips = JointFilter(Smoothing()), LimbMotion(body.limbs, PERFORMER, body.pose), SmoothReturn(1)
    count = len(timeline.positions)
    shifts, ankles = np.empty((count, 3)), np.empty((count, 2))
    rotations = np.empty((count, len(skeleton.joints), 4))
    for number in range(count):
        frame = timeline.frame(number)
        joints = to_character_axes(smoothing.step(frame.time, frame.positions, frame.confidence))
        turned = None if frame.orientations is None else orientations.to_character_axes(frame.orientations)
        motions = limbs.step(frame.time, joints, frame.confidence, orientations=turned)
        _, rotations[number] = skeleton.pose(motions, np.zeros(3))
        shift = joints[HIPS] - body.pose[HIPS]
        shifts[number] = hips.step(frame.time, shift[None], frame.confidence[[HIPS]] > LOST)[0]
        of_feet = motions[skeleton.bones[feet]]
        ankles[number] = np.einsum("ni,ni->n", skeleton.heads[feet], of_feet[:, :3, 1]) + of_feet[:, 3, 1]
    standing = np.percentile((ankles + shifts[:, 1:2]).min(axis=1), FLOOR_PERCENTILE)
    shifts -= to_character_axes(origin) * [1.0, 0.0, 1.0] + [0.0, standing - ANKLE_HEIGHT_METRES, 0.0]
    return PerformerMotion(body, timeline.fps, body.pose[HIPS] + shifts, _continuous(rotations))


def _continuous(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return quaternions (F, n, 4) with the signs with which neighbouring frames are nearest to each other."""
    flips = np.einsum("fnc,fnc->fn", rotations[1:], rotations[:-1]) < 0
    signs = np.cumprod(np.where(flips, -1.0, 1.0), axis=0)
    return np.concatenate([rotations[:1], rotations[1:] * signs[..., None]])
