"""Noise of a Kinect v1 for clips that are made by code.

Jitter, drift, guesses, outliers and dropouts have the size that was measured on real recordings (`with_kinect_noise`).
A seed determines all random numbers.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from capture.clip import SkeletonClip
from capture.skeleton import INFERRED, JOINT_INDEX, JOINTS, LOST, TRACKED

Array = NDArray[np.float64]

FRAMES_PER_SECOND = 30.0
"""Rate of the frames, per second."""
TICK_JITTER_SECONDS = 0.0025
"""Standard deviation of the times of frames from an even clock, in seconds."""
SKIPPED_SHARE = 0.01
"""Share of frames that are missing."""

_ERRORS = {  # standard deviations across the line of sight at NOMINAL_DEPTH_METRES, in millimetres: white noise; drift
    "elbow": (0.8, 4.5),
    "wrist": (1.0, 5.0),
    "hand": (1.4, 6.0),
    "knee": (0.7, 4.0),
    "ankle": (0.9, 4.0),
    "foot": (2.0, 4.5),
}
_TRUNK_ERRORS = (0.4, 3.0)
NOMINAL_DEPTH_METRES = 2.5
"""Distance from the sensor at which errors have the stated size, in metres."""
DEPTH_FACTOR = 1.6
"""Ratio of errors along the line of sight to errors across it."""
DRIFT_SECONDS = 0.35
"""Time constant of the drift, in seconds."""
MOTION_ERROR_SECONDS = 0.004
"""Increase of white noise per speed of a joint, in seconds."""

FAST_METRES_PER_SECOND = 1.5
"""Speed above which the sensor may guess a joint, in metres per second."""
HIDDEN_GUESS_CHANCE, FAST_GUESS_CHANCE = 0.05, 0.15
"""Probability per frame that a joint in front of the torso, or a fast joint, is guessed for 3 to 8 frames."""
GUESS_FACTOR = 4.0
"""Ratio of the error of a guessed joint to that of a tracked one."""
STRAY_CHANCE, STRAY_METRES = 0.001, 0.08
"""Probability per frame that a joint of a limb is an outlier for 1 or 2 frames, and the standard deviation per axis."""
DROP_CHANCE = 0.0015
"""Probability per frame that a joint of a limb is lost for 3 to 15 frames."""
ABSENCE_SECONDS = 0.6
"""How long the whole body is lost, in seconds."""


def with_kinect_noise(clip: SkeletonClip, seed: int, away: float | None = None) -> SkeletonClip:
    """Return a clip with the noise of a Kinect v1.

    - Clock: 30 Hz with jitter (`TICK_JITTER_SECONDS`); about one frame in a hundred is missing (`SKIPPED_SHARE`).
    - Error of each joint: white noise that grows with its speed, and a slow drift (white noise, low-passed twice). Both
      grow with the square of the distance, are larger in depth and largest at hands and feet.
    - A hand or wrist in front of the torso, and any fast joint may be guessed: confidence 0.5, 4 times the error.
    - Single joints of the limbs are outliers for a frame or two, with full confidence, or lost for 3 to 15 frames.

    The magnitudes were measured on real Kinect v1 clips (two of MSRC-12, 2,307 frames at 2.3-3.2 m, and one longer
    recording, 2,419 frames at 2.4-4.0 m) and keep to the middle of their range. Against a cubic fitted to 9 frames,
    joints slower than 0.15 m/s jitter by a robust σ of 0.2-0.3 mm (trunk), 0.4-1.3 mm (elbows, wrists), 0.6-1.8 mm
    (hands), 0.1-1.7 mm (knees, ankles) and 0.3-4.0 mm (feet, depth 1.5 to 1.7 times x); faster than 0.8 m/s, elbows,
    wrists and hands by 3-15 mm. Standing feet and ankles wander by 1.3-5.8 mm in half a second. Up to 3.4 % of a hand's
    positions are over 60 mm from that cubic. Intervals between frames spread by 3.2-3.8 ms; 0.3-1.2 % of them exceed
    50 ms. Bone lengths vary by 6-13 % of their mean. The SDK's guesses are not marked in these logs; in two
    frontal Kinect v2 clips 0.4 % of the joints are.

    Parameters
    ----------
    clip : SkeletonClip
        All joints are tracked, at `FRAMES_PER_SECOND`.
    seed : int
        The same seed gives the same clip.
    away : float, optional
        Time from which the whole body is lost for `ABSENCE_SECONDS`, in seconds.

    Returns
    -------
    SkeletonClip
        It has the same format and user. Guessed joints are `INFERRED`, lost joints are `LOST` and NaN.
    """
    rng = np.random.default_rng(seed)
    times = _ticks(clip.times, rng)
    path = CubicSpline(clip.times, clip.positions)
    true = path(times)
    speed = np.linalg.norm(path(times, 1), axis=2)
    limbs = np.array([_kind(joint) in _ERRORS for joint in JOINTS])

    guessed = _episodes(
        HIDDEN_GUESS_CHANCE * _before_torso(true) + FAST_GUESS_CHANCE * (speed > FAST_METRES_PER_SECOND), 3, 8, rng
    )
    stray = _episodes(np.full(speed.shape, STRAY_CHANCE) * limbs, 1, 2, rng)
    lost = _episodes(np.full(speed.shape, DROP_CHANCE) * limbs, 3, 15, rng)
    if away is not None:
        lost[(times >= away) & (times < away + ABSENCE_SECONDS)] = True

    error = _error(true, speed, rng) * np.where(guessed, GUESS_FACTOR, 1.0)[..., None]
    error += rng.normal(0.0, STRAY_METRES, true.shape) * stray[..., None]
    positions = np.where(lost[..., None], np.nan, true + error)
    confidence = np.where(lost, LOST, np.where(guessed, INFERRED, TRACKED)).astype(np.float32)
    return SkeletonClip(clip.format, clip.user, times, positions, confidence)


def _kind(joint: str) -> str:
    return joint.removesuffix("_left").removesuffix("_right")


def _ticks(even: Array, rng: np.random.Generator) -> Array:
    """Return the times of the frames that arrive; the first frame always does."""
    limit = 3 * TICK_JITTER_SECONDS  # far less than half an interval, so that the order is kept
    times = even + np.clip(rng.normal(0.0, TICK_JITTER_SECONDS, len(even)), -limit, limit)
    arrives = rng.random(len(even)) >= SKIPPED_SHARE
    arrives[0] = True
    return np.clip(times[arrives], even[0], even[-1])


def _episodes(chance: Array, shortest: int, longest: int, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Return a mask (T, 20) of episodes of `shortest` to `longest` frames, which begin with a probability per frame."""
    frame = np.arange(len(chance))[:, None]
    begins = rng.random(chance.shape) < chance
    ends = frame + rng.integers(shortest, longest, chance.shape, endpoint=True)
    return np.maximum.accumulate(np.where(begins, ends, 0), axis=0) > frame


