"""The joint position double exponential filter: the paper's Eq. 4, on a sensor's real clock.

Holt's method smooths a measurement p with the previous *smoothed* value p̃ and a trend b, both a frame old::

    p̃ₜ = β pₜ + (1 − β)(p̃ₜ₋₁ + bₜ₋₁)        p̃₁ = p₁
    bₜ = γ (p̃ₜ − p̃ₜ₋₁) + (1 − γ) bₜ₋₁        b₁ = p₁ − p₀

It counts frames, but sensors drop frames and run at different rates. So the recursion is solved over a segment between
two measurements, n frames of 1/30 s long. With the slope v = (pₜ − pₜ₋₁)/n and the errors e = p̃ − p and u = b − v,
one frame along the segment is linear::

    (e, u)ₜ = A (e, u)ₜ₋₁,    A = [[1 − β, 1 − β], [−γβ, 1 − γβ]]

and the whole segment is Aⁿ, for any real n > 0. At n = 1 this is Eq. 4 itself, and since AᵐAⁿ = Aᵐ⁺ⁿ, measurements
that lie on the same straight segments give the same output at 15, 30 and 60 Hz.

From the Kinect SDK's joint filter come three further controls, which look at each measurement by itself: a measurement
within the jitter radius of the last smoothed position is drawn towards it, the output runs ahead along the trend
(prediction), and it stays within the maximum deviation of the measurement. Both radii double for inferred joints. The
SDK starts differently (trend 0, then the mean of two measurements); the start here is Eq. 4's.
"""

import cmath
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from capture.skeleton import INFERRED, JOINTS, LOST
from puppetline.errors import PuppetError, at

FRAME_RATE = 30.0
"""Frames a second that `Smoothing` is meant for, the Kinect's own."""


@dataclass(frozen=True, slots=True)
class Smoothing:
    """What a user may set.

    Attributes
    ----------
    alpha : float
        β of Eq. 4, the weight of a new measurement, in (0, 1]; 1 does not smooth. The Kinect SDK's *Smoothing* is
        1 − alpha.
    gamma : float
        γ of Eq. 4, how fast the trend follows, in [0, 1]. The SDK's *Correction*.
    jitter_radius : float
        Metres; 0 turns it off.
    max_deviation : float
        Metres; infinity turns it off.
    prediction : float
        Frames of 1/30 s that the output runs ahead.

    Raises
    ------
    PuppetError
        If a value is outside its range.
    """

    alpha: float = 0.5
    gamma: float = 0.5
    jitter_radius: float = 0.05
    max_deviation: float = 0.1
    prediction: float = 0.0

    def __post_init__(self) -> None:
        for name, fits, expected in (
            ("alpha", 0 < self.alpha <= 1, "a number above 0 and up to 1"),
            ("gamma", 0 <= self.gamma <= 1, "a number from 0 to 1"),
            ("jitter_radius", 0 <= self.jitter_radius < math.inf, "metres, 0 or more"),
            ("max_deviation", self.max_deviation > 0, "metres, more than 0"),
            ("prediction", 0 <= self.prediction < math.inf, "frames, 0 or more"),
        ):
            if not fits:
                default = type(self).__dataclass_fields__[name].default
                raise PuppetError(
                    at("smoothing", field=name),
                    found=str(getattr(self, name)),
                    expected=expected,
                    fix=f"Leave {name} out to get {default}.",
                )


