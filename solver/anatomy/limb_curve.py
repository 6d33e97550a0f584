"""A curve inside a limb, from its end to the trunk, and the positions of the joints on it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from solver.anatomy.solid import Solid

UPPER_ARM_SHARE, THIGH_SHARE = 0.48, 0.51
"""Length of the upper arm as a share of that from shoulder to wrist, and of the thigh as a share of that from hip to
ankle, if the limb is straight: the mean of people and of game characters."""

WRIST_SHARE, WRIST_SPREAD = 0.70, 0.15
"""Usual position of the wrist, as a share of the distance from shoulder to fingertip, and its maximum deviation."""

ELBOW_SHARES, MAX_ELBOW_RATIO = (0.35, 0.5), 0.7
"""Range of an elbow that is narrower than the wrist, as shares of the distance from shoulder to fingertip, and maximum
radius there, as a share of the smallest one in the range of the wrist."""

HIP_RATIO, SHOULDER_RATIO = 0.6, 2.3
"""Half the distance between the curves of two legs at the hips, and the distance of an arm's curve from the trunk's at
the shoulder, as multiples of the distance to the surface."""

CLEAR_ARM_RATIO, CLEAR_LEG_FACTOR = 4.0, 3.0
"""Distance at which an arm is clear of the body, in the measure of `SHOULDER_RATIO`, and the same for a leg as a
multiple of `HIP_RATIO`."""

MAX_HELD_THICKNESS, MIN_HELD_LENGTH, MIN_THIN_SHARE = 0.5, 0.6, 0.8
"""An object is held in the hand if it is thinner than the first share of the arm and longer than the second share of
the arm's length, and if the third share of it is that thin: a sword has no thick parts."""

MAX_ALIKE_SHARE = 0.1
"""Maximum difference in length of what is held in both hands, as a share of the longer one, at which it is rather the
forearms."""

LOWER_LEG_SHARE = 0.5
"""Lower part of a leg that contains the ankle, as a share of the distance from the end of the foot to the hip."""

MAX_LEG_MISFIT = 0.02
"""Maximum root mean square distance of a leg's cells from three straight bones, as a share of its length; the legs of
many animals are beyond it."""

MAX_FOOT_SHARE, MIN_SHIN_COSINE = 0.35, np.cos(np.radians(30))
"""Height of a foot, as a share of the distance from its end to the hip, and cosine of its angle to up, above which it
is a shin."""

ANKLE_SHARES, KNEE_SHARES = (0.05, 0.6), (0.3, 0.7)
"""Range of the ankle, as shares of the distance from the end of the foot to the hip, and of the knee, as shares of the
distance from ankle to hip."""

UNUSUAL_WEIGHT = 0.06
"""Distance from straight bones that counts as much as joints far from their usual places, as a share of the limb's
length times that of the deviation."""

AXLE_DEGREES = 60.0
"""Angle in degrees by which a curve turns away from a thigh or upper arm where it leaves the limb for the body."""

SIDEWAYS_DEGREES = 45.0
"""Maximum angle in degrees to the left or right at which a curve leads from the trunk to the hip, as an axle does."""

BEND_DEGREES = 20.0, 50.0
"""Angles in degrees of a bent limb from which the bend begins to determine the place of the joint, and from which it
alone determines it."""


@dataclass(frozen=True, eq=False)
class LimbCurve:
    """A smoothed curve through cells.

    Attributes
    ----------
    cells : (k,) int64
        From the end of the limb to the trunk.
    centers : (k, 3) float64
        Of the cells; left, up and front.
    points : (k, 3) float64
        The smoothed curve.
    depth : (k,) float64
        Distance to the surface.
    along : (k,) float64
        Distance along the curve from the end.
    """

    cells: NDArray[np.int64]
    centers: NDArray[np.float64]
    points: NDArray[np.float64]
    depth: NDArray[np.float64]
    along: NDArray[np.float64]

    @property
    def length(self) -> float:
        """Length of the curve."""
        return float(self.along[-1])

    def at(self, way: float) -> NDArray[np.float64]:
        """Return the point (3,) at a distance along the curve."""
        return np.array([np.interp(way, self.along, column) for column in self.points.T])

    def way_to(self, place: NDArray[np.float64]) -> float:
        """Return the distance along the curve of the point that is nearest to a place."""
        return float(self.along[np.linalg.norm(self.points - place, axis=1).argmin()])

    def index(self, way: float) -> int:
        """Return the index of the first cell at a distance along the curve."""
        return min(int(np.searchsorted(self.along, way)), len(self.along) - 1)


