"""Joints of the legs of a body that lies on its legs, such as a horse, a dog or a dinosaur.

Seen from the side, a leg widens slowly from the foot upwards, and suddenly where it meets the belly: at the flank. Hip
and shoulder are above the leg's middle there, at a usual share of the way through the body. Below the flank the leg is
three straight bones: foot, metatarsus and shin. The knee of a leg with a hock is at the front of the flank.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from solver.anatomy.limb_chain import evenly
from solver.anatomy.limb_curve import LimbCurve, straight_bones
from solver.anatomy.solid import Solid

SAMPLE_COUNT = 61
"""Number of points on a leg to which straight bones are fitted."""

MIN_FLANK_SHARE, FOOT_SHARE = 0.35, 0.2
"""Minimum height of a flank, and height below which a leg is a foot that may lie, as shares of the height at which the
leg's curve ends in the trunk."""

MIN_BELLY_LENGTH = 1.1
"""Minimum length of the belly from front to back, as a share of the same height; that of a leg is smaller."""

MAX_SPRAWL = 0.5
"""Maximum distance from left to right that a leg covers below the flank, as a share of the flank's height."""

HIP_SHARE, SHOULDER_SHARE = 0.5, 0.25
"""Height of the hip and of the shoulder, as shares of the distance from the flank to the back above it."""

ANKLE_SHARE, ELBOW_SHARE, KNEE_SHARE = 0.22, 0.65, 0.6
"""Usual places of the joints of a leg without a hock, as shares of the way from the end of the foot to the flank."""

HOCK_ANKLE_SHARE = 0.4
"""Usual place of the ankle of a leg with a hock, as a share of the way from the end of the foot to the hock."""

MIN_BONE_SHARE = 0.2
"""Minimum distance of a single joint from the ends of that way; of two, half as much, as a share of it."""

MIN_SHIN_SHARE = 0.2
"""Minimum height of the knee above the ankle of a leg without a hock, as a share of the hip's height over the foot:
little of a plump body's leg is seen below the flank."""

HOCK_DEGREES = 12.0
"""Minimum angle in degrees by which the bone above a hock leans further to the front than the one below it."""

HOCK_DEPTH = 0.2
"""Distance of the hock from the back of the leg, as a share of the leg's length from front to back."""

STIFLE_DROP, STIFLE_DEPTH = 0.15, 0.1
"""Distance of the knee below the flank, as a share of that from hock to flank, and behind the leg's front, as a share
of the leg's length from front to back."""


