"""A winged horse, 2 m at the withers, bridled: each rein, from bit to withers, is a handle of the surface (genus 2)."""

import numpy as np

from ..figure import Color, Figure, Part, Pattern, both
from ..sdf import (
    Array,
    Shape,
    blade,
    curve,
    displace,
    ellipsoid,
    half_space,
    intersect,
    mirror,
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

COAT = (0.80, 0.77, 0.72)
SHADE = (0.42, 0.38, 0.38)
MANE = (0.72, 0.40, 0.09)
HOOF = (0.20, 0.11, 0.045)
FEATHER = (0.88, 0.87, 0.86)
COVERT = (0.95, 0.94, 0.90)
TIP = (0.20, 0.34, 0.62)
LEATHER = (0.22, 0.055, 0.025)
GOLD = (0.85, 0.55, 0.10)
MUZZLE = (0.33, 0.24, 0.23)
EYE = (0.012, 0.008, 0.008)
GLINT = (1.0, 1.0, 1.0)

NECK = [
    (0.0, 1.72, 0.58, 0.37),
    (0.0, 1.98, 0.80, 0.30),
    (0.0, 2.30, 1.00, 0.235),
    (0.0, 2.62, 1.14, 0.19),
    (0.0, 2.80, 1.27, 0.16),
]


def _neck() -> Shape:
    return stretch(tube(NECK), (0.72, 1, 1), (0, 0, 0))


def _body() -> list[Part]:
    trunk = tube([(0, 1.68, -0.66, 0.37), (0, 1.66, -0.30, 0.36), (0, 1.58, 0.12, 0.41), (0, 1.62, 0.52, 0.39)])
    return [
        Part(stretch(trunk, (0.92, 1, 1), (0, 0, 0)), COAT),
        Part(ellipsoid((0, 1.80, 0.28), (0.16, 0.20, 0.30)), COAT, 0.15),
        both(ellipsoid((0.17, 1.66, -0.70), (0.20, 0.30, 0.30)), COAT, 0.12),
        both(ellipsoid((0.16, 1.50, 0.66), (0.16, 0.20, 0.18)), COAT, 0.12),
        Part(_neck(), COAT, 0.12),
    ]


def _legs() -> list[Part]:
    shoulder = tube([(0.20, 1.58, 0.50, 0.20), (0.235, 1.26, 0.42, 0.15)])
    fore = tube([(0.235, 1.26, 0.42, 0.145), (0.225, 0.95, 0.45, 0.098), (0.215, 0.66, 0.48, 0.082)])
    fore_cannon = tube(
        [
            (0.215, 0.66, 0.48, 0.080),
            (0.210, 0.45, 0.465, 0.058),
            (0.210, 0.26, 0.465, 0.068),
            (0.212, 0.16, 0.50, 0.062),
        ]
    )
    thigh = tube([(0.18, 1.52, -0.64, 0.30), (0.235, 1.15, -0.54, 0.19)])
    gaskin = tube([(0.235, 1.15, -0.54, 0.18), (0.225, 0.93, -0.68, 0.115), (0.215, 0.72, -0.82, 0.085)])
    hind_cannon = tube(
        [
            (0.215, 0.72, -0.82, 0.082),
            (0.212, 0.48, -0.775, 0.062),
            (0.210, 0.27, -0.74, 0.070),
            (0.212, 0.16, -0.70, 0.064),
        ]
    )
    parts = [
        both(shape, COAT, blend)
        for shape, blend in [
            (shoulder, 0.12),
            (fore, 0.05),
            (fore_cannon, 0.02),
            (thigh, 0.14),
            (gaskin, 0.06),
            (hind_cannon, 0.02),
        ]
    ]
    for z in (0.52, -0.68):
        parts.append(both(round_cone([0.212, 0.13, z - 0.01], [0.214, 0.0, z + 0.045], 0.074, 0.112), HOOF, 0.012))
        parts.append(both(torus((0.212, 0.165, z - 0.022), (0, 0.93, -0.36), 0.058, 0.026), COAT, 0.02))
    return parts


def _skull() -> list[tuple[Shape, float]]:
    """Return the shapes of the head without its ears, each with its blend."""
    face = tube(
        [
            (0, 2.80, 1.36, 0.165),
            (0, 2.70, 1.52, 0.145),
            (0, 2.56, 1.68, 0.108),
            (0, 2.43, 1.81, 0.098),
            (0, 2.385, 1.86, 0.090),
        ]
    )
    jaw = tube([(0, 2.66, 1.34, 0.145), (0, 2.56, 1.50, 0.095), (0, 2.43, 1.68, 0.062), (0, 2.365, 1.76, 0.058)])
    return [
        (stretch(face, (0.85, 1, 1), (0, 0, 0)), 0.06),
        (mirror(ellipsoid((0.055, 2.66, 1.38), (0.085, 0.15, 0.15), turn(x=40))), 0.04),
        (stretch(jaw, (0.9, 1, 1), (0, 0, 0)), 0.03),
    ]


def _head() -> list[Part]:
    ear = tube(
        [
            (0.075, 2.93, 1.29, 0.040),
            (0.095, 3.01, 1.285, 0.052),
            (0.105, 3.10, 1.30, 0.036),
            (0.100, 3.165, 1.33, 0.012),
        ]
    )
    return [
        *[Part(shape, COAT, blend) for shape, blend in _skull()],
        both(stretch(ear, (1, 1, 0.8), (0, 0, 1.3)), COAT, 0.02),
        both(ellipsoid((0.104, 3.04, 1.342), (0.022, 0.07, 0.024), turn(z=-6)), MUZZLE, 0.015, "carve"),
    ]


def _face() -> list[Part]:
    return [
        Part(ellipsoid((0, 2.37, 1.87), (0.15, 0.12, 0.11)), MUZZLE, 0.10, "paint"),
        both(ellipsoid((0.062, 2.43, 1.905), (0.035, 0.042, 0.040)), MUZZLE, 0.03),
        both(ellipsoid((0.078, 2.432, 1.935), (0.022, 0.030, 0.020), turn(x=-25)), EYE, 0.012, "carve"),
        Part(rounded_box((0, 2.335, 1.88), (0.2, 0.009, 0.09), 0.005, turn(x=-12)), EYE, 0.01, "paint"),
        both(ellipsoid((0.108, 2.775, 1.52), (0.040, 0.052, 0.060), turn(x=35)), COAT, 0.03),
        both(sphere((0.115, 2.765, 1.535), 0.054), EYE, 0.006),
        both(sphere((0.160, 2.785, 1.555), 0.014), GLINT, 0.004, "paint"),
        both(tube([(0.10, 2.82, 1.46, 0.020), (0.137, 2.825, 1.53, 0.020), (0.125, 2.795, 1.60, 0.014)]), COAT, 0.02),
    ]


def _bridle() -> list[Part]:
    """Make the straps around the head, the bit rings and the reins."""

    def padded(shape: Shape) -> Shape:
        return displace(shape, lambda p: np.full(len(p), 0.016), 0.016)

    head, neck = padded(union([shape for shape, _ in _skull()], 0.05)), padded(_neck())
    straps = [  # shape below, y and z of the middle, half the length and the angle, in the plane x = 0
        (head, 2.66, 1.53, 0.33, 50.0),
        (head, 2.53, 1.645, 0.30, -42.0),
        (head, 2.90, 1.49, 0.20, -35.0),
        (neck, 2.17, 0.70, 0.26, 42.0),
    ]
    parts = []
    for shape, y, z, half, angle in straps:
        band = rounded_box((0, y, z), (0.4, 0.024, half), 0.01, turn(x=angle))
        parts.append(Part(intersect(shape, band, 0.01), LEATHER, 0.006))
    rein = [
        (0.105, 2.42, 1.735, 0.023),
        (0.220, 2.31, 1.62, 0.023),
        (0.320, 2.13, 1.36, 0.023),
        (0.335, 2.03, 1.08, 0.023),
        (0.260, 2.03, 0.88, 0.023),
        (0.130, 2.07, 0.74, 0.026),
        (0.040, 2.09, 0.66, 0.028),
    ]
    return [*parts, both(sphere((0.096, 2.42, 1.735), 0.038), GOLD, 0.004), both(tube(rein), LEATHER, 0.012)]


def _mane() -> list[Part]:
    """Make locks that fall from the crest to alternate sides, a forelock and the tail."""
    crest = curve(NECK, 12)
    parts = []
    for i, s in enumerate(np.linspace(6, len(crest) - 1, 11)):
        x, y, z, r = (np.interp(s, np.arange(len(crest)), crest[:, k]) for k in range(4))
        back = np.array([0.0, 0.62, -0.78])
        top = np.array([x, y, z]) + back * (r * 0.97)
        side = 0.05 if i % 2 else -0.05
        lock = [
            (*(top + 0.02 * back - [side * 0.4, 0, 0]), 0.065),
            (*(top + np.array([side, 0.0, -0.10])), 0.075),
            (*(top + np.array([1.7 * side, -0.13, -0.17])), 0.062),
            (*(top + np.array([1.9 * side, -0.25, -0.17])), 0.02),
        ]
        parts.append(Part(tube(lock), MANE, 0.018))
    parts.append(
        Part(
            tube(
                [
                    (0, 2.97, 1.22, 0.06),
                    (0.01, 3.01, 1.33, 0.055),
                    (0.02, 2.95, 1.46, 0.045),
                    (0.035, 2.83, 1.55, 0.018),
                ]
            ),
            MANE,
            0.015,
        )
    )
    dock = [
        (0.0, 1.90, -0.96, 0.09),
        (0.02, 1.96, -1.14, 0.105),
        (0.06, 1.82, -1.34, 0.13),
        (0.10, 1.45, -1.46, 0.145),
        (0.14, 1.05, -1.48, 0.12),
        (0.22, 0.72, -1.56, 0.06),
        (0.29, 0.62, -1.66, 0.02),
    ]
    parts.append(Part(tube(dock), MANE, 0.03))
    for dx, dz, end in [
        (-0.09, 0.02, (0.02, 0.74, -1.50)),
        (0.08, -0.06, (0.24, 0.90, -1.68)),
        (0.0, 0.09, (0.12, 0.78, -1.36)),
    ]:
        parts.append(
            Part(
                tube(
                    [
                        (0.05, 1.85, -1.27, 0.07),
                        (0.10 + dx, 1.45, -1.46 + dz, 0.085),
                        (0.14 + dx, 1.08, -1.48 + dz, 0.075),
                        (*end, 0.018),
                    ]
                ),
                MANE,
                0.015,
            )
        )
    return parts


# the arm of the wing from the shoulder to the fingertip
ARM = [
    (0.24, 1.88, 0.36, 0.15),
    (0.48, 2.26, 0.36, 0.12),
    (0.80, 2.78, 0.40, 0.10),
    (1.10, 3.10, 0.28, 0.085),
    (1.32, 3.28, 0.02, 0.055),
]


def _wing() -> list[Part]:
    """Make long feathers that point back at the arm's root and up at its tip, covered by short ones."""
    arm = curve(ARM, 16)
    outwards = np.array([0.58, 0.81, 0.0])
    normal = np.array([-0.81, 0.58, 0.0])

    def feather(s: float, heading: float, length: float, width: float, lift: float, color: Color) -> Part:
        root = np.array([np.interp(s, np.linspace(0, 1, len(arm)), arm[:, k]) for k in range(3)]) + lift * normal
        way = np.sin(heading) * outwards - np.cos(heading) * np.array([0.0, 0.0, 1.0])
        tip = root + length * way + 0.07 * length * normal
        return both(blade(root, tip, 0.8 * width, width, normal, 0.060, 0.024), color, 0.016)

    parts = [both(tube(ARM), COVERT, 0.06)]
    for i, s in enumerate(np.linspace(0.12, 1.0, 16)):
        heading = np.radians(-14.0 + 76.0 * s**1.8)
        parts.append(feather(s, heading, 0.66 + 0.50 * s, 0.118, -0.010 + 0.014 * (i % 2), FEATHER))
    for i, s in enumerate(np.linspace(0.06, 0.97, 13)):
        heading = np.radians(-14.0 + 72.0 * s**1.8)
        parts.append(feather(s, heading, 0.36 + 0.22 * s, 0.100, 0.034 + 0.012 * (i % 2), COVERT))
    return parts


def _plumage(points: Array, colors: Array) -> Array:
    """Colour the tips of the long feathers blue."""
    arm = curve(ARM, 8)[:, :3]
    folded = np.column_stack([np.abs(points[:, 0]), points[:, 1:]])
    far = np.min([np.linalg.norm(folded - station, axis=1) for station in arm], axis=0)
    wing = (folded[:, 0] > 0.30) & (folded[:, 1] > 1.95)
    weight = np.clip((far - 0.60) / 0.40, 0.0, 0.9) * wing
    return colors + weight[:, None] * (np.array(TIP) - colors)


def _dapple(points: Array, colors: Array) -> Array:
    """Darken the legs towards the ground."""
    weight = np.clip((0.85 - points[:, 1]) / 0.8, 0.0, 0.7)
    return colors + weight[:, None] * (np.array(SHADE) - colors)


def build() -> ColoredSurface:
    """Make the Pegasus."""
    legs = _legs()
    hooves = [part for part in legs if part.color == HOOF]
    steps: list[Part | Pattern] = [
        *_body(),
        *[part for part in legs if part.color != HOOF],
        *_head(),
        _dapple,
        *hooves,
        *_wing(),
        _plumage,
        *_mane(),
        *_face(),
        *_bridle(),
        Part(half_space((0, 0, 0), (0, 1, 0)), HOOF, 0.01, "carve"),
    ]
    return mesh_figure("pegasus", Figure(steps), 32_046, [Focus((0, 2.58, 1.60), 0.38, 1.8)])
