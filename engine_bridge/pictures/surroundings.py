"""What a picture shows around characters: the space, light, background, floor, and pictures over it."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from engine_bridge.pictures.textures import Textures

KEY, SKY, BOUNCE = (1.22, 1.10, 0.95), (0.36, 0.40, 0.47), (0.20, 0.18, 0.16)
"""Linear RGB irradiance of the key light on a surface that faces it, of the sky on the floor, and of the ground on a
surface that faces down."""


@dataclass(frozen=True, eq=False)
class StageExtent:
    """The space in which everything moves, for lights and floor.

    Attributes
    ----------
    center : (3,) float64
        On the floor, metres.
    radius : float
        Of the circle on the floor that contains all motion.
    height : float
        Of the highest point.
    size : float
        Height of a typical character, to which the softness of shadows is proportional.
    """

    center: NDArray[np.float64]
    radius: float
    height: float
    size: float


@dataclass(frozen=True)
class Lighting:
    """The light on everything.

    Attributes
    ----------
    key, sky, ground : tuple of 3 floats
        Linear RGB irradiance of the key light on a surface that faces it, of the sky, and of light from below.
    direction : tuple of 3 floats
        Towards the key light, by default over the audience's left shoulder; any length.
    """

    key: tuple[float, float, float] = KEY
    sky: tuple[float, float, float] = SKY
    ground: tuple[float, float, float] = BOUNCE
    direction: tuple[float, float, float] = (-0.42, 0.78, 0.46)


class Overlay(NamedTuple):
    """A picture (h, w, 4) over the frame, its opacity, and its edges as shares of the frame."""

    picture: NDArray[np.uint8]
    opacity: float = 1.0
    place: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 1.0)


class Panorama(NamedTuple):
    """A picture (h, w, 4) around the stage.

    It spans `period` degrees, after which it repeats, and elevations from `top` to `bottom` degrees.
    """

    image: NDArray[np.uint8]
    period: float
    top: float
    bottom: float


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What is around the characters.

    Attributes
    ----------
    background : (h, w, 4) uint8 or Panorama
        A picture of the frame's size or of one pixel, or one that turns with the camera.
    floor : Textures or None
        A picture that repeats on the floor; None for shadows on the background.
    has_floor : bool
        Whether there is a floor, with shadows.
    floor_hides : bool
        Whether what is below the floor is hidden.
    lighting : Lighting
    """

    background: NDArray[np.uint8] | Panorama
    floor: Textures | None = None
    has_floor: bool = True
    floor_hides: bool = True
    lighting: Lighting = field(default_factory=Lighting)
