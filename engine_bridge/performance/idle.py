"""Idle recordings: motion of a character without a performer, in a seamless loop."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engine_bridge.performance.clip import load_timeline, reference_pose
from engine_bridge.performance.easing import TargetPose
from engine_bridge.performance.retargeting import Retargeting
from engine_bridge.performance.rig import Rig
from engine_bridge.performance.settings import Settings
from solver.model.bones import Bones
from solver.motion.deformer import Deformer
from solver.motion.motion_blend import difference, moved_by

CROSSFADE_SECONDS = 0.5
"""Duration of the blend from the recording's end to its start, in seconds."""


class IdleRecording:
    """A recording as a loop of handle positions and bone motions.

    Parameters
    ----------
    log : Path
        Recording in any format.
    rig : Rig
    deformer : Deformer
        Deformer of the rig, which is not changed.

    Attributes
    ----------
    puppet : Puppet
        Puppet with the mapping that was used.
    targets : (T, h, 3) float64
        Positions of the handles in each frame, mesh file's coordinates.
    motions : (T, b, 4, 3) float64
        Motions of the bones.
    root : (T, 3) float64
        Translation of the character.

    Raises
    ------
    SkeletonLogError
    """

    def __init__(self, log: Path, rig: Rig, deformer: Deformer) -> None:
        self.puppet = rig.puppet
        settings = Settings()
        timeline, _ = load_timeline(log, settings)
        self._fps = timeline.fps
        retargeting = Retargeting(rig.puppet, rig.mesh, deformer, reference_pose(rig.puppet, timeline, settings))
        aims = [retargeting.step(timeline.frame(number)) for number in range(len(timeline.positions))]
        self.targets = _seamless(np.array([aim.targets for aim in aims]), self._fps)
        self.root = _seamless(np.array([aim.root for aim in aims]), self._fps)
        self._bones = deformer.bones
        self.motions = _seamless_motions(np.array([aim.motions for aim in aims]), self._fps, self._bones)

    def at(self, seconds: float) -> TargetPose:
        """Return the pose at a time in seconds since the start of the loop."""
        place = seconds * self._fps % len(self.targets)
        before, share = int(place), place % 1
        after = (before + 1) % len(self.targets)
        before %= len(self.targets)
        apart = difference(self._bones, self.motions[before], self.motions[after])
        return TargetPose(
            self.targets[before] + share * (self.targets[after] - self.targets[before]),
            moved_by(self._bones, self.motions[before], apart, share),
            self.root[before] + share * (self.root[after] - self.root[before]),
        )


def _seamless(values: NDArray[np.float64], fps: float) -> NDArray[np.float64]:
    """Shorten a sequence (T, …) so that its end blends into the frames before its new start."""
    overlap = _overlap(len(values), fps)
    if not overlap:
        return values
    share = (np.arange(overlap) / overlap).reshape(-1, *[1] * (values.ndim - 1))
    middle = values[overlap:].copy()
    middle[-overlap:] = (1 - share) * middle[-overlap:] + share * values[:overlap]
    return middle


def _seamless_motions(motions: NDArray[np.float64], fps: float, bones: Bones) -> NDArray[np.float64]:
    """Shorten motions of bones (T, b, 4, 3) like `_seamless`."""
    overlap = _overlap(len(motions), fps)
    middle = motions[overlap:].copy()
    for k, last in enumerate(range(len(middle) - overlap, len(middle))):
        middle[last] = moved_by(bones, middle[last], difference(bones, middle[last], motions[k]), k / overlap)
    return middle


def _overlap(frames: int, fps: float) -> int:
    """Return the number of frames at the end that blend into the start."""
    return min(round(CROSSFADE_SECONDS * fps), frames // 2)
