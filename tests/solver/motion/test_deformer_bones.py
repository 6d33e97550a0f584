"""A deformer with bones."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from puppetline.errors import MeshError
from solver.model import fields, matrix_blocks, polar
from solver.model.bones import Bones
from solver.model.clusters import EDGE_WEIGHT
from solver.model.reduced_model import build
from solver.motion.bone_terms import BLEND_POWER, BONE_STIFFNESS, DISTANT_BONE_WEIGHT, PRIOR_WEIGHT
from solver.motion.deformer import HANDLE_STIFFNESS, NEARBY_BONE_WEIGHT, Deformer
from solver.surface.mesh import SolverMesh

from ..shapes import chains
from .test_deformer import MODES, pulled


@pytest.fixture(scope="module")
def creature_bones():
    """The tube in three, the horn and the leg in two; see conftest.creature."""
    tube, leg = "-1.2 0 0, -0.5 0.1 0, 0 0.2 0, 0.9 0.9 0.2", "0.05 -0.2 0.07, 0.12 -0.6 0.18, 0.2 -1.1 0.3"
    return chains((-1, tube), (1, leg), (0, "-0.91 0.2 -0.05, -1 0.9 -0.4"))


@pytest.fixture(scope="module")
def model(creature, creature_bones):
    return build(creature, bones=creature_bones)


@pytest.fixture
def bound(creature, model, creature_handles):
    """Bind the creature and its bones with other options, or other handles."""

    def make(handles=creature_handles, **options):
        return Deformer(model, creature, handles, **options)

    return make


def about(turned, point):
    """Motions (4, 3) that turn about a point."""
    return np.vstack([turned, point - point @ turned])


def posed(bones, turn, degrees):
    """Each bone turned about its head, on top of its parent."""
    motions = np.zeros((len(bones), 4, 3))
    for b, parent in enumerate(bones.parents):
        motions[b] = about(turn(b, degrees), bones.heads[b])
        if parent >= 0:
            above = motions[parent]
            motions[b] = np.vstack([motions[b, :3] @ above[:3], motions[b, 3] @ above[:3] + above[3]])
    return motions


def hats_of(model):
    """Shares (n, 80) of the isolines in each vertex."""
    hats = np.maximum(0, 1 - np.abs(model.isoline_coordinates[:, :, None] - np.arange(10.0)))
    return hats.reshape(len(hats), -1)


NO_HANDLES = np.zeros((0, 3))


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(("seed", "degrees"), [(2, 120), (3, 179)])
def test_rigid_motion_of_all_bones_is_rigid_motion_of_the_character_at_once(
    bound, creature, model, creature_handles, surface, turn, mode, seed, degrees
):
    rotation, offset = turn(seed, degrees), np.random.default_rng(seed).normal(size=3)
    motions = np.tile(np.vstack([rotation, offset]), (6, 1, 1))
    expected = creature.vertices @ rotation + offset
    for handles in (NO_HANDLES, creature_handles):
        deformer = bound(handles, mode=mode)
        at_rest = surface(model, creature, deformer.solve(deformer.handles, None))
        assert_allclose(at_rest, creature.vertices, rtol=0, atol=1e-9 * creature.diagonal)
        deformer.reset()
        found = surface(model, creature, deformer.solve(deformer.handles @ rotation + offset, motions))
        assert_allclose(found, expected, rtol=0, atol=1e-9 * creature.diagonal)


def test_the_solution_with_bones_is_that_of_the_dense_least_squares_problem(
    bound, creature, model, creature_handles, creature_bones, surface, naive_interpolation, turn
):
    """Handles, bones and clusters together: W by plain loops, rotations fixed at random, NumPy's lstsq."""
    rest = model.to_model(creature.vertices)
    L, mass = fields.laplacian(SolverMesh(rest, creature.faces, creature.of_render))
    L = L.toarray()
    W, _ = naive_interpolation(rest, model.isoline_coordinates, model.weights, 10, L @ rest)
    deformer = bound(creature_handles[:2], iterations=0)
    targets, motions = pulled(deformer), posed(creature_bones, turn, 25)
    turns = Rotation.from_rotvec(0.4 * np.random.default_rng(1).normal(size=(80, 3))).as_matrix()
    deformer.solve(targets, motions)
    deformer._turns[:] = matrix_blocks.pack_rows(turns.reshape(-1, 3), matrix_blocks.matrix_row_places(80))
    found = surface(model, creature, deformer.solve(targets, motions))

    each = turns[model.cluster]
    bending = np.diag(mass**-0.5) @ L @ W
    bent = mass[:, None] ** -0.5 * np.einsum("vi,vij->vj", L @ rest, each)
    i, j = np.nonzero(np.maximum(L - np.diag(np.diag(L)), 0))
    root = np.sqrt(EDGE_WEIGHT * np.trace(bending.T @ bending) / (2 * np.trace(-W.T @ L @ W)) * L[i, j])[:, None]
    edges, stretched = root * (W[i] - W[j]), root * np.einsum("ei,eij->ej", rest[i] - rest[j], each[i])
    scale = np.sum(bending**2) + np.sum(edges**2)
    rows = model.rows(creature, creature_handles[:2])
    handles = np.sqrt(HANDLE_STIFFNESS["clusters"] * scale / np.sum(rows * rows))
    regions = model.regions
    shares, area = model.held_shares().toarray(), creature.vertex_areas
    at = np.einsum("vb,vx,bxk->vk", shares, np.column_stack([creature.vertices, np.ones(len(rest))]), motions)
    held = np.sqrt(area * (shares @ (1 / (shares.T @ area))) * shares.max(axis=1) ** BLEND_POWER)[:, None]
    bones = np.sqrt(BONE_STIFFNESS * scale / np.sum((held * W) ** 2)) * held
    hats = hats_of(model)
    near = np.array([hats[regions.owner == b].T @ area[regions.owner == b] for b in range(6)])
    near /= np.maximum(hats.T @ area, 1e-300)  # an isoline may have no vertex near it
    near += DISTANT_BONE_WEIGHT * near.mean(axis=1, keepdims=True)
    near /= near.sum(axis=0)
    in_model_units = motions.copy()
    in_model_units[:, 3] = model.to_model(motions[:, 3] + np.einsum("x,bxk->bk", model.center, motions[:, :3]))
    mean = np.einsum("bi,bxk->ixk", near, in_model_units).reshape(320, 3)
    anchor = np.sqrt(NEARBY_BONE_WEIGHT * scale / 320)
    left = np.concatenate([bending, edges, handles * rows, bones * W, anchor * np.eye(320)])
    right = np.concatenate(
        [bent, stretched, handles * model.to_model(targets), bones * model.to_model(at), anchor * mean]
    )
    expected = W @ np.linalg.lstsq(left, right, rcond=1e-12)[0] * model.diagonal + model.center
    assert_allclose(found, expected, rtol=0, atol=1e-6 * creature.diagonal)


