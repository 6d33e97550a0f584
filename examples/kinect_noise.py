"""The sensor before a performer made by code: a clip as a Kinect v1 would have recorded it.

Jitter, drift, guesses, strays and dropouts have the size that was measured on real recordings (`with_kinect_noise`).
Nothing here is random that a seed does not fix.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from capture.clip import SkeletonClip
from capture.skeleton import INFERRED, JOINT_INDEX, JOINTS, LOST, TRACKED

Array = NDArray[np.float64]

FRAME_RATE = 30.0
"""Frames a second."""
TICK_JITTER = 0.0025
"""Seconds, standard deviation of a frame's time about the even clock."""
SKIPPED = 0.01
"""Share of frames that never arrive."""

_ERRORS = {  # millimetres at NOMINAL_DEPTH, standard deviations across the line of sight: from frame to frame; slow
    "elbow": (0.8, 4.5),
    "wrist": (1.0, 5.0),
    "hand": (1.4, 6.0),
    "knee": (0.7, 4.0),
    "ankle": (0.9, 4.0),
    "foot": (2.0, 4.5),
}
_TRUNK_ERRORS = (0.4, 3.0)
NOMINAL_DEPTH = 2.5
"""Metres from the sensor at which errors have their stated size."""
DEPTH_FACTOR = 1.6
"""How much larger errors are along the line of sight."""
DRIFT_TIME = 0.35
"""Time constant, seconds, of the slow error."""
SLUR = 0.004
"""Seconds: a moving joint's error from frame to frame grows by its speed times this."""

FAST = 1.5
"""Metres a second from which the sensor begins to guess."""
GUESSED_HIDDEN, GUESSED_FAST = 0.05, 0.15
"""Chance in each frame that a joint before the torso, or a fast one, is guessed from then on for 3 to 8 frames."""
GUESS_FACTOR = 4.0
"""How much larger a guess's error is."""
STRAY, STRAY_DISTANCE = 0.001, 0.08
"""Chance in each frame that a limb's joint strays for 1 or 2 frames; metres, standard deviation on each axis."""
DROPPED = 0.0015
"""Chance in each frame that a limb's joint is lost for 3 to 15 frames."""
AWAY = 0.6
"""Seconds for which the whole body is lost, where it is."""


def with_kinect_noise(clip: SkeletonClip, seed: int, away: float | None = None) -> SkeletonClip:
    """Return a clip as a Kinect would have recorded it.

    - Clock: 30 Hz with jitter (`TICK_JITTER`); about one frame in a hundred is missing (`SKIPPED`).
    - Error of each joint: white noise that grows with its speed, and a slow drift (white noise, low-passed twice). Both
      grow with the square of the distance, are larger in depth and largest at hands and feet.
    - A hand or wrist before the torso and any fast joint is now and then guessed: confidence 0.5, four times the error.
    - Single joints of the limbs stray for a frame or two, unannounced, or are lost for 3 to 15 frames.

    The magnitudes were measured on real Kinect v1 clips (two of MSRC-12, 2,307 frames at 2.3-3.2 m, and one longer
    recording, 2,419 frames at 2.4-4.0 m) and keep to the middle of their range. Against a cubic fitted to 9 frames,
    joints slower than 0.15 m/s jitter by a robust σ of 0.2-0.3 mm (trunk), 0.4-1.3 mm (elbows, wrists), 0.6-1.8 mm
    (hands), 0.1-1.7 mm (knees, ankles) and 0.3-4.0 mm (feet, depth 1.5 to 1.7 times x); faster than 0.8 m/s, elbows,
    wrists and hands by 3-15 mm. Standing feet and ankles wander by 1.3-5.8 mm in half a second. Up to 3.4 % of a hand's
    positions lie over 60 mm off that cubic. Intervals between frames spread by 3.2-3.8 ms, 0.3-1.2 % of them are longer
    than 50 ms. Bone lengths vary by 6-13 % of their mean. The SDK's guesses are not marked in these logs; in two
    frontal Kinect v2 clips 0.4 % of the joints are.

    Parameters
    ----------
    clip : SkeletonClip
        With every joint known, at `FRAME_RATE`.
    seed : int
        The same seed gives the same clip.
    away : float, optional
        Second from which the whole body is lost for `AWAY` seconds.

    Returns
    -------
    SkeletonClip
        Of the same format and user; guesses are `INFERRED`, lost joints `LOST` and NaN.
    """
    rng = np.random.default_rng(seed)
    times = _ticks(clip.times, rng)
    path = CubicSpline(clip.times, clip.positions)
    true = path(times)
    speed = np.linalg.norm(path(times, 1), axis=2)
    limbs = np.array([_kind(joint) in _ERRORS for joint in JOINTS])

    guessed = _episodes(GUESSED_HIDDEN * _before_torso(true) + GUESSED_FAST * (speed > FAST), 3, 8, rng)
    stray = _episodes(np.full(speed.shape, STRAY) * limbs, 1, 2, rng)
    lost = _episodes(np.full(speed.shape, DROPPED) * limbs, 3, 15, rng)
    if away is not None:
        lost[(times >= away) & (times < away + AWAY)] = True

    error = _error(true, speed, rng) * np.where(guessed, GUESS_FACTOR, 1.0)[..., None]
    error += rng.normal(0.0, STRAY_DISTANCE, true.shape) * stray[..., None]
    positions = np.where(lost[..., None], np.nan, true + error)
    confidence = np.where(lost, LOST, np.where(guessed, INFERRED, TRACKED)).astype(np.float32)
    return SkeletonClip(clip.format, clip.user, times, positions, confidence)


def _kind(joint: str) -> str:
    return joint.removesuffix("_left").removesuffix("_right")


def _ticks(even: Array, rng: np.random.Generator) -> Array:
    """Return the times at which a sensor with this clock delivers frames; the first one always."""
    limit = 3 * TICK_JITTER  # far less than half an interval, so that the order stays
    times = even + np.clip(rng.normal(0.0, TICK_JITTER, len(even)), -limit, limit)
    arrives = rng.random(len(even)) >= SKIPPED
    arrives[0] = True
    return np.clip(times[arrives], even[0], even[-1])


def _episodes(chance: Array, shortest: int, longest: int, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Return when (T, 20) something is on that begins with this chance in a frame and lasts so many frames."""
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
    """Return the errors (T, 20, 3) of joints that the sensor sees."""
    jitter, drift = np.array([_ERRORS.get(_kind(joint), _TRUNK_ERRORS) for joint in JOINTS]).T / 1000
    white = rng.standard_normal(true.shape) * (jitter + SLUR * speed)[..., None]
    keep = np.exp(-1 / (FRAME_RATE * DRIFT_TIME))
    settle = round(10 * DRIFT_TIME * FRAME_RATE)
    steps = rng.standard_normal((settle + len(true), *true.shape[1:]))
    unit_variance = np.sqrt((1 - keep**2) ** 3 / (1 + keep**2))
    slow = np.zeros((2 + len(steps), *true.shape[1:]))
    for frame, step in enumerate(steps):  # a loop, because SciPy's filters take half a second to import
        slow[frame + 2] = 2 * keep * slow[frame + 1] - keep**2 * slow[frame] + unit_variance * step
    return (
        (white + slow[2 + settle :] * drift[:, None])
        * (true[..., 2:] / NOMINAL_DEPTH) ** 2
        * np.array([1.0, 1.0, DEPTH_FACTOR])
    )
