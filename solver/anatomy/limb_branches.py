"""The limbs of a character as branches of its trunk: legs, arms, wings and tail."""

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from solver.anatomy.folded_legs import folded_leg, sprawling_leg
from solver.anatomy.limb_chain import evenly, leg_names
from solver.anatomy.limb_curve import LimbCurve, curve_through, leg_joints, shoulder_ways
from solver.anatomy.limb_ends import MAX_FOOT_HEIGHT, MAX_MIRROR_DISTANCE, MIRROR, Feet, LimbEnds, Points
from solver.anatomy.standing_legs import standing_legs
from solver.surface.mesh import SolverMesh

MAX_TAIL_OFFSET, MAX_TAIL_FRONT = 0.2, -0.15
"""Distance of a tail's end from the middle plane up to which the tail may lead to a side as much as to the back, and
the maximum position of its end towards the front, in units."""

MAX_SINGLE_OFFSET = 0.03
"""Maximum distance from the middle of a single leg, or of a fin, that is on neither side, in units."""

MIN_ARM_SCORE = -0.2
"""Minimum score of a pair of arms."""

SHOULDER_SHARE = 0.6
"""Position of shoulders that are not visible, as a share of the distance from hips to crown."""

MIN_ARM_LENGTH, FULL_ARM_LENGTH = 0.06, 0.35
"""Minimum length of an arm outside the body, and the length above which its score does not increase, in heights."""

MIN_GHOST_ARM = 0.15
"""Minimum length of the arms of a body without feet, in heights; the teeth of a snake are shorter. Such arms mirror
each other; the fins on the back and the tail of a fish do not."""

SHEET_REACH_RATIO, MIN_SHEET_RATIO = 5.0, 1.6
"""Radius in which a branch is compared with a rod, in thicknesses of the branch, and the minimum ratio of the volumes
of a sheet, such as a cape, and that rod."""

MEETING_RATIO = 1.0
"""Distance to the trunk's curve at which a branch ends, as a share of the branch's distance to the surface."""

MIN_WING_LENGTH = 0.25
"""Minimum length of a wing, in units."""

MAX_ASYMMETRY = 0.06
"""Maximum distance between a limb and the mirror image of its counterpart at which the two are made equal, in
heights."""

MAX_LEG_SHARE = 0.1
"""A branch that leaves the trunk below this share of the distance from hips to crown, and ends low, is not an arm."""

SKULL_SPANS = 0.35, 0.2, 0.12
"""The last shares of the distance from hips to crown in which the thickest place of the head is looked for. A smaller
one is used if the chest or neck is at the beginning of the larger one."""

MIN_BIG_HEAD_SHARE = 0.55
"""If a two-legged body is thickest beyond this share of the distance from hips to crown, its thickest part is the head
and not the chest."""


MAX_BIG_HEADS_NECK = 0.7, 0.88
"""If the trunk only narrows beyond its thickest place, that is the head if the trunk is somewhere below it thinner than
the first share of it, and than the second share of what is farther below: a neck, and not a waist or the space between
the hips."""


