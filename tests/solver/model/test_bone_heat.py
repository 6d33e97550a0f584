import numpy as np
import pytest

from solver.model import bone_heat, fields
from solver.model.bone_heat import heat_shares
from solver.model.bones import Bones, bone_regions
from solver.surface.contacts import contacts
from solver.surface.mesh import SolverMesh

from ..shapes import joined, points, tube


def limb(length=2.0, radius=0.15, beside=0.0):
    """A closed tube along x about the origin."""
    vertices, faces = tube(np.linspace(-length / 2, length / 2, 41), radius, 16, closed=True)
    return vertices + np.array([0, beside, 0]), faces


def mesh_of(*parts):
    vertices, faces = joined(*parts)
    return SolverMesh(vertices, faces, np.arange(len(vertices)))


def shares_of(mesh, bones):
    size = mesh.diagonal
    unit = SolverMesh(mesh.vertices / size, mesh.faces, mesh.of_render)
    surface, mass = fields.laplacian(unit)
    ties = contacts(unit)
    operator = fields.energy_operator(surface, ties, mass, unit.diagonal)
    return heat_shares(operator, mass, mesh, bones, bone_regions(mesh, bones))


@pytest.fixture(scope="module")
def arm():
    """A tube with two bones that meet in its middle."""
    return mesh_of(limb()), Bones(points("-1 0 0, 0 0 0"), points("0 0 0, 1 0 0"), np.array([-1, 0]), np.array([0, 0]))


def test_two_bones_share_their_joint_equally_and_the_far_ends_are_each_ones_own(arm):
    mesh, bones = arm
    shares, x = shares_of(mesh, bones), mesh.vertices[:, 0]

    assert np.allclose(shares[np.abs(x) < 1e-9].mean(axis=0), 0.5, atol=0.05)  # the last bone is stiffer
    assert shares[x < -0.7, 0].min() > 0.99
    assert shares[x > 0.7, 1].min() > 0.99
    ring = shares.reshape(41, 16, 2).mean(axis=1)
    assert np.all(np.diff(ring[:, 1]) > -1e-6)


def test_a_bone_of_another_tube_has_no_share_however_near_it_is():
    mesh = mesh_of(limb(), limb(beside=0.45))
    heads, tails = points("-0.9 0 0, -0.9 0.45 0"), points("0.9 0 0, 0.9 0.45 0")

    shares = shares_of(mesh, Bones(heads, tails, np.array([-1, -1]), np.array([0, 1])))

    near = mesh.vertices[:, 1] < 0.225
    assert shares[near, 0].min() > 0.95
    assert shares[~near, 1].min() > 0.95


@pytest.fixture
def stuck():
    """An arm that is stuck into a body: the mesh, its bones, and the vertices of the arm."""
    body, arm = limb(1.2, 0.5), limb(1.2, 0.12)
    body_vertices, arm_vertices = body[0][:, [1, 0, 2]], arm[0] + [0.9, 0.3, 0]  # upright, with the arm at its side
    mesh = mesh_of((body_vertices, body[1][:, ::-1]), (arm_vertices, arm[1]))
    heads, tails = points("0 -0.5 0, 0.45 0.3 0, 0.75 0.3 0"), points("0 0.5 0, 0.75 0.3 0, 1.4 0.3 0")
    return mesh, Bones(heads, tails, np.array([-1, 0, 1]), np.array([-1, 0, 0])), arm_vertices


def test_an_arm_that_is_a_part_of_its_own_gets_nothing_from_the_body_that_it_is_stuck_into(stuck):
    mesh, bones, arm = stuck

    shares = shares_of(mesh, bones)[-len(arm) :]

    assert np.all(shares[:, 0] == 0)
    assert np.allclose(shares.sum(axis=1), 1)
    assert np.all(shares[arm[:, 0] < 0.5, 1] > 0.9)


def test_a_part_that_sees_no_bone_of_its_limb_follows_the_bones_that_own_it(stuck, monkeypatch):
    mesh, bones, arm = stuck
    body_alone = np.eye(3)[np.zeros(len(mesh.vertices), dtype=int)]
    monkeypatch.setattr(bone_heat, "_sources", lambda mesh, _: (body_alone, np.full(len(mesh.vertices), 0.1)))

    shares = shares_of(mesh, bones)[-len(arm) :]

    np.testing.assert_array_equal(shares, np.eye(3)[bone_regions(mesh, bones).owner[-len(arm) :]])
