"""Maps joint motion to handle targets (Section 3.3, Eq. 6-7).

The paper adds up the joints' motion from frame to frame, C^t+1 = C + H^t. While every joint is tracked, that sum is the
displacement from the first pose. `Retargeter` uses the displacement, which does not drift after a joint was lost.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled

LIMIT_KNEE_SHARE = 0.7
"""Share of a handle's reach within which it follows its joint in proportion; beyond it, motion levels off."""

MAX_JOINT_METRES = 1e6
"""Smallest coordinate, in metres, that is not a valid position of a joint."""

RETURN_SECONDS = 0.15
"""Time constant, in seconds, with which a joint that was lost eases from its held to its tracked position."""


@dataclass(frozen=True)
class Mapping:
    """The joints that move each handle, and how far.

    Attributes
    ----------
    matrix : (h, j) float64
        M of Eq. 7. Each row averages the joints of one handle; the handle of a row of zeros does not move.
    axes : (h, 3) bool
        Coordinates of the joints that are used.
    gain : (h,) float64
        Factor on each handle's motion.
    """

    matrix: NDArray[np.float64]
    axes: NDArray[np.bool_]
    gain: NDArray[np.float64]


@dataclass(frozen=True)
class Fit:
    """The scale from the performer to the character, and limits of the handles.

    Attributes
    ----------
    scale : (h,) float64
        Mesh units that a handle moves per metre of its joints.
    reach : (h, 3, 2) float64
        Largest displacement of each handle along −x, +x, −y, +y, −z, +z of the mesh file, mesh units; infinite for no
        limit.
    """

    scale: NDArray[np.float64]
    reach: NDArray[np.float64]


class Retargeter:
    """Maps a performer's joints to handle targets.

    Parameters
    ----------
    handles : (h, 3) float64
        Rest positions, mesh file's coordinates.
    mapping : Mapping
    fit : Fit
    calibration : (j, 3) float64
        The performer's joints in the calibration pose, which maps to the character's rest pose; metres, character axes
        (y up, facing +z). NaN for unknown joints, which move no handle.
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

        A lost joint keeps its position; when it is tracked again, it eases to its new position.

        Parameters
        ----------
        time : float
            Seconds, increasing from call to call.
        positions : (j, 3) float64
            Metres, character axes.
        confidence : (j,) float32
            0 for a lost joint.

        Returns
        -------
        (h, 3) float64
            Mesh file's coordinates.
        """
        return self.targets(self._return.step(time, positions - self.calibration, confidence > 0))

    def targets(self, displacement: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the handle targets for joint displacements from the calibration pose.

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
    """Holds lost joints, and eases them to their positions when they are tracked again.

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
            Whether a joint is tracked. An invalid displacement (`is_position`) counts as lost.

        Returns
        -------
        (j, 3) float64
            Zero for a joint that was never tracked.
        """
        fading = math.exp(-max(0.0, time - self._time) / RETURN_SECONDS)  # 0 if the clock is set back
        began = math.isfinite(self._time)
        self._time = time
        _ease(displacement, known, fading, began, self._last, self._offset, self._known)
        return self._last.copy()


@compiled(inner=True)
def is_position(p):
    """Return whether three coordinates are a valid position: finite, and below `MAX_JOINT_METRES`."""
    return abs(p[0]) < MAX_JOINT_METRES and abs(p[1]) < MAX_JOINT_METRES and abs(p[2]) < MAX_JOINT_METRES


@compiled(waits=False)
def _ease(displacement, known, fading, began, last, offset, was_known):
    """Update each joint's displacement, and its offset since it was tracked again."""
    for j in range(len(displacement)):
        now = known[j] and is_position(displacement[j])
        for axis in range(3):
            offset[j, axis] *= fading
            if now and began and not was_known[j]:
                offset[j, axis] = last[j, axis] - displacement[j, axis]
            if now:
                last[j, axis] = displacement[j, axis] + offset[j, axis]
        was_known[j] = now


def soft_limit(moved: NDArray[np.float64], reach: NDArray[np.float64]) -> NDArray[np.float64]:
    """Limit motion to the reach smoothly: in proportion up to the knee, then levelling off.

    The limit is an ellipsoid in each octant. With r the distance in units of the reach, r ≤ k is kept and r > k becomes
    k + (1 − k) tanh((r − k) / (1 − k)), which is continuous with its derivative and below 1.

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
    """Return a non-negative distance in units of the reach after the soft limit, at most 1 (`soft_limit`)."""
    room = 1 - LIMIT_KNEE_SHARE
    return ratio if ratio <= LIMIT_KNEE_SHARE else LIMIT_KNEE_SHARE + room * np.tanh((ratio - LIMIT_KNEE_SHARE) / room)


@compiled(waits=False)
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
