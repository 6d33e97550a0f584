"""What a character does while nobody plays it: a recorded performance, over and over without a seam."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from capture import body
from engine_bridge.performance.clip import REST_SECONDS, load_timeline
from engine_bridge.performance.retargeting import Retargeting
from engine_bridge.performance.rig import Rig
from engine_bridge.performance.settings import Settings
from solver.model.bones import Bones
from solver.motion.deformer import Deformer
from solver.motion.motion_blend import difference, moved_by


class Places(NamedTuple):
    """Where a character's handles and bones are.

    Attributes
    ----------
    targets : (h, 3) float64
        Without the root's motion, mesh file's coordinates.
    motions : (b, 4, 3) float64
        Without the root's motion.
    root : (3,) float64
        The root's translation.
    """

    targets: NDArray[np.float64]
    motions: NDArray[np.float64]
    root: NDArray[np.float64]


CROSSFADE_SECONDS = 0.5
"""Seconds in which the end of the performance goes over into its beginning."""


class Idle:
    """A recorded performance as handle targets in a loop.

    Parameters
    ----------
    log : Path
        Any skeleton log.
    rig : Rig
    deformer : Deformer
        Of the rig; not moved.

    Attributes
    ----------
    puppet : Puppet
        Whose mapping it was made with.
    targets : (T, h, 3) float64
        Where the handles go, frame by frame, mesh file's coordinates.
    motions : (T, b, 4, 3) float64
        And the bones.
    root : (T, 3) float64
        And the character with them.

    Raises
    ------
    SkeletonLogError
    """

    def __init__(self, log: Path, rig: Rig, deformer: Deformer) -> None:
        self.puppet = rig.puppet
        timeline, _ = load_timeline(log, Settings())
        self._fps = timeline.fps
        count = max(1, round(REST_SECONDS * self._fps))
        rest = body.resting_pose(timeline.positions, timeline.confidence, 0, count)
        retargeting = Retargeting(rig.puppet, rig.mesh, deformer, rest)
        aims = [retargeting.step(timeline.frame(number)) for number in range(len(timeline.positions))]
        self.targets = _seamless(np.array([aim.targets for aim in aims]), self._fps)
        self.root = _seamless(np.array([aim.root for aim in aims]), self._fps)
        self._bones = deformer.bones
        self.motions = _seamless_motions(np.array([aim.motions for aim in aims]), self._fps, self._bones)

    def at(self, seconds: float) -> Places:
        """Return where the character is after so many seconds of idling."""
        place = seconds * self._fps % len(self.targets)
        before, share = int(place), place % 1
        after = (before + 1) % len(self.targets)
        before %= len(self.targets)
        apart = difference(self._bones, self.motions[before], self.motions[after])
        return Places(
            self.targets[before] + share * (self.targets[after] - self.targets[before]),
            moved_by(self._bones, self.motions[before], apart, share),
            self.root[before] + share * (self.root[after] - self.root[before]),
        )


def _seamless(values: NDArray[np.float64], fps: float) -> NDArray[np.float64]:
    """Shorten a sequence (T, …) so that its end blends into what comes before its new beginning."""
    overlap = _overlap(len(values), fps)
    if not overlap:
        return values
    share = (np.arange(overlap) / overlap).reshape(-1, *[1] * (values.ndim - 1))
    middle = values[overlap:].copy()
    middle[-overlap:] = (1 - share) * middle[-overlap:] + share * values[:overlap]
    return middle


def _seamless_motions(motions: NDArray[np.float64], fps: float, bones: Bones) -> NDArray[np.float64]:
    """Do the same with motions of bones (T, b, 4, 3)."""
    overlap = _overlap(len(motions), fps)
    middle = motions[overlap:].copy()
    for k, last in enumerate(range(len(middle) - overlap, len(middle))):
        middle[last] = moved_by(bones, middle[last], difference(bones, middle[last], motions[k]), k / overlap)
    return middle


def _overlap(frames: int, fps: float) -> int:
    """Return how many frames at the end go over into the beginning."""
    return min(round(CROSSFADE_SECONDS * fps), frames // 2)
