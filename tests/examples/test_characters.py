import hashlib
import subprocess
import sys

import numpy as np
import pytest
from puppetline.examples.characters import CHARACTERS
from scipy import sparse
from scipy.sparse.csgraph import connected_components

VERTICES = {"dinosaur": 14_000, "biped": 60_000, "pegasus": 32_046, "dog": 18_114, "human": 15_154}
EXTENT = {"dinosaur": (2, 4.1), "biped": (1, 2.15), "pegasus": (2, 3.65), "dog": (2, 1.16), "human": (1, 1.75)}
"""Axis, and metres along it."""
GENUS = {"dinosaur": 0, "biped": 0, "pegasus": 2, "dog": 0, "human": 0}


def half_edges(faces):
    return faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)


@pytest.fixture(scope="session", params=list(VERTICES))
def character(request, example_character):
    return example_character(request.param)


def test_all_five_are_listed():
    assert set(CHARACTERS) == set(VERTICES)


def test_name_shapes_and_dtypes(character):
    assert CHARACTERS[character.name].__module__.endswith(character.name)
    assert character.vertices.shape[1:] == character.faces.shape[1:] == character.colors.shape[1:] == (3,)
    assert (character.vertices.dtype, character.faces.dtype) == (np.float64, np.int64)
    assert character.colors.dtype == np.float32
    assert len(character.colors) == len(character.vertices)


def test_has_exactly_as_many_vertices_as_in_the_paper_and_uses_them_all(character):
    assert len(character.vertices) == VERTICES[character.name]
    assert np.array_equal(np.unique(character.faces), np.arange(len(character.vertices)))


def test_every_edge_is_shared_by_two_oppositely_oriented_faces(character):
    ends = half_edges(character.faces)
    forth = ends[:, 0] * len(character.vertices) + ends[:, 1]
    back = ends[:, 1] * len(character.vertices) + ends[:, 0]
    assert len(np.unique(forth)) == len(forth)
    assert np.array_equal(np.sort(forth), np.sort(back))


def test_the_faces_around_each_vertex_form_one_fan(character):
    # Corner nodes of the same vertex are linked across each edge at it: one component a vertex, none pinched.
    faces, count = character.faces, len(character.vertices)
    corner = np.arange(faces.size).reshape(-1, 3)
    ends = half_edges(faces)
    at = np.stack([corner[:, [0, 1, 2]].ravel(), corner[:, [1, 2, 0]].ravel()], axis=1)
    forth, back = np.argsort(ends[:, 0] * count + ends[:, 1]), np.argsort(ends[:, 1] * count + ends[:, 0])
    links = np.concatenate([np.stack([at[forth, k], at[back, 1 - k]], axis=1) for k in (0, 1)])
    graph = sparse.coo_array((np.ones(len(links)), (links[:, 0], links[:, 1])), shape=(faces.size, faces.size))
    assert connected_components(graph, directed=False)[0] == count


def test_is_one_component_of_the_stated_genus(character):
    ends, count = half_edges(character.faces), len(character.vertices)
    graph = sparse.coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(count, count))
    assert connected_components(graph, directed=False)[0] == 1
    euler = count - len(ends) // 2 + len(character.faces)
    assert (2 - euler) / 2 == GENUS[character.name]


def test_is_oriented_outwards(character):
    a, b, c = (character.vertices[character.faces[:, k]] for k in range(3))
    assert np.einsum("ij,ij->", a, np.cross(b, c)) > 0


def test_triangles_are_well_shaped(character):
    corners = character.vertices[character.faces]
    sides = np.roll(corners, -1, axis=1) - corners
    lengths = np.linalg.norm(sides, axis=2)
    cosines = -np.einsum("ijk,ijk->ij", sides, np.roll(sides, 1, axis=1)) / (lengths * np.roll(lengths, 1, axis=1))
    smallest = np.degrees(np.arccos(np.clip(cosines, -1, 1))).min(axis=1)
    assert np.percentile(smallest, 1) > 30
    assert np.percentile(smallest, 0.1) > 20
    assert len(np.unique(np.sort(character.faces, axis=1), axis=0)) == len(character.faces)
    areas = np.linalg.norm(np.cross(sides[..., 0, :], sides[..., 1, :]), axis=1) / 2
    assert areas.min() > 1e-4 * areas.mean()


def test_stands_on_the_ground_on_legs_that_do_not_touch(character):
    low, high = character.vertices.min(axis=0), character.vertices.max(axis=0)
    assert low[1] == pytest.approx(0.0, abs=1e-3 * high[1])
    feet = character.vertices[character.vertices[:, 1] < 0.02 * high[1]]
    assert np.any(feet[:, 0] > 0.02 * high[1])
    assert np.any(feet[:, 0] < -0.02 * high[1])
    # Legs stand apart: nothing crosses the middle at shin height.
    shins = character.vertices[
        (character.vertices[:, 1] > 0.05 * high[1]) & (character.vertices[:, 1] < 0.15 * high[1])
    ]
    assert np.abs(shins[:, 0]).min() > 0.01 * high[1]


def test_has_its_natural_size(character):
    axis, metres = EXTENT[character.name]
    assert np.ptp(character.vertices[:, axis]) == pytest.approx(metres, rel=0.02)


def test_faces_positive_z(character):
    # Its eyes, or the slits of its visor: the darkest spots of the head are in front, on either side.
    height = character.vertices[:, 1]
    floor = {"pegasus": 2.6, "dinosaur": 2.45, "dog": 0.79, "human": 1.5, "biped": 1.8}[character.name]
    ceiling = {"pegasus": 2.85, "biped": 1.85}.get(character.name, np.inf)
    eyes = character.vertices[(height > floor) & (height < ceiling) & (character.colors.max(axis=1) < 0.05)]
    assert len(eyes)
    assert eyes[:, 2].min() > character.vertices[:, 2].mean() + 0.02 * np.ptp(character.vertices[:, 2])
    assert eyes[:, 0].min() < 0 < eyes[:, 0].max()


def test_colors_are_linear_rgb_with_dark_and_light_parts(character):
    assert character.colors.min() >= 0
    assert character.colors.max() <= 1
    light = character.colors.mean(axis=1)
    assert light.min() < 0.03
    assert light.max() > 0.5


@pytest.mark.slow
def test_two_processes_make_the_same_bytes(example_character):
    names = ("human", "dog")  # the others are made by the same functions, and take longer
    program = (
        "import hashlib; from puppetline.examples.characters import CHARACTERS\n"
        f"for c in (CHARACTERS[name]() for name in {names}):\n"
        "    print(hashlib.sha256(b''.join(a.tobytes() for a in (c.vertices, c.faces, c.colors))).hexdigest())"
    )
    made = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    arrays = [(each.vertices, each.faces, each.colors) for each in map(example_character, names)]
    assert made.split() == [hashlib.sha256(b"".join(a.tobytes() for a in each)).hexdigest() for each in arrays]
