"""Finds the limbs of a character from its shape alone.

A tree of curves runs through the inside of the character, one curve per limb (`solver.anatomy.curve_skeleton`). Its
ends are named by their positions and by where they branch off: feet are pairs on the ground, the head is an end near
the middle that is high, in front and thick, and arms are a pair that branches off between legs and head. The joints are
on the curves (`solver.anatomy.limb_curve`).
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from solver.anatomy.hidden_limbs import hidden_arm, lengthened
from solver.anatomy.limb_branches import SHOULDER_SHARE, LimbBranches
from solver.anatomy.limb_chain import LimbChain, Limbs, evenly
from solver.anatomy.limb_curve import LimbCurve, arm_joints, shoulder_ways
from solver.anatomy.limb_ends import MAX_FOOT_HEIGHT, MAX_NECK_RATIO, Points
from solver.surface.mesh import SolverMesh

HEAD_DOUBT_MARGIN = 0.15
"""Difference of head scores below which it is uncertain which of two ends is the head."""

HEAD_WIDTH_RATIO = 1.5
"""Maximum distance of the head's cells from the trunk's curve, in thicknesses of the head."""

MIN_NECK_SHARE = 0.3
"""Minimum length of a neck that is a limb, as a share of the trunk's length."""

MAX_END_HEIGHT, MIN_END_DISTANCE = 0.03, 0.15
"""Height above the ground, and distance from all limbs, of an end that stands there without a leg, in heights."""

MAX_EDGE_DISTANCE = 0.07
"""Mean distance between an arm and a wing below which they are one limb, as a share of the unit."""

