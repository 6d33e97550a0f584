"""Fields along limbs, and which contacts hold while bones move."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from solver.model import fields
from solver.model.bones import BoneRegions, bone_regions, regions_of_shares
from solver.model.limb_fields import BLUR_DIAGONALS, contacts_that_hold, limb_field_count, limb_fields
from solver.model.reduced_model import ModelParameters, build
from solver.surface.contacts import Contacts, contacts

from ..shapes import chains, points

TRUNK = -1, "0 0 0, 0 1.2 0"
ARM = points("0.35 1.15 0, 0.7 1.2 0, 1.05 1.25 0, 1.4 1.3 0")


@pytest.fixture(scope="module")
def both_arms():
    """The figure's trunk, and its arms in three bones each."""
    return chains(TRUNK, (0, ARM), (0, ARM * [-1, 1, 1]))


def made(mesh, bones, count, regions=None, shares=None):
    L, mass = fields.laplacian(mesh)
    tied = fields.field_operator(L, contacts(mesh), mesh.diagonal)
    regions = bone_regions(mesh, bones) if regions is None else regions
    if shares is None:
        shares = np.eye(len(bones))[regions.owner] * (regions.owner >= 0)[:, None]
    return limb_fields(
        fields.SurfaceOperator(tied, mass, mesh.vertices).smoothed, mesh.vertices, bones, regions, count, shares
    )


def test_more_limbs_than_fields_share_one_with_the_sign_turned_round(figure, both_arms):
    left, right = made(figure, both_arms, 2).T
    assert_allclose(made(figure, both_arms, 1), (left - right)[:, None], rtol=0, atol=1e-12)


def test_limbs_without_surface_get_no_field_and_three_fields_are_the_surfaces_own(figure, both_arms):
    regions = bone_regions(figure, both_arms)
    assert [limb_field_count(both_arms, regions, fields) for fields in (2, 3, 4, 5, 8)] == [0, 0, 1, 2, 2]
    nothing = BoneRegions(np.where(regions.owner > 3, -1, regions.owner), regions.held)
    assert limb_field_count(both_arms, nothing, 8) == 1


def test_by_a_skin_a_field_is_the_mean_over_the_bones_of_each_vertex(figure, both_arms):
    """Whatever the shares are: the smoothed mean of values that are constant on each bone but for its middle."""
    shares = np.random.default_rng(0).dirichlet(np.ones(7), len(figure.vertices))
    found = made(figure, both_arms, 2, regions_of_shares(shares), shares)
    L, mass = fields.laplacian(figure)
    axes = both_arms.tails - both_arms.heads
    along = np.einsum("nbx,bx->nb", figure.vertices[:, None] - both_arms.heads, axes) / both_arms.lengths**2
    place = 0.25 + 0.5 * np.clip(along, 0, 1)
    for column, chain_bones in ((0, [1, 2, 3]), (1, [4, 5, 6])):
        value = np.zeros_like(shares)
        value[:, chain_bones] = (1 + np.arange(3) + place[:, chain_bones]) / 4
        expected = np.linalg.solve(
            np.diag(mass) - BLUR_DIAGONALS**2 * L.toarray(), mass * np.einsum("nb,nb->n", shares, value)
        )
        assert_allclose(found[:, column], expected, rtol=0, atol=1e-9)


def test_contacts_hold_within_a_bone_and_by_a_skin_only_there(two_parts):
    """The cube is tied to the right hand: to a hand of its own bone, to the hand as its neighbour, to a stranger."""
    ties = contacts(two_parts)
    bones = chains(TRUNK, (0, ARM * [-1, 1, 1]))
    cube = np.arange(len(two_parts.vertices)) >= len(two_parts.vertices) - 8
    for owner, neighbours, skinned in ((3, True, True), (2, True, False), (1, False, False), (-1, True, True)):
        regions = BoneRegions(np.where(cube, owner, 3), np.ones(len(cube), dtype=bool))
        for by_a_skin, expected in ((False, neighbours), (True, skinned)):
            assert np.all(contacts_that_hold(ties, two_parts.vertices, regions, bones, skinned=by_a_skin) == expected)


def test_an_arm_that_is_sewn_to_the_trunk_stays_there_and_one_that_is_stuck_into_it_turns():
    trunk, upper_arm, forearm = 0, 1, 2
    bones = chains((-1, "0 0 0, 0 1 0"), (trunk, "0 1 0, 1 1 0, 2 1 0"))
    rest = points("0 0 0, 1 0 0, 0 1 0, 0.3 0.3 0, 0.3 0.3 0.003")
    ties = Contacts(np.array([3, 4]), np.array([[0, 1, 2]] * 2), np.array([[0.4, 0.3, 0.3]] * 2), np.zeros(2))
    for here, there, expected in (
        (trunk, upper_arm, [True, False]),
        (upper_arm, trunk, [True, False]),
        (upper_arm, forearm, [True, True]),
        (trunk, forearm, [False, False]),
    ):
        regions = BoneRegions(np.array([there] * 3 + [here] * 2), np.ones(5, dtype=bool))
        assert_array_equal(contacts_that_hold(ties, rest, regions, bones, skinned=False), expected)


def test_a_model_with_bones_has_the_surfaces_smoothest_fields_and_those_of_the_limbs(figure, figure_model, both_arms):
    model = build(figure, bones=both_arms)
    assert_array_equal(model.isoline_coordinates[:, :6], build(figure, ModelParameters(fields=6)).isoline_coordinates)
    assert_allclose(model.weights[6:], 1 / 8)
    assert model.weights.sum() == pytest.approx(1)
    limbs = fields.compute_isoline_coordinates(made_in_model_units(figure, both_arms, model), 10)
    assert_allclose(model.isoline_coordinates[:, 6:], limbs, rtol=0, atol=1e-5)
    assert_array_equal(build(figure).isoline_coordinates, figure_model.isoline_coordinates)


def made_in_model_units(mesh, bones, model):
    center = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
    unit = dataclasses.replace(mesh, vertices=(mesh.vertices - center) / mesh.diagonal)
    smaller = dataclasses.replace(
        bones, heads=(bones.heads - center) / mesh.diagonal, tails=(bones.tails - center) / mesh.diagonal
    )
    return made(unit, smaller, 2, model.regions, model.shares.astype(np.float64))
