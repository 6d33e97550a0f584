"""A Sphinx extension that draws the figures of "How it works" from the reduced model of an example character.

`python docs/site/figures.py` writes them to docs/images, for readers of the Markdown; the site gets new ones.
"""

import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from sphinx.application import Sphinx

from engine_bridge.character.examples import prepare
from engine_bridge.performance.prepared_character import load_prepared
from engine_bridge.pictures.mesh_picture import render
from engine_bridge.pictures.view import View

CHARACTER = "human"
SIZE = (250, 400)
"""Width and height of each picture in a figure, in pixels."""

LOW, MIDDLE, HIGH = (0.03, 0.10, 0.42), (0.82, 0.80, 0.74), (0.62, 0.10, 0.02)
"""Linear RGB colours of the values of a field."""

FIELDS = (0, 1, 3, 6)
"""The fields that are shown: two of the surface's own, and two along limbs."""


def draw(folder: Path) -> None:
    """Write the figures to a folder."""
    with tempfile.TemporaryDirectory() as temporary:
        prepared = load_prepared(prepare(CHARACTER, Path(temporary))[1])
    mesh, model = prepared.mesh, prepared.model
    view = View.around(mesh.vertices, 20.0, 8.0, SIZE)

    def write(name: str, colors: list[NDArray[np.float64]]) -> None:
        pictures = [render(mesh.vertices, mesh.faces, view, SIZE, each) for each in colors]
        Image.fromarray(np.hstack(pictures)).save(folder / name, quality=82, method=6)

    write("fields.webp", [_bands(model.isoline_coordinates[:, field], model.isolines) for field in FIELDS])
    write("regions.webp", [_distinct(each) for each in (model.regions.owner, model.cluster)])


def _bands(t: NDArray[np.float32], isolines: int) -> NDArray[np.float64]:
    """Return colours (n, 3) of what lies between two isolines; every other band is darker, so that isolines show."""
    band = np.where(t <= 0, 0, np.floor(t) + 1)
    colors = [np.interp(band, [0, isolines / 2, isolines], each) for each in zip(LOW, MIDDLE, HIGH, strict=True)]
    return np.stack(colors, axis=1) * np.where(band % 2, 0.6, 1.0)[:, None]


def _distinct(label: NDArray[np.integer]) -> NDArray[np.float64]:
    """Return a colour (n, 3) for each label, far from those of the next ones."""
    hue = label[:, None] * (np.sqrt(5) - 1) / 2 + np.array([0, 1, 2]) / 3
    return (0.42 + 0.36 * np.cos(2 * np.pi * hue)) * np.array([1.0, 0.7, 0.45])[label % 3, None]


def _draw_for_the_site(app: Sphinx, failure: Exception | None) -> None:
    if not failure and app.builder.name == "html":
        draw(Path(app.outdir) / "_images")


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the extension."""
    app.connect("build-finished", _draw_for_the_site)
    return {"parallel_read_safe": True}


if __name__ == "__main__":
    draw(Path(__file__).parents[1] / "images")
