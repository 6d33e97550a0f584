import igl
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from solver.surface.contacts import MAX_JOIN_DISTANCE_RATIO, TOUCH_DIAGONALS, PartSeparation, contacts
from solver.surface.mesh import SolverMesh, weld

from ..shapes import box, joined, sphere

TETRAHEDRON = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
TETRAHEDRON_FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def together(*parts):
    return weld(*joined(*parts))


def groups(mesh, ties):
    n = len(mesh.vertices)
    a, b = np.concatenate([mesh.edges, ties.links]).T
    return connected_components(coo_matrix((np.ones(len(a)), (a, b)), shape=(n, n)), directed=False)[0]


def apart(mesh, ties):
    """Rest distance over each contact."""
    partner = np.einsum("kc,kcx->kx", ties.blend, mesh.vertices[ties.corners])
    return np.linalg.norm(mesh.vertices[ties.vertices] - partner, axis=1)


def test_a_mesh_of_one_part_has_no_contacts_and_does_not_come_apart(creature):
    assert len(contacts(creature).vertices) == 0
    measure = PartSeparation(creature)
    measure.add((3 * creature.vertices)[:, :, None])
    assert measure.largest == 0


def test_every_vertex_that_touches_another_part_is_tied_to_the_nearest_point_of_its_surface():
    """Two boxes that intersect; libigl finds the nearest points."""
    one, other = box("0 0 0, 1 1 1", 0.11), box("0.3 0.98 0.2, 0.8 1.9 0.7", 0.07)
    mesh = together(one, other)
    ties = contacts(mesh)
    touching = TOUCH_DIAGONALS * mesh.diagonal
    expected = {}
    for (v, _), start, (others, faces) in ((one, 0, other), (other, len(one[0]), one)):
        square, _, nearest = igl.point_mesh_squared_distance(v, others, faces)
        near = np.flatnonzero(square < touching**2)
        expected |= {start + i: nearest[i] for i in near}
    assert len(expected) >= 20
    found = dict(zip(ties.vertices, np.einsum("kc,kcx->kx", ties.blend, mesh.vertices[ties.corners]), strict=True))
    assert expected.keys() == set(ties.vertices[ties.gap == 0])
    assert_allclose([found[v] for v in expected], list(expected.values()), atol=1e-12)
    assert np.all(mesh.components[ties.vertices, None] != mesh.components[ties.corners])


def test_an_edge_that_goes_through_another_part_ties_its_nearer_end():
    """A post deep inside a block: none of its vertices is near the block's surface."""
    mesh = together(box("0 0 0, 1 1 1", 0.25), box("0.4 0.85 0.4, 0.6 2.05 0.6", 0.4))
    ties = contacts(mesh)
    of_post = mesh.components[ties.vertices] == 1
    low = (mesh.components == 1) & (mesh.vertices[:, 1] < 1)
    assert_array_equal(np.sort(ties.vertices[of_post]), np.flatnonzero(low))
    assert_allclose(ties.gap[of_post], 0.15)


def test_a_part_that_floats_is_tied_to_the_nearest_one_wherever_it_is_near_to_it():
    ball, far = sphere(3, 0.45, [0.0, 0, 1.6]), box("5 5 5, 6 6 6", 0.5)
    mesh = together(box("-1 -1 0, 1 1 1", 0.2), ball, far)
    ties = contacts(mesh)
    to_box = (mesh.components[ties.vertices] == 1) & (mesh.components[ties.corners[:, 0]] == 0)
    height = ball[0][:, 2] - 1
    reach = MAX_JOIN_DISTANCE_RATIO * height.min() + TOUCH_DIAGONALS * mesh.diagonal
    assert_array_equal(np.sort(ties.vertices[to_box]), np.flatnonzero(mesh.components == 1)[height <= reach])
    assert_allclose(ties.gap[to_box], mesh.vertices[ties.vertices[to_box], 2] - 1)
    assert groups(mesh, ties) == 1


@pytest.mark.parametrize("seed", range(2))
def test_parts_that_meet_at_a_point_are_tied_there(seed):
    """Two boxes that are welded at one corner."""
    vertices, faces = joined(box("0 0 0, 1 1 1", 0.25), box("1 1 1, 2 2 2", 0.25))
    mesh = weld(vertices, np.random.default_rng(seed).permutation(faces))
    ties = contacts(mesh)
    assert mesh.parts == 2
    assert_array_equal(np.sort(ties.vertices), np.flatnonzero((mesh.vertices == 1).all(axis=1)))
    assert_allclose(apart(mesh, ties), 0, atol=1e-12)
    assert_array_equal(ties.gap, 0)


