"""Where the limbs of a character are, found from its shape alone.

The space inside the character has a tree of curves, one curve a limb (`solver.anatomy.curve_skeleton`). Its ends are
named by where they are and how they hang together: feet stand on the ground in pairs, the head is the highest and
front-most of the middle, arms are a pair that branches off between legs and head. The joints lie on the curves
(`solver.anatomy.limb_curve`).
"""

from collections.abc import Mapping, Sequence
from functools import cached_property
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from solver.anatomy.hidden_limbs import hidden_arm, uncovered
from solver.anatomy.limb_chain import LimbChain, Limbs, evenly
from solver.anatomy.limb_curve import LimbCurve, arm_joints, curve_through, leg_joints, shoulder_ways
from solver.anatomy.limb_ends import LIKE, LOW, ONE_IMAGE, LimbEnds, Points
from solver.surface.mesh import SolverMesh

MIDDLE, BEHIND = 0.15, -0.15
"""How far aside a tail may end, and how far to the front."""

LEAST_ARM = -0.2
"""What is less like arms than this is none."""

SHOULDER_HEIGHT = 0.6
"""Where shoulders are that do not show: this share of the way from hips to crown."""

SHORTEST_ARM, LONGEST_ARM = 0.06, 0.35
"""An arm reaches at least this far out of the body; beyond the second length it is no better an arm."""

SHEET_REACH, SHEET = 5.0, 1.6
"""Within so many times its thickness, a sheet has more than this many times the room of a rod."""

MEET = 1.0
"""A branch ends where it is this near to the trunk's curve, as a share of its distance to the surface there."""

SHORTEST_WING = 0.25
"""A wing is at least this long."""

SYMMETRIC = 0.06
"""Limbs of left and right that mirror each other to this share of the height are made equal."""

DOUBT = 0.15
"""If another end is less like a head by no more than this, either may be the head."""

LEGS = 0.1
"""What leaves the trunk below this share of the way from hips to crown and ends low is no arm."""

SKULLS = 0.35, 0.2, 0.12
"""The head's thickest place is on this last share of the way from hips to crown; on a smaller one if the chest or neck
is at its beginning."""

BIG_HEAD = 0.55
"""If a two-legged body is thickest beyond this share of the way from hips to crown, that is its head and no chest."""

HEAD_WIDTH = 1.5
"""What is no farther from the trunk's curve than this many times the head's thickness belongs to the head."""

LONG_NECK = 0.3
"""A neck of at least this share of the trunk's length is a limb of its own."""

UPRIGHT = np.cos(np.radians(50))
"""Cosine between up and the way from trunk to head up to which the head stands on the trunk."""


def find_limbs(
    mesh: SolverMesh, basis: NDArray[np.float64], ends: Mapping[str, Points] = MappingProxyType({})
) -> Limbs:
    """Find a character's limbs.

    Parameters
    ----------
    mesh : SolverMesh
    basis : (3, 3) float64
        Rows are the mesh's directions of the character's left, up and front.
    ends : mapping of str to (3,) float64
        Where limbs end that the user knows, by their names; mesh file's coordinates.
    """
    finder = _Finder(mesh, basis, {name: basis @ np.asarray(end) for name, end in ends.items()})
    chains = tuple(LimbChain(name, points @ basis) for name, points in finder.limbs().items())
    return Limbs(chains, tuple(finder.notes))


