"""Drawing of films: what a frame shows, and the canvas that makes its pixels."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from PIL import ImageColor

from engine_bridge.character.character import Part
from engine_bridge.character.materials import Appearance
from engine_bridge.film import overlays
from engine_bridge.film.moods import lighting_of
from engine_bridge.film.painting import BOTTOM, PERIOD, TOP
from engine_bridge.film.scene import DEFAULT_SET, Scene
from engine_bridge.film.sets import SETS, panorama
from engine_bridge.pictures.camera import Camera
from engine_bridge.pictures.gpu_renderer import GpuRenderer
from engine_bridge.pictures.gpu_scene import Overlay, Panorama, StageExtent, Surroundings

if TYPE_CHECKING:
    import moderngl

Characters = Sequence[tuple[Sequence[Part], Sequence[Appearance]]]
"""The parts of characters, and their materials."""

ShownPicture = tuple[NDArray[np.uint8], float, tuple[float, float, float, float]]
"""A bubble or title in a frame: its pixels (h, w, 4), opacity, and edges as shares of the frame."""

WHOLE_FRAME = 0.0, 0.0, 1.0, 1.0
"""Edges of a picture that covers the frame."""


class ShownView(NamedTuple):
    """What a camera shows in a frame, and the share of its brightness in the frame's."""

    camera: Camera
    share: float
    pictures: list[ShownPicture]


class ShownFrame(NamedTuple):
    """What a frame shows: the positions and unit normals (n, 3) of each character, and one view, or several mixed."""

    surfaces: list[tuple[NDArray[np.float32], NDArray[np.float32]]]
    views: list[ShownView]


class Canvas:
    """Draws frames of a scene.

    Parameters
    ----------
    scene : Scene
    path : Path
        The scene file.
    size : tuple of 2 ints
        Width and height, in pixels.
    samples : int
        Samples per pixel for edges.

    Raises
    ------
    PuppetlineError
        There is no graphics library, or the background picture cannot be opened.
    """

    def __init__(self, scene: Scene, path: Path, size: tuple[int, int], samples: int) -> None:
        self.setup = scene, path, size, samples
        self.renderer = GpuRenderer(size, samples)
        self._around = _surroundings(scene, self.renderer, path)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.renderer.__exit__()

    def add(self, stage: StageExtent, characters: Characters) -> None:
        """Set the space of all motion, and the characters."""
        self._stage = stage
        self._surfaces = [self.renderer.add(*each) for each in characters]

    def draw(self, frame: ShownFrame) -> NDArray[np.uint8]:
        """Return the pixels (h, w, 4) of a frame."""
        for surface, (positions, normals) in zip(self._surfaces, frame.surfaces, strict=True):
            surface.move(positions, normals)
        drawn = [self._draw_view(view) for view in frame.views]
        if [view.share for view in frame.views] == [1]:
            return drawn[0]
        mixed = sum(np.float32(view.share) * each for each, view in zip(drawn, frame.views, strict=True))
        return np.rint(mixed).astype(np.uint8)

    def _draw_view(self, view: ShownView) -> NDArray[np.uint8]:
        over = [Overlay(self.renderer.picture(pixels), opacity, edges) for pixels, opacity, edges in view.pictures]
        pixels = self.renderer.draw(view.camera, self._stage, self._surfaces, self._around, over)
        for each in over:
            each.picture.release()
        return pixels


def _surroundings(scene: Scene, renderer: GpuRenderer, path: Path) -> Surroundings:
    """Return the background, the floor and the light of a scene file.

    Raises
    ------
    SceneError
        The picture cannot be opened.
    """
    chosen, color = scene.background.shown_set, scene.floor.color
    painted = SETS[chosen or DEFAULT_SET]
    background: moderngl.Texture | Panorama
    if chosen is None:
        background = renderer.picture(overlays.background(scene.background, renderer.size, path))
    else:
        background = Panorama(renderer.tile(panorama(chosen)), PERIOD, TOP, BOTTOM)
    floor = None if scene.background.picture else painted.floor()
    if color is not None:
        floor = np.full((1, 1, 4), (*ImageColor.getrgb(color)[:3], 255), np.uint8)
    tile = None if floor is None else renderer.tile(floor)
    return Surroundings(background, tile, scene.floor.show, lighting_of(scene))
