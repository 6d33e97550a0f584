"""Performances made by code: a performer before a Kinect acts each of the paper's poses (Section 4.1).

A performance is a score, a list of moves for each part of the body (`_SCORES`). It is played by a body of constant
bones (`clean`) and then seen through a Kinect (`with_kinect_noise`). Nothing here is random that a seed does not fix.

The numbers in a score are metres as (out, up, forward), *out* away from the middle of the body on either side, or
degrees as (forward, right, turn): bending forward, leaning to the performer's right, turning to the right.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BPoly, CubicSpline, PchipInterpolator
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from capture.body import typical
from capture.clip import SkeletonClip
from capture.skeleton import INFERRED, JOINT_INDEX, JOINTS, LOST, TRACKED

Array = NDArray[np.float64]
Move = tuple[float, float, tuple[float, ...]]
"""From which second to which second a part moves, and where to. Between its moves it holds still."""

FRAME_RATE = 30.0
USER = 1

# --- The body -------------------------------------------------------------------------------------------------------

SIDES = {"left": -1.0, "right": 1.0}
"""Which way is *out* along the sensor's x axis."""

FLOOR = -1.0
"""Height of the floor below a sensor on a table, metres."""
ANKLE_REST = (0.115, 0.09, 0.0)
"""(out, up, forward) of a standing ankle from the point on the floor between the feet."""
HIPS_REST = 1.0
"""Height of `hip_center` above the floor: the knees not quite straight, so that the weight can be shifted."""

SHOULDER = (0.82, -0.57, -0.03)
HIP = (0.74, -0.67, 0.0)
FOOT = (0.15, -0.68, 0.72)
"""Directions, (out, up, forward), of the bones to the shoulders, the hips and the feet, as a Kinect places them."""
NECK = (0.0, 0.99, 0.1)
"""Direction of the bone from between the shoulders to the head."""
ELBOW = (0.3, -0.8, -0.45)
"""To which side an elbow bends, as seen from the chest."""
KNEE_HINGE = (1.0, 0.0, 0.15)
"""Axis of a knee that points a little outward, as seen from the pelvis."""

_REST: dict[str, tuple[float, ...]] = {
    "hips": (0.0, 0.0, 0.0),
    "pelvis": (0.0, 0.0, 0.0),
    "trunk": (0.0, 0.0, 0.0),
    "head": (0.0, 0.0, 0.0),
    "hand_left": (0.11, -0.575, 0.07),
    "hand_right": (0.11, -0.575, 0.07),
    "ankle_left": (0.0, 0.0, 0.0),
    "ankle_right": (0.0, 0.0, 0.0),
    "foot_left": (0.0, 0.0, 0.0),
    "foot_right": (0.0, 0.0, 0.0),
}
"""The parts that a score moves, and the neutral pose in which every performance begins and ends.

hips : metres (right, up, forward) from where the hips stand at rest.
pelvis, trunk, head : degrees (forward, right, turn), the trunk on the pelvis and the head on the trunk.
hand_… : metres (out, up, forward) from its own shoulder, turning with the trunk.
ankle_… : metres (out, up, forward) from where it stands at rest.
foot_… : degrees (forward, right, turn); forward is toes down.
"""


def _played(moves: Sequence[Move], rest: tuple[float, ...], times: Array) -> Array:
    """Return one part's values (T, 3): C², exactly still between moves, with no stop where one move meets the next."""
    keys = [(0.0, rest)]
    for start, end, target in moves:
        if start > keys[-1][0]:
            keys.append((start, keys[-1][1]))
        keys.append((end, target))
    keys.append((float(times[-1]) + 1.0, keys[-1][1]))
    at = np.array([time for time, _ in keys])
    values = np.array([value for _, value in keys])
    # The slopes of a monotone interpolation keep a move from overshooting its end.
    slopes = PchipInterpolator(at, values)(at, 1)
    return BPoly.from_derivatives(at, np.stack([values, slopes, np.zeros_like(values)], axis=1))(times)


