"""The double exponential filter of joint positions: the paper's Eq. 4, at the times of a sensor's frames.

Holt's method smooths a measurement p with the smoothed value p̃ and the trend b of the previous frame::

    p̃ₜ = β pₜ + (1 − β)(p̃ₜ₋₁ + bₜ₋₁)        p̃₁ = p₁
    bₜ = γ (p̃ₜ − p̃ₜ₋₁) + (1 − γ) bₜ₋₁        b₁ = p₁ − p₀

The equation counts frames, but sensors drop frames and have different rates. The recursion is therefore solved over the
segment between two measurements, whose length is n frames of 1/30 s. Let v = (pₜ − pₜ₋₁)/n be the slope, and e = p̃ − p
and u = b − v the errors. One frame along the segment is then linear, and the whole segment is Aⁿ for any real n > 0::

    (e, u)ₜ = A (e, u)ₜ₋₁,    A = [[1 − β, 1 − β], [−γβ, 1 − γβ]]

For n = 1 this is Eq. 4. Since AᵐAⁿ = Aᵐ⁺ⁿ, measurements on the same straight segments have the same output at 15, 30
and 60 Hz.

Three further controls are those of the Kinect SDK's joint filter, applied to each measurement. A measurement within the
jitter radius of the last smoothed position is moved towards it. The output is extrapolated along the trend
(prediction). It stays within the maximum deviation from the measurement. Both radii are doubled for inferred joints.
The SDK starts differently (trend 0, then the mean of two measurements); this filter starts as Eq. 4 does.
"""

import cmath
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from capture.skeleton import INFERRED, JOINTS, LOST
from puppetline.compiled import compiled
from puppetline.errors import PuppetlineError, at

FRAMES_PER_SECOND = 30.0
"""Frame rate to which the values of `Smoothing` refer: the Kinect's."""


@dataclass(frozen=True, slots=True)
class Smoothing:
    """Settings of the filter.

    Attributes
    ----------
    alpha : float
        β of Eq. 4, the weight of a new measurement, in (0, 1]; 1 does not smooth. The Kinect SDK's *Smoothing* is
        1 − alpha.
    gamma : float
        γ of Eq. 4, the weight of a new trend, in [0, 1]. The SDK's *Correction*.
    jitter_radius : float
        Metres; 0 disables it.
    max_deviation : float
        Metres; infinity disables it.
    prediction : float
        Number of frames of 1/30 s by which the output is extrapolated.

    Raises
    ------
    PuppetlineError
        A value is out of range.
    """

    alpha: float = 0.6
    gamma: float = 0.5
    jitter_radius: float = 0.05
    max_deviation: float = 0.02
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
                raise PuppetlineError(
                    at("smoothing", field=name),
                    found=str(getattr(self, name)),
                    expected=expected,
                    fix=f"Omit {name} to use {default}.",
                )


class JointFilter:
    """A filter of one performer's joints, which are independent of each other."""

    def __init__(self, smoothing: Smoothing) -> None:
        self.smoothing = smoothing
        self.reset()

    def reset(self) -> None:
        """Reset the filter to its state before the first frame."""
        # NaN marks missing state and propagates: all of a joint's state before the first measurement and after a loss,
        # only the trend after one measurement.
        self._time = math.nan
        self._measured, self._smoothed, self._trend, self._output = np.full((4, len(JOINTS), 3), np.nan)

    def step(self, time: float, positions: NDArray[np.float64], confidence: NDArray[np.float32]) -> NDArray[np.float64]:
        """Filter one frame and return its smoothed positions.

        Parameters
        ----------
        time : float
            Seconds, after the last frame's time.
        positions : (20, 3) float64
            Metres; NaN for a lost joint.
        confidence : (20,) float32
            `LOST` is a lost joint with any position; up to `INFERRED`, the radii are doubled.

        Returns
        -------
        (20, 3) float64
            A lost joint keeps its last output, and its filter restarts when it returns. It is NaN before its first
            measurement.

        Raises
        ------
        ValueError
            The time does not increase.
        """
        if time <= self._time:
            raise ValueError(f"frame at {time} s after one at {self._time} s")
        frames = 1.0 if math.isnan(self._time) else FRAMES_PER_SECOND * (time - self._time)
        self._time = time

        decay = _decay(self.smoothing.alpha, self.smoothing.gamma, frames)
        settings = self.smoothing.jitter_radius, self.smoothing.max_deviation, self.smoothing.prediction
        state = self._measured, self._smoothed, self._trend, self._output
        _filter(positions, confidence, frames, decay, settings, state)
        return self._output.copy()


