"""Limbs of a character by the votes of points inside it.

The network (`solver.anatomy.part_network`) sees several sets of points, and the mirror image of each. Points of one
part on one side whose votes are close are one limb.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from solver.anatomy.part_network import PARTS, POINTS, parts_of
from solver.anatomy.solid import Solid

SETS = 4
"""Number of sets of points."""

MAX_APART = 0.15
"""Maximum mean distance between the votes of one limb, in largest extents."""

MIN_VOTES = 12
"""Minimum number of points that vote for an arm, leg, wing or tail."""

MIN_PART_SHARE = 0.25
"""Minimum number of points that vote for a trunk or a head, as a share of those for the largest one."""

MIN_SHARE, MIN_CHANCE = 0.012, 0.55
"""Minimum share of all points that vote for a head, and minimum mean probability of a head at these points."""

PAIRED = ("arm", "leg", "wing")
"""Parts that have a side."""

NEAR_SHARE = 0.25
"""Distance along a limb up to which points surround a joint, as a share of the limb's length."""

FAR_SHARE = 0.15
"""Share of the points beyond the third joint that are at the end of a limb."""

MIN_SURROUNDING, MIN_FAR = 8, 3
"""Minimum numbers of points that surround a joint, and at the end of a limb."""

MAX_STRETCH = 3.0
"""Maximum length of the last bone to the end of a limb, as a multiple of what was voted for; beyond it is something
else."""

MAX_OUTSIDE = 0.06
"""Maximum distance of a joint from the nearest point inside the character, in largest extents."""

BEND_WIDTH = 0.12
"""Distance along a bone up to which points show how a limb bends there, as a share of the bone's length."""

MIRROR = np.array([-1.0, 1.0, 1.0])

Points = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class VotedLimb:
    """A limb that points voted for.

    Attributes
    ----------
    part : str
        One of `PARTS`.
    side : int
        1 for left, −1 for right, 0 for the middle.
    joints : (4, 3) float64
        Root to tip.
    chances : (6,) float64
        Mean probability of each of `PARTS` at these points.
    points : (k, 3) float64
        These points.
    share : float
        Share of these points in all points.
    spread : float
        Mean distance of their votes from the joints, in largest extents.
    """

    part: str
    side: int
    joints: Points
    chances: Points
    points: Points
    share: float
    spread: float


@dataclass(frozen=True, eq=False)
class Votes:
    """Points inside a character and what they vote for.

    Attributes
    ----------
    points : (n, 3) float64
    chances : (n, 6) float64
    joints : (n, 4, 3) float64
    stands : float
        Logit of the probability that the character stands as the coordinates say.
    """

    points: Points
    chances: Points
    joints: Points
    stands: float


def votes_of(solid: Solid, sets: int = SETS) -> Votes:
    """Return the votes of points inside a character whose coordinates are left, up and front.

    Thin parts have as many points as thick ones with the same surface.

    Parameters
    ----------
    solid : Solid
    sets : int, optional
        Number of sets of points. One is enough to compare ways to stand.
    """
    rng = np.random.default_rng(0)
    order = rng.permutation(len(solid.centers))
    weight = np.cumsum(1 / (solid.depth[order] + solid.size / 2))
    places = (np.arange(sets * POINTS) + 0.5) / (sets * POINTS) * weight[-1]
    cells = rng.permutation(order[np.searchsorted(weight, places)])
    points = solid.centers[cells] + rng.uniform(-0.5, 0.5, (len(cells), 3)) * solid.size
    found, stands = [], []
    for own, depth in zip(points.reshape(sets, POINTS, 3), solid.depth[cells].reshape(sets, POINTS), strict=True):
        for sign in (np.ones(3), MIRROR):
            parts = parts_of(own * sign, depth)
            found.append((own, parts.chances, parts.joints * sign))
            stands.append(parts.stands)
    points, chances, joints = (np.concatenate(each) for each in zip(*found, strict=True))
    return Votes(points, chances, joints, float(np.mean(stands)))