def _turned(degrees: Array) -> Rotation:
    """Return the rotations for (T, 3) degrees (forward, right, turn) of a performer who faces the sensor."""
    return Rotation.from_euler("YXZ", -degrees[:, [2, 0, 1]], degrees=True)


def _bone(direction: tuple[float, ...], joint: str) -> Array:
    """Return the bone to a joint, (out, up, forward)."""
    return np.array(direction) / np.linalg.norm(direction) * typical(joint)


def _bent(root: Array, end: Array, upper: float, lower: float, toward: Array) -> Array:
    """Return the joint (T, 3) between two bones from root to end, bent to the side that `toward` points to."""
    along = end - root
    distance = np.linalg.norm(along, axis=1, keepdims=True)
    if np.any(distance >= upper + lower):
        worst = int(np.argmax(distance))
        raise ValueError(f"out of reach by {float(distance[worst, 0]) - upper - lower:.3f} m in frame {worst}")
    along = along / distance
    aside = toward - np.sum(toward * along, axis=1, keepdims=True) * along
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    forward = (distance**2 + upper**2 - lower**2) / (2 * distance)
    return root + forward * along + np.sqrt(upper**2 - forward**2) * aside


def _within_reach(wish: Array, length: float) -> Array:
    """Draw hand positions (T, 3) from the shoulder smoothly in, so that the elbow never locks."""
    distance = np.linalg.norm(wish, axis=1, keepdims=True)
    return wish / (1 + (distance / length) ** 20) ** (1 / 20)


def _posed(parts: Mapping[str, Array], distance: float) -> Array:
    """Return the joints (T, 20, 3), sensor frame, of a performer who stands `distance` metres from the sensor."""
    spot = np.array([0.0, FLOOR, distance])
    ahead = np.array([1.0, 1.0, -1.0])
    pelvis = _turned(parts["pelvis"])
    chest = pelvis * _turned(parts["trunk"])
    skull = chest * _turned(parts["head"])
    up = (0.0, 1.0, 0.0)

    joints = {"hip_center": spot + (parts["hips"] + np.array([0.0, HIPS_REST, 0.0])) * ahead}
    joints["spine"] = joints["hip_center"] + pelvis.apply(_bone(up, "spine"))
    joints["shoulder_center"] = joints["spine"] + chest.apply(_bone(up, "shoulder_center"))
    joints["head"] = joints["shoulder_center"] + skull.apply(_bone(NECK, "head") * ahead)
    for side, sign in SIDES.items():
        out = np.array([sign, 1.0, -1.0])

        shoulder = joints["shoulder_center"] + chest.apply(_bone(SHOULDER, "shoulder") * out)
        forearm = typical("wrist") + typical("hand")
        wish = _within_reach(parts[f"hand_{side}"], typical("elbow") + forearm)
        hand = shoulder + chest.apply(wish * out)
        elbow = _bent(shoulder, hand, typical("elbow"), forearm, chest.apply(np.array(ELBOW) * out))
        joints |= {f"shoulder_{side}": shoulder, f"elbow_{side}": elbow, f"hand_{side}": hand}
        joints[f"wrist_{side}"] = elbow + (hand - elbow) * (typical("wrist") / forearm)

        hip = joints["hip_center"] + pelvis.apply(_bone(HIP, "hip") * out)
        ankle = spot + (parts[f"ankle_{side}"] + np.array(ANKLE_REST)) * out
        hinge = pelvis.apply(np.array(KNEE_HINGE) * [1.0, 1.0, sign])
        knee = _bent(hip, ankle, typical("knee"), typical("ankle"), np.cross(hinge, ankle - hip))
        foot = ankle + _turned(parts[f"foot_{side}"]).apply(_bone(FOOT, "foot") * out)
        joints |= {f"hip_{side}": hip, f"knee_{side}": knee, f"ankle_{side}": ankle, f"foot_{side}": foot}
    return np.stack([joints[name] for name in JOINTS], axis=1)


