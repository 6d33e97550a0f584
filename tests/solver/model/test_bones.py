"""Bones and the surface that belongs to each."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from solver.model.bones import Bones, bone_regions
from solver.surface.mesh import SolverMesh, weld

from ..shapes import capsules, chains, joined, march, points, sphere, tube

ARM = points("0 1.1 0, 1.4 1.3 0")
"""The axis of the figure's left arm."""


def along(points, head, tail):
    return (points - head) @ (tail - head) / ((tail - head) @ (tail - head))


@pytest.fixture(scope="module")
def skeleton():
    """The figure's: pelvis, chest and head, then upper arm, forearm and hand, thigh and shin of both sides."""
    arm = ARM[0] + np.outer([0.25, 0.55, 0.85, 1.0], ARM[1] - ARM[0])
    leg, mirror = np.outer([0.25, 0.6, 1.0], [0.6, -1.5, 0.1]), [-1, 1, 1]
    middle = (-1, "0 0 0, 0 0.6 0, 0 1.2 0"), (1, "0 1.2 0, 0 1.9 0.2")
    return chains(*middle, (1, arm), (1, arm * mirror), (0, leg), (0, leg * mirror))


@pytest.fixture(scope="module")
def regions(figure, skeleton):
    return bone_regions(figure, skeleton)


# --- properties of bones


def test_ends_and_roots_of_limbs(skeleton):
    assert np.flatnonzero(skeleton.terminal).tolist() == [2, 5, 8, 10, 12]
    assert np.flatnonzero(skeleton.roots).tolist() == [0, 1, 2, 3, 6, 9, 11]
    assert_allclose(skeleton.lengths[:3], [0.6, 0.6, np.hypot(0.7, 0.2)])
    assert len(skeleton) == 13


# --- regions


def test_the_middle_of_an_arm_belongs_to_its_bones_and_the_hand_is_whole(figure, skeleton, regions):
    v = figure.vertices
    for bone, low, high in ((3, 0.2, 0.8), (4, 0.2, 0.8), (5, 0.0, np.inf)):
        place = along(v, skeleton.heads[bone], skeleton.tails[bone])
        on_the_arm = v[:, 0] > 0.36  # outside the trunk and above the legs
        expected = np.flatnonzero(on_the_arm & (v[:, 1] > 0.6) & (place >= low) & (place <= high))
        assert np.all(regions.owner[expected] == bone)
        assert set(regions.of(bone)) == (set(expected) if bone == 5 else set())
        assert len(expected) > 5


def test_no_vertex_behind_the_root_of_a_limb_belongs_to_it(figure, skeleton, regions):
    for root in np.flatnonzero(skeleton.roots):
        place = along(figure.vertices, skeleton.heads[root], skeleton.tails[root])
        assert place[regions.owner == root].min() >= 0


def test_without_a_trunk_nobody_owns_it(figure, skeleton):
    arms = Bones(skeleton.heads[3:6], skeleton.tails[3:6], np.array([-1, 0, 1]), np.zeros(3, dtype=int))
    found = bone_regions(figure, arms)
    assert np.all(found.owner[figure.vertices[:, 0] < 0.2] == -1)
    assert not found.held[figure.vertices[:, 0] < 0.4].any()
    assert found.held[figure.vertices[:, 0] > 1.3].all()


@pytest.fixture(scope="module")
def skirted():
    """A trunk with a skirt, and an arm whose hand hangs beside the hem."""
    limbs = capsules("""
    0   0   0   0    2   0   0.25
    0   0.5 0   0.45 0.3 0   0.13
    0   2   0   0.8  2   0   0.12
    0.8 2   0   0.8  0.2 0   0.12
    """)
    return weld(*march(limbs, (-0.4, -0.4, -0.4), (1.1, 2.4, 0.4), 0.04))


def test_a_hem_beside_a_hand_is_not_the_hands(skirted):
    """In space, most of the hem is nearer to the hand's bone than to the trunk's."""
    bones = chains((-1, "0 0 0, 0 2 0"), (0, "0.8 1.9 0, 0.8 1.1 0, 0.8 0.5 0, 0.8 0.2 0"))
    v = skirted.vertices
    hem = (v[:, 0] > 0.45) & (v[:, 0] < 0.62) & (v[:, 1] < 0.6)
    to_hand = np.linalg.norm((v - [0.8, 0, 0])[:, [0, 2]], axis=1)
    to_trunk = np.linalg.norm(v[:, [0, 2]], axis=1)
    assert hem.sum() > 20
    assert (to_hand < to_trunk)[hem].all()
    regions = bone_regions(skirted, bones)
    assert np.all(regions.owner[hem] == 0)
    assert np.all(regions.owner[(v[:, 0] > 0.7) & (v[:, 1] < 1.8)] > 0)


# --- rays


def test_a_bone_beside_the_mesh_takes_the_nearest_vertex(figure):
    regions = bone_regions(figure, chains((-1, "5 1 0, 5 1.5 0")))
    nearest = np.argmin(np.linalg.norm(figure.vertices - [5.0, 1.25, 0.0], axis=1))
    assert regions.owner[nearest] == 0
    assert regions.held[nearest]


# --- several parts, and few vertices


def test_a_part_that_touches_follows_the_bone_that_it_touches(two_parts):
    """The cube beside the right hand is tied to it across a gap, and belongs to its bone."""
    arm = ARM[0] + np.outer([0.25, 0.6, 1.0], ARM[1] - ARM[0])
    regions = bone_regions(two_parts, chains((-1, "0 0 0, 0 1.2 0"), (0, arm)))
    cube = np.arange(len(two_parts.vertices) - 8, len(two_parts.vertices))
    assert np.all(regions.owner[cube] == 2)
    assert regions.held[cube].all()


def test_a_part_is_a_limb_if_it_is_so_for_the_most_part_and_is_held_by_the_bone_that_it_is_nearly_all_on():
    """A ball, and a separate arm from x = 3 inside it to x = 21."""
    mesh = weld(*joined(sphere(2, 6), tube(np.arange(3.0, 22.0, 2.0), 1.4, 4, closed=True)))
    of_arm = mesh.components == mesh.components[np.argmax(mesh.vertices[:, 0])]
    body, x = (-1, "0 -5 0, 0 5 0"), mesh.vertices[of_arm, 0]
    owner = bone_regions(mesh, chains(body, (0, "6 0 0, 13 0 0, 21 0 0"))).owner
    assert_array_equal(owner[of_arm], np.where(x <= 13, 1, 2))
    assert np.all(owner[~of_arm] != 2)
    regions = bone_regions(mesh, chains(body, (0, "6 0 0, 18 0 0, 24 0 0")))
    assert np.all(regions.owner[of_arm] == 1)
    assert regions.held[of_arm].all()


def test_a_bone_around_whose_middle_there_is_no_vertex_owns_what_it_has():
    """A long box whose vertices are all at its ends and its elbow."""
    vertices, faces = tube(np.array([0.0, 10.0, 20.0]), 1.4, 4, closed=True)
    regions = bone_regions(SolverMesh(vertices, faces, np.arange(12)), chains((-1, "0 0 0, 10 0 0, 20 0 0")))
    assert_array_equal(regions.owner[[0, 1, 2, 3, 8, 9, 10, 11]], [0] * 4 + [1] * 4)
