"""An armoured biped, 2 m tall: plate over mail from helmet to sabatons."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ..figure import Figure, Part, Pattern, both
from ..sdf import (
    Array,
    Shape,
    displace,
    ellipsoid,
    half_space,
    intersect,
    round_cone,
    rounded_box,
    sphere,
    stretch,
    torus,
    tube,
    turn,
    union,
)
from ..surface import Focus
from .character import ColoredSurface, mesh_figure

STEEL = (0.33, 0.37, 0.43)
BRIGHT = (0.60, 0.64, 0.70)
SHADOW = (0.16, 0.18, 0.22)
GOLD = (0.78, 0.47, 0.10)
MAIL = (0.055, 0.055, 0.065)
LEATHER = (0.17, 0.065, 0.028)
RED = (0.50, 0.015, 0.02)
BLACK = (0.006, 0.006, 0.008)

SHOULDER, ELBOW, WRIST = np.array([0.25, 1.55, -0.01]), np.array([0.47, 1.28, -0.01]), np.array([0.655, 1.045, 0.07])
HIP, KNEE, ANKLE = np.array([0.125, 0.98, 0.0]), np.array([0.165, 0.55, 0.02]), np.array([0.185, 0.14, -0.025])


EDGE_METRES = 0.006
"""Radius of the edges of a cone."""


def frustum(a: ArrayLike, b: ArrayLike, radius_a: float, radius_b: float, depth: float = 1.0) -> Shape:
    """Return a cone that is cut flat at a and b, with rounded edges and a scaled depth."""
    start, end = np.asarray(a, float), np.asarray(b, float)
    axis, growth = end - start, radius_b - radius_a
    more = 1.0 if abs(growth) < min(radius_a, radius_b) else 0.9 * min(radius_a, radius_b) / abs(growth)
    cone = round_cone(start - more * axis, end + more * axis, radius_a - more * growth, radius_b + more * growth)
    cut = intersect(
        intersect(stretch(cone, (1, 1, depth), (0, 0, start[2])), half_space(start, -axis), EDGE_METRES),
        half_space(end, axis),
        EDGE_METRES,
    )
    reach = 1.2 * max(radius_a, radius_b)
    return replace(cut, low=np.minimum(start, end) - reach, high=np.maximum(start, end) + reach)


def _between(a: Array, b: Array, t: float) -> Array:
    return a + t * (b - a)


def _limb(a: Array, b: Array, start: float, stop: float, radius_a: float, radius_b: float) -> list[Part]:
    """Make a plate around a limb with a bright rim at its lower end."""
    top, bottom = _between(a, b, start), _between(a, b, stop)
    return [
        both(frustum(top, bottom, radius_a, radius_b), STEEL, 0.003),
        both(torus(bottom, b - a, radius_b - 0.004, 0.0085), BRIGHT, 0.003),
    ]


def _mail() -> list[Part]:
    def rings(p: Array) -> Array:
        return 0.0016 * np.sin(380.0 * p[:, 1]) * np.sin(380.0 * (p[:, 0] + p[:, 2]))

    trunk = stretch(
        tube(
            [(0, 1.00, 0, 0.155), (0, 1.20, 0, 0.15), (0, 1.42, 0, 0.17), (0, 1.52, -0.01, 0.13), (0, 1.64, 0.0, 0.075)]
        ),
        (1, 1, 0.8),
        (0, 0, 0),
    )
    arm = tube([(*SHOULDER, 0.075), (*_between(SHOULDER, ELBOW, 0.5), 0.066), (*ELBOW, 0.055), (*WRIST, 0.040)])
    leg = tube(
        [
            (*HIP, 0.105),
            (*_between(HIP, KNEE, 0.5), 0.094),
            (*KNEE, 0.068),
            (*_between(KNEE, ANKLE, 0.4), 0.068),
            (*ANKLE, 0.052),
        ]
    )
    shapes = [(trunk, False, 0.0), (arm, True, 0.04), (leg, True, 0.03)]
    return [(both if paired else Part)(displace(shape, rings, 0.002), MAIL, blend) for shape, paired, blend in shapes]


def _cuirass() -> list[Part]:
    chest = stretch(
        tube([(0, 1.30, 0.0, 0.165), (0, 1.40, 0.005, 0.198), (0, 1.49, 0.0, 0.190)]), (1.08, 1, 0.84), (0, 0, 0)
    )
    keel = round_cone([0, 1.28, 0.105], [0, 1.50, 0.075], 0.055, 0.055)
    plate = union([chest, keel], 0.07)
    plate = intersect(plate, half_space((0, 1.255, 0), (0, -1, 0)), 0.02)
    parts = [Part(plate, STEEL, 0.003)]
    for i in range(5):
        y = 1.275 - 0.062 * i
        radius = 0.163 + 0.016 * i
        ring = frustum((0, y, 0), (0, y - 0.075, 0), radius, radius + 0.017, 0.82)
        parts.append(Part(ring, STEEL, 0.002))
        parts.append(
            Part(
                stretch(torus((0, y - 0.075, 0), (0, 1, 0), radius + 0.012, 0.0075), (1, 1, 0.82), (0, 0, 0)),
                BRIGHT,
                0.002,
            )
        )
    belt = stretch(torus((0, 1.262, 0), (0, 1, 0), 0.166, 0.022), (1, 1, 0.84), (0, 0, 0))
    return [
        *parts,
        Part(belt, LEATHER, 0.003),
        Part(rounded_box((0, 1.262, 0.158), (0.034, 0.030, 0.014), 0.008), GOLD, 0.003),
        Part(rounded_box((0, 1.43, 0.17), (0.052, 0.052, 0.10), 0.004, turn(z=45)), GOLD, 0.004, "paint"),
        Part(rounded_box((0, 1.43, 0.17), (0.030, 0.030, 0.11), 0.004, turn(z=45)), RED, 0.004, "paint"),
        Part(stretch(torus((0, 1.585, -0.008), (0, 1, 0.1), 0.128, 0.016), (1.05, 1, 0.9), (0, 0, 0)), GOLD, 0.004),
        Part(frustum((0, 1.565, -0.005), (0, 1.675, 0.0), 0.125, 0.098, 0.95), STEEL, 0.003),
        Part(torus((0, 1.675, 0.0), (0, 1, 0), 0.092, 0.011), BRIGHT, 0.003),
    ]


def _pauldrons() -> list[Part]:
    """Make three lames that overlap downwards, the uppermost with a gilded rim."""
    down = (ELBOW - SHOULDER) / np.linalg.norm(ELBOW - SHOULDER)
    parts = []
    for i, (offset, width, height) in enumerate([(0.115, 0.098, 0.052), (0.070, 0.112, 0.066), (0.012, 0.128, 0.092)]):
        center = SHOULDER + offset * down + [0.012, 0.018, 0.0]
        shell = ellipsoid(center, (height + 0.028, width, width), turn(z=-51))
        shell = intersect(shell, half_space(center + 0.030 * down, down), 0.008)
        parts.append(both(shell, STEEL, 0.002))
        rim = np.sqrt(1.0 - (0.030 / (height + 0.028)) ** 2) * width
        parts.append(both(torus(center + 0.030 * down, down, rim - 0.006, 0.009), GOLD if i == 2 else BRIGHT, 0.003))
    return parts


def _arms() -> list[Part]:
    outward = np.array([0.77, 0.63, 0.0])
    return [
        *_limb(SHOULDER, ELBOW, 0.40, 0.84, 0.077, 0.068),
        *_limb(ELBOW, WRIST, 0.16, 0.86, 0.068, 0.050),
        both(ellipsoid(ELBOW, (0.070, 0.066, 0.074), turn(z=-51)), BRIGHT, 0.003),
        both(ellipsoid(ELBOW + 0.066 * outward, (0.020, 0.066, 0.062), turn(z=39)), STEEL, 0.004),
        both(sphere(ELBOW + 0.084 * outward, 0.018), GOLD, 0.004),
        *_gauntlets(),
    ]


def _gauntlets() -> list[Part]:
    along = (WRIST - ELBOW) / np.linalg.norm(WRIST - ELBOW)
    across = np.cross(along, np.array([1.0, 0.5, 0.1]))
    across /= np.linalg.norm(across)
    back = np.cross(along, across)
    back *= np.sign(back[0])

    def at(length: float, side: float, height: float = 0.0) -> Array:
        return WRIST + length * along + side * across + height * back

    cuff = frustum(at(-0.075, 0), at(0.015, 0), 0.076, 0.050)
    parts = [
        both(cuff, STEEL, 0.003),
        both(torus(at(-0.075, 0), along, 0.072, 0.010), GOLD, 0.003),
        both(
            union(
                [round_cone(at(0.02, 0.5 * s), at(0.105, s), 0.030, 0.027) for s in (-0.033, -0.011, 0.011, 0.033)],
                0.02,
            ),
            LEATHER,
            0.006,
        ),
    ]
    for length, size in [(0.035, 0.046), (0.065, 0.050), (0.095, 0.052)]:
        parts.append(
            both(
                ellipsoid(at(length, 0, 0.016), (size, 0.026, 0.024), np.column_stack([across, along, back])),
                STEEL,
                0.002,
            )
        )
    for i, length in enumerate([0.070, 0.088, 0.094, 0.080]):
        side = -0.042 + 0.028 * i
        mid, tip = at(0.105 + 0.5 * length, 1.02 * side, -0.004), at(0.105 + length, 1.0 * side, -0.022)
        parts.append(both(tube([(*at(0.095, 0.92 * side), 0.0185), (*mid, 0.0175), (*tip, 0.0155)]), LEATHER, 0.004))
        for t, size in [(0.10, 0.021), (0.45, 0.0195), (0.80, 0.0175)]:
            knuckle = at(0.105 + t * length, (0.93 + 0.08 * t) * side, 0.007 - 0.022 * t * t)
            parts.append(both(sphere(knuckle, size), BRIGHT if t < 0.2 else STEEL, 0.002))
    thumb = [(*at(0.03, 0.025), 0.026), (*at(0.075, 0.070, -0.006), 0.021), (*at(0.120, 0.088, -0.016), 0.0165)]
    return [*parts, both(tube(thumb), STEEL, 0.008)]


def _legs() -> list[Part]:
    calf = tube(
        [
            (*_between(KNEE, ANKLE, 0.16), 0.074),
            (*(_between(KNEE, ANKLE, 0.40) - [0, 0, 0.012]), 0.085),
            (*_between(KNEE, ANKLE, 0.80), 0.064),
            (*_between(KNEE, ANKLE, 0.97), 0.064),
        ]
    )
    shin = round_cone(
        _between(KNEE, ANKLE, 0.2) + np.array([0, 0, 0.060]),
        _between(KNEE, ANKLE, 0.85) + np.array([0, 0, 0.047]),
        0.014,
        0.012,
    )
    parts = [
        *_limb(HIP, KNEE, 0.16, 0.84, 0.116, 0.086),
        both(calf, STEEL, 0.003),
        both(shin, BRIGHT, 0.02),
        both(ellipsoid(KNEE + np.array([0, 0, 0.012]), (0.080, 0.082, 0.084)), BRIGHT, 0.003),
        both(
            round_cone(KNEE + np.array([0, 0.045, 0.078]), KNEE + np.array([0, -0.055, 0.078]), 0.016, 0.016),
            BRIGHT,
            0.03,
        ),
        both(ellipsoid(KNEE + np.array([0.075, 0.0, -0.004]), (0.020, 0.070, 0.066)), STEEL, 0.004),
        both(sphere(KNEE + np.array([0.094, 0.0, -0.004]), 0.019), GOLD, 0.004),
        both(torus(_between(KNEE, ANKLE, 0.97), ANKLE - KNEE, 0.060, 0.011), GOLD, 0.003),
    ]
    foot = [
        (0.185, 0.085, -0.055, 0.062),
        (0.188, 0.085, 0.02, 0.064),
        (0.198, 0.055, 0.11, 0.060),
        (0.206, 0.040, 0.19, 0.046),
        (0.211, 0.030, 0.235, 0.028),
    ]
    parts.append(both(tube(foot), STEEL, 0.004))
    for z, x, y, radius in [
        (0.045, 0.190, 0.062, 0.066),
        (0.085, 0.194, 0.052, 0.065),
        (0.125, 0.199, 0.042, 0.062),
        (0.162, 0.203, 0.034, 0.055),
    ]:
        parts.append(both(torus((x, y, z), (0.08, -0.40, 1.0), radius - 0.006, 0.010), BRIGHT, 0.004))
    return parts


def _helmet() -> list[Part]:
    skull = ellipsoid((0, 1.825, -0.012), (0.118, 0.150, 0.142))
    lower = stretch(tube([(0, 1.78, 0.0, 0.112), (0, 1.70, 0.012, 0.098)]), (1, 1, 1.08), (0, 0, 0))
    beak = tube([(0, 1.765, 0.05, 0.100), (0, 1.755, 0.125, 0.066), (0, 1.745, 0.192, 0.018)])
    parts = [
        Part(union([skull, lower], 0.05), STEEL, 0.003),
        Part(stretch(beak, (1.05, 1, 1), (0, 0, 0)), BRIGHT, 0.03),
        Part(
            intersect(
                displace(skull, lambda p: np.full(len(p), 0.009), 0.009),
                rounded_box((0, 1.868, 0), (0.3, 0.014, 0.3), 0.004, turn(x=-6)),
                0.006,
            ),
            GOLD,
            0.003,
        ),
        Part(
            intersect(
                displace(union([skull, lower], 0.05), lambda p: np.full(len(p), 0.008), 0.008),
                rounded_box((0, 1.70, 0), (0.3, 0.013, 0.3), 0.004, turn(x=4)),
                0.006,
            ),
            GOLD,
            0.003,
        ),
        Part(
            intersect(
                displace(skull, lambda p: np.full(len(p), 0.020), 0.020),
                rounded_box((0, 1.95, -0.02), (0.013, 0.12, 0.3), 0.006),
                0.01,
            ),
            GOLD,
            0.008,
        ),
        both(
            rounded_box((0.060, 1.828, 0.140), (0.040, 0.0105, 0.032), 0.006, turn(y=25, z=-4)), BLACK, 0.003, "carve"
        ),
        both(ellipsoid((0.118, 1.815, -0.005), (0.018, 0.034, 0.034)), GOLD, 0.004),
    ]
    for y, z in [(1.778, 0.150), (1.776, 0.122), (1.748, 0.160), (1.746, 0.130), (1.720, 0.140)]:
        x = 0.105 * np.sqrt(max(0.0, 1 - ((z - 0.02) / 0.18) ** 2)) * 0.90
        parts.append(both(sphere((x, y, z), 0.0095), BLACK, 0.002, "carve"))
    return parts


def _plume() -> list[Part]:
    """Make a plume that falls back from the crown, with its tip to the left."""

    def barbs(p: Array) -> Array:
        return 0.005 * np.sin(120.0 * (p[:, 1] - 0.8 * p[:, 2]))

    feather = tube(
        [
            (0, 1.96, 0.01, 0.022),
            (0, 2.035, 0.005, 0.040),
            (0.005, 2.085, -0.075, 0.056),
            (0.012, 2.06, -0.185, 0.062),
            (0.022, 1.95, -0.265, 0.058),
            (0.038, 1.82, -0.285, 0.042),
            (0.055, 1.72, -0.265, 0.014),
        ]
    )
    return [Part(displace(stretch(feather, (0.75, 1, 1), (0, 0, 0)), barbs, 0.006), RED, 0.008)]


def _worn(points: Array, colors: Array) -> Array:
    """Darken the lower side of steel, as if it reflected the ground."""
    weight = np.clip((0.9 - points[:, 1]) / 1.2, 0.0, 0.45)
    return colors + weight[:, None] * (np.array(SHADOW) * colors / 0.45 - colors)


def build() -> ColoredSurface:
    """Make the armoured biped."""
    steps: list[Part | Pattern] = [
        *_mail(),
        *_cuirass(),
        *_legs(),
        *_arms(),
        *_pauldrons(),
        *_helmet(),
        *_plume(),
        _worn,
        Part(half_space((0, 0, 0), (0, 1, 0)), LEATHER, 0.004, "carve"),
    ]
    foci = [
        Focus((0, 1.80, 0.08), 0.14, 1.5),
        Focus((0.75, 0.92, 0.11), 0.12, 1.4),
        Focus((-0.75, 0.92, 0.11), 0.12, 1.4),
    ]
    return mesh_figure("biped", Figure(steps), 60_000, foci)
