"""The plan of a film: what each frame shows, by which cameras, with which bubbles and titles, and how bright it is.

The video is drawn by it, and the studio's page plays it.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from engine_bridge.film.bubbles import Bubble, BubblePlace
from engine_bridge.film.framing import Extent, Shots, View, rectangle
from engine_bridge.film.overlays import fading
from engine_bridge.film.production import Production


class ShownBubble(NamedTuple):
    """A bubble in a frame: its number in the scene, from 0 on, how visible it is, and where it is in the picture."""

    number: int
    opacity: float
    place: BubblePlace


class FilmPlan:
    """The plan of a production.

    Parameters
    ----------
    production : Production
    extents : mapping of str to Extent
        Of each character.
    bubbles : sequence of Bubble
        Of all tables of the scene, for this size.
    size : tuple of 2 ints
        Width and height of the frames in pixels.
    """

    def __init__(
        self, production: Production, extents: Mapping[str, Extent], bubbles: Sequence[Bubble], size: tuple[int, int]
    ) -> None:
        self._production, self._extents, self._bubbles, self._size = production, extents, bubbles, size
        self._shots = Shots(production.scene.camera, extents, production.fps, size)
        self._usual_heads: dict[tuple[int, int], NDArray[np.float64]] = {}

    def views(self, frame: int) -> list[View]:
        """Return the view of a frame, or during a cross-fade both."""
        return self._shots.views(frame)

    def brightness(self, frame: int) -> float:
        """Return how bright a frame is while the film fades from or to black, from 0 to 1."""
        table, fps, left = self._production.scene.film, self._production.fps, self._production.frames - 1 - frame
        fades = (frame, table.fade_in), (left, table.fade_out)
        return min([1.0, *(count / (fade * fps) for count, fade in fades if fade)])

    def titles(self, frame: int) -> list[float]:
        """Return how visible each title is in a frame, from 0 to 1."""
        time = frame / self._production.fps
        return [fading(time, table.at, table.seconds, table.fade) for table in self._production.scene.title]

    def bubbles(self, frame: int, view: View) -> Iterator[ShownBubble]:
        """Yield the bubbles that are visible in a view of a frame."""
        for number, bubble in enumerate(self._bubbles):
            opacity = bubble.opacity(frame / self._production.fps)
            if opacity == 0:
                continue
            if (number, view.shot) not in self._usual_heads:
                self._usual_heads[number, view.shot] = self._usual_head(bubble, view)
            extent = self._extents[bubble.table.character]
            head, body = (self._pixels(view, boxes[frame]) for boxes in (extent.head, extent.whole))
            if bubble.table.kind == "name" and ((body[1] < 0) | (body[0] > self._size)).any():
                continue  # a character outside the picture may speak, but a name would be beside nothing
            yield ShownBubble(number, opacity, bubble.place(head, body, self._usual_heads[number, view.shot]))

    def _usual_head(self, bubble: Bubble, seen: View) -> NDArray[np.float64]:
        """Return the mean rectangle (2, 2) of a head in a shot while a bubble is shown, in pixels."""
        table, fps = bubble.table, self._production.fps
        first, end = round(table.at * fps), round((table.at + table.seconds) * fps)
        heads = self._extents[table.character].head
        shown = [
            self._pixels(view, heads[frame])
            for frame in range(first, min(end + 1, self._production.frames))
            for view in self._shots.views(frame)
            if view.shot == seen.shot
        ]
        usual: NDArray[np.float64] = np.mean(shown, axis=0)
        return usual

    def _pixels(self, view: View, box: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the upper left and lower right corner (2, 2) of a box (2, 3) in a view, in pixels."""
        return (rectangle(view.camera, box, self._size) / 2 + 0.5) * self._size
