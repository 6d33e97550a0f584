import numpy as np
import pytest

from solver.extremities import extremities
from solver.mesh import SolverMesh, weld

FIGURE_ENDS = np.array([[1.58, 1.3, 0], [-1.58, 1.3, 0], [0.66, -1.7, 0.1], [-0.66, -1.7, 0.1], [0.0, 2.1, 0.2]])
CREATURE_ENDS = np.array([[-1.5, 0, 0], [1.05, 1.1, 0.25], [-1.0, 1.05, -0.45], [0.22, -1.28, 0.33]])


def assert_one_each(points, ends, within):
    distances = np.linalg.norm(points[:, None] - ends, axis=2)
    assert sorted(distances.argmin(axis=1)) == list(range(len(ends)))
    assert distances.min(axis=1).max() < within


def test_a_figure_ends_in_hands_feet_and_head(figure):
    assert_one_each(figure.vertices[extremities(figure)], FIGURE_ENDS, within=0.25)


def test_a_bent_creature_ends_in_both_tube_ends_horn_and_leg(creature):
    assert_one_each(creature.vertices[extremities(creature)], CREATURE_ENDS, within=0.25)


def test_a_folded_limb_is_found_by_the_way_along_the_surface():
    """A flat spiral: in space its inner end lies in the middle of the shape, along the surface it is an end."""
    angles = np.linspace(0, 4.5 * np.pi, 200)
    middle = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(200)]) * (0.4 + 0.15 * angles[:, None])
    outward = middle / np.linalg.norm(middle, axis=1, keepdims=True)
    round_it = np.linspace(0, 2 * np.pi, 7)[:-1]
    ring = np.cos(round_it)[:, None, None] * outward + np.sin(round_it)[:, None, None] * np.array([0.0, 0, 1])
    vertices = (middle + 0.1 * ring).transpose(1, 0, 2).reshape(-1, 3)
    i, j = (part.ravel() for part in np.meshgrid(np.arange(199), np.arange(6), indexing="ij"))
    a, b, c, d = 6 * i + j, 6 * i + (j + 1) % 6, 6 * (i + 1) + j, 6 * (i + 1) + (j + 1) % 6
    tube = weld(vertices, np.concatenate([np.column_stack([a, b, c]), np.column_stack([b, d, c])]))
    found = tube.vertices[extremities(tube)]
    assert_one_each(found, middle[[0, -1]], within=0.2)


@pytest.mark.parametrize("degrees", [35, 120])
def test_rigid_motion_scale_and_mirroring_change_nothing(creature, turn, degrees):
    expected = extremities(creature)
    for matrix in (turn(0, degrees), 50 * turn(1, degrees), np.diag([-1.0, 1, 1])):
        moved = SolverMesh(creature.vertices @ matrix + [3.0, -8.0, 1.0], creature.faces, creature.of_render)
        assert extremities(moved).tolist() == expected.tolist()


def test_the_most_outlying_come_first_and_no_more_than_asked(figure):
    tips = extremities(figure)
    assert len(tips) == 5
    for most in (0, 1, 3, 5):
        assert extremities(figure, most=most).tolist() == tips[:most].tolist()
    assert set(np.sign(figure.vertices[tips[:4], 1])) == {-1.0, 1.0}
    assert np.argmin(np.abs(figure.vertices[tips, 0])) == 4  # the head is nearest to the trunk


def test_a_part_of_its_own_is_reached_over_bridges(two_parts):
    points = two_parts.vertices[extremities(two_parts)]
    ends = FIGURE_ENDS.copy()
    ends[0] = [2.0, 1.4, 0.1]  # the cube beside the hand is what sticks out now
    assert_one_each(points, ends, within=0.35)


@pytest.mark.slow
def test_the_armadillo_has_hands_feet_ears_and_a_tail(real_mesh):
    mesh = real_mesh("armadillo.obj")
    found = mesh.vertices[extremities(mesh)]
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    for direction in ([1, 0.3, 0], [-1, 0.3, 0], [0.4, -1, 0], [-0.4, -1, 0]):
        end = mesh.vertices[np.argmax(mesh.vertices @ direction)]
        assert np.linalg.norm(found - end, axis=1).min() < 0.1 * np.linalg.norm(high - low)
