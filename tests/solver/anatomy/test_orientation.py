from functools import cache

import numpy as np
import pytest

from solver.anatomy import orientation
from solver.surface.mesh import SolverMesh

from ..shapes import TURNS, body_of, capsules, tube

STANDS = {
    "armadillo.obj": ("y", "z"),
    "beast_32k_quads.obj": ("y", "z"),
    "cat_7k.obj": ("y", "z"),
    "dinosaur_14k.obj": ("y", "-x"),
    "homer_6k.obj": ("y", "z"),
    "human_crane_10k.obj": ("y", "-x"),
    "spot_cow_uv.obj": ("y", "-z"),
}
"""Up and front as seen in pictures of them."""


def vector(direction):
    return np.eye(3)["xyz".index(direction[-1])] * (-1 if direction[0] == "-" else 1)


def name(direction):
    axis = int(np.abs(direction).argmax())
    return ("-" if direction[axis] < 0 else "") + "xyz"[axis]


def changed(mesh, vertices):
    return SolverMesh(vertices, mesh.faces, mesh.of_render)


def assert_turns_with_the_mesh(mesh, up, front, turns):
    for turned in turns:
        found = orientation.propose(changed(mesh, mesh.vertices @ turned))
        assert (found.up, found.front) == (name(vector(up) @ turned), name(vector(front) @ turned))


@pytest.fixture(scope="module")
def example(example_character):
    @cache
    def make(name):
        character = example_character(name)
        return SolverMesh(character.vertices, character.faces, np.arange(len(character.vertices)))

    return make


@pytest.mark.parametrize(
    ("character", "turns"), [("dog", TURNS[::10]), ("human", TURNS[5:6]), ("dinosaur", TURNS[20:21])]
)
def test_a_character_that_is_turned_or_mirrored_gets_the_same_answer_turned(example, character, turns):
    mesh = example(character)
    assert_turns_with_the_mesh(mesh, "y", "z", turns)
    found = orientation.propose(mesh)
    assert found.confidence > orientation.MIN_PROBABILITIES[1]
    image = orientation.propose(changed(mesh, mesh.vertices * [-1, 1, 1]))
    assert (image.up, image.front) == (found.up, found.front)
    turned = orientation.propose(changed(mesh, mesh.vertices @ TURNS[7]))
    assert [image.confidence, turned.confidence] == pytest.approx([found.confidence] * 2, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(("number", "file"), list(enumerate(STANDS)))
def test_real_characters_stand_on_their_feet_and_face_forwards_however_they_lie(real_mesh, number, file):
    assert_turns_with_the_mesh(real_mesh(file), *STANDS[file], [TURNS[5 * (number % 5)]])


@pytest.fixture
def ball():
    heights = np.linspace(-0.9, 0.9, 13)
    sphere, faces = tube(heights, np.sqrt(1 - heights**2), 24)
    return SolverMesh(sphere[:, [1, 0, 2]], faces[:, ::-1], np.arange(len(sphere)))


def test_a_shape_that_says_nothing_keeps_the_convention_of_gltf(ball):
    found = orientation.propose(ball)
    assert (found.up, found.front) == ("y", "z")
    assert found.confidence < 0.5
    assert ["not clear" in reason for reason in found.reasons] == [True, True]


def test_an_insect_stands_on_its_six_legs_also_in_the_air():
    insect = body_of(
        capsules("""
        0   0.5  -0.9   0    0.5  -0.2    0.22
        0   0.5  -0.1   0    0.5   0.35   0.17
        0   0.5   0.55  0    0.5   0.6    0.16
        0.1 0.45  0.3   0.55 0.75  0.525  0.03 *
        0.1 0.45  0.1   0.55 0.75  0.1    0.03 *
        0.1 0.45 -0.1   0.55 0.75 -0.325  0.03 *
        0.55 0.75  0.525 1   0.03  0.75   0.03 *
        0.55 0.75  0.1   1   0.03  0.1    0.03 *
        0.55 0.75 -0.325 1   0.03 -0.55   0.03 *
        """)
    )
    for ground in (0.0, 0.5):
        up = [0, ground - insect.vertices[:, 1].min(), 0]
        found = orientation.propose(changed(insect, insect.vertices + up))
        assert (found.up, found.front) == ("y", "z")


def test_a_flat_figure_is_no_division_by_nothing():
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 2, 0], [0, 2, 0], [0.5, 1, 0]], float)
    faces = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
    with np.errstate(all="raise"):
        found = orientation.propose(SolverMesh(square, faces, np.arange(5)))
    assert (found.up, found.front) == ("y", "z")


def test_what_the_format_specifies_decides_sooner(real_mesh):
    """The front of this cow is likely, but not certain."""
    mesh = real_mesh("spot_cow_uv.obj")
    assert [orientation.propose(mesh, specified=specified).front for specified in (False, True)] == ["-z", "z"]


def test_given_axes_are_kept_and_the_others_fit_them(example):
    mesh = example("dog")
    for up, front in (("y", None), (None, "z"), ("-z", "x"), ("x", None)):
        found = orientation.propose(mesh, up, front)
        assert found.up == (up or "y")
        assert front in (None, found.front)
        assert found.up[-1] != found.front[-1]
        assert up != "y" or found.front == "z"
