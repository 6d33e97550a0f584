"""What the film shows at each moment: the reply to `PlanFilm`. Positions in the picture are shares of its size."""

from collections.abc import Mapping, Sequence
from typing import Literal

from puppetline.toml_schema import Table

Pair = tuple[float, float]
Triple = tuple[float, float, float]


class BubbleShape(Table):
    """A speech bubble: its lines with their widths, the height of its letters, and half of its size."""

    kind: Literal["speech", "thought", "name"]
    lines: Sequence[tuple[str, float]]
    letter: float
    half: Pair


class ShownBubble(Table):
    """A bubble that is visible: its number, its opacity, its middle, and the tip of its tail."""

    number: int
    opacity: float
    middle: Pair
    tip: Pair


class ShownView(Table):
    """What a camera sees: the number of its shot, its share during a cross-fade, its place in metres, and bubbles."""

    shot: int
    share: float
    eye: Triple
    target: Triple
    field_of_view: float
    bubbles: Sequence[ShownBubble]


class Moment(Table):
    """A moment of the film.

    Attributes
    ----------
    brightness : float
        From 0 to 1.
    titles : list of float
        Opacity of each title of the scene.
    views : list of ShownView
        One, or two during a cross-fade.
    places : dict
        Of each character: the position of its origin in metres, from which it walks, and its turn in degrees.
    """

    brightness: float
    titles: Sequence[float]
    views: Sequence[ShownView]
    places: Mapping[str, tuple[float, float, float, float]]


class FilmPlan(Table):
    """The film's size in pixels, its bubbles, and its moments, which are `step` seconds apart."""

    size: tuple[int, int]
    step: float
    bubbles: Sequence[BubbleShape]
    moments: Sequence[Moment]
