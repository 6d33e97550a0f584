"""Responses of the Kinect SDK's presets to a step, a ramp and noise at 30 Hz: the table of docs/smoothing.md."""

import numpy as np
from numpy.typing import NDArray

from capture.skeleton import JOINTS
from capture.smoothing import FRAMES_PER_SECOND, JointFilter, Smoothing

PRESETS = {
    "default": Smoothing(alpha=0.5, gamma=0.5, prediction=0.5, jitter_radius=0.05, max_deviation=0.04),
    "smooth": Smoothing(alpha=0.5, gamma=0.1, prediction=0.5, jitter_radius=0.1, max_deviation=0.1),
    "very smooth": Smoothing(alpha=0.3, gamma=0.3, prediction=1.0, jitter_radius=1.0, max_deviation=1.0),
    "Puppetline": Smoothing(),
}
FRAMES = 3000
STEP = 0.3  # metres
SPEED = 1.0  # metres per second
NOISE = 0.005  # metres, standard deviation per axis


def run(smoothing: Smoothing, positions: NDArray[np.float64]) -> NDArray[np.float64]:
    joint_filter = JointFilter(smoothing)
    confidence = np.ones(len(JOINTS), dtype=np.float32)
    return np.array([joint_filter.step(k / FRAMES_PER_SECOND, frame, confidence) for k, frame in enumerate(positions)])


def along_x(x: NDArray[np.float64]) -> NDArray[np.float64]:
    return x[:, None, None] * np.array([1.0, 0.0, 0.0]) * np.ones((1, len(JOINTS), 1))


def main() -> None:
    frame = np.arange(FRAMES)
    step = along_x(np.where(frame < 10, 0.0, STEP))
    ramp = along_x(np.maximum(frame - 10, 0) * SPEED / FRAMES_PER_SECOND)
    noise = np.random.default_rng(0).normal(scale=NOISE, size=(FRAMES, len(JOINTS), 3))
    print("| preset | 90 % of a 0.3 m step, ms | overshoot, mm | lag at 1 m/s, ms | noise left of 5 mm, mm |")
    print("| --- | --- | --- | --- | --- |")
    for name, smoothing in PRESETS.items():
        after_step = run(smoothing, step)[10:, 0, 0]
        settled = np.argmax(after_step >= 0.9 * STEP) / FRAMES_PER_SECOND
        lag = (ramp - run(smoothing, ramp))[-1, 0, 0] / SPEED
        left = run(smoothing, noise)[30:].std()
        overshoot = after_step.max() - STEP
        print(f"| {name} | {settled * 1e3:.0f} | {overshoot * 1e3:.0f} | {lag * 1e3:.0f} | {left * 1e3:.2f} |")


if __name__ == "__main__":
    main()
