"""How many arms, legs, wings and tails a body has, decided together.

Points inside the character vote for limbs (`solver.anatomy.voted_limbs`), and small or blurred groups of votes may be
limbs or not. Groups on both sides that mirror each other are a pair; so are a group and its mirror image, if the
character is there too. A pair is the likelier, the more points vote for
it, the more certain and the closer together their votes are; a body is the likelier, the more common its numbers of
limbs are. The sum of both is the log odds of a body; `limb_counts.toml` has the weights.
"""

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import NDArray

from solver.anatomy.part_network import PARTS
from solver.anatomy.voted_limbs import MAX_OUTSIDE, MIRROR, VotedLimb

MOST = {"arm": 2, "leg": 4, "wing": 1, "tail": 1}
"""Parts that are counted, and the maximum number of pairs of each; a tail, in the middle, counts as a pair."""

MEASURES = ("share", "beside others", "chance", "spread", "single")
"""What is measured of a pair: the logarithm of its share of the points, where that of the smaller limb counts, and of
this beside the largest pair of the part; the logit of its part's mean probability; how far its votes are apart; and
whether nobody votes for one of the two."""

USUAL_SHARE, USUAL_SPREAD, SPREAD_UNIT = 0.011, 0.045, 0.02
"""Share and spread whose measures are 0, and the spread beyond it whose measure is 1."""

FEWEST = 1e-3
"""Share of the points at which a pair gains nothing from being one."""

ASYMMETRY_COST = 3.0
"""What a pair loses for each largest extent of the character between a limb and the mirror image of the other."""

WEIGHTS = Path(__file__).with_name("limb_counts.toml")

Counts = tuple[int, ...]


@dataclass(frozen=True, eq=False)
class CountedBody:
    """A body with some of the limbs that were voted for.

    Attributes
    ----------
    chance : float
        Its probability.
    limbs : dict of str to list of tuple of VotedLimb
        For each part of `MOST` its pairs, left before right, the largest first; tails, and arms without a
        counterpart, are alone.
    """

    chance: float
    limbs: dict[str, list[tuple[VotedLimb, ...]]]


@cache
def load_weights() -> tuple[dict[str, NDArray[np.float64]], dict[Counts, float]]:
    """Return what the file says.

    Returns
    -------
    weights : dict of str to (6,) float64
        For each part its bias and the weights of `MEASURES`.
    shares : dict
        As in `log_shares`.
    """
    table = tomllib.loads(WEIGHTS.read_text(encoding="utf-8"))
    weights = {part: np.array([table[part][name] for name in ("bias", *MEASURES)]) for part in MOST}
    return weights, log_shares(table["seen"]["bodies"], table["seen"]["other"])


def log_shares(bodies: Sequence[Sequence[float]], other: Sequence[float]) -> dict[Counts, float]:
    """Return the logarithm of how common each body is, up to a constant, by its counts in the order of `MOST`.

    Parameters
    ----------
    bodies : sequence of (arms, legs, wings, number, tails)
        Number of characters with these pairs, and the share of them that has a tail.
    other : (number, tails)
        The same of any other body.
    """
    known = {tuple(map(int, row[:3])): row[3:] for row in bodies}
    found = {}
    for counts in product(*(range(most + 1) for most in MOST.values())):
        number, tails = known.get(counts[:3], other)
        found[counts] = float(np.log(number * (tails if counts[3] else 1 - tails)))
    return found


