"""Drawing of films: what a frame shows, and the canvas that makes its pixels."""

from collections import deque
from collections.abc import Generator, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

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
from engine_bridge.pictures.geometry import geometry_of
from engine_bridge.pictures.renderer import Renderer
from engine_bridge.pictures.surroundings import Overlay, Panorama, StageExtent, Surroundings
from engine_bridge.pictures.textures import textures_of
from puppetline.child_process import processor_count

MAX_THREADS = 8
"""Maximum number of frames that are drawn at a time, in some 80 MB each at 720p: more draw faster than one encodes."""

AHEAD = 2
"""Number of frames per thread that wait for being drawn or taken."""

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
    """Draws frames of a scene, in any number of threads.

    Parameters
    ----------
    scene : Scene
    path : Path
        The scene file.
    size : tuple of 2 ints
        Width and height, in pixels.
    samples : int
        Samples per pixel for edges.
    stage : StageExtent
        The space of all motion.
    characters : sequence of (parts, materials)

    Raises
    ------
    SceneError
        The background picture cannot be opened.
    """

    def __init__(
        self,
        scene: Scene,
        path: Path,
        size: tuple[int, int],
        samples: int,
        stage: StageExtent,
        characters: Sequence[tuple[Sequence[Part], Sequence[Appearance]]],
    ) -> None:
        self._size, self._samples, self._stage = size, samples, stage
        self._around = surroundings_of(scene, path, size)
        self._geometry = geometry_of(characters)
        self._idle = deque[Renderer]()

    def draw(self, frame: ShownFrame) -> NDArray[np.uint8]:
        """Return the pixels (h, w, 4) of a frame."""
        try:
            renderer = self._idle.pop()
        except IndexError:  # all are drawing
            renderer = Renderer(self._size, self._samples)
        drawn = [self._draw_view(renderer, frame, view) for view in frame.views]
        self._idle.append(renderer)
        if [view.share for view in frame.views] == [1]:
            return drawn[0]
        mixed = sum(np.float32(view.share) * each for each, view in zip(drawn, frame.views, strict=True))
        return np.rint(mixed).astype(np.uint8)

    def _draw_view(self, renderer: Renderer, frame: ShownFrame, view: ShownView) -> NDArray[np.uint8]:
        over = [Overlay(*each) for each in view.pictures]
        return renderer.draw(view.camera, self._stage, self._geometry, frame.surfaces, self._around, over)


def draw_in_order(frames: Iterable[ShownFrame], canvas: Canvas) -> Generator[NDArray[np.uint8], None, None]:
    """Yield the pixels (h, w, 4) of frames, of which several are drawn at a time."""
    count = min(processor_count(), MAX_THREADS)
    waiting = deque[Future[NDArray[np.uint8]]]()
    with ThreadPoolExecutor(count) as threads:
        try:
            for frame in frames:
                waiting.append(threads.submit(canvas.draw, frame))
                if len(waiting) > AHEAD * count:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            threads.shutdown(cancel_futures=True)


def surroundings_of(scene: Scene, path: Path, size: tuple[int, int]) -> Surroundings:
    """Return the background, the floor and the light of a scene file.

    Raises
    ------
    SceneError
        The picture cannot be opened.
    """
    chosen, color = scene.background.shown_set, scene.floor.color
    painted = SETS[chosen or DEFAULT_SET]
    background: NDArray[np.uint8] | Panorama
    if chosen is None:
        background = overlays.background(scene.background, size, path)
    else:
        background = Panorama(panorama(chosen), PERIOD, TOP, BOTTOM)
    floor = None if scene.background.picture else painted.floor()
    if color is not None:
        floor = np.full((1, 1, 4), (*ImageColor.getrgb(color)[:3], 255), np.uint8)
    tile = None if floor is None else textures_of([floor], np.linspace(0, 1, 256, dtype=np.float32))
    return Surroundings(background, tile, scene.floor.show, lighting=lighting_of(scene))
