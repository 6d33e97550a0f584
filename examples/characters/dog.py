"""A young dog with a collar, 0.6 m at the withers."""

import numpy as np

from ..figure import Figure, Part, Pattern, both
from ..sdf import Array, ellipsoid, half_space, round_cone, sphere, stretch, torus, tube, turn
from ..surface import Focus
from .character import ColoredSurface, mesh_figure

COAT = (0.48, 0.21, 0.065)
DARK = (0.10, 0.04, 0.016)
WHITE = (0.86, 0.81, 0.72)
NOSE = (0.012, 0.010, 0.010)
EYE = (0.02, 0.008, 0.004)
GLINT = (1.0, 1.0, 1.0)
TONGUE = (0.72, 0.17, 0.19)
MOUTH = (0.10, 0.02, 0.02)
COLLAR = (0.60, 0.02, 0.02)
TAG = (0.85, 0.55, 0.08)


def _body() -> list[Part]:
    trunk = tube(
        [
            (0, 0.475, -0.31, 0.095),
            (0, 0.475, -0.20, 0.11),
            (0, 0.475, -0.02, 0.118),
            (0, 0.465, 0.15, 0.138),
            (0, 0.50, 0.23, 0.118),
        ]
    )
    neck = tube([(0, 0.52, 0.20, 0.11), (0, 0.62, 0.29, 0.088), (0, 0.72, 0.345, 0.085)])
    return [Part(stretch(trunk, (0.88, 1, 1), (0, 0, 0)), COAT), Part(neck, COAT, 0.05)]


def _legs() -> list[Part]:
    parts = []
    upper = tube([(0.075, 0.45, 0.185, 0.075), (0.088, 0.33, 0.15, 0.055)])
    fore = tube(
        [
            (0.088, 0.33, 0.15, 0.055),
            (0.090, 0.22, 0.165, 0.040),
            (0.088, 0.11, 0.175, 0.035),
            (0.088, 0.045, 0.185, 0.036),
        ]
    )
    thigh = tube([(0.070, 0.45, -0.27, 0.105), (0.095, 0.34, -0.22, 0.075)])
    shin = tube([(0.095, 0.34, -0.22, 0.07), (0.098, 0.25, -0.26, 0.048), (0.094, 0.165, -0.335, 0.034)])
    hind = tube([(0.094, 0.165, -0.335, 0.034), (0.092, 0.10, -0.325, 0.032), (0.092, 0.045, -0.31, 0.035)])
    parts += [
        both(shape, COAT, blend)
        for shape, blend in [(upper, 0.04), (fore, 0.02), (thigh, 0.05), (shin, 0.03), (hind, 0.02)]
    ]
    for x, z in [(0.088, 0.205), (0.092, -0.29)]:
        parts.append(both(ellipsoid((x, 0.036, z), (0.046, 0.038, 0.055)), WHITE, 0.02))
        for offset in (-0.029, 0.0, 0.029):
            toe = ellipsoid((x + offset, 0.026, z + 0.045 - 8 * offset**2), (0.0175, 0.026, 0.026))
            parts.append(both(toe, WHITE, 0.008))
    return parts


def _tail() -> Part:
    """Make a raised tail with its tip to the left."""
    return Part(
        tube(
            [
                (0, 0.53, -0.37, 0.038),
                (0.0, 0.60, -0.45, 0.036),
                (0.01, 0.71, -0.495, 0.034),
                (0.035, 0.81, -0.48, 0.026),
                (0.055, 0.87, -0.44, 0.012),
            ]
        ),
        COAT,
        0.03,
    )


def _head() -> list[Part]:
    return [
        Part(ellipsoid((0, 0.795, 0.385), (0.112, 0.105, 0.115)), COAT, 0.05),
        both(ellipsoid((0.055, 0.745, 0.42), (0.058, 0.055, 0.065)), COAT, 0.04),
        Part(
            stretch(round_cone([0, 0.757, 0.46], [0, 0.752, 0.575], 0.062, 0.044), (1.05, 0.95, 1), (0, 0.755, 0)),
            WHITE,
            0.03,
        ),
        Part(
            stretch(
                tube([(0, 0.70, 0.43, 0.05), (0, 0.682, 0.50, 0.037), (0, 0.668, 0.548, 0.029)]),
                (1.05, 0.75, 1),
                (0, 0.69, 0),
            ),
            WHITE,
            0.012,
        ),
    ]