@dataclass(frozen=True, eq=False)
class _Leg:
    """A leg up to where it meets the belly.

    Attributes
    ----------
    backs, fronts : (k,) float64
        Its ends at each height, from the ground to the flank.
    heights : (k,) float64
    back : float
        Height of the body's back above it.
    foot : int
        Number of the height up to which it is a foot that may lie.
    line : (SAMPLE_COUNT, 3) float64
        Evenly spaced points in the middle of the leg, from the end of the foot to the flank.
    """

    backs: NDArray[np.float64]
    fronts: NDArray[np.float64]
    heights: NDArray[np.float64]
    back: float
    foot: int
    line: NDArray[np.float64]

    def top(self, share: float) -> NDArray[np.float64]:
        """Return hip or shoulder (3,): above the flank and the leg, at a share of the way to the back."""
        _, flank, front = self.line[-1]
        return np.array([np.median(self.line[:, 0]), flank + share * (self.back - flank), front])

    def hock(self) -> tuple[NDArray[np.float64], float]:
        """Return where the back of the leg sticks out most (3,), and the angle in degrees by which it bends there.

        The angle is that by which the leg leans further to the front above than below.
        """
        middles = (self.backs + self.fronts) / 2
        middle = (self.foot + len(self.backs)) // 2
        top = middle + int(np.argmax(self.backs[middle:]))  # above it the rump sticks out
        chord = np.linspace(self.backs[self.foot], self.backs[top], top - self.foot + 1)
        row = self.foot + int(np.argmax(chord - self.backs[self.foot : top + 1]))
        ends = [self.foot, row, len(middles) - 1]
        lean = np.degrees(np.arctan2(np.diff(middles[ends]), np.maximum(np.diff(self.heights[ends]), 1e-12)))
        left = np.interp(self.heights[row], self.line[:, 1], self.line[:, 0])
        place = self.backs[row] + HOCK_DEPTH * (self.fronts[row] - self.backs[row])
        bends = self.foot < row < len(middles) - 1
        return np.array([left, self.heights[row], place]), float(lean[1] - lean[0]) if bends else 0.0

    def ankle(self, hock: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the corner (3,) of the two straight bones from the end of the foot to the hock."""
        below = self.line[: max(int(np.argmax(self.line[:, 1] > hock[1])), 3)]
        points = evenly(np.concatenate([below, hock[None]]), SAMPLE_COUNT)
        return np.asarray(straight_bones(points, _places(1), (HOCK_ANKLE_SHARE,))[0][1])

    def stifle(self, hock: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the knee (3,) of a leg with a hock."""
        flank = self.line[-1]
        height = flank[1] - STIFLE_DROP * (flank[1] - hock[1])
        front, back = (np.interp(height, self.heights, ends) for ends in (self.fronts, self.backs))
        return np.array([flank[0], height, front - STIFLE_DEPTH * (front - back)])


def standing_legs(solid: Solid, legs: Sequence[LimbCurve], *, front: bool) -> list[NDArray[np.float64]] | None:
    """Return the joints of two legs under a body that lies.

    Parameters
    ----------
    solid : Solid
        Left, up and front.
    legs : 2 of LimbCurve
        From the end of the foot to the trunk.
    front : bool
        Whether they are front legs, and not hind legs or the only ones.

    Returns
    -------
    2 of (4 or 5, 3) float64, or None
        Hip, knee, hock if there is one, ankle and the end of the foot; None if the legs do not stand below the body, as
        those of a frog.
    """
    found = [leg for leg in (_leg(solid, curve) for curve in legs) if leg is not None]
    if len(found) < len(legs):
        return None
    hips = [leg.top(SHOULDER_SHARE if front else HIP_SHARE) for leg in found]
    hocks = [leg.hock() for leg in found]
    if not front and np.mean([bend for _, bend in hocks]) > HOCK_DEGREES:
        return [
            np.array([hip, leg.stifle(hock), hock, leg.ankle(hock), leg.line[0]])
            for hip, leg, (hock, _) in zip(hips, found, hocks, strict=True)
        ]
    # both legs have the same bones
    lines, usual = np.hstack([leg.line for leg in found]), (ANKLE_SHARE, ELBOW_SHARE if front else KNEE_SHARE)
    bones = np.hsplit(straight_bones(lines, _places(2), usual)[0], len(found))
    for hip, leg, joints in zip(hips, found, bones, strict=True):
        least = joints[1, 1] + MIN_SHIN_SHARE * (hip[1] - joints[0, 1])
        higher = leg.line[leg.line[:, 1] >= least]
        if len(higher) and joints[2, 1] < higher[0, 1]:
            joints[2] = higher[0]
    return [np.array([hip, *joints[2::-1]]) for hip, joints in zip(hips, bones, strict=True)]


def _places(count: int) -> list[tuple[int, ...]]:
    """Return where the joints below the flank may be, as numbers of the leg's points."""
    least = round(MIN_BONE_SHARE / count * SAMPLE_COUNT)
    inner = range(least, SAMPLE_COUNT - least)
    return [places for places in combinations(inner, count) if min(np.diff(places), default=least) >= least]


def _leg(solid: Solid, curve: LimbCurve) -> _Leg | None:
    """Return a leg up to the flank; None if it does not stand below the body."""
    low, size = solid.centers.min(axis=0), solid.size
    cells = np.rint((solid.centers - low) / size).astype(int)
    inside = np.zeros(cells.max(axis=0) + 1, dtype=bool)
    inside[tuple(cells.T)] = True
    backs, fronts, lefts = _sections(inside, curve, low, size)
    top = (curve.points[-1, 1] - low[1]) / size
    row = _flank((fronts - backs + 1).astype(np.float64), top)
    if row is None or np.ptp(lefts[: row + 1]) > MAX_SPRAWL * row:
        return None
    middles = low + size * np.column_stack([lefts, np.arange(len(lefts)), (fronts + backs) / 2])
    foot = round(FOOT_SHARE * top)
    under = curve.centers[: max(int(np.argmax(curve.centers[:, 1] > middles[foot, 1])), 1)]
    line = evenly(np.concatenate([under, middles[foot + 1 : row + 1]]), SAMPLE_COUNT)
    above = np.flatnonzero(~inside[lefts[row], row + 1 :, (fronts[row] + backs[row]) // 2])
    back = row + int(above[0]) if len(above) else inside.shape[1] - 1
    ends = [low[2] + size * edges[: row + 1] for edges in (backs, fronts)]
    return _Leg(ends[0], ends[1], middles[: row + 1, 1], float(low[1] + size * back), min(foot, row), line)


def _flank(lengths: NDArray[np.float64], top: float) -> int | None:
    """Return the last row of cells below the belly; None without one.

    Parameters
    ----------
    lengths : (k,) float64
        Length of a leg from front to back in each row from the ground, in cells.
    top : float
        Row in which the leg's curve ends.
    """
    start = round(MIN_FLANK_SHARE * top)
    long = lengths[start:] > MIN_BELLY_LENGTH * top
    belly = int(np.argmax(long))
    if not belly:
        return None
    # the last row before the leg becomes longer fast is farthest below the straight line to the belly
    line = np.linspace(lengths[start], lengths[start + belly], belly + 1)
    return start + int(np.argmax(line - lengths[start : start + belly + 1]))


def _sections(
    inside: NDArray[np.bool_], leg: LimbCurve, low: NDArray[np.float64], size: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return the back, the front and the position from left to right (k,) of a leg at each height, in cells.

    Parameters
    ----------
    inside : (a, b, c) bool
        Cells of the character.
    leg : LimbCurve
    low : (3,) float64
        Centre of the first cell.
    size : float
        Of a cell.
    """
    found = np.zeros((inside.shape[1], 3), dtype=np.int64)
    for row in range(len(found)):
        nearest = np.abs(leg.points[:, 1] - low[1] - size * row).argmin()
        left, _, way = np.rint((leg.points[nearest] - low) / size).astype(int)
        filled = np.flatnonzero(inside[left, row])
        parts = np.split(filled, np.flatnonzero(np.diff(filled) > 1) + 1) if len(filled) else []
        here = [part for part in parts if part[0] - 2 <= way <= part[-1] + 2]
        found[row] = *(here[0][[0, -1]] if here else (way, way)), left
    return found[:, 0], found[:, 1], found[:, 2]