@pytest.mark.parametrize("mode", MODES)
def test_rotations_are_drawn_to_the_bones_that_hold_them(bound, creature, model, creature_bones, turn, mode):
    """One iteration written out: S_c + μ Σ_b a_cb s_c Q_b, with the shares of area added up vertex by vertex."""
    motions = posed(creature_bones, turn, 25)
    deformer = bound(NO_HANDLES, mode=mode, iterations=0)
    R = deformer.solve(NO_HANDLES, motions)
    deformer.iterations = 1
    deformer.solve(NO_HANDLES, motions)
    reader = model.B_clusters.T if mode == "clusters" else model.covariance
    S, size = (
        (reader @ R).reshape(80, 3, 3),
        np.trace((reader @ model.rest_controls).reshape(80, 3, 3), axis1=1, axis2=2),
    )
    together = np.eye(80)[model.cluster] if mode == "clusters" else hats_of(model)
    regions = model.regions
    area = creature.vertex_areas
    for b in range(6):
        share = together[regions.of(b)].T @ area[regions.of(b)] / np.maximum(together.T @ area, 1e-300)
        S = S + PRIOR_WEIGHT * (share * size / 3)[:, None, None] * motions[b, :3]
    assert_allclose(deformer.turns.reshape(80, 3, 3), polar.of_matrices(S), rtol=0, atol=1e-6)


def test_where_there_are_bones_rotations_are_those_of_clusters(
    bound, creature, creature_model, creature_handles, creature_bones, turn
):
    motions = posed(creature_bones, turn, 20)
    with_bones, without = bound(), Deformer(creature_model, creature, creature_handles)
    for deformer, given, mode in ((with_bones, motions, "clusters"), (without, None, "covariance")):
        other = Deformer(deformer.model, creature, creature_handles, mode=mode)
        assert_array_equal(deformer.solve(deformer.handles, given), other.solve(deformer.handles, given))


def test_bones_that_hold_nothing_are_refused_where_there_is_no_handle(creature, creature_handles):
    away = Bones(np.array([[50.0, 0, 0]]), np.array([[60.0, 0, 0]]), np.array([-1]), np.array([0]))
    model = build(creature, bones=away)
    with pytest.raises(MeshError):
        Deformer(model, creature, NO_HANDLES)
    deformer = Deformer(model, creature, creature_handles)
    assert_allclose(deformer.solve(deformer.handles), model.rest_controls, rtol=0, atol=1e-6)
    motions = np.eye(4, 3)[None]
    for bad in (motions[:0], motions.transpose(0, 2, 1), motions[0], motions * np.nan):
        with pytest.raises(ValueError, match="expected"):
            deformer.solve(deformer.handles, bad)
