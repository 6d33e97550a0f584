"""Moves of the example performances: the poses of the paper (Section 4.1), in the units of `performer.REST`."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from .performer import REST, Move


@dataclass(frozen=True)
class Script:
    """The moves of a performance.

    Attributes
    ----------
    duration : float
        Seconds.
    moves : mapping
        Moves of the parts of `REST` in order of time; omitted parts rest.
    distance : float
        Initial distance of the performer from the sensor, in metres.
    seed : int
        Seed of the noise, with which no joint is lost in the first 0.6 s, because they calibrate the performer.
    away : float or None
        Time at which the sensor loses the whole body for a moment, in seconds.
    """

    duration: float
    moves: Mapping[str, Sequence[Move]]
    seed: int
    distance: float = 2.5
    away: float | None = None


_HANG = REST["hand_left"]
_STILL = (0.0, 0.0, 0.0)


def _kung_fu() -> Script:
    """Guard stance, a punch with either hand, a high front kick, a wide sweep of the arms, a bow."""
    guard_left, guard_right = (0.03, 0.14, 0.42), (-0.1, 0.08, 0.28)
    palms = (-0.135, -0.14, 0.3)
    return Script(
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


def _lean() -> Script:
    """Lean forwards, to the right and to the left with bent arms like a dinosaur, and look around."""
    paw, paw_up = (0.02, -0.27, 0.24), (0.03, -0.16, 0.3)
    return Script(
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


def _bow() -> Script:
    """Lower the left hand (a Pegasus' head) to the knee and raise it, swish the right (its tail), paw with the feet."""
    head_up = (-0.02, 0.0, 0.47)
    return Script(
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


def _bark() -> Script:
    """Bark three times, wag the right foot, bark three times: the hands are the jaws, head and trunk jerk along."""
    barks = (1.7, 2.15, 2.6, 4.9, 5.35, 5.8)

    def barking(ready: tuple[float, ...], open_: tuple[float, ...]) -> list[Move]:
        return [move for t in barks for move in ((t, t + 0.15, open_), (t + 0.17, t + 0.4, ready))]

    crouch, lower, upper = (0.0, -0.12, 0.0), (-0.13, -0.3, 0.38), (-0.13, -0.22, 0.4)
    wags = [(3.45 + 0.2 * k, 3.65 + 0.2 * k, (0.2 if k % 2 == 0 else 0.0, 0.1, -0.05)) for k in range(5)]
    return Script(
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


def _walk() -> Script:
    """Walk three steps towards the sensor, wave with the right hand, step aside and back again."""
    swing = [(0.95, 1.5, -1), (1.5, 2.1, 1), (2.1, 2.7, -1)]

    def swung(sign: int) -> list[Move]:
        return [(start, end, (0.12, -0.55, 0.06 + 0.16 * sign * way)) for start, end, way in swing]

    def step(start: float, before: float, after: float) -> list[Move]:
        middle = (before + after) / 2
        return [(start, start + 0.3, (0.0, 0.11, middle)), (start + 0.3, start + 0.6, (0.0, 0.0, after))]

    return Script(
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


SCRIPTS: dict[str, Callable[[], Script]] = {
    "kung_fu": _kung_fu,
    "lean": _lean,
    "bow": _bow,
    "bark": _bark,
    "walk": _walk,
}
"""Functions that return the moves of the performances, by name."""
