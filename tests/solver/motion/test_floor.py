"""Limbs that would pass through the floor, as plain Python functions, on bodies of points."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from solver.motion.limbs import Limb, bones_of

from ..shapes import assert_joined, moved

TRUNK = Limb("trunk", np.array([[0, 1.0, 0], [0, 1.0, 1.0]]), ((0,), (1,)))
TAIL = Limb("tail", np.array([[0, 1.0, 0], [0, 1, -1.0], [0, 1, -2.0]]), ((0,), (1,), (1,)), "turn", parent="trunk")
LIMBS = TRUNK, TAIL
BONES = bones_of(LIMBS)
RADIUS = 0.2


def tube():
    """Return points around the tail, their bones, and a foot's point on the floor."""
    angles, places = np.linspace(0, 2 * np.pi, 16, endpoint=False), np.linspace(0, 2, 41)
    points = np.array([[RADIUS * np.sin(a), 1 + RADIUS * np.cos(a), -z] for z in places for a in angles])
    owner = np.where(points[:, 2] < -1, 2, 1)
    return np.vstack([points, [0, 0, 0]]), np.append(owner, -1)


VERTICES, OWNER = tube()


def pitched(degrees, about=(1.0, 0, 0)):
    """Motions of all bones when the body turns about the head of its tail; a positive pitch lowers the tail."""
    T = np.zeros((3, 4, 3))
    T[:, :3] = Rotation.from_rotvec(np.radians(-degrees) * np.array(about)).as_matrix().T
    T[:, 3] = np.array([0, 1.0, 0]) - np.array([0, 1.0, 0]) @ T[0, :3]
    return T


def heights(T, root):
    """Heights of the points around the tail."""
    return moved(VERTICES[:-1], T[OWNER[:-1]])[:, 1] + root[1]


@pytest.fixture(scope="module")
def lifted(interpreted):
    """Return a function that keeps the tail over the floor, in motions that it returns."""
    module = interpreted("solver.motion.floor")

    def lift(T, root=(0, 0, 0), limbs=LIMBS, vertices=VERTICES, basis=None):
        T = T.copy()
        basis = np.eye(3) if basis is None else basis
        module.Floor(limbs, bones_of(limbs), vertices, OWNER, basis).step(T, np.array(root, float))
        return T

    return lift


@pytest.mark.parametrize("degrees", [-60, 0, 20])
def test_a_tail_over_the_floor_keeps_its_motion(lifted, degrees):
    T = pitched(degrees)

    assert np.array_equal(lifted(T), T)


@pytest.mark.parametrize("degrees", [30, 50, 70, 89])
@pytest.mark.parametrize("sink", [0.0, -0.3])
def test_a_tail_lies_on_the_floor_and_stays_joined(lifted, degrees, sink):
    T, root = pitched(degrees), (0.4, sink, 0.1)
    now = lifted(T, root)

    assert heights(T, root).min() < -0.1
    outer = VERTICES[:-1, 2] <= -1
    assert heights(now, root)[outer].min() == pytest.approx(0, abs=0.02)
    assert np.array_equal(now[0], T[0])
    assert_joined(BONES, now)


def test_a_bone_that_hangs_is_lifted_by_the_least_angle_to_behind_the_body(lifted):
    limbs = TRUNK, Limb("tail", TAIL.points[[0, 1]], ((0,), (1,)), "turn", parent="trunk")
    T = pitched(90)[:2]
    T[:, 3] -= [0, 0.5, 0]  # the joint is 0.5 over the floor, and the bone 1 long: it ends on the floor 30° below level
    only_bones = np.vstack([np.full((len(OWNER) - 1, 3), 5.0), VERTICES[-1]])
    way = np.array([0, 0, -1.0]) @ lifted(T, limbs=limbs, vertices=only_bones)[1, :3]

    assert way == pytest.approx([0, -np.sin(np.radians(30)), -np.cos(np.radians(30))])


def test_the_lift_grows_steadily_as_a_body_turns(lifted):
    ways = [np.array([0, 0, -1.0]) @ lifted(pitched(degrees))[2, :3] for degrees in np.arange(0, 89, 0.5)]

    turns = np.degrees(np.arccos(np.clip(np.einsum("kx,kx->k", ways[1:], ways[:-1]), -1, 1)))
    assert turns.max() < 1.0  # for half a degree of the body


def test_a_tail_below_the_feet_at_rest_is_only_kept_from_going_lower(lifted):
    high = VERTICES.copy()
    high[-1] = [0, 2, 0]  # the feet; the lowest point is that of the tail, on a body that hangs
    T = pitched(0)

    assert np.array_equal(lifted(T, vertices=high), T)
    assert heights(lifted(pitched(30), vertices=high), (0, 0, 0)).min() >= 0.8 - 0.25


@pytest.mark.parametrize("change", [{"follow": "direction"}, {"stands": True}])
def test_arms_and_legs_are_left_to_the_performer(lifted, change):
    limbs = TRUNK, Limb(**(TAIL.__dict__ | change))
    T = pitched(60)

    assert np.array_equal(lifted(T, limbs=limbs), T)


def test_other_axes_of_the_file_change_nothing(lifted):
    turn = Rotation.from_euler("xyz", [90, 0, 30], degrees=True).as_matrix().T  # row vectors, x' = x turn
    limbs = tuple(Limb(**(limb.__dict__ | {"points": limb.points @ turn})) for limb in LIMBS)
    T = pitched(60)
    there = T.copy()
    there[:, :3], there[:, 3] = turn.T @ T[:, :3] @ turn, T[:, 3] @ turn
    now = lifted(there, limbs=limbs, vertices=VERTICES @ turn, basis=np.eye(3) @ turn)

    assert np.allclose(turn @ now[:, :3] @ turn.T, lifted(T)[:, :3], atol=0.02)