class LimbBranches(LimbEnds):
    """A character with its legs, its trunk, and what branches off the trunk.

    Parameters
    ----------
    mesh, basis, ends
        See `LimbEnds`.

    Attributes
    ----------
    leg_names : tuple of str
        Names of the pairs of legs without the side, from hind to front.
    legs : dict
        Points of the legs by name.
    legs_are_folded : bool
        Whether a leg of a two-legged character is folded at the knee.
    sprawls : bool
        Whether the legs of a body that lies do not stand below it.
    thighs : set of int
        Cells of the legs outside the trunk.
    trunk : LimbCurve
        From between the hips to the end of the head.
    """

    def __init__(self, mesh: SolverMesh, basis: NDArray[np.float64], ends: Mapping[str, Points]) -> None:
        super().__init__(mesh, basis, ends)
        self.legs: dict[str, Points] = {}
        self.legs_are_folded = self.sprawls = False
        self.thighs: set[int] = set()
        self.leg_names = leg_names(len(self.feet))
        for name, row in zip(self.leg_names, self.feet, strict=True):
            curves, parted = self._single(name, row[0]) if len(row) == 1 else self._pair(name, row)
            if row == self.feet[0]:
                self.trunk = self._trunk(curves, parted)
            for curve in curves:
                self.thighs.update(curve.cells[curve.along < curve.length - parted].tolist())
        if not self.feet:
            self.trunk = curve_through(self.solid, self.skeleton.between(self.base(), self.head))

    def _pair(self, name: str, feet: Feet) -> tuple[list[LimbCurve], float]:
        """Add two legs; return their curves, and the distance of the hips from the ends of these."""
        fork = self.skeleton.fork(*feet)
        curves = [curve_through(self.solid, self.skeleton.between(foot, fork)) for foot in feet]
        points, parted = leg_joints(curves, self.solid.size, upright=name == "leg")
        if self.lies and len(self.feet) < 3:
            standing = None if self.sprawls else standing_legs(self.solid, curves, front=name == "front leg")
            self.sprawls = standing is None
            points = standing or [sprawling_leg(self.skeleton, curve) for curve in curves]
        elif name == "leg":
            folded = [folded_leg(self.skeleton, curve, curve.length - parted) for curve in curves]
            points = [leg if other is None else other for leg, other in zip(points, folded, strict=True)]
            self.legs_are_folded = any(leg is not None for leg in folded)
        self.legs |= self.sides(name, points)
        return curves, parted

    def _single(self, name: str, foot: int) -> tuple[list[LimbCurve], float]:
        """Add a leg without a counterpart; return its curve, and the distance of the hip from the end of that."""
        others = [row[0] for row in self.feet if foot not in row]
        fork = self.skeleton.fork(foot, others[0] if others else self.head)
        curve = curve_through(self.solid, self.skeleton.between(foot, fork))
        standing = standing_legs(self.solid, [curve], front=name == "front leg") if self.lies else None
        points = standing[0] if standing else sprawling_leg(self.skeleton, curve)
        aside = (points[0, 0] - self.middle) / self.unit
        side = "" if abs(aside) < MAX_SINGLE_OFFSET else "left " if aside > 0 else "right "
        self.legs[f"{side}{name}"] = points
        return [curve], curve.length - curve.way_to(points[0])

    def _trunk(self, legs: Sequence[LimbCurve], parted: float) -> LimbCurve:
        """Return the curve from between the hips to the end of the head.

        Where the curves of the legs run side by side through the trunk, it is in their middle.
        """
        ways = np.arange(parted, 0.0, -self.solid.size)
        middle = np.mean([[leg.at(leg.length - way) for way in ways] for leg in legs], axis=0).reshape(-1, 3)
        depth = np.mean([np.interp(leg.length - ways, leg.along, leg.depth) for leg in legs], axis=0)
        above = curve_through(self.solid, self.skeleton.between(int(legs[0].cells[-1]), self.head))
        points, centers = (np.concatenate([middle, each]) for each in (above.points, above.centers))
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        cells = np.concatenate([np.full(len(ways), legs[0].cells[-1]), above.cells])
        return LimbCurve(cells, centers, points, np.concatenate([depth, above.depth]), along)

    @cached_property
    def skull(self) -> int:
        """Index into the trunk's curve of the thickest place of the head: beyond the neck, if there is one."""
        thickest = int(self.trunk.depth.argmax())
        if not self.four_legged and self._is_big_head(thickest):
            return thickest
        for share in SKULL_SPANS:
            last = np.flatnonzero(self.trunk.along >= (1 - share) * self.trunk.length)
            thickest = int(self.trunk.depth[last].argmax())
            if thickest > 2:
                break
        return int(last[thickest])

    def _is_big_head(self, thickest: int) -> bool:
        """Return whether the thickest place of the trunk of a body on two legs is its head, by its index."""
        if self.trunk.along[thickest] > MIN_BIG_HEAD_SHARE * self.trunk.length:
            return True
        depth, (of_head, of_body) = self.trunk.depth, MAX_BIG_HEADS_NECK
        below, beyond = depth[: thickest + 1], depth[thickest:]
        neck = (below < of_head * depth[thickest]) & (below < of_body * np.maximum.accumulate(below))
        narrows = beyond <= np.minimum.accumulate(beyond) + self.solid.size
        return bool(neck.any() and narrows.all())

    @property
    def chin(self) -> float:
        """Distance along the trunk's curve at which the head begins."""
        return float(self.trunk.along[self.skull] - 0.5 * self.trunk.depth[self.skull])

    def branches(self) -> list[LimbCurve]:
        """Return the curves that branch off the trunk, one per limb, the longest first."""
        feet = [foot for pair in self.feet for foot in pair]
        near = cKDTree(self.trunk.points)
        found = []
        tips = [tip for tip in self.skeleton.tips.tolist() if not any(self.same_foot(tip, foot) for foot in feet)]
        for tip in [*self.ends.values(), *tips]:
            way = self.skeleton.between(tip, self.head)
            away, _ = near.query(self.cells[way])
            stop = int(np.argmax(away <= np.maximum(MEETING_RATIO * self.solid.depth[way], self.solid.size)))
            if stop > 2 and not self.thighs & set(way[:stop]):
                found.append(curve_through(self.solid, way[: stop + 1]))
        given = set(self.ends.values())
        found.sort(key=lambda branch: (int(branch.cells[0]) not in given, -branch.length))
        kept: list[LimbCurve] = []
        for branch in found:
            outside = branch.cells[branch.along < branch.length - 0.5 * branch.depth[-1]]
            if len(outside) and not any(np.isin(outside, other.cells).any() for other in kept):
                kept.append(branch)
        return kept

    def _leaves_at(self, branch: LimbCurve) -> float:
        """Return where a branch leaves the trunk, from 0 at the hips to 1 at the end of the head."""
        place = np.linalg.norm(self.trunk.points - branch.points[-1], axis=1).argmin()
        return float(self.trunk.along[place] / self.trunk.length)

    def arms(self, branches: list[LimbCurve]) -> tuple[LimbCurve, LimbCurve] | None:
        """Return the pair of branches with the highest arm score, the left one first."""
        if "left arm" in self.ends:
            given = self._given(branches, "arm")
            free = given is not None and all(self._is_free(branch) for branch in given)
            return given if free else None
        scores: dict[tuple[int, int], float] = {}
        shoulders = [self.shoulder_place(branch) for branch in branches]
        for i, one in enumerate(branches):
            for j, other in enumerate(branches[:i]):
                beside = (self._aside(one) - self.middle) * (self._aside(other) - self.middle) < 0
                long = self.feet or (
                    min(one.length, other.length) > MIN_GHOST_ARM * self.height
                    and self.mirror_distance(self.cells[one.cells[0]], self.cells[other.cells[0]])
                    < MAX_MIRROR_DISTANCE / 2
                )
                if beside and long and all(self._below_head(branches[k], shoulders[k]) for k in (i, j)):
                    scores[i, j] = self._arm_score(one, other)
        best = max(scores, key=lambda pair: scores[pair], default=None)
        if best is None or scores[best] < MIN_ARM_SCORE:
            return None
        one, other = (branches[i] for i in best)
        return (one, other) if self._aside(one) > self._aside(other) else (other, one)

    def _given(self, branches: Sequence[LimbCurve], limb: str) -> tuple[LimbCurve, LimbCurve] | None:
        """Return the pair of branches whose ends the user has given."""
        by_end = {int(branch.cells[0]): branch for branch in branches}
        pair = [by_end.get(self.ends.get(f"{side} {limb}", -1)) for side in ("left", "right")]
        return (pair[0], pair[1]) if pair[0] is not None and pair[1] is not None else None

    def _is_free(self, branch: LimbCurve) -> bool:
        """Return whether a branch is outside the trunk for the most part; an arm that hangs into it is not."""
        away = np.linalg.norm(self.trunk.at(SHOULDER_SHARE * self.trunk.length) - branch.points[0])
        return bool(branch.length > 0.5 * away)

    def _below_head(self, branch: LimbCurve, shoulder: float) -> bool:
        """Return whether a branch with its shoulder there is neither an ear, a horn nor a leg."""
        hangs = branch.points[0, 1] < branch.points[-1, 1]
        high = self.place(int(branch.cells[0]))[1] > MAX_FOOT_HEIGHT or shoulder > MAX_LEG_SHARE * self.trunk.length
        return bool(high and (shoulder < self.chin or hangs))

    def _arm_score(self, one: LimbCurve, other: LimbCurve) -> float:
        """Return the arm score of two branches: long, equal, low, leaving at one height, and not behind."""
        lengths = [branch.length / self.height for branch in (one, other)]
        leaves = [self._leaves_at(branch) for branch in (one, other)]
        ends = [self.cells[branch.cells[0]] for branch in (one, other)]
        behind = -np.mean([self.place(int(branch.cells[0]))[2] for branch in (one, other)])
        return float(
            min(*lengths, FULL_ARM_LENGTH)
            - MIN_ARM_LENGTH
            - 0.3 * abs(lengths[0] - lengths[1]) / sum(lengths)
            - 0.5 * abs(leaves[0] - leaves[1])
            - 0.2 * max(leaves)
            - 0.25 * min(self.mirror_distance(*ends), MAX_MIRROR_DISTANCE)
            - 0.2 * max(behind, 0.0)
        )

    def shoulder_place(self, branch: LimbCurve) -> float:
        """Return the distance along the trunk's curve at which a branch would have its shoulder."""
        shoulder = branch.at(shoulder_ways(branch, self.trunk)[0])
        return float(self.trunk.along[np.linalg.norm(self.trunk.points - shoulder, axis=1).argmin()])

    def _aside(self, branch: LimbCurve) -> float:
        """Return how far left a branch is, without its outer half, which may cross the body."""
        return float(branch.points[branch.along > 0.5 * branch.length, 0].mean())

    def tail(self, branches: list[LimbCurve]) -> LimbCurve | None:
        """Return the longest branch that is in the middle, at the back, and not a sheet."""
        if self.crawls:
            return curve_through(self.solid, self.skeleton.between(self.rear, int(self.trunk.cells[0])))
        if "tail" in self.ends:
            return next((branch for branch in branches if branch.cells[0] == self.ends["tail"]), None)
        behind = []
        for branch in branches:
            left, _, front = self.place(int(branch.cells[0]))
            back = (branch.points[-1, 2] - branch.points[0, 2]) / self.unit
            if (
                abs(left) < max(MAX_TAIL_OFFSET, back)
                and front < MAX_TAIL_FRONT
                and self._leaves_at(branch) < 0.4
                and (self.lies or not self._is_flat(branch))
            ):
                behind.append(branch)
        return max(behind, key=lambda branch: branch.length, default=None)

    def _is_flat(self, branch: LimbCurve) -> bool:
        """Return whether a branch is a sheet, such as a cape: its volume is larger than that of a rod as thick.

        Only the cells that it leads to count, and not those of a leg beside it.
        """
        outer = branch.along < 0.5 * branch.length
        points, thickness = branch.points[outer], branch.depth + self.solid.size / 2
        reach = np.maximum(SHEET_REACH_RATIO * thickness[outer], SHEET_REACH_RATIO * self.solid.size)
        root = int(branch.cells[branch.along <= max(branch.length - branch.depth[-1], 0.0)][-1])
        own = cKDTree(self.cells[self.skeleton.beyond(root)])
        around = own.query_ball_point(points, reach, return_length=True)
        near = np.linalg.norm(points[:, None] - branch.points, axis=2) < reach[:, None]
        rod = near @ (np.pi * thickness**2 * np.gradient(branch.along))
        return bool(np.median(around * self.solid.size**3 / rod) > MIN_SHEET_RATIO)

    def wings(self, branches: list[LimbCurve]) -> tuple[LimbCurve, LimbCurve] | None:
        """Return the longest pair of branches that mirror each other."""
        given = self._given(branches, "wing")
        if given is not None:
            return given
        pairs = []
        for i, one in enumerate(branches):
            for other in branches[:i]:
                shortest = min(one.length, other.length) / self.unit
                alike = (
                    self.mirror_distance(self.cells[one.cells[0]], self.cells[other.cells[0]]) < MAX_MIRROR_DISTANCE / 2
                )
                below = all(self.shoulder_place(branch) < self._wings_end for branch in (one, other))
                places = [self.place(int(branch.cells[0])) for branch in (one, other)]
                below &= all(abs(left) > MAX_SINGLE_OFFSET and up > MAX_FOOT_HEIGHT for left, up, _ in places)
                if shortest > MIN_WING_LENGTH and alike and below:
                    pairs.append((shortest, (one, other) if self._aside(one) > self._aside(other) else (other, one)))
        return max(pairs, key=lambda pair: pair[0], default=(0.0, None))[1]

    @cached_property
    def _wings_end(self) -> float:
        """Distance along the trunk's curve before which wings begin: the head, or the neck on four legs."""
        if not self.four_legged:
            return float(self.trunk.along[self.skull] - self.trunk.depth[self.skull])
        roots = [leg[0] for name, leg in self.legs.items() if name.endswith(self.leg_names[-1])]
        shoulders = np.linalg.norm(self.trunk.points - np.mean(roots, axis=0), axis=1).argmin()
        return float((self.trunk.along[shoulders] + self.chin) / 2)

    def sides(self, limb: str, pair: Sequence[Points]) -> dict[str, Points]:
        """Return a left and a right limb by name; limbs that nearly mirror each other are made equal."""
        left, right = pair
        offset = np.array([left[0, 0] + right[0, 0], 0.0, 0.0])
        apart = np.linalg.norm(left - (right * MIRROR + offset), axis=1)
        if apart.max() < MAX_ASYMMETRY * self.height:
            left = (left + right * MIRROR + offset) / 2
            right = left * MIRROR + offset
        elif apart[0] < MAX_ASYMMETRY * self.height:
            keep_left = _straightness(left) > _straightness(right)
            image = (left if keep_left else right) * MIRROR + offset
            if self._inside(image):  # an object such as a shield hides the other limb
                left, right = (left, image) if keep_left else (image, right)
        return {f"left {limb}": left, f"right {limb}": right}

    def _inside(self, points: Points) -> bool:
        """Return whether bones are inside the body."""
        away, _ = self._tree.query(evenly(points, 30))
        return bool(np.quantile(away, 0.9) < self.solid.size)

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.cells)


def _straightness(points: Points) -> float:
    """Return the distance between the ends of a chain as a share of its length."""
    return float(np.linalg.norm(points[-1] - points[0]) / np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