def curve_through(solid: Solid, cells: Sequence[int]) -> LimbCurve:
    """Return the curve through some cells, each point averaged with its neighbours over the limb's thickness."""
    chosen = np.array(cells, dtype=np.int64)
    centers, depth = solid.centers[chosen], solid.depth[chosen]
    reach = max(2, round(float(np.median(depth)) / solid.size))
    sums = np.concatenate([np.zeros((1, 3)), np.cumsum(centers, axis=0)])
    place = np.arange(len(centers))
    either = np.minimum(np.minimum(place, place[::-1]), reach)
    smooth = (sums[place + either + 1] - sums[place - either]) / (2 * either + 1)[:, None]
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(smooth, axis=0), axis=1))])
    return LimbCurve(chosen, centers, smooth, depth, along)


def shoulder_ways(arm: LimbCurve, trunk: LimbCurve) -> tuple[float, float]:
    """Return the distances from an arm's end at which it leaves the body, and at which it is clear of the body."""
    away, _ = cKDTree(trunk.points).query(arm.points)
    near = np.asarray(away) < 0.5 * np.max(away)
    first = [np.flatnonzero(near & (away < times * arm.depth)) for times in (SHOULDER_RATIO, CLEAR_ARM_RATIO)]
    leaves, clear = (float(arm.along[each[0]]) if len(each) else arm.length for each in first)
    return leaves, clear


def arm_joints(
    arms: Sequence[LimbCurve],
    shoulders: Sequence[tuple[float, float]],
    around: Sequence[NDArray[np.float64]],
    size: float,
) -> tuple[list[NDArray[np.float64]], list[float]]:
    """Return the joints of two arms.

    Parameters
    ----------
    arms : 2 of LimbCurve
    shoulders : 2 of (float, float)
        From `shoulder_ways`.
    around : 2 of (m, 3) float64
        Centres of the cells of each arm.
    size : float
        Of a cell.

    Returns
    -------
    points : 2 of (4, 3) float64
        Shoulder, elbow, wrist and the end of the hand.
    ends : 2 of float
        Distances from the tips at which the hands end; objects that they hold are beyond.
    """
    tops = [leaves for leaves, _ in shoulders]
    ends = [_end_of_hand(arm, top, size) for arm, top in zip(arms, tops, strict=True)]
    if max(ends) - min(ends) < MAX_ALIKE_SHARE * max(ends):  # slender forearms beyond wide sleeves
        ends = [0.0, 0.0]
    wrists = [
        _narrowest(arm, end, top, cells, size) for arm, end, top, cells in zip(arms, ends, tops, around, strict=True)
    ]
    elbows = _between(arms, wrists, tops, UPPER_ARM_SHARE)
    joints = []
    for arm, (shoulder, clear), elbow, wrist, end in zip(arms, shoulders, elbows, wrists, ends, strict=True):
        joints.append(np.array([_straight_on(arm, elbow, clear, shoulder), *map(arm.at, (elbow, wrist, end))]))
    return joints, ends


