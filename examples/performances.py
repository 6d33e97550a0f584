"""Performances made by code: what performers do in front of a Kinect.

`clean` returns the motion of a body with constant bones, and `PERFORMANCES` the same with the noise of a Kinect.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from capture.clip import SkeletonClip
from capture.skeleton import TRACKED

from .kinect_noise import FRAMES_PER_SECOND, with_kinect_noise
from .performer import REST, interpolated, posed
from .scripts import SCRIPTS

USER = 1


def clean(name: str) -> SkeletonClip:
    """Return a performance without noise.

    Bone lengths (`capture.body.TYPICAL_BONE_METRES`) are constant, standing feet do not move and all motion is C².

    Parameters
    ----------
    name : str
        A key of `PERFORMANCES`.

    Returns
    -------
    SkeletonClip
        User 1 at 30 frames per second from time 0, with all joints tracked.
    """
    script = SCRIPTS[name]()
    times = np.arange(round(script.duration * FRAMES_PER_SECOND) + 1) / FRAMES_PER_SECOND
    parts = {part: interpolated(script.moves.get(part, ()), rest, times) for part, rest in REST.items()}
    positions = posed(parts, script.distance)
    return SkeletonClip("demo", USER, times, positions, np.full(positions.shape[:2], TRACKED, dtype=np.float32))


def _recorded(name: str) -> SkeletonClip:
    script = SCRIPTS[name]()
    return with_kinect_noise(clean(name), script.seed, script.away)


PERFORMANCES: dict[str, Callable[[], SkeletonClip]] = {name: partial(_recorded, name) for name in SCRIPTS}
"""Functions that return the performances with the noise of a Kinect, by name."""