@compiled(waits=False, error_model="numpy")
def _filter(positions, confidence, frames, decay, settings, state):
    """Update every joint's measurement, smoothed position, trend and output with a frame."""
    jitter_radius, max_deviation, prediction = settings
    measured, smoothed, trend, output = state
    for j in range(len(positions)):
        x, y, z = positions[j, 0], positions[j, 1], positions[j, 2]
        known = confidence[j] > LOST and np.isfinite(x) and np.isfinite(y) and np.isfinite(z)
        widen = 1.0 if confidence[j] > INFERRED else 2.0
        # a measurement near the last smoothed position is moved towards it, the more the nearer it is
        distance = _distance(positions[j], smoothed[j])
        near = distance < widen * jitter_radius
        share = distance / (widen * jitter_radius) if near else 1.0
        for axis in range(3):
            now = positions[j, axis] if known else np.nan
            if near:
                now = smoothed[j, axis] + share * (now - smoothed[j, axis])
            velocity = (now - measured[j, axis]) / frames
            error = smoothed[j, axis] - measured[j, axis]
            trend_error = 0.0 if np.isnan(trend[j, axis]) else trend[j, axis] - velocity
            filtered = now + decay[0][0] * error + decay[0][1] * trend_error
            measured[j, axis] = now
            smoothed[j, axis] = now if np.isnan(filtered) else filtered
            trend[j, axis] = velocity + decay[1][0] * error + decay[1][1] * trend_error
            if known:
                extrapolation = 0.0 if np.isnan(trend[j, axis]) else prediction * trend[j, axis]
                output[j, axis] = smoothed[j, axis] + extrapolation
        if known:
            away = _distance(output[j], positions[j])
            if away > widen * max_deviation:  # moved to the sphere around the measurement
                for axis in range(3):
                    offset = output[j, axis] - positions[j, axis]
                    output[j, axis] = positions[j, axis] + widen * max_deviation / away * offset


@compiled(inner=True)
def _distance(a, b):
    return np.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


def _decay(alpha: float, gamma: float, frames: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the rows of Aⁿ for n = frames, which maps the errors (e, u) to those after that many frames.

    Cayley-Hamilton with the eigenvalues λ and μ of A: Aⁿ = μⁿ I + (λⁿ − μⁿ)/(λ − μ) (A − μ I). A has determinant
    1 − β ≥ 0 and trace 2 − β − γβ ≥ 0, so no eigenvalue is a negative real number and the power is real.
    """
    if alpha == 1.0:
        # p̃ is the measurement and e is 0, so only the trend's column counts; for γ = 1 the first has no root
        return (0.0, 0.0), (0.0, (1.0 - gamma) ** frames)
    determinant = 1.0 - alpha
    half_trace = (1.0 + determinant - gamma * alpha) / 2.0
    large = half_trace + cmath.sqrt(half_trace**2 - determinant + 0j)
    small = determinant / large
    # the quotient by λ − μ is written with x = log(μ/λ), to avoid cancellation if the eigenvalues are nearly equal
    log_ratio = cmath.log(small / large)
    growth = _expm1(frames * log_ratio) / _expm1(log_ratio) if log_ratio != 0 else frames + 0j
    power, slope = small**frames, large ** (frames - 1.0) * growth
    return (
        ((power + slope * (1.0 - alpha - small)).real, (slope * (1.0 - alpha)).real),
        ((slope * -gamma * alpha).real, (power + slope * (1.0 - gamma * alpha - small)).real),
    )


def _expm1(z: complex) -> complex:
    """Return exp(z) − 1 of a complex number, without cancellation near 0."""
    x, y = z.real, z.imag
    return complex(math.expm1(x) * math.cos(y) - 2.0 * math.sin(y / 2.0) ** 2, math.exp(x) * math.sin(y))