def leg_joints(legs: Sequence[LimbCurve], size: float, *, upright: bool) -> tuple[list[NDArray[np.float64]], float]:
    """Return the joints of two legs whose curves end at the same cell.

    Parameters
    ----------
    legs : 2 of LimbCurve
    size : float
        Of a cell.
    upright : bool
        The character has two legs.

    Returns
    -------
    points : 2 of (4, 3) float64
        Hip, knee, ankle and the end of the foot.
    parted : float
        Distance of the hips from the ends of the curves.
    """
    inwards = np.arange(0.0, min(leg.length for leg in legs), size / 2)
    left, right = (np.array([leg.at(leg.length - way) for way in inwards]) for leg in legs)
    depth = np.mean([np.interp(leg.length - inwards, leg.along, leg.depth) for leg in legs], axis=0)
    apart = np.linalg.norm(left - right, axis=1) / 2 / depth
    parted, clear = (
        float(inwards[np.argmax(apart >= min(share * HIP_RATIO, apart.max()))]) for share in (1, CLEAR_LEG_FACTOR)
    )
    hips = [below_axle(leg, leg.length - parted) if upright else leg.length - parted for leg in legs]
    ankles = [_ankle(leg, hip) if upright else _low_corner(leg, hip) for leg, hip in zip(legs, hips, strict=True)]
    lows = [leg.way_to(ankle) for leg, ankle in zip(legs, ankles, strict=True)]
    knees = _between(legs, lows, hips, THIGH_SHARE)
    points = [
        np.array([_straight_on(leg, knee, min(leg.length - clear, hip), hip), leg.at(knee), ankle, leg.at(0.0)])
        for leg, hip, knee, ankle in zip(legs, hips, knees, ankles, strict=True)
    ]
    return points, parted


def below_axle(leg: LimbCurve, top: float) -> float:
    """Return the distance from the end of a leg at which its curve no longer leads sideways from the trunk.

    Parameters
    ----------
    leg : LimbCurve
    top : float
        Distance at which the two legs part; the result if all of the upper half leads sideways.
    """
    ways = np.linspace(top, top / 2, 31)
    steps = np.diff([leg.at(way) for way in ways], axis=0)
    sideways = np.abs(steps[:, 0]) > np.cos(np.radians(SIDEWAYS_DEGREES)) * np.linalg.norm(steps, axis=1)
    return top if sideways.all() else float(ways[np.argmin(sideways)])


def _ankle(leg: LimbCurve, hip: float) -> NDArray[np.float64]:
    """Return the ankle (3,): the first corner of foot, shin and thigh, all straight, that fit the cells best.

    The smoothed curve would cut the corner. If three bones do not fit, as in the legs of many animals, the ankle is the
    corner of the lower part. A long foot that leads straight up is the shin of a leg without a foot, such as a robot's.

    Parameters
    ----------
    leg : LimbCurve
    hip : float
        Distance from the end.
    """
    ways = np.linspace(0.0, hip, 61)
    joints, misfit = three_bones(np.column_stack([np.interp(ways, leg.along, column) for column in leg.centers.T]))
    foot = joints[1] - joints[0]
    if foot[1] > max(MAX_FOOT_SHARE * hip, MIN_SHIN_COSINE * float(np.linalg.norm(foot))):
        return leg.at(ANKLE_SHARES[0] * hip)
    return _low_corner(leg, hip) if misfit > MAX_LEG_MISFIT * hip else joints[1]


def three_bones(
    points: NDArray[np.float64], knees: tuple[float, float] = KNEE_SHARES, usual: tuple[float, ...] = ()
) -> tuple[NDArray[np.float64], float]:
    """Fit three straight bones to a leg: from the end of the foot to ankle, knee and hip (`straight_bones`).

    Parameters
    ----------
    points : (k, c) float64
    knees : (float, float)
        Range of the knee, as shares of the distance from ankle to hip.
    """
    last = len(points) - 1
    places = []
    for low in range(round(ANKLE_SHARES[0] * last), round(ANKLE_SHARES[1] * last) + 1):
        first, past = (round(low + share * (last - low)) for share in knees)
        places += [(low, high) for high in range(first, past + 1)]
    return straight_bones(points, places, usual)


