"""Joint motion to handle targets (Section 3.3, Eq. 6-7): arrays only.

The paper adds up the joints' motion from frame to frame, C^t+1 = C + H^t. While every joint is tracked that sum is the
displacement from the first pose, which is what `Retargeter` uses: unlike the sum it does not drift after a drop-out.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled

LIMIT_KNEE_SHARE = 0.7
"""Share of a handle's reach within which it follows its joint in proportion; beyond, it comes softly to a stop."""

MAX_JOINT_METRES = 1e6
"""Metres from the calibration pose, and more: no place of a joint."""

RETURN_SECONDS = 0.15
"""Seconds in which a joint that was lost closes 63 % of the way from where it was held to where it is."""


@dataclass(frozen=True)
class Mapping:
    """Which joints move which handles, and how.

    Attributes
    ----------
    matrix : (h, j) float64
        M of Eq. 7. Each row averages the joints of one handle; a row of zeros leaves the handle where it is.
    axes : (h, 3) bool
        Which of a joint's coordinates count.
    gain : (h,) float64
        Factor on each handle's motion.
    """

    matrix: NDArray[np.float64]
    axes: NDArray[np.bool_]
    gain: NDArray[np.float64]


@dataclass(frozen=True)
class Fit:
    """The performer's size against the character's.

    Attributes
    ----------
    scale : (h,) float64
        Mesh units that a handle moves for a metre of its joints.
    reach : (h, 3, 2) float64
        How far each handle may go along −x, +x, −y, +y, −z, +z of the mesh file, mesh units; infinite for no limit.
    """

    scale: NDArray[np.float64]
    reach: NDArray[np.float64]


class Retargeter:
    """Turns a performer's joints into handle targets.

    Parameters
    ----------
    handles : (h, 3) float64
        Rest positions, mesh file's coordinates.
    mapping : Mapping
    fit : Fit
    calibration : (j, 3) float64
        The performer's joints in the pose that stands for the character's rest pose; metres, character axes (y up,
        facing +z). NaN for joints that are not known: they move nothing.
    basis : (3, 3) float64
        Rows: the mesh file's direction of the performer's left (+x), up and forward. Identity for a glTF character.
    """

    def __init__(
        self,
        handles: NDArray[np.float64],
        mapping: Mapping,
        fit: Fit,
        calibration: NDArray[np.float64],
        basis: NDArray[np.float64] | None = None,
    ) -> None:
        self.handles = handles
        self.mapping = mapping
        self.fit = fit
        self.calibration = calibration
        self.basis = np.eye(3) if basis is None else basis
        self._return = SmoothReturn(len(calibration))

    def step(self, time: float, positions: NDArray[np.float64], confidence: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return the handle targets of one frame.

        A joint that is lost is held where it was; when it comes back it closes the distance smoothly.

        Parameters
        ----------
        time : float
            Seconds, increasing from call to call.
        positions : (j, 3) float64
            Metres, character axes.
        confidence : (j,) float32
            0 where a joint is lost.

        Returns
        -------
        (h, 3) float64
            Mesh file's coordinates.
        """
        return self.targets(self._return.step(time, positions - self.calibration, confidence > 0))

    def targets(self, displacement: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where the handles go for joint displacements from the calibration pose.

        Parameters
        ----------
        displacement : (..., j, 3) float64
            Metres, character axes.

        Returns
        -------
        (..., h, 3) float64
        """
        moved = (self.mapping.matrix @ displacement) * self.mapping.axes * self.fit.scale[:, None]
        return self.handles + self.mapping.gain[:, None] * soft_limit(moved @ self.basis, self.fit.reach)


class SmoothReturn:
    """Holds joints where they are lost, and closes the distance smoothly when they come back.

    Parameters
    ----------
    joints : int
    """

    def __init__(self, joints: int) -> None:
        self._last = np.zeros((joints, 3))
        self._offset = np.zeros((joints, 3))
        self._known = np.zeros(joints, dtype=bool)
        self._time = -np.inf

    def step(self, time: float, displacement: NDArray[np.float64], known: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return the displacements to use.

        Parameters
        ----------
        time : float
            Seconds, increasing from call to call.
        displacement : (j, 3) float64
        known : (j,) bool
            A displacement that is not finite, or farther than `MAX_JOINT_METRES`, is not known either.

        Returns
        -------
        (j, 3) float64
            Zero for a joint that was never known.
        """
        fading = math.exp(-max(0.0, time - self._time) / RETURN_SECONDS)  # a clock that is set back stands still here
        began = math.isfinite(self._time)
        self._time = time
        _close(displacement, known, fading, began, self._last, self._offset, self._known)
        return self._last.copy()


@compiled
def _close(displacement, known, fading, began, last, offset, was_known):
    """Bring each joint's displacement up to date, and the offset at which it came back."""
    for j in range(len(displacement)):
        now = known[j] and np.abs(displacement[j]).max() < MAX_JOINT_METRES  # which NaN is not
        for axis in range(3):
            offset[j, axis] *= fading
            if now and began and not was_known[j]:
                offset[j, axis] = last[j, axis] - displacement[j, axis]
            if now:
                last[j, axis] = displacement[j, axis] + offset[j, axis]
        was_known[j] = now


def soft_limit(moved: NDArray[np.float64], reach: NDArray[np.float64]) -> NDArray[np.float64]:
    """Keep motion within reach without a jolt: in proportion up to the knee, then levelling off.

    The limit is an ellipsoid in each octant. With r the distance in units of the reach, r ≤ k stays and r > k becomes
    k + (1 − k) tanh((r − k) / (1 − k)), which is smooth in value and slope and stays below 1.

    Parameters
    ----------
    moved : (..., h, 3) float64
    reach : (h, 3, 2) float64
        Along −x, +x, −y, +y, −z, +z; positive.

    Returns
    -------
    (..., h, 3) float64
    """
    out = np.empty(moved.shape)
    frames = math.prod(moved.shape[:-2]), *moved.shape[-2:]
    _limit(np.ascontiguousarray(moved, dtype=np.float64).reshape(frames), reach, out.reshape(frames))
    return out


@compiled
def levelled_off(ratio):
    """Return a distance in units of the reach, 0 or more, after the soft limit: at most 1 (`soft_limit`)."""
    room = 1 - LIMIT_KNEE_SHARE
    return ratio if ratio <= LIMIT_KNEE_SHARE else LIMIT_KNEE_SHARE + room * np.tanh((ratio - LIMIT_KNEE_SHARE) / room)


@compiled
def _limit(moved, reach, out):
    """Limit (k, h, 3) motions."""
    for k in range(len(moved)):
        for h in range(len(reach)):
            square = 0.0
            for axis in range(3):
                square += (moved[k, h, axis] / reach[h, axis, 0 if moved[k, h, axis] < 0 else 1]) ** 2
            ratio = np.sqrt(square)
            scale = levelled_off(ratio) / ratio if ratio > LIMIT_KNEE_SHARE else 1.0
            for axis in range(3):
                out[k, h, axis] = moved[k, h, axis] * scale
