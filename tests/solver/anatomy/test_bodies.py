import numpy as np
import pytest
from numpy.testing import assert_array_equal
from puppetline.examples.characters import human

from solver.anatomy.bodies import STILL, find_bodies
from solver.surface.mesh import weld

from ..shapes import box, sphere

MADE = human.build()
PERSON = np.asarray(MADE.vertices, float), np.asarray(MADE.faces)
LOW, HIGH = PERSON[0].min(axis=0), PERSON[0].max(axis=0)
HAND = PERSON[0][PERSON[0][:, 0].argmax()]
FEET = PERSON[0][PERSON[0][:, 1] < LOW[1] + 0.05]
ASIDE = np.array([1.5 * np.ptp(PERSON[0][:, 0]), 0.0, 0.2])


def moved(shape, by):
    return shape[0] + by, shape[1]


def shoe(side):
    foot = FEET[side * FEET[:, 0] > 0]
    return box(foot.min(axis=0) - [0.01, 0.0, 0.02], foot.max(axis=0) + np.array([0.01, 0.0, 0.02]))


FLOOR = box([-9, LOW[1] - 0.05, -9], [9, LOW[1] + 0.005, 9])
PLATE = np.array([[x, LOW[1], z] for x, z in ((-2, -2), (2, -2), (2, 2), (-2, 2))]), np.array([[0, 2, 1], [0, 3, 2]])
PEDESTAL = box([-0.4, LOW[1] - 0.3, -0.4], [0.4, LOW[1], 0.4])
STONE = moved(box([0, LOW[1], 0], [0.3, LOW[1] + 0.2, 0.3]), ASIDE)
HALL = [(STILL, FLOOR), (STILL, STONE), (1, PERSON), (2, moved(PERSON, 2 * ASIDE))]
SCENES = {
    "a figure": [(1, PERSON)],
    "on a plate": [(STILL, PLATE), (1, PERSON)],
    "on a pedestal on a floor": [(1, PERSON), (STILL, PEDESTAL), (STILL, moved(FLOOR, [0, -0.3, 0]))],
    "a stone beside": [(STILL, STONE), (1, PERSON)],
    "two figures in the order of the mesh": [(1, moved(PERSON, ASIDE)), (2, PERSON)],
    "a hall": HALL,
    "a thing in a hand": [(1, PERSON), (1, box(HAND - 0.03, HAND + np.array([0.03, 0.5, 0.03])))],
    "what floats above": [(1, PERSON), (1, sphere(1, 0.1, [0, HIGH[1] + 0.3, 0]))],
    "two figures, and what floats beside each": [
        (1, PERSON),
        (2, moved(PERSON, 2 * ASIDE)),
        *((1, sphere(1, 0.02, HIGH * [-1.3, share, 0])) for share in (0.4, 0.6)),
        *((2, sphere(1, 0.02, 2 * ASIDE + HIGH * [-1.3, share, 0])) for share in (0.4, 0.6)),
    ],
    "shoes": [(1, PERSON), (1, shoe(1)), (1, shoe(-1))],
    "two feet that touch nothing": [
        (1, PERSON),
        (1, box([1.1, LOW[1], 0], [1.2, LOW[1] + 0.1, 0.2])),
        (1, box([-1.2, LOW[1], 0], [-1.1, LOW[1] + 0.1, 0.2])),
    ],
}
"""Surfaces, and the body of which each of them is."""


def joined(scene):
    """The solver mesh of a scene, and the number of the body of each of its vertices."""
    starts = np.cumsum([0, *(len(vertices) for _, (vertices, _) in scene)])
    mesh = weld(
        np.concatenate([vertices for _, (vertices, _) in scene]),
        np.concatenate([faces + start for (_, (_, faces)), start in zip(scene, starts, strict=False)]),
    )
    wanted = np.zeros(len(mesh.vertices), dtype=np.int64)
    wanted[mesh.of_render] = np.repeat([number for number, _ in scene], np.diff(starts))
    return mesh, wanted


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("turn", [np.eye(3), [[1, 0, 0], [0, 0, 1], [0, -1, 0]]], ids=["y up", "z up"])
def test_figures_are_told_from_each_other_and_from_what_is_under_and_beside_them(scene, turn):
    mesh, wanted = joined([(number, (vertices @ turn, faces)) for number, (vertices, faces) in SCENES[scene]])
    assert_array_equal(find_bodies(mesh), wanted)


def test_what_belongs_together_is_one_body():
    mesh, wanted = joined(HALL)
    together = np.where(wanted == STILL, -1, 7)
    assert_array_equal(find_bodies(mesh, together), np.minimum(wanted, 1))


@pytest.mark.parametrize("axes", [[0, 1, 2], [0, 2, 1]], ids=["flat along z", "flat along y"])
def test_flat_figures_stand_along_the_axis_along_which_they_have_a_height(axes):
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])[:, axes]
    mesh, _ = joined([(number, moved((square, PLATE[1]), [3 * number, 0, 0])) for number in (1, 2)])
    assert_array_equal(find_bodies(mesh)[mesh.of_render], np.repeat([1, 2], 4))