def straight_bones(
    points: NDArray[np.float64], places: Sequence[tuple[int, ...]], usual: tuple[float, ...] = ()
) -> tuple[NDArray[np.float64], float]:
    """Fit straight bones.

    Parameters
    ----------
    points : (k, c) float64
        Evenly spaced along a limb; the bones begin and end at the first and last. Several limbs with the same bones
        have three columns each.
    places : sequence of tuple of int
        Numbers of the points that may be joints.
    usual : tuple of float
        Usual shares of the joints along the limb, which decide where the limb is straight; without them, all places
        are as likely.

    Returns
    -------
    joints : (b + 1, c) float64
        Ends of the bones.
    misfit : float
        Root mean square distance of the points from the bones.
    """
    last = len(points) - 1
    inner = np.array(places)
    corners = np.column_stack([np.zeros(len(inner)), inner, np.full(len(inner), last)])
    # how much of each bone is before each point, and with it the shares of the ends of the bones in each point
    before = (np.arange(last + 1)[:, None] - corners[:, None, :-1]) / np.diff(corners)[:, None]
    before = np.pad(np.clip(before, 0.0, 1.0), [(0, 0), (0, 0), (1, 1)], constant_values=(1.0, 0.0))
    shares = before[..., :-1] - before[..., 1:]
    fixed = points - shares[..., [0, -1]] @ points[[0, last]]
    between = shares[..., 1:-1]
    across = between.transpose(0, 2, 1)
    found = np.linalg.solve(across @ between, across @ fixed)
    misfit = ((between @ found - fixed) ** 2).mean(axis=1).sum(axis=1)
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    unusual = ((inner[:, : len(usual)] / last - np.array(usual)) ** 2).sum(axis=1)
    best = np.argmin(misfit + (UNUSUAL_WEIGHT * length) ** 2 * unusual)
    return np.array([points[0], *found[best], points[last]]), float(np.sqrt(misfit[best]))


def _low_corner(leg: LimbCurve, hip: float) -> NDArray[np.float64]:
    """Return the corner (3,) of two straight bones in the lower part of a leg."""
    return _corner(leg, 0.0, LOWER_LEG_SHARE * hip, (0.05, 0.95))[1]


def _straight_on(limb: LimbCurve, joint: float, clear: float, top: float) -> NDArray[np.float64]:
    """Return a shoulder or hip (3,) on the straight line from elbow or knee; the curve itself bends into the body.

    Parameters
    ----------
    limb : LimbCurve
    joint : float
        Elbow or knee; this and the following are distances from the limb's end.
    clear : float
        End of the part in which the curve is in the middle of the limb.
    top : float
        Place where the limb leaves the body.
    """
    straight = _before_bend(limb, joint, min(max(clear, joint + 0.1 * (top - joint)), top))
    bone = limb.at(straight) - limb.at(joint)
    bone /= max(float(np.linalg.norm(bone)), 1e-12)
    return np.asarray(limb.at(straight) + max(float((limb.at(top) - limb.at(straight)) @ bone), 0.0) * bone)


def _before_bend(limb: LimbCurve, joint: float, end: float) -> float:
    """Return the distance up to which a curve keeps its direction from a joint; that of a thigh on an axle bends."""
    ways = np.linspace(joint, end, 21)[1:]
    points = np.array([limb.at(joint), *(limb.at(way) for way in ways)])
    so_far, steps = points[1:-1] - points[0], np.diff(points[1:], axis=0)
    cosine = np.einsum("kx,kx->k", so_far, steps)
    cosine /= np.maximum(np.linalg.norm(so_far, axis=1) * np.linalg.norm(steps, axis=1), 1e-12)
    bends = np.flatnonzero(cosine < np.cos(np.radians(AXLE_DEGREES)))
    return float(ways[bends[0]]) if len(bends) else end


def _corner(
    limb: LimbCurve, low: float, high: float, between: tuple[float, float]
) -> tuple[float, NDArray[np.float64]]:
    """Return the distance from the end and the point (3,) of the joint between the two straight bones that fit best.

    The curve itself cuts the corner.

    Parameters
    ----------
    limb : LimbCurve
    low, high : float
        Distances at which the bones end.
    between : (float, float)
        Range of the joint, as shares of the distance from low to high.
    """
    ways = np.linspace(low, high, 61)
    points = np.array([limb.at(way) for way in ways])
    number, last = np.arange(len(ways)), len(ways) - 1
    best, where, corner = np.inf, 0, points[0]
    for place in range(round(between[0] * last), round(between[1] * last) + 1):
        share = np.where(number <= place, number / place, (last - number) / (last - place))[:, None]
        end = np.where((number <= place)[:, None], points[0], points[-1])
        fitted = (share * (points - (1 - share) * end)).sum(axis=0) / (share**2).sum()
        misfit = float(((share * fitted + (1 - share) * end - points) ** 2).sum())
        if misfit < best:
            best, where, corner = misfit, place, fitted
    return float(ways[where]), np.asarray(corner)


