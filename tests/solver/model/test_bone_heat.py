import numpy as np
import pytest

from solver.model import bone_heat, fields
from solver.model.bone_heat import heat_shares
from solver.model.bones import Bones, bone_regions
from solver.surface.contacts import contacts
from solver.surface.mesh import SolverMesh


def tube(length=2.0, radius=0.15, rings=41, sides=16, beside=0.0):
    """A closed tube along x about the origin."""
    angles = np.arange(sides) * 2 * np.pi / sides
    x = np.repeat(np.linspace(-length / 2, length / 2, rings), sides)
    around = np.tile(np.stack([np.cos(angles), np.sin(angles)], axis=1), (rings, 1))
    vertices = np.column_stack([x, radius * around])
    faces = []
    for ring in range(rings - 1):
        for side in range(sides):
            a, b = ring * sides + side, ring * sides + (side + 1) % sides
            faces += [[a, b, a + sides], [b, b + sides, a + sides]]
    ends = len(vertices) + np.arange(2)
    vertices = np.vstack([vertices, [[-length / 2, 0, 0], [length / 2, 0, 0]]])
    last = (rings - 1) * sides
    for side in range(sides):
        faces += [[ends[0], (side + 1) % sides, side], [ends[1], last + side, last + (side + 1) % sides]]
    return vertices + np.array([0, beside, 0]), np.array(faces)


def mesh_of(*parts):
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    vertices = np.concatenate([vertices for vertices, _ in parts])
    faces = np.concatenate([faces + start for (_, faces), start in zip(parts, starts, strict=False)])
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
    heads, tails = np.array([[-1.0, 0, 0], [0, 0, 0]]), np.array([[0, 0, 0], [1.0, 0, 0]])
    return mesh_of(tube()), Bones(heads, tails, np.array([-1, 0]), np.array([0, 0]))


def test_two_bones_share_their_joint_equally_and_the_far_ends_are_each_ones_own(arm):
    mesh, bones = arm
    shares, x = shares_of(mesh, bones), mesh.vertices[:, 0]

    assert np.allclose(shares[np.abs(x) < 1e-9].mean(axis=0), 0.5, atol=0.05)  # the last bone is stiffer
    assert shares[x < -0.7, 0].min() > 0.99
    assert shares[x > 0.7, 1].min() > 0.99
    ring = shares[:-2].reshape(41, 16, 2).mean(axis=1)
    assert np.all(np.diff(ring[:, 1]) > -1e-6)


def test_shares_do_not_depend_on_the_unit_or_the_order_of_the_vertices(arm):
    mesh, bones = arm
    order = np.random.default_rng(3).permutation(len(mesh.vertices))
    larger = SolverMesh(100 * mesh.vertices[order], np.argsort(order)[mesh.faces], np.arange(len(order)))

    found = shares_of(larger, Bones(100 * bones.heads, 100 * bones.tails, bones.parents, bones.limbs))

    assert np.allclose(found, shares_of(mesh, bones)[order], atol=1e-6)


def test_a_bone_of_another_tube_has_no_share_however_near_it_is():
    mesh = mesh_of(tube(), tube(beside=0.45))
    heads, tails = np.array([[-0.9, 0, 0], [-0.9, 0.45, 0]]), np.array([[0.9, 0, 0], [0.9, 0.45, 0]])

    shares = shares_of(mesh, Bones(heads, tails, np.array([-1, -1]), np.array([0, 1])))

    near = mesh.vertices[:, 1] < 0.225
    assert shares[near, 0].min() > 0.95
    assert shares[~near, 1].min() > 0.95


@pytest.fixture
def stuck():
    """An arm that is stuck into a body: the mesh, its bones, and the vertices of the arm."""
    body, arm = tube(length=1.2, radius=0.5), tube(length=1.2, radius=0.12)
    body_vertices, arm_vertices = body[0][:, [1, 0, 2]], arm[0] + [0.9, 0.3, 0]  # upright, with the arm at its side
    mesh = mesh_of((body_vertices, body[1][:, ::-1]), (arm_vertices, arm[1]))
    heads = np.array([[0, -0.5, 0], [0.45, 0.3, 0], [0.75, 0.3, 0]])
    tails = np.array([[0, 0.5, 0], [0.75, 0.3, 0], [1.4, 0.3, 0]])
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
