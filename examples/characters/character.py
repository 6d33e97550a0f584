"""Characters, and their meshes made from figures."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..figure import Figure
from ..surface import Focus, mesh


@dataclass(frozen=True)
class ColoredSurface:
    """A coloured closed surface in metres: y up, facing +z, its right side at −x, its feet at y = 0.

    Parameters
    ----------
    name : str
    vertices : (n, 3) float64
    faces : (t, 3) int64
        Oriented outwards.
    colors : (n, 3) float32
        Linear RGB in [0, 1].
    """

    name: str
    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    colors: NDArray[np.float32]


def mesh_figure(name: str, figure: Figure, vertices: int, foci: Sequence[Focus] = ()) -> ColoredSurface:
    """Return the mesh of a figure with a given number of coloured vertices."""
    v, f = mesh(figure.distance, *figure.bounds(), vertices, foci)
    return ColoredSurface(name, v, f, _smooth_colors(figure, v, f).astype(np.float32))


def _smooth_colors(figure: Figure, v: NDArray[np.float64], f: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return colours (n, 3): the mean of the vertex's and the surrounding triangles' colours, for smooth boundaries."""
    around = figure.colors(v[f].mean(axis=1))
    count = np.bincount(f.ravel(), minlength=len(v))
    mean = np.stack([np.bincount(f.ravel(), np.repeat(c, 3), len(v)) / count for c in around.T], axis=1)
    return (figure.colors(v) + mean) / 2
