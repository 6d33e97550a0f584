"""Moves of the example performances, in the units of `performer.REST`."""

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


def _steps(
    start: float, seconds: float, lift: float, stops: Sequence[float]
) -> tuple[list[Move], dict[str, list[Move]]]:
    """Return the moves of the hips, and of the ankles, of steps with the right and the left foot in turn.

    Parameters
    ----------
    start, seconds : float
        Time of the first step, and time of a step.
    lift : float
        Height of a step, in metres.
    stops : sequence of float
        Where each step ends, in metres ahead of the initial position.
    """
    hips: list[Move] = []
    ankles: dict[str, list[Move]] = {"ankle_right": [], "ankle_left": []}
    places = dict.fromkeys(ankles, 0.0)
    for step, stop in enumerate(stops):
        foot, aside = ("ankle_left", 0.05) if step % 2 else ("ankle_right", -0.05)
        begin, end = start + step * seconds, start + (step + 1) * seconds
        half = (begin + end) / 2
        ankles[foot] += [(begin, half, (0.0, lift, (places[foot] + stop) / 2)), (half, end, (0.0, 0.0, stop))]
        places[foot] = stop
        hips.append((begin, end - 0.05, (aside, -0.045, sum(places.values()) / 2)))
    hips.append((end, end + 0.5, (0.0, 0.0, sum(places.values()) / 2)))
    return hips, ankles


def _roar() -> Script:
    """Stomp towards the sensor, roar with raised claws and the body bent forward, and look around."""
    hips, ankles = _steps(start=0.9, seconds=0.62, lift=0.2, stops=(0.3, 0.6, 0.9, 0.9))
    claws, raised = (0.05, -0.2, 0.36), (0.2, 0.12, 0.42)
    arm = [(3.8, 4.3, claws), (4.5, 4.8, raised), (6.1, 6.8, _HANG)]
    return Script(
        duration=9.4,
        distance=3.25,
        seed=5,
        moves={
            "hips": [
                *hips,
                (3.9, 4.4, (0.0, -0.03, 0.82)),
                (4.5, 4.9, (0.0, -0.06, 0.95)),
                (6.2, 6.7, (0.0, 0.0, 0.9)),
            ],
            "pelvis": [(4.5, 4.9, (6.0, 0.0, 0.0)), (6.2, 6.7, _STILL)],
            "trunk": [
                (1.0, 1.5, (0.0, 6.0, 8.0)),
                (1.6, 2.1, (0.0, -6.0, -8.0)),
                (2.2, 2.8, (0.0, 6.0, 8.0)),
                (2.9, 3.4, _STILL),
                (3.9, 4.4, (-14.0, 0.0, 0.0)),
                (4.5, 4.9, (16.0, 0.0, 0.0)),
                (5.1, 5.4, (12.0, 0.0, 16.0)),
                (5.5, 5.9, (12.0, 0.0, -16.0)),
                (6.2, 6.8, _STILL),
                (7.0, 7.4, (0.0, 14.0, 12.0)),
                (7.6, 8.1, (0.0, -14.0, -12.0)),
                (8.2, 8.8, _STILL),
            ],
            "head": [
                (3.9, 4.4, (6.0, 0.0, 0.0)),
                (4.5, 4.9, (-28.0, 0.0, 0.0)),
                (6.2, 6.8, _STILL),
                (7.0, 7.4, (0.0, 0.0, 40.0)),
                (7.6, 8.1, (0.0, 0.0, -40.0)),
                (8.2, 8.8, _STILL),
            ],
            "hand_left": arm,
            "hand_right": arm,
            **ankles,
        },
    )


def _rear() -> Script:
    """Trot towards the sensor with quick steps, raise both arms, beat them like wings, and nod."""
    hips, ankles = _steps(start=0.9, seconds=0.42, lift=0.14, stops=(0.25, 0.5, 0.75, 0.96, 0.96))
    high, wide, low = (0.3, 0.55, 0.12), (0.55, 0.1, 0.15), (0.62, -0.12, 0.15)
    beats = [
        move for start in (5.4, 6.2, 7.0) for move in ((start, start + 0.4, high), (start + 0.4, start + 0.8, low))
    ]
    arm = [(3.9, 4.5, high), (4.9, 5.3, wide), *beats, (7.9, 8.6, _HANG)]
    return Script(
        duration=9.8,
        distance=3.25,
        seed=8,
        moves={
            "hips": [*hips, (3.9, 4.5, (0.0, 0.0, 0.9)), (4.9, 5.5, (0.0, 0.0, 0.96))],
            "trunk": [(3.9, 4.5, (-10.0, 0.0, 0.0)), (4.9, 5.5, _STILL)],
            "head": [
                (3.9, 4.5, (-14.0, 0.0, 0.0)),
                (4.9, 5.5, _STILL),
                (8.4, 8.8, (16.0, 0.0, 0.0)),
                (8.9, 9.3, _STILL),
            ],
            "hand_left": arm,
            "hand_right": arm,
            **ankles,
        },
    )