def _face() -> list[Part]:
    """Make eyes, nose and mouth."""
    tongue = tube(
        [(0, 0.707, 0.345, 0.026), (0, 0.704, 0.50, 0.027), (0.004, 0.688, 0.585, 0.026), (0.006, 0.650, 0.600, 0.024)]
    )
    return [
        both(ellipsoid((0.026, 0.728, 0.567), (0.031, 0.027, 0.036)), WHITE, 0.012),
        Part(
            stretch(round_cone([0, 0.714, 0.45], [0, 0.706, 0.60], 0.022, 0.036), (2.0, 0.5, 1), (0, 0.712, 0)),
            MOUTH,
            0.008,
            "carve",
        ),
        Part(stretch(tongue, (1.0, 1.0, 0.6), (0, 0.7, 0.57)), TONGUE, 0.006),
        Part(ellipsoid((0, 0.778, 0.612), (0.031, 0.024, 0.023)), NOSE, 0.006),
        both(sphere((0.016, 0.774, 0.634), 0.0075), NOSE, 0.003, "carve"),
        both(sphere((0.052, 0.815, 0.468), 0.0265), EYE, 0.003),
        both(sphere((0.058, 0.826, 0.4895), 0.0065), GLINT, 0.002, "paint"),
        both(
            tube([(0.030, 0.850, 0.478, 0.012), (0.058, 0.857, 0.462, 0.014), (0.080, 0.845, 0.440, 0.010)]),
            COAT,
            0.018,
        ),
    ]


def _ears() -> Part:
    """Make flat ears that hang slightly away from the cheeks."""
    flap = tube(
        [
            (0.060, 0.862, 0.375, 0.030),
            (0.105, 0.872, 0.382, 0.036),
            (0.160, 0.83, 0.39, 0.048),
            (0.195, 0.745, 0.40, 0.054),
            (0.205, 0.685, 0.405, 0.034),
        ]
    )
    return both(stretch(flap, (0.5, 1, 1), (0.11, 0, 0)), DARK, 0.02)


def _coat(points: Array, colors: Array) -> Array:
    """Colour chest, belly, blaze, socks and tail tip white, and a dark saddle."""
    x, y, z = points.T

    def toward(color: tuple[float, float, float], weight: Array) -> None:
        nonlocal colors
        colors = colors + np.clip(weight, 0.0, 1.0)[:, None] * (np.array(color) - colors)

    wave = 0.012 * np.sin(40 * z) + 0.01 * np.sin(55 * x + 20 * z)
    trunk = (z < 0.30) & (z > -0.42)
    toward(DARK, (y - 0.51 + 0.25 * np.abs(z + 0.08) + wave) / 0.02 * (trunk & (y < 0.66) & (z < 0.2)))
    toward(
        WHITE,
        (0.425 - y + 0.9 * np.maximum(z - 0.05, 0.0) + wave - 1.3 * np.maximum(np.abs(x) - 0.05, 0))
        / 0.02
        * (y > 0.3)
        * (y < 0.64),
    )
    toward(WHITE, (0.16 - y + wave) / 0.02)
    toward(WHITE, (y - 0.79 + wave) / 0.015 * (z < -0.35))
    toward(
        WHITE,
        (0.017 + 0.02 * (y < 0.83) - np.abs(x)) / 0.008 * (z > 0.40) * (y > 0.74) * np.clip((0.90 - y) / 0.03, 0, 1),
    )
    return colors


def build() -> ColoredSurface:
    """Make the dog."""
    lean = turn(x=-38)
    collar = torus((0, 0.655, 0.312), (0, 0.82, 0.57), 0.086, 0.016)
    steps: list[Part | Pattern] = [
        *_body(),
        *_legs(),
        _tail(),
        *_head(),
        _coat,
        _ears(),
        *_face(),
        Part(collar, COLLAR, 0.004),
        Part(ellipsoid((0, 0.588, 0.382), (0.020, 0.022, 0.013), lean), TAG, 0.004),
        Part(half_space((0, 0, 0), (0, 1, 0)), DARK, 0.004, "carve"),
    ]
    return mesh_figure("dog", Figure(steps), 18_114, [Focus((0, 0.77, 0.48), 0.14, 1.8)])