class JointFilter:
    """Smooths one performer's joints, each by itself.

    Parameters
    ----------
    smoothing : Smoothing
    """

    def __init__(self, smoothing: Smoothing) -> None:
        self.smoothing = smoothing
        self.reset()

    def reset(self) -> None:
        """Forget everything seen so far."""
        unknown = np.full((len(JOINTS), 3), np.nan)
        # NaN marks what a joint does not have yet, and spreads by itself: all of it before the first measurement and
        # after a loss, the trend alone after one measurement.
        self._time = math.nan
        self._measured = self._smoothed = self._trend = self._output = unknown

    def step(self, time: float, positions: NDArray[np.float64], confidence: NDArray[np.float32]) -> NDArray[np.float64]:
        """Take one frame and return its smoothed positions.

        Parameters
        ----------
        time : float
            Seconds, later than the last frame's.
        positions : (20, 3) float64
            Metres. NaN is a lost joint.
        confidence : (20,) float32
            `LOST` is a lost joint whatever its position; up to `INFERRED` the radii double.

        Returns
        -------
        (20, 3) float64
            A lost joint stays at its last output and starts afresh when it returns; NaN before it was first seen.

        Raises
        ------
        ValueError
            If time does not increase.
        """
        if time <= self._time:
            raise ValueError(f"frame at {time} s after one at {self._time} s")
        frames = 1.0 if math.isnan(self._time) else FRAME_RATE * (time - self._time)
        self._time = time

        known = (confidence > LOST) & np.isfinite(positions).all(axis=1)
        raw = np.where(known[:, None], positions, np.nan)
        radius = np.where(confidence > INFERRED, 1.0, 2.0)

        measured = self._without_jitter(raw, radius * self.smoothing.jitter_radius)
        velocity = (measured - self._measured) / frames
        error = self._smoothed - self._measured
        trend_error = np.where(np.isnan(self._trend), 0.0, self._trend - velocity)
        decay = _decay(self.smoothing.alpha, self.smoothing.gamma, frames)
        smoothed = measured + decay[0, 0] * error + decay[0, 1] * trend_error

        self._measured = measured
        self._smoothed = np.where(np.isnan(smoothed), measured, smoothed)
        self._trend = velocity + decay[1, 0] * error + decay[1, 1] * trend_error

        ahead = self._smoothed + self.smoothing.prediction * np.nan_to_num(self._trend)
        output = _within(ahead, raw, radius * self.smoothing.max_deviation)
        self._output = np.where(known[:, None], output, self._output)
        return self._output.copy()

    def _without_jitter(self, raw: NDArray[np.float64], radius: NDArray[np.float64]) -> NDArray[np.float64]:
        """Draw measurements (20, 3) that are near the last smoothed position towards it, the nearer the more."""
        move = raw - self._smoothed
        distance = np.linalg.norm(move, axis=1)
        near = distance < radius
        weight = np.divide(distance, radius, out=np.ones_like(distance), where=near)
        return np.where(near[:, None], self._smoothed + weight[:, None] * move, raw)


def _within(
    points: NDArray[np.float64], centres: NDArray[np.float64], radius: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Pull points (20, 3) that are outside the sphere about their centre straight onto it."""
    away = points - centres
    distance = np.linalg.norm(away, axis=1)
    outside = distance > radius
    scale = np.divide(radius, distance, out=np.ones_like(distance), where=outside)
    return np.where(outside[:, None], centres + scale[:, None] * away, points)


def _decay(alpha: float, gamma: float, frames: float) -> NDArray[np.float64]:
    """Return Aⁿ (2, 2), n = frames: what remains of the errors (e, u) after that many frames.

    Cayley-Hamilton with the eigenvalues λ and μ of A: Aⁿ = μⁿ I + (λⁿ − μⁿ)/(λ − μ) (A − μ I). A has determinant
    1 − β ≥ 0 and trace 2 − β − γβ ≥ 0, so no eigenvalue is a negative real and the power is real.
    """
    if alpha == 1.0:
        # p̃ is the measurement and e is 0: only the trend's column counts. (For γ = 1 the first would have no root.)
        return np.diag([0.0, (1.0 - gamma) ** frames])
    step = np.array([[1.0 - alpha, 1.0 - alpha], [-gamma * alpha, 1.0 - gamma * alpha]])
    determinant = 1.0 - alpha
    half_trace = (1.0 + determinant - gamma * alpha) / 2.0
    large = half_trace + cmath.sqrt(half_trace**2 - determinant)
    small = determinant / large
    # The quotient by λ − μ is rewritten with x = log(μ/λ), so that nothing cancels where the eigenvalues (nearly) meet.
    log_ratio = cmath.log(small / large)
    growth = np.expm1(frames * log_ratio) / np.expm1(log_ratio) if log_ratio else frames
    power = small**frames * np.eye(2) + large ** (frames - 1.0) * growth * (step - small * np.eye(2))
    return np.real(power)