def _bark() -> Script:
    """Do a dog's tricks: walk, sit, give the right paw, bark three times, get up, and wag with the trunk."""
    hips, ankles = _steps(start=0.95, seconds=0.6, lift=0.11, stops=(0.32, 0.64, 0.64))
    bark_times, wag_times = (6.5, 6.95, 7.4), [8.9 + 0.32 * k for k in range(6)]

    def barking(open_: tuple[float, ...], closed: tuple[float, ...]) -> list[Move]:
        return [move for t in bark_times for move in ((t, t + 0.15, open_), (t + 0.17, t + 0.4, closed))]

    def wagging(*target: float) -> list[Move]:
        """Alternate between a value and its mirror image."""
        forward, right, turn = target
        return [
            *((t, t + 0.32, (forward, right * (-1) ** k, turn * (-1) ** k)) for k, t in enumerate(wag_times)),
            (10.9, 11.2, _STILL),
        ]

    upright, paw = (-4.0, 0.0, 0.0), (0.05, 0.02, 0.45)
    return Script(
        duration=11.6,
        distance=3.25,
        seed=9,
        moves={
            "hips": [
                *hips,
                (3.3, 4.0, (0.0, -0.36, 0.48)),
                (8.0, 8.7, (0.0, 0.0, 0.64)),
                *((t, t + 0.32, (0.06 * (-1) ** k, -0.01, 0.64)) for k, t in enumerate(wag_times)),
                (10.9, 11.2, (0.0, 0.0, 0.64)),
            ],
            "trunk": [
                (3.3, 4.0, upright),
                *barking((8.0, 0.0, 0.0), upright),
                (8.0, 8.7, _STILL),
                *wagging(4.0, -16.0, 0.0),
            ],
            "head": [
                (4.2, 4.7, (0.0, 12.0, 10.0)),
                (5.7, 6.1, _STILL),
                *barking((-28.0, 0.0, 0.0), _STILL),
                *wagging(0.0, 12.0, 0.0),
            ],
            "hand_right": [(4.2, 4.8, paw), (4.9, 5.1, (0.05, -0.06, 0.44)), (5.1, 5.3, paw), (5.6, 6.2, _HANG)],
            "hand_left": barking((0.05, -0.25, 0.5), _HANG),
            **ankles,
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


def _train() -> Script:
    """Train a dog: wave to it, let it sit, hold out a hand for its paw, start back from its barks, cheer and clap."""
    wave, aside, point = (0.3, 0.33, 0.12), (0.06, 0.38, 0.14), (0.02, -0.2, 0.54)
    held_out, palm, cheer = (-0.02, 0.16, 0.51), (0.1, 0.02, 0.3), (0.22, 0.52, 0.1)
    apart, together = (0.02, -0.1, 0.4), (-0.17, -0.1, 0.42)
    startled = [(6.5, 6.7, palm), (7.4, 7.8, _HANG)]
    cheering = [(7.8, 8.15, (0.5, -0.1, 0.2)), (8.15, 8.5, cheer), (8.6, 8.85, (0.36, 0.44, 0.1)), (8.9, 9.35, apart)]
    clapping = [
        move
        for start in (9.35, 9.75, 10.15)
        for move in ((start, start + 0.18, together), (start + 0.2, start + 0.4, apart))
    ]
    both = [*startled, *cheering, *clapping, (10.6, 11.1, _HANG)]
    return Script(
        duration=11.6,
        seed=9,
        moves={
            "hips": [
                (4.1, 4.7, (0.0, -0.16, -0.06)),
                (5.6, 6.2, _STILL),
                (6.5, 6.75, (0.0, -0.04, -0.07)),
                (7.5, 7.9, _STILL),
                (8.0, 8.25, (0.0, -0.07, 0.0)),
                (8.25, 8.5, _STILL),
                (8.5, 8.75, (0.0, -0.07, 0.0)),
                (8.75, 9.0, _STILL),
            ],
            "pelvis": [(4.1, 4.7, (14.0, 0.0, 0.0)), (5.6, 6.2, _STILL)],
            "trunk": [
                (0.9, 1.3, (0.0, -5.0, 8.0)),
                (2.2, 2.6, _STILL),
                (2.9, 3.3, (8.0, 0.0, -10.0)),
                (4.1, 4.7, (26.0, 0.0, -8.0)),
                (5.6, 6.2, _STILL),
                (6.5, 6.7, (-12.0, 0.0, 8.0)),
                (7.5, 7.9, _STILL),
                (8.0, 8.4, (-6.0, 0.0, 0.0)),
                (9.0, 9.4, (8.0, 0.0, 0.0)),
                (10.6, 11.1, _STILL),
            ],
            "head": [
                (0.9, 1.3, (4.0, 8.0, -10.0)),
                (2.9, 3.3, (12.0, 0.0, -6.0)),
                (4.1, 4.7, (-6.0, 10.0, -6.0)),
                (5.6, 6.2, (6.0, 0.0, -8.0)),
                (6.5, 6.7, (14.0, 0.0, -10.0)),
                (8.0, 8.4, (-8.0, 0.0, 0.0)),
                (9.0, 9.4, (8.0, 10.0, -8.0)),
                (10.6, 11.1, _STILL),
            ],
            "hand_left": both,
            "hand_right": [
                (0.85, 1.25, wave),
                (1.25, 1.45, aside),
                (1.45, 1.65, wave),
                (1.65, 1.85, aside),
                (1.85, 2.05, wave),
                (2.1, 2.6, _HANG),
                (2.8, 3.2, point),
                (3.3, 3.45, (0.02, -0.12, 0.54)),
                (3.45, 3.6, point),
                (3.7, 4.1, _HANG),
                (4.15, 4.7, held_out),
                (4.9, 5.1, (-0.02, 0.1, 0.51)),
                (5.1, 5.3, held_out),
                (5.6, 6.2, _HANG),
                *both,
            ],
        },
    )


SCRIPTS: dict[str, Callable[[], Script]] = {
    "kung_fu": _kung_fu,
    "roar": _roar,
    "rear": _rear,
    "bark": _bark,
    "walk": _walk,
    "train": _train,
}
"""Functions that return the moves of the performances, by name."""