def counted_bodies(voted: Sequence[VotedLimb], inside: scipy.spatial.cKDTree) -> list[CountedBody]:
    """Return the bodies that limbs may be, the likeliest first.

    Parameters
    ----------
    voted : sequence of VotedLimb
    inside : cKDTree
        Points inside the character, all over it.
    """
    weights, shares = load_weights()
    pairs = {part: pairs_of(voted, part, inside) for part in MOST}
    scores = {part: measured(own) @ weights[part][1:] + weights[part][0] for part, own in pairs.items()}
    totals = {part: np.concatenate([[0.0], np.cumsum(own)]) for part, own in scores.items()}
    possible = [dict(zip(MOST, counts, strict=True)) for counts in shares]
    possible = [counts for counts in possible if all(n <= len(pairs[part]) for part, n in counts.items())]
    odds = [shares[*counts.values()] + sum(totals[part][n] for part, n in counts.items()) for counts in possible]
    found = [
        CountedBody(float(chance), {part: pairs[part][:n] for part, n in counts.items()})
        for counts, chance in zip(possible, scipy.special.softmax(odds), strict=True)
    ]
    return sorted(found, key=lambda body: -body.chance)


def pairs_of(voted: Sequence[VotedLimb], part: str, inside: scipy.spatial.cKDTree) -> list[tuple[VotedLimb, ...]]:
    """Return the pairs of a part, the largest first; tails, and arms without a counterpart, are alone.

    The parameters are those of `counted_bodies`.
    """
    size = float(np.max(inside.maxes - inside.mins))
    left, right = ([limb for limb in voted if limb.part == part and limb.side == side] for side in (1, -1))
    gains = np.array([[_gain(one, other, size) for other in right] for one in left]).reshape(len(left), len(right))
    matched = zip(*scipy.optimize.linear_sum_assignment(-np.maximum(gains, 0.0)), strict=True)
    found: list[tuple[VotedLimb, ...]] = [
        (left[row], right[column]) for row, column in matched if gains[row, column] > 0
    ]
    paired = [limb for pair in found for limb in pair]
    for limb in [limb for limb in voted if limb.part == part and limb not in paired]:
        image = _image(limb, voted)
        if limb.side and np.max(inside.query(image.joints)[0]) < MAX_OUTSIDE * size:
            found.append((limb, image) if limb.side > 0 else (image, limb))
        elif part in ("arm", "tail"):
            found.append((limb,))
    return sorted(found, key=lambda pair: -sum(limb.share for limb in pair))


def _image(limb: VotedLimb, voted: Sequence[VotedLimb]) -> VotedLimb:
    """Return the mirror image of a limb, for which no point votes."""
    trunk = next(each for each in voted if each.part == "trunk")
    middle = np.array([2 * float(np.median(trunk.joints[:, 0])), 0.0, 0.0])
    joints, points = limb.joints * MIRROR + middle, limb.points * MIRROR + middle
    return replace(limb, side=-limb.side, joints=joints, points=points, share=0.0)


def _gain(one: VotedLimb, other: VotedLimb, size: float) -> float:
    """Return how well two limbs are a pair: both have many points, and they mirror each other but for their place."""
    ways = one.joints - other.joints * MIRROR
    ways[:, 0] -= ways[:, 0].mean()
    return float(np.log(min(one.share, other.share) / FEWEST) - ASYMMETRY_COST * np.linalg.norm(ways) / 2 / size)


def measured(pairs: Sequence[Sequence[VotedLimb]]) -> NDArray[np.float64]:
    """Return `MEASURES` (n, 5) of all n pairs of a part; the share of the largest one counts for the others."""
    seen = [[limb for limb in pair if limb.share] for pair in pairs]
    shares = [min(limb.share for limb in limbs) for limbs in seen]
    rows = [_measures(limbs, share, max(shares)) for limbs, share in zip(seen, shares, strict=True)]
    return np.array(rows).reshape(len(rows), len(MEASURES))


def _measures(seen: Sequence[VotedLimb], share: float, largest: float) -> tuple[float, ...]:
    count = [len(limb.points) for limb in seen]
    chance = float(np.average([limb.chances[PARTS.index(limb.part)] for limb in seen], weights=count))
    spread = float(np.average([limb.spread for limb in seen], weights=count))
    return (
        float(np.log(share / USUAL_SHARE)),
        float(np.log(share / largest)),
        float(np.log(chance / (1 - chance + 1e-3))),
        (spread - USUAL_SPREAD) / SPREAD_UNIT,
        float(len(seen) == 1 and seen[0].side != 0),
    )
