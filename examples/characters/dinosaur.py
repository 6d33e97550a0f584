"""A two-legged dinosaur, 4 m long, about to roar."""

import numpy as np

from ..figure import Figure, Part, Pattern, both
from ..sdf import Array, curve, ellipsoid, half_space, round_cone, sphere, stretch, tube, turn
from ..surface import Focus
from .character import ColoredSurface, mesh_figure

SKIN = (0.10, 0.34, 0.16)
DARK = (0.03, 0.15, 0.10)
BELLY = (0.72, 0.62, 0.33)
RIDGE = (0.78, 0.22, 0.04)
CLAW = (0.05, 0.04, 0.035)
TOOTH = (0.90, 0.87, 0.75)
MOUTH = (0.42, 0.06, 0.07)
TONGUE = (0.65, 0.16, 0.18)
EYE = (0.90, 0.62, 0.05)
BLACK = (0.005, 0.005, 0.005)
WHITE = (1.0, 1.0, 1.0)

# rows (x, y, z, radius) from the tip of the tail, which curls to the left, to the back of the head
SPINE = [
    (0.42, 1.12, -2.22, 0.03),
    (0.34, 1.05, -1.95, 0.06),
    (0.18, 1.04, -1.50, 0.12),
    (0.05, 1.14, -1.00, 0.20),
    (0.00, 1.30, -0.50, 0.31),
    (0.00, 1.42, -0.05, 0.40),
    (0.00, 1.50, 0.35, 0.40),
    (0.00, 1.68, 0.68, 0.31),
    (0.00, 1.95, 0.86, 0.24),
    (0.00, 2.22, 0.94, 0.22),
]


def _along_spine(points: Array) -> tuple[Array, Array]:
    """Return the nearest row (n, 4) of the spine as seen from the side, and the height (n,) above it in its radii."""
    spine = curve(SPINE, 8)
    nearest = spine[np.argmin(np.linalg.norm(points[:, None, 1:] - spine[None, :, 1:3], axis=2), axis=1)]
    return nearest, (points[:, 1] - nearest[:, 1]) / nearest[:, 3]


def _belly(points: Array, colors: Array) -> Array:
    """Colour the underside pale, from the lower jaw to the tip of the tail, and the front of the neck."""
    nearest, height = _along_spine(points)
    front = (points[:, 2] - nearest[:, 2]) / nearest[:, 3] * np.clip(nearest[:, 2] - 0.2, 0.0, 0.8)
    pale = np.clip((front - height - 0.3) / 0.25, 0.0, 1.0)
    return colors + pale[:, None] * (np.array(BELLY) - colors)


def _bands(points: Array, colors: Array) -> Array:
    """Colour darker bands across the back."""
    _, height = _along_spine(points)
    wave = np.clip(3.0 * np.sin(11.0 * (points[:, 2] - 0.25 * points[:, 1])), 0.0, 1.0)
    dark = 0.9 * wave * np.clip((height + 0.1) / 0.35, 0.0, 1.0)
    return colors + dark[:, None] * (np.array(DARK) - colors)


def _ridge() -> list[Part]:
    """Make plates along the spine, the tallest over the back."""
    stations = curve(SPINE, 12)
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(stations[:, :3], axis=0), axis=1))])
    parts = []
    for s in np.linspace(0.25, arc[-1] - 0.05, 17):
        x, y, z, radius = (np.interp(s, arc, stations[:, i]) for i in range(4))
        ahead = np.array([np.interp(s + 0.05, arc, stations[:, i]) for i in range(3)])
        forward = (ahead - (x, y, z)) / np.linalg.norm(ahead - (x, y, z))
        up = np.array([0.0, forward[2], -forward[1]])
        height = 0.05 + 0.14 * np.sin(np.pi * s / arc[-1]) ** 1.5
        base, tip = (
            np.array([x, y, z]) + up * radius * 0.9,
            np.array([x, y, z]) + up * (radius + height) - 0.05 * forward,
        )
        plate = stretch(round_cone(base, tip, 0.10, 0.02), (0.42, 1.0, 1.0), base)
        parts.append(Part(plate, RIDGE, 0.02))
    return parts


def _legs() -> list[Part]:
    foot = np.array([0.37, 0.0, 0.02])
    thigh = tube([(0.24, 1.38, -0.14, 0.28), (0.33, 1.10, 0.06, 0.25), (0.37, 0.84, 0.18, 0.16)])
    shin = tube(
        [(0.37, 0.84, 0.18, 0.155), (0.38, 0.62, 0.02, 0.125), (0.37, 0.38, -0.14, 0.085), (0.37, 0.10, 0.0, 0.085)]
    )
    parts = [both(thigh, SKIN, 0.12), both(shin, SKIN, 0.06)]
    for angle, length in [(-24.0, 0.30), (2.0, 0.36), (28.0, 0.30)]:
        ahead = turn(y=angle) @ [0, 0, 1]
        knuckle, tip = foot + 0.6 * length * ahead + [0, 0.075, 0], foot + length * ahead + [0, 0.055, 0]
        parts.append(
            both(tube([(*(foot + np.array([0, 0.08, 0])), 0.09), (*knuckle, 0.075), (*tip, 0.06)]), SKIN, 0.03)
        )
        parts.append(both(round_cone(tip + 0.02 * ahead, tip + 0.13 * ahead - [0, 0.02, 0], 0.045, 0.018), CLAW, 0.01))
    return parts


