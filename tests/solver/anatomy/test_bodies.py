import numpy as np
import pytest
from numpy.testing import assert_array_equal

from solver.anatomy.bodies import STILL, find_bodies
from solver.surface.mesh import weld

from ..shapes import box, joined, points, sphere

PLATE_FACES = np.array([[0, 2, 1], [0, 3, 2]])


def moved(shape, by):
    return shape[0] + by, shape[1]


class Person:
    """The example, and what is around it."""

    def __init__(self, made):
        vertices = np.asarray(made.vertices, float)
        self.shape = vertices, np.asarray(made.faces)
        low, self.high = vertices.min(axis=0), vertices.max(axis=0)
        self.ground, self.hand = low[1], vertices[vertices[:, 0].argmax()]
        self.feet = vertices[vertices[:, 1] < low[1] + 0.05]
        self.aside = np.array([1.5 * np.ptp(vertices[:, 0]), 0.0, 0.2])
        self.floor = self.box([-9, -0.05, -9], [9, 0.005, 9])
        self.stone = moved(self.box([0, 0, 0], [0.3, 0.2, 0.3]), self.aside)
        corners = [[x, self.ground, z] for x, z in ((-2, -2), (2, -2), (2, 2), (-2, 2))]
        self.plate = np.array(corners), PLATE_FACES

    def beside(self, steps):
        return moved(self.shape, steps * self.aside)

    def box(self, low, high):
        """A box at heights above the ground."""
        up = np.array([0, self.ground, 0])
        return box([low + up, high + up])

    def shoe(self, side):
        foot, room = self.feet[side * self.feet[:, 0] > 0], np.array([0.01, 0.0, 0.02])
        return box([foot.min(axis=0) - room, foot.max(axis=0) + room])

    def floating(self, radius, place, steps=0):
        """A ball at a place in units of the outermost corner of the figure."""
        return sphere(1, radius, steps * self.aside + self.high * place)

    def hall(self):
        return [(STILL, self.floor), (STILL, self.stone), (1, self.shape), (2, self.beside(2))]


SCENES = {
    "a figure": lambda p: [(1, p.shape)],
    "on a plate": lambda p: [(STILL, p.plate), (1, p.shape)],
    "on a pedestal on a floor": lambda p: [
        (1, p.shape),
        (STILL, p.box([-0.4, -0.3, -0.4], [0.4, 0, 0.4])),
        (STILL, moved(p.floor, [0, -0.3, 0])),
    ],
    "a stone beside": lambda p: [(STILL, p.stone), (1, p.shape)],
    "two figures in the order of the mesh": lambda p: [(1, p.beside(1)), (2, p.shape)],
    "a hall": Person.hall,
    "a thing in a hand": lambda p: [(1, p.shape), (1, box(p.hand + points("-0.03 -0.03 -0.03, 0.03 0.5 0.03")))],
    "what floats above": lambda p: [(1, p.shape), (1, sphere(1, 0.1, [0, p.high[1] + 0.3, 0]))],
    "two figures, and what floats beside each": lambda p: [
        (1, p.shape),
        (2, p.beside(2)),
        *((1, p.floating(0.02, [-1.3, share, 0])) for share in (0.4, 0.6)),
        *((2, p.floating(0.02, [-1.3, share, 0], steps=2)) for share in (0.4, 0.6)),
    ],
    "shoes": lambda p: [(1, p.shape), (1, p.shoe(1)), (1, p.shoe(-1))],
    "two feet that touch nothing": lambda p: [
        (1, p.shape),
        (1, p.box([1.1, 0, 0], [1.2, 0.1, 0.2])),
        (1, p.box([-1.2, 0, 0], [-1.1, 0.1, 0.2])),
    ],
}
"""Surfaces, and the body of which each of them is."""


@pytest.fixture(scope="module")
def person(example_character):
    return Person(example_character("human"))


def welded(scene):
    """The solver mesh of a scene, and the number of the body of each of its vertices."""
    numbers, shapes = zip(*scene, strict=True)
    mesh = weld(*joined(*shapes))
    wanted = np.zeros(len(mesh.vertices), dtype=np.int64)
    wanted[mesh.of_render] = np.repeat(numbers, [len(vertices) for vertices, _ in shapes])
    return mesh, wanted


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("turn", [np.eye(3), [[1, 0, 0], [0, 0, 1], [0, -1, 0]]], ids=["y up", "z up"])
def test_figures_are_told_from_each_other_and_from_what_is_under_and_beside_them(person, scene, turn):
    mesh, wanted = welded([(number, (vertices @ turn, faces)) for number, (vertices, faces) in SCENES[scene](person)])
    assert_array_equal(find_bodies(mesh), wanted)


def test_what_belongs_together_is_one_body(person):
    mesh, wanted = welded(person.hall())
    together = np.where(wanted == STILL, -1, 7)
    assert_array_equal(find_bodies(mesh, together), np.minimum(wanted, 1))


@pytest.mark.parametrize("axes", [[0, 1, 2], [0, 2, 1]], ids=["flat along z", "flat along y"])
def test_flat_figures_stand_along_the_axis_along_which_they_have_a_height(axes):
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])[:, axes]
    mesh, _ = welded([(number, moved((square, PLATE_FACES), [3 * number, 0, 0])) for number in (1, 2)])
    assert_array_equal(find_bodies(mesh)[mesh.of_render], np.repeat([1, 2], 4))
