"""What a character does while nobody plays it: a recorded performance, over and over without a seam."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from capture import body
from capture.skeleton import SkeletonFrame
from engine_bridge.clip import REST_SECONDS, load_timeline
from engine_bridge.retargeting import Retargeting
from engine_bridge.rig import Rig
from engine_bridge.settings import Settings
from solver.deformer import Deformer

CROSSFADE = 0.5
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
        frames = zip(timeline.times, timeline.positions, timeline.confidence, strict=True)
        aims = [retargeting.step(SkeletonFrame(float(time), 0, p, c)) for time, p, c in frames]
        self.targets = _seamless(np.array([aim.targets for aim in aims]), self._fps)
        self.root = _seamless(np.array([aim.root for aim in aims]), self._fps)

    def at(self, seconds: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the handle targets (h, 3) and the root's translation (3,) after so many seconds of idling."""
        place = seconds * self._fps % len(self.targets)
        before, share = int(place), place % 1
        after = (before + 1) % len(self.targets)
        before %= len(self.targets)
        return (
            self.targets[before] + share * (self.targets[after] - self.targets[before]),
            self.root[before] + share * (self.root[after] - self.root[before]),
        )


def _seamless(values: NDArray[np.float64], fps: float) -> NDArray[np.float64]:
    """Shorten a sequence (T, …) so that its end blends into what comes before its new beginning."""
    overlap = min(round(CROSSFADE * fps), len(values) // 2)
    if not overlap:
        return values
    share = (np.arange(overlap) / overlap).reshape(-1, *[1] * (values.ndim - 1))
    middle = values[overlap:].copy()
    middle[-overlap:] = (1 - share) * middle[-overlap:] + share * values[:overlap]
    return middle
