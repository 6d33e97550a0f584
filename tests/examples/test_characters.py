import hashlib
import subprocess
import sys

import igl
import numpy as np
import pytest
from puppetline.examples.characters import CHARACTERS

VERTICES = {"dinosaur": 14_000, "biped": 60_000, "pegasus": 32_046, "dog": 18_114, "human": 15_154}
"""As many as in the paper."""
EXTENT = {"dinosaur": (2, 4.1), "biped": (1, 2.15), "pegasus": (2, 3.65), "dog": (2, 1.16), "human": (1, 1.75)}
"""Axis, and metres along it."""
GENUS = {"dinosaur": 0, "biped": 0, "pegasus": 2, "dog": 0, "human": 0}
EYES = {
    "pegasus": (2.6, 2.85),
    "dinosaur": (2.45, np.inf),
    "dog": (0.79, np.inf),
    "human": (1.5, np.inf),
    "biped": (1.8, 1.85),
}
"""Heights between which the darkest spots are the eyes, or the slits of a visor."""


@pytest.fixture(scope="session", params=list(VERTICES))
def character(request, example_character):
    return example_character(request.param)


def test_the_arrays_have_one_row_per_vertex_and_every_vertex_is_used(character):
    assert set(CHARACTERS) == set(VERTICES)
    assert CHARACTERS[character.name].__module__.endswith(character.name)
    count = VERTICES[character.name]
    assert (character.vertices.shape, character.vertices.dtype) == ((count, 3), np.float64)
    assert (character.colors.shape, character.colors.dtype) == ((count, 3), np.float32)
    assert (character.faces.shape[1:], character.faces.dtype) == ((3,), np.int64)
    assert np.array_equal(np.unique(character.faces), np.arange(count))
    assert 0 <= character.colors.min() <= character.colors.max() <= 1
    light = character.colors.mean(axis=1)
    assert light.min() < 0.03
    assert light.max() > 0.5


def test_it_is_one_closed_surface_of_the_stated_genus_that_faces_outwards(character):
    faces = character.faces
    sides = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    forth, back = (np.unique(each, axis=0) for each in (sides, sides[:, ::-1]))
    assert len(forth) == len(sides)
    assert np.array_equal(forth, back)  # each edge has two faces, which agree
    assert igl.is_vertex_manifold(faces).all()  # none is pinched
    assert igl.facet_components(faces)[0] == 1
    assert (2 - igl.euler_characteristic(faces)) / 2 == GENUS[character.name]
    a, b, c = (character.vertices[faces[:, k]] for k in range(3))
    assert np.einsum("ij,ij->", a, np.cross(b, c)) > 0


def test_triangles_are_well_shaped(character):
    smallest = np.degrees(igl.internal_angles(character.vertices, character.faces)).min(axis=1)
    assert np.percentile(smallest, 1) > 30
    assert np.percentile(smallest, 0.1) > 20
    assert len(np.unique(np.sort(character.faces, axis=1), axis=0)) == len(character.faces)
    areas = igl.doublearea(character.vertices, character.faces)
    assert areas.min() > 1e-4 * areas.mean()


def test_it_stands_on_the_ground_in_its_natural_size_on_legs_apart_and_faces_positive_z(character):
    axis, metres = EXTENT[character.name]
    x, y, z = character.vertices.T
    assert np.ptp(character.vertices[:, axis]) == pytest.approx(metres, rel=0.02)
    tall = y.max()
    assert y.min() == pytest.approx(0.0, abs=1e-3 * tall)
    feet, shins = x[y < 0.02 * tall], x[(y > 0.05 * tall) & (y < 0.15 * tall)]
    assert feet.min() < -0.02 * tall
    assert feet.max() > 0.02 * tall
    assert np.abs(shins).min() > 0.01 * tall  # nothing crosses the middle
    low, high = EYES[character.name]
    eyes = character.vertices[(y > low) & (y < high) & (character.colors.max(axis=1) < 0.05)]
    assert eyes[:, 2].min() > z.mean() + 0.02 * np.ptp(z)
    assert eyes[:, 0].min() < 0 < eyes[:, 0].max()


@pytest.mark.slow
def test_two_processes_make_the_same_bytes(example_character):
    """The other characters are made by the same functions, and take longer."""
    program = (
        "import hashlib; from puppetline.examples.characters import CHARACTERS; made = CHARACTERS['human']()\n"
        "print(hashlib.sha256(made.vertices.tobytes() + made.faces.tobytes() + made.colors.tobytes()).hexdigest())"
    )
    printed = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    made = example_character("human")
    content = made.vertices.tobytes() + made.faces.tobytes() + made.colors.tobytes()
    assert printed.strip() == hashlib.sha256(content).hexdigest()
