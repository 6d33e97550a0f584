"""A young person in everyday clothes, 1.75 m tall, arms held away from the body."""

from dataclasses import replace

import numpy as np

from ..figure import Figure, Part, Pattern, both
from ..sdf import (
    Array,
    Shape,
    displace,
    ellipsoid,
    half_space,
    intersect,
    round_cone,
    sphere,
    stretch,
    subtract,
    torus,
    tube,
    turn,
    union,
)
from ..surface import Focus
from .character import ColoredSurface, mesh_figure

SKIN = (0.62, 0.31, 0.18)
LIP = (0.52, 0.17, 0.13)
HAIR = (0.075, 0.028, 0.012)
SHIRT = (0.03, 0.22, 0.42)
TRIM = (0.80, 0.55, 0.10)
JEANS = (0.045, 0.06, 0.13)
SHOE = (0.62, 0.04, 0.03)
SOLE = (0.85, 0.83, 0.78)
WHITE = (0.90, 0.90, 0.88)
MOUTH = (0.25, 0.05, 0.04)
IRIS = (0.10, 0.045, 0.012)
BLACK = (0.008, 0.008, 0.008)

SCALE = 0.912
"""Factor that scales the body, which has an oversized head, to 1.75 m."""


def _flat(shape: Shape, depth: float) -> Shape:
    """Return the shape with its depth scaled about the plane z = 0."""
    return stretch(shape, (1.0, 1.0, depth), (0.0, 0.0, 0.0))


def _legs() -> list[Part]:
    leg = tube(
        [
            (0.080, 0.90, -0.01, 0.094),
            (0.098, 0.72, 0.006, 0.088),
            (0.112, 0.50, 0.012, 0.068),
            (0.118, 0.34, -0.012, 0.066),
            (0.120, 0.125, -0.02, 0.058),
        ]
    )
    cuff = torus((0.120, 0.105, -0.02), (0, 1, 0), 0.052, 0.016)
    foot = tube(
        [
            (0.120, 0.075, -0.055, 0.050),
            (0.124, 0.070, 0.02, 0.052),
            (0.130, 0.048, 0.10, 0.050),
            (0.134, 0.040, 0.16, 0.042),
        ]
    )
    sole = tube(
        [
            (0.120, 0.012, -0.065, 0.046),
            (0.124, 0.012, 0.03, 0.046),
            (0.131, 0.012, 0.11, 0.052),
            (0.135, 0.012, 0.165, 0.046),
        ]
    )
    return [
        Part(ellipsoid((0, 0.935, -0.012), (0.158, 0.115, 0.110)), JEANS),
        both(ellipsoid((0.072, 0.90, -0.058), (0.082, 0.085, 0.062)), JEANS, 0.04),
        both(leg, JEANS, 0.05),
        both(ellipsoid((0.112, 0.505, 0.042), (0.05, 0.06, 0.035)), JEANS, 0.04),
        both(cuff, JEANS, 0.012),
        both(foot, SHOE, 0.006),
        both(stretch(sole, (1.06, 1.0, 1.04), (0.12, 0, 0.05)), SOLE, 0.003),
        *[
            both(round_cone((0.108, y, z), (0.146, y - 0.003, z), 0.008, 0.008), WHITE, 0.003)
            for y, z in [(0.121, 0.022), (0.112, 0.048), (0.101, 0.074)]
        ],
    ]


def _torso() -> list[Part]:
    trunk = tube(
        [
            (0, 0.86, -0.016, 0.186),
            (0, 0.96, -0.014, 0.176),
            (0, 1.10, 0.0, 0.150),
            (0, 1.26, 0.0, 0.168),
            (0, 1.345, -0.008, 0.13),
        ]
    )
    shoulders = tube([(0, 1.395, -0.02, 0.076), (0.10, 1.392, -0.022, 0.080), (0.168, 1.372, -0.022, 0.076)])
    sleeve = tube([(0.165, 1.372, -0.020, 0.078), (0.225, 1.295, -0.020, 0.070), (0.272, 1.225, -0.016, 0.068)])
    return [
        Part(subtract(_flat(trunk, 0.76), half_space((0, 0.915, 0), (0, 1, 0)), 0.01), SHIRT, 0.003),
        both(ellipsoid((0.075, 1.29, 0.065), (0.095, 0.075, 0.065)), SHIRT, 0.06),
        both(shoulders, SHIRT, 0.06),
        both(sleeve, SHIRT, 0.03),
        Part(tube([(0, 1.38, -0.03, 0.066), (0, 1.47, -0.020, 0.056), (0, 1.60, -0.008, 0.060)]), SKIN, 0.004),
        Part(torus((0, 1.474, -0.022), (0, 0.99, 0.12), 0.066, 0.014), TRIM, 0.003),
    ]