def _before_torso(positions: Array) -> NDArray[np.bool_]:
    """Return which joints (T, 20) are wrists or hands between the sensor and the torso."""
    x, y, z = np.moveaxis(positions, 2, 0)

    def of(values: Array, joint: str) -> Array:
        return values[:, JOINT_INDEX[joint], None]

    before = (
        (x > of(x, "shoulder_left"))
        & (x < of(x, "shoulder_right"))
        & (y > of(y, "hip_center"))
        & (y < of(y, "shoulder_center"))
        & (z < of(z, "shoulder_center"))
    )
    return before & np.array([_kind(joint) in ("wrist", "hand") for joint in JOINTS])


def _error(true: Array, speed: Array, rng: np.random.Generator) -> Array:
    """Return the errors (T, 20, 3) of visible joints."""
    jitter, drift = np.array([_ERRORS.get(_kind(joint), _TRUNK_ERRORS) for joint in JOINTS]).T / 1000
    white = rng.standard_normal(true.shape) * (jitter + MOTION_ERROR_SECONDS * speed)[..., None]
    keep = np.exp(-1 / (FRAMES_PER_SECOND * DRIFT_SECONDS))
    settle = round(10 * DRIFT_SECONDS * FRAMES_PER_SECOND)
    steps = rng.standard_normal((settle + len(true), *true.shape[1:]))
    unit_variance = np.sqrt((1 - keep**2) ** 3 / (1 + keep**2))
    slow = np.zeros((2 + len(steps), *true.shape[1:]))
    for frame, step in enumerate(steps):  # a loop, because SciPy's filters take half a second to import
        slow[frame + 2] = 2 * keep * slow[frame + 1] - keep**2 * slow[frame] + unit_variance * step
    return (
        (white + slow[2 + settle :] * drift[:, None])
        * (true[..., 2:] / NOMINAL_DEPTH_METRES) ** 2
        * np.array([1.0, 1.0, DEPTH_FACTOR])
    )
