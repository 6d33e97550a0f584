"""The renderer: characters in perspective, in soft light, on a floor, with pictures over them."""

from collections.abc import Sequence
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

from engine_bridge.pictures.backdrop import Rays, rays_of, show, show_floor, show_panorama, show_shadows
from engine_bridge.pictures.camera import NEAR_SHARE, Camera
from engine_bridge.pictures.drawing import Moment, Samples, blend, cover, paint
from engine_bridge.pictures.geometry import Geometry
from engine_bridge.pictures.lights import SKY_PENUMBRA, lights_of
from engine_bridge.pictures.surroundings import Overlay, Panorama, StageExtent, Surroundings

SAMPLES = 4
"""Samples per pixel for edges."""

PLACES = {1: np.array([[0.5, 0.5]]), 4: np.array([[0.375, 0.125], [0.875, 0.375], [0.125, 0.625], [0.625, 0.875]])}
"""Column and row of the samples in a pixel, by their number."""

FLOOR_REACH, FLOOR_TILE = 9.0, 1.6
"""Radius of the visible floor in radii of the stage, and width of its repeated picture in `StageExtent.size`."""

Window = tuple[int, int, int, int]
"""First column and row of a part of a frame, and those after its last."""


class Renderer:
    """Draws frames of one size, one at a time. Several threads need a renderer each.

    Parameters
    ----------
    size : tuple of 2 ints
        Width and height, in pixels.
    samples : int
        Samples per pixel for edges, one of `PLACES`.
    """

    def __init__(self, size: tuple[int, int], samples: int = SAMPLES) -> None:
        self.size = size
        width, height = size
        shape = height, width, samples
        nearness, shares = np.empty(shape, np.float32), np.empty((*shape, 2), np.float32)
        self._samples = Samples(PLACES[samples], nearness, np.empty(shape, np.int32), shares)
        self._behind = np.empty((height, width, 4), np.uint8)
        self._is_behind: tuple[object, ...] = ()

    def draw(
        self,
        camera: Camera,
        stage: StageExtent,
        geometry: Geometry,
        moved: Sequence[tuple[NDArray[np.float32], NDArray[np.float32]]],
        around: Surroundings,
        overlays: Sequence[Overlay] = (),
    ) -> NDArray[np.uint8]:
        """Draw a frame.

        Parameters
        ----------
        camera : Camera
        stage : StageExtent
        geometry : Geometry
        moved : sequence of ((n, 3), (n, 3)) float32
            Positions and unit normals of the vertices of each character.
        around : Surroundings
        overlays : sequence of Overlay

        Returns
        -------
        (height, width, 4) uint8
            sRGB; the fourth channel is undefined.
        """
        rays = rays_of(camera, self.size)
        frame = self._drawn_around(camera, stage, around, rays)
        if moved:
            points, normals = (np.concatenate(each) for each in zip(*moved, strict=True))
            self._draw_characters(frame, camera, stage, geometry, points, normals, around, rays)
        for overlay in overlays:
            show(frame, overlay)
        return frame

    def _drawn_around(self, camera: Camera, stage: StageExtent, around: Surroundings, rays: Rays) -> NDArray[np.uint8]:
        """Return a frame with the background and the floor, which stay the same while the camera does not move."""
        matrix = camera.matrix(self.size).tobytes()
        if self._is_behind != (matrix, stage, around):
            self._is_behind = matrix, stage, around
            if isinstance(around.background, Panorama):
                show_panorama(self._behind, around.background, rays)
            else:
                self._behind[:] = around.background
            if around.has_floor and around.floor is not None:
                reach, tile = FLOOR_REACH * stage.radius, FLOOR_TILE * stage.size
                show_floor(self._behind, around.floor, rays, stage.center, reach, tile)
        return self._behind.copy()

    def _draw_characters(
        self,
        frame: NDArray[np.uint8],
        camera: Camera,
        stage: StageExtent,
        geometry: Geometry,
        points: NDArray[np.float32],
        normals: NDArray[np.float32],
        around: Surroundings,
        rays: Rays,
    ) -> None:
        """Draw characters with vertices (n, 3) and unit normals (n, 3) over a frame, and their shadows on the floor."""
        lights = lights_of(around.lighting, stage, points, geometry.casting)
        axes = np.ascontiguousarray(points.T)  # of which NumPy finds extremes 40 times as fast
        own = [axes[:, first:last] for first, last in pairwise(geometry.starts)]
        boxes = np.array([(each.min(axis=1), each.max(axis=1)) for each in own])
        if around.has_floor:
            window = self._window(_shadows(boxes, lights.towards, SKY_PENUMBRA * stage.size), camera)
            show_shadows(frame, lights, rays, window)
        window = self._window(boxes, camera)
        moment = Moment(
            geometry.surfaces,
            points,
            normals,
            self._projected(points, camera),
            rays.eye,
            near=NEAR_SHARE * float(np.linalg.norm(camera.eye - camera.target)),
            side=float(np.sign(camera.eye[1])) if around.has_floor and around.floor_hides else 0.0,
            lights=lights,
            at_vertices=np.full((2 * len(points), 3), np.nan, np.float32),
        )
        cover(moment, self._samples, window)
        paint(moment, self._samples, window, frame)
        away = np.linalg.norm(boxes.mean(axis=1) - camera.eye, axis=1)
        for number in np.argsort(-away, kind="stable"):
            if len(geometry.transparent[number]):
                blend(moment, self._samples, window, geometry.transparent[number], frame)

    def _projected(self, points: NDArray[np.float32], camera: Camera) -> NDArray[np.float32]:
        """Return the columns and rows of points (n, 3) times their distances from the camera's plane, and these."""
        width, height = self.size
        to_pixels = np.array([[width / 2, 0, 0], [0, height / 2, 0], [0, 0, 0], [width / 2, height / 2, 1]])
        pixels = (camera.matrix(self.size).astype(np.float64) @ to_pixels).astype(np.float32)
        projected: NDArray[np.float32] = points @ pixels[:3] + pixels[3]
        return projected

    def _window(self, boxes: NDArray[np.float32], camera: Camera) -> Window:
        """Return the part of the frame that boxes (n, 2, 3) cover."""
        low, high = boxes[:, 0], boxes[:, 1]
        corners = np.concatenate([np.where(bits, high, low) for bits in product((False, True), repeat=3)])
        projected = self._projected(corners.astype(np.float32), camera)
        if (projected[:, 2] <= 0).any():  # beside or behind the camera
            return 0, 0, *self.size
        pixels = projected[:, :2] / projected[:, 2:]
        left, top = np.clip(np.floor(pixels.min(axis=0)), 0, self.size).astype(int).tolist()
        right, bottom = np.clip(np.ceil(pixels.max(axis=0)), 0, self.size).astype(int).tolist()
        return left, top, right, bottom


def _shadows(boxes: NDArray[np.float32], towards: NDArray[np.float64], blur: float) -> NDArray[np.float32]:
    """Return boxes (n, 2, 3) around the shadows of boxes on the floor, of a light and of the sky above."""
    ways = boxes[:, 1, 1, None] * (towards / towards[1])
    low = np.minimum(boxes[:, 0], boxes[:, 0] - ways) - blur
    high = np.maximum(boxes[:, 1], boxes[:, 1] - ways) + blur
    shadows: NDArray[np.float32] = np.stack([low, high], axis=1) * [1, 0, 1]
    return shadows