UPRIGHT_COSINE = np.cos(np.radians(50))
"""Minimum cosine between up and the direction from trunk to head at which the head is upright on the trunk."""


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
        Ends of limbs that the user has given, by name; mesh file's coordinates.
    """
    finder = _Finder(mesh, basis, {name: basis @ np.asarray(end) for name, end in ends.items()})
    chains = tuple(LimbChain(name, points @ basis) for name, points in finder.limbs().items())
    return Limbs(chains, tuple(finder.notes))


class _Finder(LimbBranches):
    """Names the limbs and places their joints; collects notes on what is unclear."""

    def __init__(self, mesh: SolverMesh, basis: NDArray[np.float64], ends: Mapping[str, Points]) -> None:
        super().__init__(mesh, basis, ends)
        self.notes = list[str]()

    def limbs(self) -> dict[str, Points]:
        """Return the points of each limb by its name."""
        found: dict[str, Points] = {}
        branches = self.branches()
        self._note_other_heads(branches)
        arms = None if self.four_legged else self.arms(branches)
        if arms is not None:
            found |= self.sides("arm", self._arm_points(arms))
        elif "left arm" in self.ends:
            found |= self.sides("arm", [self._hidden_arm(side) for side in ("left", "right")])
        found |= self.legs
        self._lengthen_hidden_legs(found)
        used = list(arms or ())
        tail = self.tail([branch for branch in branches if branch not in used])
        if tail is not None:
            used.append(tail)
            found["tail"] = evenly(tail.points[::-1], 4)
        wings = self.wings([branch for branch in branches if branch not in used])
        if wings is not None:
            pair = self.sides("wing", [evenly(wing.points[::-1], 4) for wing in wings])
            if np.linalg.norm(pair["left wing"][1] - pair["right wing"][1]) > self.solid.size:  # no rider's legs
                found |= pair
        found = self._without_edges(found)
        self._note_missing_limbs(found)
        found = self._trunk_and_head(found) | found
        self._note_other_feet(found)
        return found | self._given_on_head()

    def _without_edges(self, found: dict[str, Points]) -> dict[str, Points]:
        """Return limbs without arms along wings, or wings along arms: the shorter ones are edges of the others."""
        if not {"left arm", "right arm", "left wing", "right wing"} <= found.keys() or "left arm" in self.ends:
            return found
        lengths = {
            limb: np.linalg.norm(np.diff(found[f"left {limb}"], axis=0), axis=1).sum() for limb in ("arm", "wing")
        }
        edge, limb = sorted(lengths, key=lambda name: lengths[name])
        away = [
            np.mean(cKDTree(evenly(found[f"{side} {limb}"], 40)).query(evenly(found[f"{side} {edge}"], 20))[0])
            for side in ("left", "right")
        ]
        if max(away) > MAX_EDGE_DISTANCE * self.unit:
            return found
        return {name: points for name, points in found.items() if not name.endswith(edge)}

    def _given_on_head(self) -> dict[str, Points]:
        """Return ears and a jaw whose ends the user has given, straight from the middle of the head.

        By its shape, an ear is not to be told from a horn, nor a jaw that is closed from the head.
        """
        skull, limbs = self.trunk.points[self.skull], dict[str, Points]()
        for name in [name for name in ("left ear", "right ear", "jaw") if name in self.ends]:
            way = self.cells[self.ends[name]] - skull
            inside = self.trunk.depth[self.skull] / np.linalg.norm(way) if name != "jaw" else 0.0
            limbs[name] = evenly(skull + way * [[min(inside, 0.5)], [1.0]], 2 if name == "jaw" else 3)
        return limbs

    def _note_other_heads(self, branches: Sequence[LimbCurve]) -> None:
        """Note ends whose head scores are close to that of the head, and that are not its ears or horns."""
        for branch in branches:
            end = int(branch.cells[0])
            close = self.head_scores.get(end, -np.inf) > self.head_scores.get(self.head, np.inf) - HEAD_DOUBT_MARGIN
            close &= bool(
                np.linalg.norm(self.cells[end] - self.cells[self.head]) > MAX_FOOT_HEIGHT * self.height
            )  # no jaw
            close &= self.twin(end, self.skeleton.tips.tolist()) is None
            if close and self.shoulder_place(branch) < self.chin:
                here, there = (self.option_value(self.cells[cell]) for cell in (self.head, end))
                self.notes.append(
                    f"The head could be at {here} or at {there}: the first was taken. "
                    f"If that is wrong: --limb 'head={there}'"
                )

    def _hidden_arm(self, side: str) -> Points:
        """Return an arm that is not separate from the body."""
        root = self.trunk.at(SHOULDER_SHARE * self.trunk.length)
        sign = np.array([1.0 if side == "left" else -1.0, 0.0, 0.0])
        beside = (self.cells[np.abs(self.cells[:, 1] - root[1]) < self.solid.size] - root) @ sign
        return hidden_arm(root, max(float(beside.max()), 0.0) * sign, self.cells[self.ends[f"{side} arm"]])

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
                    f"of the arm: --limb '{side} arm={self.option_value(arm.points[0])}'"
                )
        return points

    def _lengthen_hidden_legs(self, found: dict[str, Points]) -> None:
        """Lengthen legs that a skirt hides."""
        if self.legs_are_folded or not {"left leg", "right leg", "left arm", "right arm"} <= found.keys():
            return
        legs, arms = ([found[f"{side} {limb}"] for side in ("left", "right")] for limb in ("leg", "arm"))
        middle, ground = float(self.trunk.points[0, 0]), float(self.low[1])
        (found["left leg"], found["right leg"]), hidden = lengthened(legs, arms, middle, ground, self.height)
        if hidden:
            self.notes.append(
                "The legs are hidden, as by a skirt: hips and knees are where people of this height have them. If "
                "that is wrong, change the points of the legs in the puppet file."
            )

    def _trunk_and_head(self, found: dict[str, Points]) -> dict[str, Points]:
        trunk = self.trunk
        near = cKDTree(trunk.points)
        legs, arms = (self.leg_names[0], self.leg_names[-1]) if self.four_legged else ("leg", "arm")
        low, high = trunk.points[0], trunk.at(SHOULDER_SHARE * trunk.length)
        hips, shoulders = (
            [found[name][0] for name in (f"left {limb}", f"right {limb}", limb) if name in found]
            for limb in (legs, arms)
        )
        low, high = (np.mean(roots, axis=0) if roots else end for roots, end in ((hips, low), (shoulders, high)))
        place = self._narrow_neck(int(near.query(high)[1]))
        start = int(near.query(low)[1])
        high = trunk.points[place]
        result = {"trunk": np.array([low, trunk.points[(start + place) // 2], high])}
        crown = trunk.points[-1]
        skull = trunk.points[self.skull]
        stands = skull - high
        if not self.four_legged and stands[1] > UPRIGHT_COSINE * np.linalg.norm(stands) > 0:
            crown = self._crown(high)
        elif self.skull > place:
            neck = trunk.along[self.skull] - trunk.depth[self.skull] - trunk.along[place]
            if neck > MIN_NECK_SHARE * (trunk.along[place] - trunk.along[start]):
                way = trunk.points[place : trunk.index(trunk.along[place] + neck) + 1]
                return result | {"neck": evenly(way, 3), "head": np.array([way[-1], crown])}
        return result | {"head": np.array([high, crown])}

    def _narrow_neck(self, shoulders: int) -> int:
        """Return the index of the neck on the curve of an upright trunk, or that of the shoulders if none is narrow."""
        depth = self.trunk.depth
        if self.four_legged or self.skull <= shoulders:
            return shoulders
        neck = shoulders + int(depth[shoulders : self.skull + 1].argmin())
        narrow = depth[neck] < MAX_NECK_RATIO * min(depth[self.skull], depth[: neck + 1].max())
        return neck if narrow else shoulders

    def _crown(self, neck: Points) -> Points:
        """Return the top of a head that is upright on a neck: above its middle, whatever the brim of a cap adds."""
        away, place = cKDTree(self.trunk.points).query(self.cells)
        near = away < HEAD_WIDTH_RATIO * self.trunk.depth[self.skull]
        head = self.cells[near & (self.trunk.along[place] > self.chin)]
        middle = head.mean(axis=0)
        way = (middle - neck) / np.linalg.norm(middle - neck)
        return np.asarray(neck + way * np.quantile((head - neck) @ way, 0.95))

    def _note_missing_limbs(self, found: dict[str, Points]) -> None:
        no_arms = not self.four_legged and "left arm" not in found and "left wing" not in found
        for limb in ["leg"] * (not self.feet) + ["arm"] * no_arms:
            self.notes.append(
                f"No {limb}s were found. If there are any, give where they end: "
                f"--limb 'left {limb}=X,Y,Z' --limb 'right {limb}=X,Y,Z'"
            )

    def _note_other_feet(self, found: dict[str, Points]) -> None:
        """Note what stands on the ground besides the legs, such as a third leg: legs are found in pairs."""
        if not self.feet:
            return
        limbs = cKDTree(np.concatenate([evenly(points, 9) for points in found.values()]))
        tips = self.cells[self.skeleton.tips]
        low = tips[:, 1] - self.low[1] < MAX_END_HEIGHT * self.height + self.solid.size
        others = tips[low & (limbs.query(tips)[0] > MIN_END_DISTANCE * self.height)]
        if len(others):
            places = " and at ".join(self.option_value(place) for place in others)
            self.notes.append(
                f"Something else reaches the floor at {places}. Legs are found in pairs, so it moves with the body "
                "above it and takes no steps."
            )