def voted_limbs(votes: Votes) -> list[VotedLimb]:
    """Return the limbs that points vote for, those of one part and side from the largest to the smallest share.

    There is a trunk, even if no point is more likely in it than elsewhere. Of the others, a body has only some
    (`solver.anatomy.limb_counts`).
    """
    part = votes.chances.argmax(axis=1)
    if not (part == 0).any():
        part[votes.chances[:, 0].argsort()[-len(part) // 20 :]] = 0
    size = float(np.ptp(votes.points, axis=0).max())
    amid = part < PARTS.index("arm")
    middle = float(np.median(votes.joints[amid if amid.any() else slice(None), :, 0]))
    left = votes.joints[:, :, 0].mean(axis=1) > middle
    limbs = []
    for number, name in enumerate(PARTS):
        for side in (1, -1) if name in PAIRED else (0,):
            own = np.flatnonzero((part == number) & ((left == (side > 0)) if side else True))
            groups = sorted(_groups(votes.joints[own], MAX_APART * size), key=len, reverse=True)
            for group in groups:
                limb = _limb(votes, own[group], name, side, size) if len(group) else None
                if limb is not None and _is_kept(limb, len(groups[0])):
                    limbs.append(limb)
    return limbs


def _limb(votes: Votes, own: NDArray[np.int64], part: str, side: int, size: float) -> VotedLimb:
    """Return the limb that some points vote for."""
    points, joints = votes.points[own], np.median(votes.joints[own], axis=0)
    spread = float(np.linalg.norm(votes.joints[own] - joints, axis=2).mean()) / size
    joints = _settled(joints, points) if PARTS.index(part) >= PARTS.index("arm") else joints
    joints = _inside(joints, votes.points, MAX_OUTSIDE * size)
    chances = votes.chances[own].mean(axis=0)
    return VotedLimb(part, side, joints, chances, points, len(own) / len(votes.points), spread)


def _is_kept(limb: VotedLimb, most: int) -> bool:
    """Return whether a limb has enough votes, if the largest of its part and side has most of them.

    Which arms, legs, wings and tails a body has is decided later.
    """
    if limb.part not in ("trunk", "head"):
        return len(limb.points) >= MIN_VOTES
    if len(limb.points) < MIN_PART_SHARE * most:
        return False
    is_certain = limb.share >= MIN_SHARE and limb.chances[PARTS.index("head")] >= MIN_CHANCE
    return limb.part == "trunk" or bool(is_certain)


def _groups(joints: Points, apart: float) -> list[NDArray[np.int64]]:
    """Return the groups of votes (n, 4, 3) that are close; roots count half, tips once, the others a quarter."""
    if len(joints) < 2:
        return [np.arange(len(joints))]
    some = np.arange(0, len(joints), max(len(joints) // 1000, 1))
    weight = np.sqrt(np.repeat([0.25, 0.125, 0.125, 0.5], 3))
    flat = joints.reshape(len(joints), 12) * weight
    tree = scipy.cluster.hierarchy.linkage(flat[some], "average")
    label = scipy.cluster.hierarchy.fcluster(tree, apart, "distance")
    near = scipy.spatial.cKDTree(flat[some]).query(flat)[1]
    return [np.flatnonzero(label[near] == each) for each in range(1, label.max() + 1)]


def _settled(joints: Points, points: Points) -> Points:
    """Return the joints of a limb (4, 3) amid its points (k, 3).

    The second and the third move into the middle of the points around them, across the limb, and the tip half of the
    way to the points that are farthest beyond the third joint on its side.
    """
    along, beside = _along(points, joints)
    ends = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(joints, axis=0), axis=1))])
    settled = joints.copy()
    for number in (1, 2):
        away = np.abs(along - ends[number]) / max(ends[-1], 1e-12)
        near = away < NEAR_SHARE
        if np.count_nonzero(near) >= MIN_SURROUNDING:
            weight = np.exp(-((2 * away[near] / NEAR_SHARE) ** 2))
            settled[number] += np.average(beside[near], axis=0, weights=weight)
    beyond = points[along > ends[2]] - joints[2]
    if len(beyond) >= MIN_SURROUNDING:
        reach = np.linalg.norm(beyond, axis=1)
        kept = reach < MAX_STRETCH * np.linalg.norm(joints[3] - joints[2])
        beyond, reach = beyond[kept], reach[kept]
    if len(beyond) >= MIN_SURROUNDING:
        far = beyond[(reach >= np.quantile(reach, 1 - FAR_SHARE)) & (beyond @ (joints[3] - joints[2]) > 0)]
        if len(far) >= MIN_FAR:
            settled[3] = (joints[3] + joints[2] + far.mean(axis=0)) / 2
    return settled


def _inside(joints: Points, points: Points, apart: float) -> Points:
    """Return joints (4, 3) of which those that are farther from all points (n, 3) are at the nearest one."""
    away, nearest = scipy.spatial.cKDTree(points).query(joints)
    return np.where(np.asarray(away)[:, None] > apart, points[nearest], joints)


def _along(points: Points, joints: Points) -> tuple[NDArray[np.float64], Points]:
    """Return how far along a chain (4, 3) points (k, 3) are, and their ways from there; the last bone has no end."""
    bones = np.diff(joints, axis=0)
    lengths = np.maximum(np.linalg.norm(bones, axis=1), 1e-12)
    ways = points[:, None] - joints[:-1]
    share = np.clip(np.einsum("kbc,bc->kb", ways, bones) / lengths**2, 0.0, [1.0, 1.0, np.inf])
    beside = ways - share[:, :, None] * bones
    nearest = np.linalg.norm(beside, axis=2).argmin(axis=1)
    rows = np.arange(len(points))
    before = np.concatenate([[0.0], np.cumsum(lengths)[:-1]])
    return before[nearest] + share[rows, nearest] * lengths[nearest], beside[rows, nearest]


def bend_of(limb: VotedLimb) -> tuple[float, Points]:
    """Return how far a limb bends away from the straight line between its second and its third joint, and where.

    Returns
    -------
    bend : float
        As a share of the length of this line; 0 if few points surround it.
    place : (3,) float64
        Amid the points that surround the limb there.
    """
    start, end = limb.joints[1], limb.joints[2]
    along, beside = _along(limb.points, limb.joints)
    before, length = (float(np.linalg.norm(each)) for each in (start - limb.joints[0], end - start))
    share = (along - before) / max(length, 1e-12)
    inside = (share > 0) & (share < 1)
    places = [(0.0, (start + end) / 2)]
    for at in np.linspace(0.2, 0.8, 7) if inside.any() else ():
        weight = np.exp(-(((share[inside] - at) / BEND_WIDTH) ** 2))
        if weight.sum() > MIN_FAR:
            way = np.average(beside[inside], axis=0, weights=weight)
            places.append((float(np.linalg.norm(way)) / length, start + at * (end - start) + way))
    return max(places, key=lambda each: each[0])