def _arms() -> list[Part]:
    arm = tube(
        [(0.22, 1.66, 0.74, 0.12), (0.34, 1.50, 0.80, 0.085), (0.38, 1.34, 0.86, 0.065), (0.36, 1.32, 1.04, 0.055)]
    )
    parts = [both(arm, SKIN, 0.06)]
    for x, y in [(0.04, 0.015), (-0.045, -0.01)]:
        knuckle, tip = np.array([0.36 + x, 1.31 + y, 1.10]), np.array([0.36 + 1.4 * x, 1.25 + y, 1.20])
        parts.append(both(round_cone([0.36, 1.32, 1.04], knuckle, 0.05, 0.04), SKIN, 0.02))
        parts.append(both(round_cone(knuckle, tip, 0.036, 0.014), CLAW, 0.01))
    return parts


def _skull() -> Part:
    upper = tube([(0, 2.38, 1.02, 0.25), (0, 2.39, 1.25, 0.24), (0, 2.33, 1.52, 0.19), (0, 2.29, 1.76, 0.15)])
    return Part(stretch(upper, (0.98, 1.0, 1.0), (0, 0, 0)), SKIN, 0.10)


def _jaw() -> Part:
    lower = tube([(0, 2.20, 1.02, 0.19), (0, 2.10, 1.28, 0.125), (0, 2.02, 1.55, 0.10), (0, 1.99, 1.68, 0.085)])
    return Part(stretch(lower, (1.25, 0.8, 1.0), (0, 2.06, 0)), SKIN, 0.03)


def _face() -> list[Part]:
    parts = [
        Part(
            stretch(round_cone([0, 2.21, 1.10], [0, 2.10, 1.75], 0.05, 0.09), (1.6, 0.55, 1.0), (0, 2.17, 0)),
            MOUTH,
            0.01,
            "carve",
        ),
        Part(
            stretch(
                tube([(0, 2.14, 1.10, 0.06), (0, 2.10, 1.35, 0.07), (0, 2.085, 1.54, 0.05)]), (1.1, 0.5, 1), (0, 2.1, 0)
            ),
            TONGUE,
            0.015,
        ),
        both(ellipsoid((0.105, 2.505, 1.22), (0.10, 0.09, 0.13), turn(x=15)), SKIN, 0.05),
        both(sphere((0.155, 2.50, 1.255), 0.082), EYE, 0.004),
        both(ellipsoid((0.222, 2.50, 1.295), (0.05, 0.052, 0.034), turn(y=30)), BLACK, 0.004, "paint"),
        both(sphere((0.225, 2.528, 1.305), 0.018), WHITE, 0.004, "paint"),
        both(tube([(0.09, 2.60, 1.14, 0.04), (0.17, 2.595, 1.24, 0.04), (0.17, 2.545, 1.35, 0.03)]), DARK, 0.03),
        both(sphere((0.065, 2.385, 1.86), 0.035), SKIN, 0.04),
        both(sphere((0.075, 2.395, 1.885), 0.022), BLACK, 0.008, "carve"),
    ]
    for z in np.linspace(1.36, 1.80, 6):
        x = np.interp(z, [1.3, 1.6, 1.85], [0.185, 0.140, 0.075])
        y = np.interp(z, [1.3, 1.8], [2.235, 2.185])
        parts.append(both(round_cone([x, y, z], [x, y - 0.065, z + 0.01], 0.028, 0.008), TOOTH, 0.004))
    for z in np.linspace(1.42, 1.70, 4):
        x = np.interp(z, [1.3, 1.6, 1.75], [0.135, 0.105, 0.06])
        y = np.interp(z, [1.3, 1.7], [2.10, 2.03])
        parts.append(both(round_cone([x, y, z], [x, y + 0.06, z + 0.005], 0.026, 0.008), TOOTH, 0.004))
    return parts


def build() -> ColoredSurface:
    """Make the dinosaur."""
    spine = stretch(tube(SPINE), (0.92, 1.0, 1.0), (0, 0, 0))
    steps: list[Part | Pattern] = [
        Part(spine, SKIN),
        _jaw(),
        _belly,
        _skull(),
        *_legs(),
        _bands,
        *_ridge(),
        *_arms(),
        *_face(),
        Part(half_space((0, 0, 0), (0, 1, 0)), DARK, 0.01, "carve"),
    ]
    return mesh_figure("dinosaur", Figure(steps), 14_000, [Focus((0, 2.3, 1.45), 0.5, 2.0)])
