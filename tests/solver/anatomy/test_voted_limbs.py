"""Limbs by votes that were made by hand."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from solver.anatomy import voted_limbs as module
from solver.anatomy.part_network import PARTS, POINTS, Parts
from solver.anatomy.solid import Solid
from solver.anatomy.voted_limbs import MIRROR, VotedLimb, Votes, bend_of, voted_limbs, votes_of

from ..shapes import points as points_of

TRUNK = points_of("0 0.5 0, 0 0.6 0, 0 0.7 0, 0 0.8 0")
LEG = points_of("0.1 0.5 0.2, 0.1 0.3 0.2, 0.1 0.1 0.2, 0.1 0 0.3")
HIND = LEG - [0, 0, 0.8]


def votes(*limbs):
    """Return votes of points near joints: (part, joints, number of points) each."""
    rng, found = np.random.default_rng(3), []
    for part, joints, count in limbs:
        chances = np.full((count, len(PARTS)), 0.05)
        chances[:, PARTS.index(part)] = 0.75
        points = joints[rng.integers(4, size=count)] + rng.normal(0, 0.01, (count, 3))
        found.append((points, chances, joints + rng.normal(0, 0.01, (count, 4, 3))))
    return Votes(*(np.concatenate(each) for each in zip(*found, strict=True)), 0.0)


def test_limbs_of_one_part_are_told_apart_by_side_and_place():
    four = [LEG, HIND, LEG * MIRROR, HIND * MIRROR]
    found = voted_limbs(votes(("trunk", TRUNK, 200), *(("leg", joints, 60) for joints in four)))
    assert [(limb.part, limb.side) for limb in found] == [("trunk", 0), *[("leg", 1)] * 2, *[("leg", -1)] * 2]
    legs = sorted(found[1:], key=lambda each: (-each.side, -each.joints[0, 2]))
    assert_allclose([limb.joints for limb in legs], four, atol=0.01)
    assert [len(limb.points) for limb in found] == [200, 60, 60, 60, 60]


def test_sides_are_those_of_the_trunk_and_not_of_the_coordinates():
    moved = np.array([5.0, 0, 0])
    limbs = votes(("trunk", TRUNK + moved, 200), ("arm", LEG + moved, 50), ("arm", LEG * MIRROR + moved, 50))
    assert [(limb.part, limb.side) for limb in voted_limbs(limbs)] == [("trunk", 0), ("arm", 1), ("arm", -1)]


@pytest.mark.parametrize(("count", "kept"), [(12, 2), (11, 1)])
def test_a_limb_has_a_minimum_number_of_votes(count, kept):
    found = voted_limbs(votes(("trunk", TRUNK, 300), ("leg", LEG, 60), ("leg", HIND, count)))
    assert sum(limb.part == "leg" for limb in found) == kept


def test_a_limb_knows_how_many_points_vote_for_it_how_certainly_and_how_far_apart():
    limbs = votes(("trunk", TRUNK, 300), ("leg", LEG, 100))
    limbs.chances[300:] = [0, 0, 0.41, 0.59, 0, 0]
    limbs.joints[300:] = LEG
    limbs.joints[300:350] += [0, 0.02, 0]
    leg = voted_limbs(limbs)[1]
    assert_allclose(leg.chances, [0, 0, 0.41, 0.59, 0, 0])
    assert leg.share == 0.25
    assert_allclose(leg.spread, 0.01 / np.ptp(limbs.points, axis=0).max())


def test_what_is_hardly_a_head_is_none():
    limbs = votes(("trunk", TRUNK, 300), ("head", LEG * [0, 1, 1] + [0, 0.8, 0], 60))
    limbs.chances[300:] = [0.49, 0.51, 0, 0, 0, 0]
    assert [limb.part for limb in voted_limbs(limbs)] == ["trunk"]


def test_a_joint_that_is_far_outside_is_at_the_nearest_point_inside():
    limbs = votes(("trunk", TRUNK, 200), ("leg", LEG, 60))
    limbs.joints[200:, 0] = away = (0.4, 0.5, 0.2)
    assert_allclose(voted_limbs(limbs)[1].joints[0], limbs.points[np.linalg.norm(limbs.points - away, axis=1).argmin()])


def test_there_is_a_trunk_where_it_is_likeliest_if_no_point_says_so():
    limbs = votes(("head", TRUNK, 100), ("leg", LEG, 100))
    limbs.chances[:100, 0] += np.linspace(0, 0.2, 100)
    assert voted_limbs(limbs)[0].part == "trunk"
    assert len(voted_limbs(limbs)[0].points) == 10


def test_points_are_inside_and_each_set_is_seen_with_its_mirror_image(monkeypatch):
    """The answer that is made up here is the place of each point itself: both images must say the same."""
    grid = np.stack(np.meshgrid(*[np.arange(12.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    seen = []

    def answer(points, depths):
        seen.append(points)
        return Parts(np.ones((POINTS, 6), np.float32) / 6, np.repeat(points[:, None], 4, axis=1), 2.0)

    monkeypatch.setattr(module, "parts_of", answer)
    found = votes_of(Solid(1.0, grid, np.ones(len(grid))), sets=2)
    assert len(seen) == 4
    assert found.points.shape == (4 * POINTS, 3)
    assert_allclose(found.joints, np.repeat(found.points[:, None], 4, axis=1))
    assert_allclose(seen[1], seen[0] * MIRROR)
    assert np.abs(found.points - np.rint(found.points)).max() <= 0.5
    assert len(np.unique(np.rint(found.points[: 2 * POINTS]), axis=0)) > POINTS / 2
    assert found.stands == 2.0


def test_thin_parts_have_as_many_points_as_thick_ones_with_the_same_surface(monkeypatch):
    cells = np.array([[x, 0.0, 0.0] for x in range(1000)])
    depth = np.where(cells[:, 0] < 500, 0.5, 9.5)  # weights 1 and 0.1
    monkeypatch.setattr(module, "parts_of", lambda points, _: Parts(points, points, 0.0))
    points = votes_of(Solid(1.0, cells, depth), sets=1).points[:POINTS]
    assert_allclose(np.mean(points[:, 0] < 499.5), 10 / 11, atol=0.03)


def test_joints_move_into_the_middle_of_a_limb_and_its_tip_half_way_to_its_end_where_there_are_enough_points():
    along = np.linspace(0, 1, 401)
    ring = 2 * np.pi * 0.381966 * np.arange(401)
    tube = np.column_stack([0.05 * np.cos(ring), 0.05 * np.sin(ring), along])
    voted = points_of("0.1 0 0, 0.1 0 0.4, 0.1 0 0.7, 0.1 0 0.9")
    settled = module._settled(voted, tube)
    assert_allclose(settled[0], voted[0])
    assert_allclose(settled[1:3], voted[1:3] * [0, 1, 1], atol=0.004)
    far = tube[along > 0.7 + 0.85 * 0.3]
    assert_allclose(settled[3], (voted[3] + far.mean(axis=0)) / 2, atol=0.01)
    assert_allclose(module._settled(LEG, LEG[:2]), LEG)  # too few points


def test_a_limb_bends_where_its_points_are_away_from_the_straight_line():
    hip, knee, hock, ankle, toes = points_of("0 0.8 0, 0 0.6 0.1, 0 0.35 -0.1, 0 0.1 0.1, 0 0 0.15")
    way = np.linspace(0, 1, 100)[:, None]
    points = np.concatenate([knee + way * (hock - knee), hock + way * (ankle - hock)])
    limb = VotedLimb("leg", 1, np.array([hip, knee, ankle, toes]), np.zeros(6), points, 0.1, 0.0)
    bend, place = bend_of(limb)
    assert_allclose(place, hock, atol=0.04)
    assert_allclose(bend, 0.2 / 0.5, atol=0.08)
    assert bend_of(replace(limb, points=knee + way * (ankle - knee)))[0] < 1e-9