class _Finder(LimbEnds):
    """Names what branches off the trunk, and places the joints."""

    def __init__(self, mesh: SolverMesh, basis: NDArray[np.float64], ends: Mapping[str, Points]) -> None:
        super().__init__(mesh, basis, ends)
        self.notes = list[str]()
        self.legs: dict[str, Points] = {}
        self.thighs: set[int] = set()
        for name, pair in zip(("hind leg", "front leg") if self.four_legged else ("leg",), self.feet, strict=False):
            fork = self.skeleton.fork(*pair)
            curves = [curve_through(self.solid, self.skeleton.between(foot, fork)) for foot in pair]
            points, parted = leg_joints(curves, self.solid.size, upright=name == "leg")
            self.legs |= self._sides(name, points)
            if name != "front leg":
                self.trunk = self._trunk(curves, parted)
            for curve in curves:
                self.thighs.update(curve.cells[curve.along < curve.length - parted].tolist())
        if not self.feet:
            self.trunk = curve_through(self.solid, self.skeleton.between(self.base(), self.head))

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
        """Where the head is thickest, an index into the trunk's curve: beyond the neck, if there is one."""
        thickest = int(self.trunk.depth.argmax())
        if not self.four_legged and self.trunk.along[thickest] > BIG_HEAD * self.trunk.length:
            return thickest
        for share in SKULLS:
            last = np.flatnonzero(self.trunk.along >= (1 - share) * self.trunk.length)
            thickest = int(self.trunk.depth[last].argmax())
            if thickest > 2:
                break
        return int(last[thickest])

    @property
    def _chin(self) -> float:
        """Where the head begins on the trunk's curve."""
        return float(self.trunk.along[self.skull] - 0.5 * self.trunk.depth[self.skull])

    def limbs(self) -> dict[str, Points]:
        """Return the points of each limb by its name."""
        found: dict[str, Points] = {}
        branches = self._branches()
        self._say_other_heads(branches)
        arms = None if self.four_legged else self._arms(branches)
        if arms is not None:
            found |= self._sides("arm", self._arm_points(arms))
        elif "left arm" in self.ends:
            found |= self._sides("arm", [self._hidden_arm(side) for side in ("left", "right")])
        found |= self.legs
        self._uncover_legs(found)
        used = list(arms or ())
        tail = self._tail([branch for branch in branches if branch not in used])
        if tail is not None:
            used.append(tail)
            found["tail"] = evenly(tail.points[::-1], 4)
        wings = self._wings([branch for branch in branches if branch not in used])
        if wings is not None:
            found |= self._sides("wing", [evenly(wing.points[::-1], 4) for wing in wings])
        self._say_what_is_missing(found)
        return self._trunk_and_head(found) | found

    def _say_other_heads(self, branches: Sequence[LimbCurve]) -> None:
        """Name ends that are nearly as much like a head as the one that was taken, and are no ears or horns of it."""
        for branch in branches:
            end = int(branch.cells[0])
            close = self.like_heads.get(end, -np.inf) > self.like_heads.get(self.head, np.inf) - DOUBT
            close &= bool(np.linalg.norm(self.cells[end] - self.cells[self.head]) > LOW * self.height)  # no jaw
            close &= self.twin(end, self.skeleton.tips.tolist()) is None
            if close and self._shoulder_place(branch) < self._chin:
                here, there = (self.text(self.cells[cell]) for cell in (self.head, end))
                self.notes.append(
                    f"The head could be at {here} or at {there}: the first was taken. "
                    f"If that is wrong: --limb 'head={there}'"
                )

    # what branches off the trunk ------------------------------------------------------------------------------------

    def _branches(self) -> list[LimbCurve]:
        """Return the curves of what branches off the trunk, one a limb, the longest first."""
        feet = [foot for pair in self.feet for foot in pair]
        near = cKDTree(self.trunk.points)
        found = []
        tips = [tip for tip in self.skeleton.tips.tolist() if not any(self.same_foot(tip, foot) for foot in feet)]
        for tip in [*self.ends.values(), *tips]:
            way = self.skeleton.between(tip, self.head)
            away, _ = near.query(self.cells[way])
            stop = int(np.argmax(away <= np.maximum(MEET * self.solid.depth[way], self.solid.size)))
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

    def _given(self, branches: Sequence[LimbCurve], limb: str) -> tuple[LimbCurve, LimbCurve] | None:
        """Return the pair whose ends the user has given."""
        by_end = {int(branch.cells[0]): branch for branch in branches}
        pair = [by_end.get(self.ends.get(f"{side} {limb}", -1)) for side in ("left", "right")]
        return (pair[0], pair[1]) if pair[0] is not None and pair[1] is not None else None

    def _hidden_arm(self, side: str) -> Points:
        """Return an arm that is one with the body."""
        root = self.trunk.at(SHOULDER_HEIGHT * self.trunk.length)
        sign = np.array([1.0 if side == "left" else -1.0, 0.0, 0.0])
        beside = (self.cells[np.abs(self.cells[:, 1] - root[1]) < self.solid.size] - root) @ sign
        return hidden_arm(root, max(float(beside.max()), 0.0) * sign, self.cells[self.ends[f"{side} arm"]])

    def _arms(self, branches: list[LimbCurve]) -> tuple[LimbCurve, LimbCurve] | None:
        """Return the pair of branches that is most like arms, the left one first."""
        if "left arm" in self.ends:
            given = self._given(branches, "arm")
            free = given is not None and all(self._is_free(branch) for branch in given)
            return given if free else None
        scores: dict[tuple[int, int], float] = {}
        shoulders = [self._shoulder_place(branch) for branch in branches]
        for i, one in enumerate(branches):
            for j, other in enumerate(branches[:i]):
                beside = (self._aside(one) - self.middle) * (self._aside(other) - self.middle) < 0
                if beside and all(self._below_head(branches[k], shoulders[k]) for k in (i, j)):
                    scores[i, j] = self._like_arms(one, other)
        best = max(scores, key=lambda pair: scores[pair], default=None)
        if best is None or scores[best] < LEAST_ARM:
            return None
        one, other = (branches[i] for i in best)
        return (one, other) if self._aside(one) > self._aside(other) else (other, one)

    def _is_free(self, branch: LimbCurve) -> bool:
        """Return whether a branch is most of the way from its end to the trunk: an arm that hangs into it is not."""
        away = np.linalg.norm(self.trunk.at(SHOULDER_HEIGHT * self.trunk.length) - branch.points[0])
        return bool(branch.length > 0.5 * away)

    def _below_head(self, branch: LimbCurve, shoulder: float) -> bool:
        """Return whether a branch with its shoulder there is no ear, horn or leg."""
        hangs = branch.points[0, 1] < branch.points[-1, 1]
        high = self.place(int(branch.cells[0]))[1] > LOW or shoulder > LEGS * self.trunk.length
        return bool(high and (shoulder < self._chin or hangs))

    def _like_arms(self, one: LimbCurve, other: LimbCurve) -> float:
        """Return how much two branches are like arms: long, equal, low, leaving at one height, not behind."""
        lengths = [branch.length / self.height for branch in (one, other)]
        leaves = [self._leaves_at(branch) for branch in (one, other)]
        ends = [self.cells[branch.cells[0]] for branch in (one, other)]
        behind = -np.mean([self.place(int(branch.cells[0]))[2] for branch in (one, other)])
        return float(
            min(*lengths, LONGEST_ARM)
            - SHORTEST_ARM
            - 0.3 * abs(lengths[0] - lengths[1]) / sum(lengths)
            - 0.5 * abs(leaves[0] - leaves[1])
            - 0.2 * max(leaves)
            - 0.25 * min(self.unlike(*ends), LIKE)
            - 0.2 * max(behind, 0.0)
        )

    def _shoulder_place(self, branch: LimbCurve) -> float:
        """Return where on the trunk's curve a branch would have its shoulder."""
        shoulder = branch.at(shoulder_ways(branch, self.trunk)[0])
        return float(self.trunk.along[np.linalg.norm(self.trunk.points - shoulder, axis=1).argmin()])

    def _aside(self, branch: LimbCurve) -> float:
        """Return how far left a branch is, its outer half that may cross the body left aside."""
        return float(branch.points[branch.along > 0.5 * branch.length, 0].mean())

    def _tail(self, branches: list[LimbCurve]) -> LimbCurve | None:
        """Return the longest rod in the middle behind."""
        if "tail" in self.ends:
            return next((branch for branch in branches if branch.cells[0] == self.ends["tail"]), None)
        behind = []
        for branch in branches:
            left, _, front = self.place(int(branch.cells[0]))
            if abs(left) < MIDDLE and front < BEHIND and self._leaves_at(branch) < 0.4 and not self._is_flat(branch):
                behind.append(branch)
        return max(behind, key=lambda branch: branch.length, default=None)

    def _is_flat(self, branch: LimbCurve) -> bool:
        """Return whether a branch is a sheet, such as a cape: there is much more around it than a rod has."""
        outer = branch.along < 0.5 * branch.length
        points, thickness = branch.points[outer], branch.depth[outer] + self.solid.size / 2
        reach = np.maximum(SHEET_REACH * thickness, SHEET_REACH * self.solid.size)
        around = self._tree.query_ball_point(points, reach, return_length=True)
        rod = 2 * np.pi * thickness**2 * reach
        return bool(np.median(around * self.solid.size**3 / rod) > SHEET)

    def _wings(self, branches: list[LimbCurve]) -> tuple[LimbCurve, LimbCurve] | None:
        """Return the longest pair that mirrors itself and branches off the trunk."""
        given = self._given(branches, "wing")
        if given is not None:
            return given
        pairs = []
        for i, one in enumerate(branches):
            for other in branches[:i]:
                shortest = min(one.length, other.length) / self.unit
                alike = self.unlike(self.cells[one.cells[0]], self.cells[other.cells[0]]) < LIKE / 2
                below = all(self._shoulder_place(branch) < self._chin for branch in (one, other))
                below = below and all(self.place(int(branch.cells[0]))[1] > LOW for branch in (one, other))
                if shortest > SHORTEST_WING and alike and below:
                    pairs.append((shortest, (one, other) if self._aside(one) > self._aside(other) else (other, one)))
        return max(pairs, key=lambda pair: pair[0], default=(0.0, None))[1]

    # joints ----------------------------------------------------------------------------------------------------------

    def _arm_points(self, arms: tuple[LimbCurve, LimbCurve]) -> list[Points]:
        shoulders = [shoulder_ways(arm, self.trunk) for arm in arms]
        around = [
            self.cells[self.skeleton.beyond(int(arm.cells[arm.index(shoulder)]))]
            for arm, (shoulder, _) in zip(arms, shoulders, strict=True)
        ]
        points, ends = arm_joints(arms, shoulders, around, self.solid.size)
        for arm, side, end in zip(arms, ("left", "right"), ends, strict=True):
            if end > 0 and f"{side} arm" not in self.ends:
                self.notes.append(
                    f"Something long and thin at the end of the {side} arm is not part of it. If it is, give the end "
                    f"of the arm: --limb '{side} arm={self.text(arm.points[0])}'"
                )
        return points

    def _sides(self, limb: str, pair: Sequence[Points]) -> dict[str, Points]:
        """Name a left and a right limb; limbs that nearly mirror each other are made equal."""
        left, right = pair
        offset = np.array([left[0, 0] + right[0, 0], 0.0, 0.0])
        apart = np.linalg.norm(left - (right * ONE_IMAGE + offset), axis=1)
        if apart.max() < SYMMETRIC * self.height:
            left = (left + right * ONE_IMAGE + offset) / 2
            right = left * ONE_IMAGE + offset
        elif apart[0] < SYMMETRIC * self.height:
            keep_left = _straightness(left) > _straightness(right)
            image = (left if keep_left else right) * ONE_IMAGE + offset
            if self._inside(image):  # whatever hides the other limb, such as a shield, hides this as well
                left, right = (left, image) if keep_left else (image, right)
        return {f"left {limb}": left, f"right {limb}": right}

    def _inside(self, points: Points) -> bool:
        """Return whether bones run inside the body."""
        away, _ = self._tree.query(evenly(points, 30))
        return bool(np.quantile(away, 0.9) < self.solid.size)

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.cells)

    def _uncover_legs(self, found: dict[str, Points]) -> None:
        """Lengthen legs that a skirt hides."""
        if not {"left leg", "left arm"} <= found.keys():
            return
        legs, arms = ([found[f"{side} {limb}"] for side in ("left", "right")] for limb in ("leg", "arm"))
        middle, ground = float(self.trunk.points[0, 0]), float(self.low[1])
        (found["left leg"], found["right leg"]), hidden = uncovered(legs, arms, middle, ground, self.height)
        if hidden:
            self.notes.append(
                "The legs are hidden, as by a skirt: hips and knees are where people of this height have them. If "
                "that is wrong, change the points of the legs in the puppet file."
            )

    def _trunk_and_head(self, found: dict[str, Points]) -> dict[str, Points]:
        trunk = self.trunk
        near = cKDTree(trunk.points)
        legs, arms = ("hind leg", "front leg") if self.four_legged else ("leg", "arm")
        low, high = trunk.points[0], trunk.at(SHOULDER_HEIGHT * trunk.length)
        if f"left {legs}" in found:
            low = (found[f"left {legs}"][0] + found[f"right {legs}"][0]) / 2
        if f"left {arms}" in found:
            high = (found[f"left {arms}"][0] + found[f"right {arms}"][0]) / 2
        place = int(near.query(high)[1])
        start = int(near.query(low)[1])
        high = trunk.points[place]
        result = {"trunk": np.array([low, trunk.points[(start + place) // 2], high])}
        crown = trunk.points[-1]
        skull = trunk.points[self.skull]
        stands = skull - high
        if not self.four_legged and stands[1] > UPRIGHT * np.linalg.norm(stands) > 0:
            crown = self._crown(high)
        elif self.skull > place:
            neck = trunk.along[self.skull] - trunk.depth[self.skull] - trunk.along[place]
            if neck > LONG_NECK * (trunk.along[place] - trunk.along[start]):
                way = trunk.points[place : trunk.index(trunk.along[place] + neck) + 1]
                return result | {"neck": evenly(way, 3), "head": np.array([way[-1], crown])}
        return result | {"head": np.array([high, crown])}

    def _crown(self, neck: Points) -> Points:
        """Return the end of a head that stands on a neck, straight above its middle: a cap's brim does not count."""
        away, place = cKDTree(self.trunk.points).query(self.cells)
        near = away < HEAD_WIDTH * self.trunk.depth[self.skull]
        head = self.cells[near & (self.trunk.along[place] > self._chin)]
        middle = head.mean(axis=0)
        way = (middle - neck) / np.linalg.norm(middle - neck)
        return np.asarray(neck + way * np.quantile((head - neck) @ way, 0.95))

    def _say_what_is_missing(self, found: dict[str, Points]) -> None:
        if not self.feet:
            self.notes.append(
                "No legs were found. If there are any, give where they end: "
                "--limb 'left leg=X,Y,Z' --limb 'right leg=X,Y,Z'"
            )
        if not self.four_legged and "left arm" not in found and "left wing" not in found:
            self.notes.append(
                "No arms were found. If there are any, give where they end: "
                "--limb 'left arm=X,Y,Z' --limb 'right arm=X,Y,Z'"
            )


def _straightness(points: Points) -> float:
    """Return the distance between the ends of a chain as a share of its length."""
    return float(np.linalg.norm(points[-1] - points[0]) / np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
