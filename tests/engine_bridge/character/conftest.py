"""A cube and a ball; the figures of the exports' tests."""

from types import SimpleNamespace

import numpy as np
import pytest

from ...solver.shapes import sphere
from ..export.conftest import variant, variants

__all__ = ["variant", "variants"]

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
SIDES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], np.uint16)
"""A tetrahedron."""

VERTICES = np.array([[x, y, z] for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)])
QUADS = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [3, 2, 6, 7], [2, 0, 4, 6], [1, 3, 7, 5]]


@pytest.fixture
def cube():
    """The unit cube: 8 vertices, 6 quads, and the 12 triangles of their fans."""
    triangles = np.array([[a, *rest] for a, b, c, d in QUADS for rest in ((b, c), (c, d))])
    return SimpleNamespace(vertices=VERTICES.copy(), quads=[list(quad) for quad in QUADS], triangles=triangles)


@pytest.fixture
def ball():
    """A round surface of 162 vertices; its edges are all soft."""
    vertices, triangles = sphere(2)
    return SimpleNamespace(vertices=vertices, triangles=triangles)


@pytest.fixture
def written(tmp_path):
    """Write a file and return its path."""

    def write(name, content):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write
