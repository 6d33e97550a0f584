"""Bodies that are counted from limbs which were voted for by hand."""

from dataclasses import replace

import numpy as np
import pytest
import scipy
from numpy.testing import assert_allclose

from solver.anatomy.limb_counts import MOST, counted_bodies, load_weights, log_shares, measured, pairs_of
from solver.anatomy.part_network import PARTS
from solver.anatomy.voted_limbs import MIRROR, VotedLimb

from ..shapes import points as points_of

LEG = points_of("0.1 0.5 0.2, 0.1 0.3 0.2, 0.1 0.1 0.2, 0.1 0 0.3")
HIND = LEG - [0, 0, 0.6]
ARM = points_of("0.1 0.8 0, 0.3 0.8 0, 0.5 0.8 0, 0.6 0.8 0")

UNCERTAIN = {"share": 0.005, "chance": 0.5, "spread": 0.07}


def voted(part, joints, share=0.05, chance=0.9, spread=0.04):
    """Return a limb on the side of its joints, with a hundred points for each percent of the share."""
    chances = np.full(len(PARTS), (1 - chance) / 5)
    chances[PARTS.index(part)] = chance
    side = 0 if part in ("trunk", "head", "tail") else int(np.sign(joints[0, 0]))
    return VotedLimb(part, side, joints, chances, np.repeat(joints, round(2500 * share), axis=0), share, spread)


def pair(part, joints, **settings):
    return [voted(part, joints, **settings), voted(part, joints * MIRROR, **settings)]


TRUNK = voted("trunk", points_of("0 0.5 0, 0 0.6 0, 0 0.7 0, 0 0.8 0"), 0.4)


def inside(*limbs):
    """Return a tree of points inside a character with these limbs."""
    return scipy.spatial.cKDTree(np.concatenate([limb.joints for limb in limbs]))


def counts(limbs):
    """Return the likeliest numbers of pairs of arms, legs and wings, and of tails."""
    body = counted_bodies([TRUNK, *limbs], inside(TRUNK, *limbs))[0]
    return tuple(len(body.limbs[part]) for part in MOST)


def test_how_common_a_body_is_depends_on_its_pairs_and_on_whether_such_bodies_have_tails():
    shares = log_shares([(1, 1, 0, 45, 0.06)], (0.05, 0.4))
    assert len(shares) == 3 * 5 * 2 * 2
    assert_allclose(np.exp([shares[1, 1, 0, 0], shares[1, 1, 0, 1]]), [45 * 0.94, 45 * 0.06])
    assert_allclose(np.exp([shares[0, 3, 1, 0], shares[0, 3, 1, 1]]), [0.05 * 0.6, 0.05 * 0.4])


def test_limbs_that_mirror_each_other_are_pairs_wherever_the_middle_is():
    moved = np.array([5.0, 0, 0])
    limbs = [replace(limb, joints=limb.joints + moved) for limb in [*pair("leg", HIND), *pair("leg", LEG)]]
    left, right = [limb for limb in limbs if limb.side > 0], [limb for limb in limbs if limb.side < 0]
    found = list(pairs_of([*left, *right[::-1]], "leg", inside(*limbs)))
    assert sorted(found, key=lambda each: each[0].joints[0, 2]) == [(left[0], right[0]), (left[1], right[1])]


def test_a_limb_is_a_pair_with_its_mirror_image_if_the_character_is_there_too():
    arm, leg = voted("arm", ARM), voted("leg", -LEG * [1, -1, -1])
    both = inside(TRUNK, *pair("arm", ARM), *pair("leg", LEG))
    (pair_of_arms,) = pairs_of([TRUNK, arm, leg], "arm", both)
    assert pair_of_arms[0] is arm
    assert_allclose(pair_of_arms[1].joints, ARM * MIRROR)
    assert (pair_of_arms[1].side, pair_of_arms[1].share) == (-1, 0)
    ((image, own),) = pairs_of([TRUNK, arm, leg], "leg", both)
    assert (image.side, own) == (1, leg)
    one_sided = inside(TRUNK, arm, leg)
    assert list(pairs_of([TRUNK, arm, leg], "arm", one_sided)) == [(arm,)]
    assert not list(pairs_of([TRUNK, arm, leg], "leg", one_sided))


def test_what_is_measured_of_a_pair():
    large, small = pair("leg", LEG, share=0.044, chance=0.75, spread=0.065), pair("leg", HIND, share=0.011, chance=0.5)
    small[0] = replace(small[0], share=0.022)
    image = replace(voted("leg", LEG * MIRROR), share=0.0)
    rows = measured([tuple(large), tuple(small), (large[0], image)])
    assert_allclose(rows[0], [np.log(4), 0, np.log(3), 1, 0], atol=0.01)
    assert_allclose(rows[1], [0, -np.log(4), 0, -0.25, 0], atol=0.01)
    assert_allclose(rows[2], [np.log(4), 0, np.log(3), 1, 1], atol=0.01)
    assert measured([(voted("tail", LEG),)])[0, 4] == 0


@pytest.mark.parametrize(
    ("limbs", "expected"),
    [
        ([*pair("arm", ARM), *pair("leg", LEG)], (1, 1, 0, 0)),
        ([*pair("arm", ARM, share=0.004, chance=0.6), *pair("leg", LEG)], (1, 1, 0, 0)),
        ([*pair("leg", LEG), *pair("leg", HIND), voted("tail", HIND * [0, 1, 1])], (0, 2, 0, 1)),
        ([*pair("leg", LEG), *pair("leg", HIND), *pair("leg", HIND - [0, 0, 0.4])], (0, 3, 0, 0)),
        ([*pair("leg", LEG), *pair("leg", HIND), *pair("leg", LEG + 0.1, **UNCERTAIN)], (0, 2, 0, 0)),
        ([*pair("wing", ARM), *pair("leg", LEG), voted("tail", HIND * [0, 1, 1])], (0, 1, 1, 1)),
        (pair("arm", ARM, **UNCERTAIN), (0, 0, 0, 0)),
    ],
)
def test_few_uncertain_votes_are_limbs_where_bodies_usually_have_them(limbs, expected):
    assert counts(limbs) == expected


def test_probabilities_of_all_bodies_add_up_and_follow_the_weights():
    limbs = [TRUNK, *pair("arm", ARM, share=0.011, chance=0.6)]
    bodies = counted_bodies(limbs, inside(*limbs))
    assert_allclose(sum(body.chance for body in bodies), 1)
    assert [body.chance for body in bodies] == sorted((body.chance for body in bodies), reverse=True)
    weights, shares = load_weights()
    chance = {tuple(len(body.limbs[part]) for part in MOST): body.chance for body in bodies}
    assert set(chance) == {(0, 0, 0, 0), (1, 0, 0, 0)}
    gained = weights["arm"] @ [1, *measured([limbs[1:]])[0]] + shares[1, 0, 0, 0] - shares[0, 0, 0, 0]
    assert_allclose(np.log(chance[1, 0, 0, 0] / chance[0, 0, 0, 0]), gained)