@pytest.mark.parametrize("seed", range(2))
def test_any_scattered_parts_are_tied_into_one(seed):
    rng = np.random.default_rng(seed)
    places = rng.normal(size=(300, 3)) * rng.choice([2.0, 20.0])
    mesh = together(*((place + rng.uniform(0.1, 2) * TETRAHEDRON, TETRAHEDRON_FACES) for place in places))
    assert groups(mesh, contacts(mesh)) == 1


# --- limbs at rest against the trunk


@pytest.fixture(scope="module")
def arm_at_the_side():
    """A trunk, and an arm that intersects it at the shoulder and hangs at its side with a gap of 0.3 %."""
    gap = 0.003 * np.sqrt(1 + 4 + 0.25)
    trunk, arm = box("0 0 0, 0.5 2 0.5", 0.08), box([[0.5 + gap, 0.3, 0.1], [0.7, 1.9, 0.3]], 0.05)
    shoulder = (arm[0][:, 1] > 1.7) & (arm[0][:, 0] < 0.55)
    arm[0][shoulder, 0] -= 0.05
    return together(trunk, arm)


def test_an_arm_that_hangs_beside_the_trunk_is_tied_at_the_shoulder_only(arm_at_the_side):
    mesh = arm_at_the_side
    assert np.linalg.norm(np.ptp(mesh.vertices, axis=0)) == pytest.approx(2.2, abs=0.2)
    ties = contacts(mesh).vertices
    smaller = SolverMesh(mesh.vertices / 1024, mesh.faces, mesh.of_render)
    assert_array_equal(contacts(smaller).vertices, ties)
    height = mesh.vertices[ties, 1]
    assert height.max() > 1.7
    assert height.min() > 1.7 - 0.5 * 0.2 * mesh.diagonal - 0.2
    assert height.min() > 1.2


def test_parts_that_only_face_each_other_are_tied_all_the_same():
    """A head over a neck, with a gap between them and no other contact."""
    mesh = together(box("0 0 0, 1 1 1", 0.2), box("0.2 1.005 0.2, 0.8 1.6 0.8", 0.1))
    ties = contacts(mesh)
    assert 0 < apart(mesh, ties).max() < TOUCH_DIAGONALS * mesh.diagonal
    bottom = np.count_nonzero((mesh.components == 1) & (mesh.vertices[:, 1] < 1.01))
    assert np.count_nonzero(mesh.components[ties.vertices] == 1) == bottom


# --- do they stay together


def test_separation_is_the_largest_distance_over_the_contacts_of_all_frames():
    mesh = together(box("0 0 0, 1 1 1", 0.25), box("0.25 0.999 0.25, 0.75 2 0.75", 0.25))
    measure = PartSeparation(mesh)
    measure.add((mesh.vertices)[:, :, None])
    assert measure.largest == pytest.approx(0.001 / mesh.diagonal)
    upper = mesh.components[:, None] == 1
    for lift in (0.02, 0.05, 0.03):
        measure.add((mesh.vertices + lift * upper * [0, 1, 0])[:, :, None])
    assert measure.largest == pytest.approx(0.05 / mesh.diagonal)


@pytest.mark.parametrize(
    "other",
    [sphere(2, 0.3, [0.5, 1.8, 0.5]), box("0.4 0.85 0.4, 0.6 2.05 0.6", 0.4)],
    ids=["floats free", "is stuck deep into the other"],
)
def test_separation_does_not_see_what_does_not_touch_at_rest(other):
    block, touching = box("0 0 0, 1 1 1", 0.25), box("0.2 -1 0.2, 0.8 0 0.8", 0.2)
    mesh = together(block, other, touching)
    number = mesh.components[mesh.of_render[np.cumsum([0, len(block[0]), len(other[0])])]]
    measure = PartSeparation(mesh)
    measure.add((mesh.vertices + 0.1 * (mesh.components[:, None] == number[1]) * [0, 1, 0])[:, :, None])
    assert measure.largest == pytest.approx(0, abs=1e-12)
    measure.add((mesh.vertices - 0.1 * (mesh.components[:, None] == number[2]) * [0, 1, 0])[:, :, None])
    assert measure.largest == pytest.approx(0.1 / mesh.diagonal)