# --- The scores -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Score:
    """A performance as it is written down.

    Attributes
    ----------
    duration : float
        Seconds.
    moves : mapping
        The moves of the parts of `_REST` in the order of time; parts that are left out rest.
    distance : float
        Metres from the sensor at which the performer begins.
    seed : int
        Of the noise; one with which no joint is lost in the first 0.6 s, from which a puppet is calibrated.
    away : float or None
        Second at which the sensor loses the whole body for a while.
    """

    duration: float
    moves: Mapping[str, Sequence[Move]]
    seed: int
    distance: float = 2.5
    away: float | None = None


_HANG = _REST["hand_left"]
_STILL = (0.0, 0.0, 0.0)


def _kung_fu() -> _Score:
    """Guard stance, a punch with either hand, a high front kick, a wide sweep of the arms, a bow."""
    guard_left, guard_right = (0.03, 0.14, 0.42), (-0.1, 0.08, 0.28)
    palms = (-0.135, -0.14, 0.3)
    return _Score(
        duration=10.4,
        seed=3,
        moves={
            "hips": [
                (0.8, 1.5, (0.0, -0.09, 0.1)),
                (2.0, 2.22, (-0.02, -0.10, 0.16)),
                (2.3, 2.8, (0.0, -0.09, 0.1)),
                (3.0, 3.22, (0.0, -0.10, 0.15)),
                (3.3, 3.8, (-0.05, -0.08, 0.16)),
                (3.9, 4.4, (-0.09, -0.06, 0.22)),
                (5.2, 5.8, (0.0, -0.09, 0.1)),
                (6.1, 6.8, _STILL),
                (8.2, 8.8, (0.0, -0.02, -0.09)),
                (9.2, 9.8, _STILL),
            ],
            "pelvis": [
                (0.9, 1.5, (4.0, 0.0, 14.0)),
                (2.0, 2.22, (6.0, 0.0, -12.0)),
                (2.3, 2.8, (4.0, 0.0, 14.0)),
                (3.0, 3.22, (6.0, 0.0, 16.0)),
                (3.3, 3.8, (4.0, 0.0, 15.0)),
                (4.1, 4.75, (-12.0, 0.0, -8.0)),
                (5.0, 5.8, (4.0, 0.0, 15.0)),
                (6.1, 6.8, _STILL),
                (8.2, 8.9, (24.0, 0.0, 0.0)),
                (9.2, 9.8, _STILL),
            ],
            "trunk": [
                (0.9, 1.5, (5.0, 0.0, 8.0)),
                (1.95, 2.22, (8.0, 0.0, -22.0)),
                (2.3, 2.8, (5.0, 0.0, 8.0)),
                (2.95, 3.22, (8.0, 0.0, 20.0)),
                (3.3, 3.8, (5.0, 0.0, 10.0)),
                (4.1, 4.75, (-8.0, -4.0, 0.0)),
                (5.0, 5.8, (5.0, 0.0, 10.0)),
                (6.1, 6.8, (-4.0, 0.0, 0.0)),
                (7.2, 7.8, _STILL),
                (8.15, 8.85, (26.0, 0.0, 0.0)),
                (9.2, 9.85, _STILL),
            ],
            "head": [
                (0.9, 1.5, (0.0, 0.0, -18.0)),
                (2.0, 2.22, (0.0, 0.0, 25.0)),
                (2.3, 2.8, (0.0, 0.0, -18.0)),
                (3.0, 3.22, (0.0, 0.0, -30.0)),
                (3.3, 3.8, (0.0, 0.0, -22.0)),
                (4.2, 4.75, (14.0, 0.0, 0.0)),
                (5.0, 5.8, (0.0, 0.0, -20.0)),
                (6.1, 6.8, (-8.0, 0.0, 0.0)),
                (7.2, 7.8, _STILL),
                (8.1, 8.7, (20.0, 0.0, 0.0)),
                (9.2, 9.8, _STILL),
            ],
            "hand_left": [
                (0.8, 1.5, guard_left),
                (1.98, 2.22, (0.02, -0.26, 0.12)),
                (2.3, 2.75, guard_left),
                (3.0, 3.24, (0.27, 0.2, 0.54)),
                (3.3, 3.75, guard_left),
                (4.3, 4.75, (0.25, -0.15, 0.3)),
                (5.0, 5.7, guard_left),
                (6.0, 6.4, (0.12, -0.5, 0.12)),
                (6.4, 6.8, (0.58, 0.0, 0.1)),
                (6.8, 7.25, (0.12, 0.58, 0.08)),
                (7.35, 7.95, palms),
                (9.4, 10.0, _HANG),
            ],
            "hand_right": [
                (0.8, 1.5, guard_right),
                (1.98, 2.22, (0.25, 0.2, 0.55)),
                (2.3, 2.75, guard_right),
                (2.98, 3.22, (0.02, -0.26, 0.1)),
                (3.3, 3.75, guard_right),
                (4.3, 4.75, (0.3, -0.3, 0.05)),
                (5.0, 5.7, guard_right),
                (6.0, 6.4, (0.12, -0.5, 0.12)),
                (6.4, 6.8, (0.58, 0.0, 0.1)),
                (6.8, 7.25, (0.12, 0.58, 0.08)),
                (7.35, 7.95, palms),
                (9.4, 10.0, _HANG),
            ],
            "ankle_left": [
                (0.9, 1.2, (0.03, 0.08, 0.15)),
                (1.2, 1.5, (0.05, 0.0, 0.3)),
                (6.1, 6.45, (0.03, 0.07, 0.15)),
                (6.45, 6.8, _STILL),
            ],
            "ankle_right": [
                (4.1, 4.55, (-0.03, 0.5, 0.34)),
                (4.55, 4.8, (-0.08, 1.05, 1.0)),
                (4.85, 5.15, (-0.03, 0.5, 0.4)),
                (5.15, 5.7, _STILL),
            ],
            "foot_right": [
                (4.1, 4.5, (20.0, 0.0, 0.0)),
                (4.5, 4.8, (-55.0, 0.0, 0.0)),
                (4.85, 5.2, (10.0, 0.0, 0.0)),
                (5.2, 5.7, _STILL),
            ],
        },
    )


