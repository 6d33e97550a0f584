"""Figures: solid parts with colours, combined in order."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .sdf import Array, Shape, mirror, smooth_minimum

Color = tuple[float, float, float]
"""Linear RGB in [0, 1]."""
Operation = Literal["add", "carve", "paint"]
Pattern = Callable[[Array, Array], Array]
"""Function from points (n, 3) and their colours (n, 3) to new colours (n, 3)."""


@dataclass(frozen=True)
class Part:
    """One step of a figure.

    Parameters
    ----------
    shape : Shape
        The solid that is added, carved or painted.
    color : Color
        Colour of the surface that the step makes.
    blend : float
        Distance over which surface and colour blend with the existing ones, in metres.
    how : {"add", "carve", "paint"}
        Add the shape, remove it, or only colour the surface inside it.
    """

    shape: Shape
    color: Color
    blend: float = 0.0
    how: Operation = "add"


def both(shape: Shape, color: Color, blend: float = 0.0, how: Operation = "add") -> Part:
    """Return the part for a shape on the left (x > 0) and its mirror image on the right."""
    return Part(mirror(shape), color, blend, how)


@dataclass(frozen=True)
class Figure:
    """Parts and patterns in order; each acts on the result of those before it."""

    steps: Sequence[Part | Pattern]

    def bounds(self) -> tuple[Array, Array]:
        """Return the corners (3,) of a box around the figure."""
        added = [step.shape for step in self.steps if isinstance(step, Part) and step.how == "add"]
        return np.min([s.low for s in added], axis=0), np.max([s.high for s in added], axis=0)

    def distance(self, points: Array) -> Array:
        """Return the signed distances (n,) of points (n, 3) to the surface."""
        total = np.full(len(points), np.inf)
        for step in self.steps:
            if isinstance(step, Part) and step.how != "paint":
                self._shape(step, points, total)
        return total

    def colors(self, points: Array) -> Array:
        """Return linear RGB (n, 3) of points (n, 3) on the surface."""
        total, colors = np.full(len(points), np.inf), np.zeros((len(points), 3))
        for step in self.steps:
            if isinstance(step, Part):
                near, weight = self._shape(step, points, total)
                colors[near] += weight[:, None] * (np.array(step.color) - colors[near])
            else:
                colors = step(points, colors)
        return colors

    @staticmethod
    def _shape(part: Part, points: Array, total: Array) -> tuple[NDArray[np.intp], Array]:
        """Update the distances in `total`; return the points that the part affects, and its share of their colour."""
        sign = 1.0 if part.how == "add" else -1.0
        reach = sign * total + part.blend if part.how != "paint" else np.full(len(points), part.blend)
        near = part.shape.within(points, reach)
        before, own = sign * total[near], part.shape.distance(points[near])
        if part.how == "paint":
            before = np.zeros_like(own)
        else:
            total[near] = sign * smooth_minimum(before, own, part.blend)
        return near, np.clip(0.5 + 0.5 * (before - own) / max(part.blend, 1e-9), 0.0, 1.0)