def _arms() -> list[Part]:
    arm = tube(
        [
            (0.255, 1.25, -0.018, 0.050),
            (0.318, 1.16, -0.014, 0.045),
            (0.368, 1.085, -0.004, 0.041),
            (0.425, 0.99, 0.025, 0.037),
            (0.468, 0.915, 0.05, 0.028),
        ]
    )
    return [both(arm, SKIN, 0.008), *_hands()]


def _hands() -> list[Part]:
    """Make four fingers with grooves between them, and a thumb."""
    wrist = np.array([0.468, 0.915, 0.05])
    along = np.array([0.52, -0.80, 0.29])
    along /= np.linalg.norm(along)
    across = np.cross(along, [1.0, 0.35, 0.2])  # from the little finger to the forefinger, mostly forward
    across /= np.linalg.norm(across)
    outward = np.cross(across, along)

    def at(length: float, side: float, depth: float = 0.0) -> list[float]:
        return list(wrist + length * along + side * across + depth * outward)

    palm = union(
        [round_cone(at(0.02, s * 0.4), at(0.075, s), 0.021, 0.020) for s in (-0.024, -0.008, 0.008, 0.024)], 0.02
    )
    parts = [both(palm, SKIN, 0.02)]
    for i, length in enumerate([0.055, 0.073, 0.080, 0.070]):
        s = -0.033 + 0.022 * i
        joints = [
            (*at(0.075, 0.85 * s), 0.0140),
            (*at(0.08 + 0.5 * length, 0.92 * s, -0.003), 0.0135),
            (*at(0.08 + length, 0.90 * s, -0.014), 0.0122),
        ]
        parts.append(both(tube(joints), SKIN, 0.004 if i else 0.010))
    thumb = [(*at(0.02, 0.012), 0.019), (*at(0.055, 0.050, 0.004), 0.0155), (*at(0.092, 0.068, 0.008), 0.0125)]
    parts.append(both(tube(thumb), SKIN, 0.012))
    return parts


def _head() -> list[Part]:
    skull = ellipsoid((0, 1.632, -0.008), (0.092, 0.105, 0.108))
    jaw = tube([(0, 1.60, 0.005, 0.080), (0, 1.56, 0.028, 0.064), (0, 1.535, 0.046, 0.046)])
    return [
        Part(skull, SKIN),
        Part(jaw, SKIN, 0.04),
        both(ellipsoid((0.050, 1.588, 0.056), (0.032, 0.028, 0.026)), SKIN, 0.03),
    ]