def _lean() -> _Score:
    """Lean forward, to the right and to the left with small arms as of a dinosaur, and look about."""
    paw, paw_up = (0.02, -0.27, 0.24), (0.03, -0.16, 0.3)
    return _Score(
        duration=8.4,
        seed=5,
        moves={
            "hips": [
                (0.8, 1.7, (0.0, -0.04, -0.13)),
                (2.0, 2.7, _STILL),
                (2.8, 3.4, (-0.07, -0.02, 0.0)),
                (3.6, 4.4, (0.07, -0.02, 0.0)),
                (4.7, 5.3, _STILL),
            ],
            "pelvis": [
                (0.8, 1.7, (22.0, 0.0, 0.0)),
                (2.0, 2.7, _STILL),
                (2.8, 3.4, (0.0, 8.0, 0.0)),
                (3.6, 4.4, (0.0, -8.0, 0.0)),
                (4.7, 5.3, _STILL),
            ],
            "trunk": [
                (0.8, 1.7, (33.0, 0.0, 0.0)),
                (2.0, 2.7, _STILL),
                (2.8, 3.4, (3.0, 27.0, 6.0)),
                (3.6, 4.4, (3.0, -27.0, -6.0)),
                (4.7, 5.3, _STILL),
                (5.5, 5.95, (0.0, 0.0, 12.0)),
                (6.1, 6.8, (0.0, 0.0, -12.0)),
                (6.9, 7.4, _STILL),
            ],
            "head": [
                (0.8, 1.6, (-28.0, 0.0, 0.0)),
                (2.0, 2.6, _STILL),
                (2.8, 3.4, (0.0, -8.0, 0.0)),
                (3.6, 4.4, (0.0, 8.0, 0.0)),
                (4.7, 5.3, _STILL),
                (5.4, 5.9, (6.0, 12.0, 45.0)),
                (6.1, 6.8, (-12.0, -12.0, -45.0)),
                (6.9, 7.4, _STILL),
            ],
            **{
                f"hand_{side}": [
                    (0.8, 1.6, paw),
                    *((start, start + 0.28, place) for start, place in paws),
                    (7.0, 7.8, _HANG),
                ]
                for side, paws in {
                    "left": ((1.7, paw_up), (2.0, paw), (5.35, paw_up), (5.65, paw), (6.2, paw_up), (6.5, paw)),
                    "right": ((1.85, paw_up), (2.15, paw), (5.5, paw_up), (5.8, paw), (6.35, paw_up), (6.65, paw)),
                }.items()
            },
        },
    )


