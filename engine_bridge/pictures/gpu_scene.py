"""What `engine_bridge.pictures.gpu_renderer` draws around surfaces: the space, light, background and floor."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engine_bridge.pictures.lighting import KEY, SKY
from engine_bridge.pictures.renderer import BOUNCE

if TYPE_CHECKING:
    import moderngl


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
    """A picture over the frame, from `GpuRenderer.picture`, its opacity, and its edges as shares of the frame."""

    picture: "moderngl.Texture"
    opacity: float = 1.0
    place: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 1.0)


class Panorama(NamedTuple):
    """A picture around the stage, from `GpuRenderer.tile`.

    It spans `period` degrees, after which it repeats, and elevations from `top` to `bottom` degrees.
    """

    image: "moderngl.Texture"
    period: float
    top: float
    bottom: float


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What is around the characters.

    Attributes
    ----------
    background : moderngl.Texture or Panorama
        A picture that covers the frame, from `GpuRenderer.picture`, or one that turns with the camera.
    floor : moderngl.Texture or None
        A picture that repeats on the floor, from `GpuRenderer.tile`; None for shadows on the background.
    has_floor : bool
        Whether there is a floor, with shadows.
    lighting : Lighting
    """

    background: "moderngl.Texture | Panorama"
    floor: "moderngl.Texture | None" = None
    has_floor: bool = True
    lighting: Lighting = field(default_factory=Lighting)
