"""Generated performers, and virtual sensors with known poses that record them."""

from dataclasses import replace

import numpy as np
from puppetline.examples.performances import clean
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from capture.clip import SkeletonClip
from capture.sensor_pose import SensorPose
from capture.skeleton import INFERRED, JOINT_INDEX, OPPOSITE, TRACKED

LEFT, RIGHT = JOINT_INDEX["shoulder_left"], JOINT_INDEX["shoulder_right"]
HIP_LEFT, HIP_RIGHT = JOINT_INDEX["hip_left"], JOINT_INDEX["hip_right"]
TRUNK = [JOINT_INDEX[name] for name in ("hip_center", "spine", "shoulder_center")]

JITTER, DRIFT, GUESS = 0.003, 0.01, 0.08
"""Noise in metres on each axis: from frame to frame, slow, and slow for a joint that is hidden behind the body."""


def turning(clip, begin, end):
    """Return a clip whose performer turns around once on the spot."""
    part = np.clip((clip.times - begin) / (end - begin), 0, 1)
    place = clip.positions[:, :1] * [1, 0, 1]
    return headed(clip, 2 * np.pi * part**2 * (3 - 2 * part), place)


def headed(clip, angle, place):
    """Return a clip whose performer is turned to the left by angles (T,), at positions (T, 1, 3) on the floor."""
    turns = Rotation.from_euler("y", angle[:, None]).as_matrix()
    positions = np.einsum("tij,tkj->tki", turns, clip.positions - clip.positions[:, :1] * [1, 0, 1]) + place
    return replace(clip, positions=positions)


def facing(positions):
    """Return the direction (T, 3) in which the chest points."""
    across = positions[:, RIGHT] - positions[:, LEFT] + positions[:, HIP_RIGHT] - positions[:, HIP_LEFT]
    forward = np.cross([0.0, 1.0, 0.0], across)
    return forward / np.linalg.norm(forward, axis=1, keepdims=True)


def hidden(positions):
    """Return which joints (T, 20) the trunk hides from a sensor at the origin: joints behind it and near its axis."""
    trunk = positions[:, TRUNK].mean(axis=1, keepdims=True)
    away = np.linalg.norm(positions[..., ::2], axis=2) - np.linalg.norm(trunk[..., ::2], axis=2)
    direction = trunk[..., ::2] / np.linalg.norm(trunk[..., ::2], axis=2, keepdims=True)
    beside = np.abs(positions[..., 0] * direction[..., 1] - positions[..., 2] * direction[..., 0])
    return (away > 0.06) & (beside < 0.2)


class VirtualSensor:
    """A sensor with a pose and a clock that records a clip in common coordinates.

    A hidden joint is inferred with an error of 8 cm. From behind, left and right are swapped.
    """

    def __init__(self, pose, clock=0.0, seed=None, swaps=True):
        self.pose, self.clock, self.seed, self.swaps = pose, clock, seed, swaps

    def record(self, clip, phase=0.0):
        times = clip.times[:-1] + phase
        mixed = (phase / np.diff(clip.times))[:, None, None]
        truth = (1 - mixed) * clip.positions[:-1] + mixed * clip.positions[1:]
        positions = (truth - self.pose.position) @ self.pose.rotation
        confidence = np.full(positions.shape[:2], TRACKED, dtype=np.float32)
        if self.seed is not None:
            random = np.random.default_rng(self.seed)
            behind = hidden(positions)
            confidence[behind] = INFERRED
            slow = lfilter([1 - 0.9], [1, -0.9], random.standard_normal((len(times) + 60, 20, 3)), axis=0)[60:]
            slow /= slow.std()
            positions += JITTER * random.standard_normal(positions.shape)
            positions += np.where(behind, GUESS, DRIFT)[..., None] * slow
        if self.swaps:
            back = (facing(truth) * (truth[:, 0] - self.pose.position)).sum(axis=1) > 0
            positions[back] = positions[back][:, OPPOSITE]
            confidence[back] = confidence[back][:, OPPOSITE]
        return SkeletonClip("virtual", clip.user, times + self.clock, positions, confidence)


def part(clip, start, end):
    """Return some frames of a clip."""
    return SkeletonClip("", clip.user, *(each[start:end] for each in (clip.times, clip.positions, clip.confidence)))


def truth(clip, times):
    """Return the true positions of the joints (T, 20, 3) at times (T,)."""
    flat = clip.positions.reshape(len(clip.times), -1)
    return np.stack([np.interp(times, clip.times, column) for column in flat.T], axis=1).reshape(-1, 20, 3)


WALK, KUNG_FU = clean("walk"), clean("kung_fu")
TURN = turning(WALK, 2.0, 7.0)
"""A performer who walks and turns around once."""

HERE = SensorPose(np.eye(3), np.zeros(3))
"""The pose of the first sensor."""
BESIDE = SensorPose.of_degrees(4.0, -75.0, 2.0, np.array([2.4, 0.3, 1.9]))
"""On the performer's right, facing the performer."""
ACROSS = SensorPose.of_degrees(3.0, 75.0, -1.0, np.array([-2.4, 0.4, 2.0]))
"""On the performer's left, facing the performer."""
BEHIND = SensorPose.of_degrees(8.0, 170.0, -1.0, np.array([0.4, 0.5, 5.5]))