def _bow() -> _Score:
    """Lower the left hand (a Pegasus' head) to the knee and raise it, swish the right (its tail), paw with the feet."""
    head_up = (-0.02, 0.0, 0.47)
    return _Score(
        duration=10.2,
        seed=7,
        moves={
            "hips": [
                (1.7, 3.2, (0.0, -0.17, -0.12)),
                (3.6, 4.8, _STILL),
                (6.7, 7.0, (-0.075, -0.02, 0.0)),
                (7.3, 7.65, (0.075, -0.02, 0.0)),
                (7.95, 8.3, (-0.075, -0.02, 0.0)),
                (8.6, 8.95, (0.075, -0.02, 0.0)),
                (9.25, 9.55, _STILL),
            ],
            "pelvis": [(1.7, 3.2, (24.0, 0.0, 0.0)), (3.6, 4.8, _STILL)],
            "trunk": [
                (1.6, 3.2, (36.0, 0.0, 12.0)),
                (3.6, 4.8, _STILL),
                (6.7, 7.0, (0.0, 6.0, 0.0)),
                (7.3, 7.65, (0.0, -6.0, 0.0)),
                (7.95, 8.3, (0.0, 6.0, 0.0)),
                (8.6, 8.95, (0.0, -6.0, 0.0)),
                (9.25, 9.55, _STILL),
            ],
            "head": [(1.6, 3.1, (12.0, 0.0, 0.0)), (3.6, 4.8, _STILL)],
            "hand_left": [
                (0.8, 1.5, head_up),
                (1.7, 3.2, (0.0, -0.42, 0.4)),
                (3.6, 4.8, head_up),
                (8.9, 9.7, _HANG),
            ],
            "hand_right": [
                (1.7, 3.2, (0.16, -0.42, 0.25)),
                (3.6, 4.5, (0.1, -0.45, 0.02)),
                (4.6, 4.95, (0.47, -0.27, 0.02)),
                (4.95, 5.3, (0.02, -0.42, 0.15)),
                (5.3, 5.65, (0.5, -0.2, 0.02)),
                (5.65, 6.0, (0.05, -0.4, 0.15)),
                (6.0, 6.5, (0.42, 0.25, 0.05)),
                (6.6, 7.3, _HANG),
            ],
            "ankle_right": [
                (6.95, 7.15, (0.0, 0.22, 0.14)),
                (7.15, 7.35, _STILL),
                (8.25, 8.45, (0.0, 0.22, 0.14)),
                (8.45, 8.65, _STILL),
            ],
            "ankle_left": [
                (7.6, 7.8, (0.0, 0.22, 0.14)),
                (7.8, 8.0, _STILL),
                (8.9, 9.1, (0.0, 0.22, 0.14)),
                (9.1, 9.3, _STILL),
            ],
            "foot_right": [
                (6.95, 7.1, (25.0, 0.0, 0.0)),
                (7.15, 7.35, _STILL),
                (8.25, 8.4, (25.0, 0.0, 0.0)),
                (8.45, 8.65, _STILL),
            ],
            "foot_left": [
                (7.6, 7.75, (25.0, 0.0, 0.0)),
                (7.8, 8.0, _STILL),
                (8.9, 9.05, (25.0, 0.0, 0.0)),
                (9.1, 9.3, _STILL),
            ],
        },
    )