def _between(limbs: Sequence[LimbCurve], lows: Sequence[float], highs: Sequence[float], usual: float) -> list[float]:
    """Return the distances of elbows or knees: at the bend of the limbs, or else at the usual share.

    Both limbs get the same share.

    Parameters
    ----------
    limbs : 2 of LimbCurve
    lows, highs : 2 of float
        Wrists and shoulders, or ankles and hips.
    usual : float
        Usual share of the upper bone.
    """
    total, weights = 0.25 * usual, 0.25
    for limb, low, high in zip(limbs, lows, highs, strict=True):
        near = high - 0.15 * (high - low)  # without the part that bends into the body
        corner, joint = _corner(limb, low, near, (0.3, 0.8))
        inner, outer = limb.at(near) - joint, joint - limb.at(low)
        cosine = inner @ outer / max(float(np.linalg.norm(inner) * np.linalg.norm(outer)), 1e-12)
        angle = float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
        weight = float(np.clip((angle - BEND_DEGREES[0]) / (BEND_DEGREES[1] - BEND_DEGREES[0]), 0, 1))
        total += weight * (high - corner) / max(high - low, 1e-12)
        weights += weight
    return [high - total / weights * (high - low) for low, high in zip(lows, highs, strict=True)]


def _end_of_hand(arm: LimbCurve, shoulder: float, size: float) -> float:
    """Return the distance from the tip at which a hand ends; beyond may be an object that is long and thin."""
    top = arm.index(shoulder)
    for place in range(top - 1, 0, -1):
        so_far = shoulder - arm.along[place]
        # depths are up to half a cell too small, which is much of a slender forearm's
        thin = arm.depth[:place] + size / 4 < MAX_HELD_THICKNESS * np.median(arm.depth[place:top])
        if (
            so_far > 3 * arm.depth[top]
            and thin[-1]
            and thin.mean() > MIN_THIN_SHARE
            and arm.along[place] > MIN_HELD_LENGTH * so_far
        ):
            return float(arm.along[place])
    return 0.0


def _narrowest(arm: LimbCurve, end: float, shoulder: float, around: NDArray[np.float64], size: float) -> float:
    """Return the distance of the wrist from the tip: where the arm is narrow, near the usual place.

    If the arm narrows all the way up from there, as that of a robot with a thick forearm, the narrowest place is the
    elbow, and the wrist is at the usual distance beyond it.
    """
    _, nearest = cKDTree(arm.points).query(around)
    ways, length = arm.along[nearest], shoulder - end
    reach = max(0.04 * length, 1.5 * size)

    def radius(share: NDArray[np.float64]) -> NDArray[np.float64]:
        room = [np.count_nonzero(np.abs(ways - end - (1 - each) * length) < reach) for each in share]
        return np.sqrt(np.maximum(room, 1.0))

    share = np.linspace(WRIST_SHARE - WRIST_SPREAD, WRIST_SHARE + WRIST_SPREAD, 31)
    low = radius(share)
    unlikely = low / np.median(low) + 0.3 * ((share - WRIST_SHARE) / WRIST_SPREAD) ** 2
    wrist = share[unlikely.argmin()]
    above = np.linspace(ELBOW_SHARES[0], ELBOW_SHARES[1], 21)
    high = radius(above)
    if share[low.argmin()] < ELBOW_SHARES[1] + 0.1 and high.min() < MAX_ELBOW_RATIO * low.min():
        wrist = min(above[high.argmin()] / UPPER_ARM_SHARE, share[-1])
    return float(end + (1 - wrist) * length)
