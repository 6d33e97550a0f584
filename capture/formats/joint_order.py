"""Meanings of joints in an unknown order, by how they move: bones keep their lengths, and limbs have two long ones.

The bones are the tree of pairs of joints whose distances are short and constant. Its longest branches are the legs and
the arms. Feet, or knees that bend, tell the front, and thereby in right-handed axes the sides. Arrays have no rest
pose whose sides mirror each other, as `capture.skeleton_shape` needs.
"""

import itertools
from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MIN_FRAMES, COUNTS = 10, range(12, 65)
"""Smallest number of frames that tell bones, and numbers of joints of a body without detailed hands."""

RIGIDITY = 20.0
"""How much longer a distance counts that changes by its own length."""

SAME_PLACE = 0.003
"""Distance of two joints at one place, as a share of the longest distance."""

MAX_SPREAD = 0.1
"""Largest standard deviation of a bone's length, as a share of it."""

MIN_BRANCH = 0.25
"""Length of a branch of the body, as a share of a leg; fingers, toes and ears are shorter."""

MAX_RATIO, MIN_LEG_RATIO = 1.25, 1.1
"""How much longer a limb may be than on the other side, and how much longer legs are than arms at least."""

END_SHARES = 0.05, 0.6
"""Lengths of hands and feet, as shares of the bone before."""

CLEAR_SHARE = 0.9
"""Share of frames that must agree on the sides."""


def names_by_shape(positions: Floats) -> list[str]:
    """Return the names of joints that move as a person's do; none if that is in doubt.

    Parameters
    ----------
    positions : (T, J, 3) float64
        In right-handed axes and any unit. Frames with NaN, or with a joint at the origin, do not count.

    Returns
    -------
    list of str
        For each joint one of `capture.skeleton.JOINTS`, "" for others.
    """
    known = positions[np.isfinite(positions).all(axis=(1, 2)) & (positions != 0).any(axis=2).all(axis=1)]
    count = positions.shape[1]
    if len(known) < MIN_FRAMES or count not in COUNTS:
        return []
    known = known[:: max(1, len(known) // 300)]
    lengths = np.linalg.norm(known[:, :, None] - known[:, None], axis=3)
    mean, spread = lengths.mean(axis=0), lengths.std(axis=0)
    distinct = [k for k in range(count) if not (lengths[:, k, :k] < SAME_PLACE * mean.max()).all(axis=0).any()]
    weights = (mean + RIGIDITY * spread)[np.ix_(distinct, distinct)]
    tree = scipy.sparse.csgraph.minimum_spanning_tree(weights).toarray()
    beside = [[distinct[j] for j in np.flatnonzero(tree[i] + tree[:, i])] for i in range(len(distinct))]
    limbs = _limbs(dict(zip(distinct, beside, strict=True)), mean)
    bones = [pair for way in limbs for pair in itertools.pairwise(way[:3])]
    is_clear = len(limbs) == 4 and all(spread[bone] < MAX_SPREAD * mean[bone] for bone in bones)
    return _named(known, mean, limbs) if is_clear else []


def _limbs(beside: dict[int, list[int]], mean: Floats) -> list[list[int]]:
    """Return the joints of legs and arms from the inner end of their long bones outwards, the legs first.

    Parameters
    ----------
    beside : dict of int to list of int
        Joints at the other ends of each joint's bones.
    mean : (J, J) float64
        Mean distance between any two joints.
    """

    def branch(node: int, before: int) -> tuple[float, list[int]]:
        """Return the longest way from a node on, and its length from the node before."""
        ways = [branch(each, node) for each in beside[node] if each != before]
        length, way = max(ways, default=(0.0, []))
        return length + mean[before, node], [node, *way]

    found: dict[int, tuple[float, list[int]]] = {}
    paths: list[list[int]] = []
    leg = max((branch(each, node)[0] for node in beside for each in beside[node]), default=0.0) / 2
    for node, others in beside.items():
        ways = [branch(each, node) for each in others]
        long = [way for way in ways if way[0] > MIN_BRANCH * leg]
        for _, way in long if len(long) > 2 else ():
            path = [node, *way]
            if any(sum(branch(each, one)[0] > MIN_BRANCH * leg for each in beside[one]) > 2 for one in path[1:]):
                continue
            paths.append(path)
    for path in paths:
        is_shared = sum(other[0] == path[0] for other in paths) > 1  # the middle of the hips or the shoulders
        path = path[is_shared:]
        bones = [mean[pair] for pair in itertools.pairwise(path)]
        pairs = [(one + other, k) for k, (one, other) in enumerate(itertools.pairwise(bones))]
        if pairs:
            size, k = max(pairs)
            inner, middle, *outer = path[k:]
            outer.sort(key=mean[middle].__getitem__)  # the wrist before the hand
            found.setdefault(middle, (size, [inner, middle, *outer]))
    chosen = sorted(found.values(), reverse=True)[:4]
    sizes = [size for size, _ in chosen]
    is_body = (
        len(sizes) == 4
        and max(sizes[0] / sizes[1], sizes[2] / sizes[3]) < MAX_RATIO
        and sizes[1] > MIN_LEG_RATIO * sizes[2]
    )
    return [way for _, way in chosen] if is_body else []


def _named(points: Floats, mean: Floats, limbs: Sequence[list[int]]) -> list[str]:
    """Return the names of joints at points (T, J, 3) by the two legs and the two arms, in this order; none in doubt."""
    (leg, other_leg), (arm, other_arm) = limbs[:2], limbs[2:]
    hips, shoulders, ankles = (
        points[:, [one[k], other[k]]].mean(axis=1)
        for one, other, k in ((leg, other_leg, 0), (arm, other_arm, 0), (leg, other_leg, 2))
    )
    ahead = np.zeros_like(hips)
    for way in (leg, other_leg):
        hip, knee, ankle = (points[:, each] for each in way[:3])
        ahead += points[:, way[-1]] - ankle if len(way) > 3 else knee - (hip + ankle) / 2
    right = np.cross(ahead, shoulders - (hips + ankles) / 2)
    names = [""] * points.shape[1]
    for one, other, parts in (
        (leg, other_leg, ("hip", "knee", "ankle", "foot")),
        (arm, other_arm, ("shoulder", "elbow", "wrist", "hand")),
    ):
        share = np.mean(np.einsum("ti,ti->t", points[:, one[0]] - points[:, other[0]], right) > 0)
        if 1 - CLEAR_SHARE < share < CLEAR_SHARE:
            return []
        for side, way in zip(("right", "left") if share > 0.5 else ("left", "right"), (one, other), strict=True):
            ends = [way[-1]] if END_SHARES[0] < mean[way[2], way[-1]] / mean[way[1], way[2]] < END_SHARES[1] else []
            for part, node in zip(parts, [*way[:3], *ends], strict=False):
                names[node] = f"{part}_{side}"
    middle = shoulders - hips
    above = [
        -np.inf if name else float(np.median(np.einsum("ti,ti->t", points[:, k] - shoulders, middle)))
        for k, name in enumerate(names)
    ]
    if max(above) > 0:
        names[int(np.argmax(above))] = "head"
    return names