def _bark() -> _Score:
    """Bark three times, wag the right foot, bark three times: the hands are the jaws, head and trunk jerk along."""
    barks = (1.7, 2.15, 2.6, 4.9, 5.35, 5.8)

    def barking(ready: tuple[float, ...], open_: tuple[float, ...]) -> list[Move]:
        return [move for t in barks for move in ((t, t + 0.15, open_), (t + 0.17, t + 0.4, ready))]

    crouch, lower, upper = (0.0, -0.12, 0.0), (-0.13, -0.3, 0.38), (-0.13, -0.22, 0.4)
    wags = [(3.45 + 0.2 * k, 3.65 + 0.2 * k, (0.2 if k % 2 == 0 else 0.0, 0.1, -0.05)) for k in range(5)]
    return _Score(
        duration=8.2,
        seed=8,
        moves={
            "hips": [
                (0.8, 1.4, crouch),
                *barking(crouch, (0.0, -0.01, 0.08))[:6],
                (3.05, 3.35, (-0.08, -0.08, 0.0)),
                (4.55, 4.85, crouch),
                *barking(crouch, (0.0, -0.01, 0.08))[6:],
                (6.7, 7.3, _STILL),
            ],
            "trunk": [
                (0.8, 1.4, (12.0, 0.0, 0.0)),
                *barking((12.0, 0.0, 0.0), (24.0, 0.0, 0.0)),
                (6.7, 7.3, _STILL),
            ],
            "head": [
                (0.8, 1.4, (8.0, 0.0, 0.0)),
                *barking((8.0, 0.0, 0.0), (-32.0, 0.0, 0.0)),
                (6.7, 7.3, _STILL),
            ],
            "hand_left": [(0.8, 1.4, lower), *barking(lower, (-0.13, -0.37, 0.36)), (6.7, 7.4, _HANG)],
            "hand_right": [(0.8, 1.4, upper), *barking(upper, (-0.13, 0.08, 0.42)), (6.7, 7.4, _HANG)],
            "ankle_right": [(3.2, 3.45, (0.0, 0.1, -0.05)), *wags, (4.45, 4.65, _STILL)],
            "foot_right": [(3.2, 3.45, (20.0, 0.0, 0.0)), (4.45, 4.65, _STILL)],
        },
    )