def _face() -> list[Part]:
    eye = (0.0365, 1.628, 0.0715)
    lid = intersect(sphere(eye, 0.0295), half_space((0, 1.641, 0.07), (0.15, -1.0, -0.25)), 0.002)
    smile = subtract(
        ellipsoid((0, 1.575, 0.104), (0.044, 0.023, 0.034)), ellipsoid((0, 1.606, 0.104), (0.080, 0.034, 0.08)), 0.002
    )
    brow = [(0.014, 1.671, 0.092, 0.0055), (0.036, 1.677, 0.088, 0.0085), (0.060, 1.667, 0.074, 0.006)]
    nose = tube([(0, 1.640, 0.096, 0.010), (0, 1.612, 0.112, 0.013), (0, 1.601, 0.119, 0.016)])
    return [
        both(sphere(eye, 0.0235), SKIN, 0.010, "carve"),
        both(sphere(eye, 0.0275), WHITE, 0.001),
        both(sphere((0.0385, 1.627, 0.0955), 0.0172), IRIS, 0.001, "paint"),
        both(sphere((0.0385, 1.627, 0.0990), 0.0105), BLACK, 0.001, "paint"),
        Part(sphere((0.0445, 1.633, 0.0975), 0.0042), WHITE, 0.001, "paint"),
        Part(sphere((-0.0325, 1.633, 0.0975), 0.0042), WHITE, 0.001, "paint"),
        both(lid, SKIN, 0.002),
        both(tube(brow), HAIR, 0.003),
        Part(nose, SKIN, 0.016),
        both(sphere((0.012, 1.598, 0.108), 0.0105), SKIN, 0.010),
        Part(smile, MOUTH, 0.003, "carve"),
        both(ellipsoid((0.096, 1.612, -0.006), (0.012, 0.031, 0.020), turn(x=-10, y=22)), SKIN, 0.008),
        both(ellipsoid((0.107, 1.615, -0.002), (0.007, 0.017, 0.009), turn(x=-10, y=22)), LIP, 0.006, "carve"),
    ]


def _hair() -> list[Part]:
    """Make hair that is swept back from a parting on the left, with strands."""

    def strands(p: Array) -> Array:
        return 0.0022 * np.sin(150.0 * (p[:, 0] + 0.5 * p[:, 1] * np.sign(p[:, 0] - 0.03)) + 25.0 * p[:, 2])

    cap = ellipsoid((0, 1.652, -0.022), (0.103, 0.105, 0.117))
    back = ellipsoid((0, 1.585, -0.058), (0.088, 0.085, 0.064))
    quiff = tube(
        [
            (0.045, 1.715, 0.062, 0.024),
            (0.010, 1.738, 0.070, 0.034),
            (-0.040, 1.725, 0.064, 0.030),
            (-0.076, 1.690, 0.042, 0.020),
        ]
    )
    whole = union([cap, back, quiff], 0.03)
    face = union(
        [ellipsoid((0, 1.60, 0.115), (0.078, 0.102, 0.10)), ellipsoid((0, 1.56, 0.06), (0.15, 0.085, 0.042))], 0.03
    )
    return [
        Part(displace(subtract(whole, face, 0.015), strands, 0.003), HAIR, 0.003),
        both(
            tube([(0.090, 1.66, 0.030, 0.012), (0.090, 1.625, 0.030, 0.009), (0.088, 1.605, 0.030, 0.005)]), HAIR, 0.006
        ),
    ]


def _cloth(points: Array, colors: Array) -> Array:
    """Colour a band across the chest, and the trim of the sleeves."""
    x, y, _ = points.T / SCALE
    sleeve = (np.abs(x) - 0.17) * 0.62 - (y - 1.372) * 0.78  # metres down the sleeve
    band = (np.abs(y - 1.245) < 0.028) & (np.abs(x) < 0.20)
    for mask, color in [(band, TRIM), ((sleeve > 0.148) & (np.abs(x) > 0.19) & (y > 1.1), TRIM)]:
        colors = np.where(mask[:, None], np.array(color), colors)
    return colors


def build() -> ColoredSurface:
    """Make the human."""
    steps: list[Part | Pattern] = [
        *_legs(),
        *_torso(),
        _cloth,
        *_arms(),
        *(
            replace(part, shape=stretch(part.shape, (1.4, 1.4, 1.4), (0, 1.40, -0.02)))
            for part in [*_head(), *_hair(), *_face()]
        ),
    ]
    steps = [
        replace(step, shape=stretch(step.shape, (SCALE,) * 3, (0, 0, 0))) if isinstance(step, Part) else step
        for step in steps
    ]
    steps = [*steps, Part(half_space((0, 0, 0), (0, 1, 0)), BLACK, 0.002, "carve")]
    foci = [
        Focus((0, 1.555, 0.09), 0.13, 2.8),
        Focus((0.475, 0.77, 0.07), 0.08, 1.7),
        Focus((-0.475, 0.77, 0.07), 0.08, 1.7),
    ]
    return mesh_figure("human", Figure(steps), 15_154, foci)