def _walk() -> _Score:
    """Walk three steps towards the sensor, wave with the right hand, step aside and back again."""
    swing = [(0.95, 1.5, -1), (1.5, 2.1, 1), (2.1, 2.7, -1)]

    def swung(sign: int) -> list[Move]:
        return [(start, end, (0.12, -0.55, 0.06 + 0.16 * sign * way)) for start, end, way in swing]

    def step(start: float, before: float, after: float) -> list[Move]:
        middle = (before + after) / 2
        return [(start, start + 0.3, (0.0, 0.11, middle)), (start + 0.3, start + 0.6, (0.0, 0.0, after))]

    return _Score(
        duration=9.2,
        distance=3.25,
        seed=9,
        away=5.9,
        moves={
            "hips": [
                (0.8, 1.3, (-0.04, -0.045, 0.1)),
                (1.3, 1.9, (0.04, -0.045, 0.42)),
                (1.9, 2.5, (-0.04, -0.045, 0.74)),
                (2.5, 3.2, (0.0, 0.0, 0.96)),
                (5.8, 6.35, (0.2, -0.05, 0.96)),
                (6.35, 6.9, (0.36, 0.0, 0.96)),
                (7.1, 7.65, (0.16, -0.05, 0.96)),
                (7.65, 8.2, (0.0, 0.0, 0.96)),
            ],
            "pelvis": [
                (0.95, 1.5, (2.0, 0.0, -7.0)),
                (1.5, 2.1, (2.0, 0.0, 7.0)),
                (2.1, 2.7, (2.0, 0.0, -7.0)),
                (2.7, 3.2, _STILL),
            ],
            "trunk": [
                (0.95, 1.5, (3.0, 0.0, 11.0)),
                (1.5, 2.1, (3.0, 0.0, -11.0)),
                (2.1, 2.7, (3.0, 0.0, 11.0)),
                (2.7, 3.2, _STILL),
                (3.4, 3.9, (0.0, -5.0, 0.0)),
                (5.3, 5.8, _STILL),
            ],
            "head": [(3.4, 3.9, (0.0, 8.0, 0.0)), (5.3, 5.8, _STILL)],
            "hand_left": [*swung(-1), (2.7, 3.2, _HANG)],
            "hand_right": [
                *swung(1),
                (2.7, 3.2, _HANG),
                (3.3, 3.65, (0.22, -0.2, 0.38)),
                (3.65, 3.95, (0.3, 0.33, 0.12)),
                (3.95, 4.15, (0.06, 0.38, 0.14)),
                (4.15, 4.4, (0.34, 0.31, 0.12)),
                (4.4, 4.65, (0.06, 0.38, 0.14)),
                (4.65, 4.9, (0.34, 0.31, 0.12)),
                (4.9, 5.15, (0.1, 0.38, 0.14)),
                (5.15, 5.45, (0.15, -0.15, 0.4)),
                (5.45, 5.9, _HANG),
            ],
            "ankle_right": [
                *step(0.95, 0.0, 0.32),
                *step(2.15, 0.32, 0.96),
                (5.85, 6.1, (0.18, 0.08, 0.96)),
                (6.1, 6.35, (0.36, 0.0, 0.96)),
                (7.75, 8.0, (0.18, 0.08, 0.96)),
                (8.0, 8.25, (0.0, 0.0, 0.96)),
            ],
            "ankle_left": [
                *step(1.55, 0.0, 0.64),
                *step(2.75, 0.64, 0.96),
                (6.45, 6.7, (-0.18, 0.08, 0.96)),
                (6.7, 6.95, (-0.36, 0.0, 0.96)),
                (7.15, 7.4, (-0.18, 0.08, 0.96)),
                (7.4, 7.65, (0.0, 0.0, 0.96)),
            ],
        },
    )


_SCORES: dict[str, Callable[[], _Score]] = {
    "kung_fu": _kung_fu,
    "lean": _lean,
    "bow": _bow,
    "bark": _bark,
    "walk": _walk,
}


def clean(name: str) -> SkeletonClip:
    """Return a performance as it was done, before the sensor saw it.

    Bone lengths (`capture.body.TYPICAL_BONES`) are constant, standing feet do not move and all motion is C².

    Parameters
    ----------
    name : str
        A key of `PERFORMANCES`.

    Returns
    -------
    SkeletonClip
        Of user 1, 30 frames a second from second 0, every joint tracked.
    """
    score = _SCORES[name]()
    times = np.arange(round(score.duration * FRAME_RATE) + 1) / FRAME_RATE
    parts = {part: _played(score.moves.get(part, ()), rest, times) for part, rest in _REST.items()}
    positions = _posed(parts, score.distance)
    return SkeletonClip("demo", USER, times, positions, np.full(positions.shape[:2], TRACKED, dtype=np.float32))


# --- The sensor -----------------------------------------------------------------------------------------------------

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

    - Clock: 30 Hz with jitter (`TICK_JITTER`); about one frame in a hundred is missing.
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
        With every joint known, at an even frame rate.
    seed : int
        The same seed gives the same clip.
    away : float, optional
        Second from which the whole body is lost for `AWAY` seconds.

    Returns
    -------
    SkeletonClip
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
    slow = lfilter([unit_variance], [1.0, -2 * keep, keep**2], steps, axis=0)[settle:] * drift[:, None]
    return (white + slow) * (true[..., 2:] / NOMINAL_DEPTH) ** 2 * np.array([1.0, 1.0, DEPTH_FACTOR])


def _recorded(name: str) -> SkeletonClip:
    score = _SCORES[name]()
    return with_kinect_noise(clean(name), score.seed, score.away)


PERFORMANCES: dict[str, Callable[[], SkeletonClip]] = {name: partial(_recorded, name) for name in _SCORES}
"""The performances as a Kinect recorded them, each made when it is called for, by the same name as in `clean`."""
