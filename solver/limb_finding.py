"""Where the limbs of a character are, found from its shape alone.

The space inside the character has a tree of curves, one curve a limb (`solver.curve_skeleton`). Its ends are named by
where they are and how they hang together: feet stand on the ground in pairs, the head is the highest and front-most
of the middle, arms are a pair that branches off between legs and head. Joints lie on the curves: where a limb leaves
the body, where it bends or is narrow, and by the proportions of bodies where it is straight.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from solver.curve_skeleton import CurveSkeleton, curve_skeleton
from solver.limb_chain import LimbChain, Limbs, evenly
from solver.mesh import SolverMesh
from solver.solid import fill

LOW = 0.2
"""Ends of legs are below this share of the height."""

TOES = 0.15
"""Ways from two ends that meet below this share of the height are toes of one foot."""

STRIDE = 0.25
"""Feet this far behind others, as a share of the larger of width and length, are hind feet."""

SYMMETRIC = 0.06
"""Limbs of left and right that mirror each other to this share of the height are made equal."""

UPPER_ARM, THIGH = 0.48, 0.51
"""Share of the way from shoulder to wrist that is upper arm, from hip to ankle that is thigh."""

WRIST = 0.70
"""Where the wrist usually is on the way from shoulder to fingertip."""

LEG_PARTING, ARM_PARTING = 0.6, 2.3
"""A hip is where the legs' curves part: half their distance is this many times their distance to the surface. A shoulder
is this many times as far from the trunk's curve as from the surface."""

HELD = 0.35
"""What is thinner than half the arm over more than this share of the arm's length is held in the hand."""

BENT = 25.0
"""Degrees at a joint from which the bend says where it is."""


@dataclass(frozen=True, eq=False)
class _Limb:
    """A curve from the end of a limb to where it meets the trunk.

    Attributes
    ----------
    cells : (k,) int64
    points : (k, 3) float64
        Left, up and front of the cells, smoothed.
    depth : (k,) float64
        Distance to the surface.
    along : (k,) float64
        Way from the end.
    """

    cells: NDArray[np.int64]
    points: NDArray[np.float64]
    depth: NDArray[np.float64]
    along: NDArray[np.float64]

    @property
    def length(self) -> float:
        return float(self.along[-1])

    def at(self, way: float) -> NDArray[np.float64]:
        """Return the point (3,) so far from the end."""
        return np.array([np.interp(way, self.along, column) for column in self.points.T])

    def index(self, way: float) -> int:
        return int(np.clip(np.searchsorted(self.along, way), 0, len(self.along) - 1))


class _Body:
    """The curve skeleton of a character in its own directions: left, up, front."""

    def __init__(self, mesh: SolverMesh, basis: NDArray[np.float64]) -> None:
        self.skeleton: CurveSkeleton = curve_skeleton(fill(mesh.vertices @ basis.T, mesh.faces, mesh.components))
        self.cells = self.skeleton.solid.centers
        self.depth = self.skeleton.solid.depth
        self.size = self.skeleton.solid.size
        self.ground = float(self.cells[:, 1].min())
        self.height = float(np.ptp(self.cells[:, 1])) + self.size
        self.middle = float(np.mean(self.cells[:, 0]))
        self.wide = float(max(np.ptp(self.cells[:, 0]), np.ptp(self.cells[:, 2]))) + self.size

    def up(self, cell: int) -> float:
        """Return a cell's height over the ground as a share of the character's."""
        return float((self.cells[cell, 1] - self.ground) / self.height)

    def left(self, cell: int) -> float:
        """Return how far left of the middle a cell is, as a share of width or length."""
        return float((self.cells[cell, 0] - self.middle) / self.wide)

    def front(self, cell: int) -> float:
        """Return how far before the middle a cell is, as a share of width or length."""
        low, high = self.cells[:, 2].min(), self.cells[:, 2].max()
        return float((self.cells[cell, 2] - (low + high) / 2) / self.wide)

    def limb(self, cells: list[int]) -> _Limb:
        """Return the smoothed curve through some cells, from the first to the last."""
        chosen = np.array(cells, dtype=np.int64)
        points, depth = self.cells[chosen], self.depth[chosen]
        points = _smoothed(points, max(2, round(float(np.median(depth)) / self.size)))
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        return _Limb(chosen, points, depth, along)

    @cached_property
    def order(self) -> NDArray[np.int64]:
        """Cells, each after its parent."""
        parents = self.skeleton.parents
        depth = np.full(len(parents), -1)
        for cell in range(len(parents)):
            way = []
            while depth[cell] < 0 and parents[cell] >= 0:
                way.append(cell)
                cell = int(parents[cell])
            start = max(int(depth[cell]), 0)
            depth[cell] = start
            depth[way[::-1]] = start + 1 + np.arange(len(way))
        return np.argsort(depth, kind="stable")

    def behind(self, cell: int) -> NDArray[np.bool_]:
        """Return which cells (n,) have their way to the root through one."""
        inside = np.zeros(len(self.cells), dtype=bool)
        inside[cell] = True
        parents = self.skeleton.parents
        for other in self.order.tolist():
            if parents[other] >= 0 and inside[parents[other]]:
                inside[other] = True
        return inside


def _smoothed(points: NDArray[np.float64], reach: int) -> NDArray[np.float64]:
    """Average each point with as many on both sides, no more than there are; the ends stay."""
    sums = np.concatenate([np.zeros((1, 3)), np.cumsum(points, axis=0)])
    place = np.arange(len(points))
    either = np.minimum(np.minimum(place, len(points) - 1 - place), reach)
    smooth: NDArray[np.float64] = (sums[place + either + 1] - sums[place - either]) / (2 * either + 1)[:, None]
    return smooth


def find_limbs(
    mesh: SolverMesh,
    basis: NDArray[np.float64],
    ends: Mapping[str, NDArray[np.float64]] = MappingProxyType({}),
) -> Limbs:
    """Find a character's limbs.

    Parameters
    ----------
    mesh : SolverMesh
    basis : (3, 3) float64
        Rows are the mesh's directions of the character's left, up and front.
    ends : mapping of str to (3,) float64
        Ends of limbs that are known, mesh file's coordinates.
    """
    body = _Body(mesh, basis)
    found = _Finder(body, {name: body_cell(body, basis @ end) for name, end in ends.items()}).limbs()
    return Limbs(tuple(LimbChain(name, points @ basis) for name, points in found.items()), ())


def body_cell(body: _Body, place: NDArray[np.float64]) -> int:
    return int(np.linalg.norm(body.cells - place, axis=1).argmin())


_Pair = tuple[int, int]


class _Finder:
    def __init__(self, body: _Body, ends: Mapping[str, int]) -> None:
        self.body, self.ends, self.skeleton = body, ends, body.skeleton

    def limbs(self) -> dict[str, NDArray[np.float64]]:
        body = self.body
        tips = [int(tip) for tip in self.skeleton.tips]
        feet = self.feet(tips)
        four_legged = len(feet) > 1
        head = self.head(four_legged)
        pelvis = self.skeleton.fork(*feet[0]) if feet else self.base()
        trunk = body.limb(self.skeleton.between(pelvis, head))
        self.trunk_cells = set(trunk.cells.tolist())
        self.trunk = trunk
        legs = [foot for pair in feet for foot in pair]
        branches = self.branches([tip for tip in tips if tip not in legs and body.up(tip) > 0.02], legs)
        self.debug = (feet, head, pelvis, branches)
        found: dict[str, NDArray[np.float64]] = {}
        names = ["hind leg", "front leg"] if four_legged else ["leg"]
        roots = []
        for name, pair in zip(names, feet, strict=False):
            left, right = self.leg_pair(pair)
            roots.append((left[0] + right[0]) / 2)
            found[f"left {name}"], found[f"right {name}"] = left, right
        arms = None if four_legged else self.arms(branches)
        if arms is not None:
            left, right = self.arm_pair(arms)
            found["left arm"], found["right arm"] = left, right
            roots.append((left[0] + right[0]) / 2)
        tail = self.tail(branches, arms)
        wings = self.wings(branches, arms, tail, four_legged)
        result = {}
        result |= self.trunk_and_head(roots, head, four_legged)
        result |= dict(sorted(found.items(), key=lambda item: ("leg" in item[0], "hind" in item[0])))
        if tail is not None:
            result["tail"] = evenly(tail.points[::-1], 4)
        if wings is not None:
            for side, wing in zip(("left", "right"), wings, strict=True):
                result[f"{side} wing"] = evenly(wing.points[::-1], 4)
        return result

    def base(self) -> int:
        """Return a cell in the middle of what a body without feet stands on."""
        cells = self.body.cells
        low = cells[:, 1] < self.body.ground + LOW * self.body.height
        return int(np.flatnonzero(low)[self.body.depth[low].argmax()])

    def feet(self, tips: list[int]) -> list[_Pair]:
        """Return no feet, a pair of feet, or hind feet and front feet; the left one first."""
        body = self.body
        low: list[int] = []
        for tip in tips:  # the longest first
            if body.up(tip) < LOW and all(body.up(self.skeleton.fork(tip, other)) > TOES for other in low):
                low.append(tip)
        pairs = sorted(self.pairs(low), key=self.pair_front)
        if len(pairs) > 1 and self.pair_front(pairs[-1]) - self.pair_front(pairs[0]) > STRIDE:
            return [pairs[0], pairs[-1]]
        return sorted(pairs, key=lambda pair: min(self.reach(tip) for tip in pair))[-1:]

    def reach(self, tip: int) -> float:
        return self.body.limb(self.skeleton.path(tip)).length

    def pair_front(self, pair: _Pair) -> float:
        return (self.body.front(pair[0]) + self.body.front(pair[1])) / 2

    def unlike(self, a: int, b: int) -> float:
        """Return how far two cells are from mirroring each other, as a share of width or length."""
        a_place, b_place = self.body.cells[a], self.body.cells[b]
        image = b_place * [-1, 1, 1] + [2 * self.body.middle, 0, 0]
        return float(np.linalg.norm(a_place - image) / self.body.wide)

    def pairs(self, tips: list[int]) -> list[_Pair]:
        """Match tips on the left with those on the right that mirror them best."""
        left = [tip for tip in tips if self.body.left(tip) > 0]
        right = [tip for tip in tips if self.body.left(tip) <= 0]
        unlike = np.array([[self.unlike(a, b) for b in right] for a in left]).reshape(len(left), len(right))
        rows, columns = linear_sum_assignment(unlike)
        return [(left[i], right[j]) for i, j in zip(rows, columns, strict=True) if unlike[i, j] < 0.5]

    def head(self, four_legged: bool) -> int:
        """Return the cell farthest to the front and up, near the middle."""
        body = self.body
        low, high = body.cells.min(axis=0), body.cells.max(axis=0)
        extent = np.array([body.wide, body.height, body.wide])
        _, up, front = (2 * (body.cells - (low + high) / 2) / extent).T
        left = 2 * (body.cells[:, 0] - body.middle) / body.wide
        forwards = front + 0.25 * up if four_legged else up + 0.7 * front
        return int(np.argmax(forwards - np.abs(left)))

    def branches(self, tips: list[int], legs: list[int]) -> list[_Limb]:
        """Return the curves of what branches off the trunk, one a limb, the longest first."""
        body, skeleton = self.body, self.skeleton
        leg_cells = {cell for leg in legs for cell in skeleton.path(leg)} - self.trunk_cells
        ways = []
        for tip in tips:
            way = skeleton.between(tip, int(self.trunk.cells[0]))
            stop = next(place for place, cell in enumerate(way) if cell in self.trunk_cells)
            if stop == 0 or any(cell in leg_cells for cell in way[: stop // 2]):
                continue
            ways.append(body.limb(way[: stop + 1]))
        ways.sort(key=lambda limb: -limb.length)
        kept: list[_Limb] = []
        for limb in ways:
            outside = limb.cells[limb.along < limb.length - 1.2 * limb.depth[-1]]
            if len(outside) and not any(np.isin(outside, other.cells).any() for other in kept):
                kept.append(limb)
        return kept

    def place_on_trunk(self, limb: _Limb) -> float:
        """Return where a branch leaves the trunk, from 0 at the pelvis to 1 at the end of the head."""
        where = int(np.flatnonzero(self.trunk.cells == limb.cells[-1])[0])
        return float(self.trunk.along[where] / self.trunk.length)

    def arms(self, branches: list[_Limb]) -> tuple[_Limb, _Limb] | None:
        """Return the pair of branches that is most like arms, the left one first."""
        body = self.body
        best, arms = 0.0, None
        for i, one in enumerate(branches):
            for other in branches[i + 1 :]:
                a, b = one.length - one.depth[-1], other.length - other.depth[-1]
                places = self.place_on_trunk(one), self.place_on_trunk(other)
                lefts = [(self.outwards(limb) - body.middle) / body.wide for limb in (one, other)]
                if lefts[0] * lefts[1] > 0:
                    continue
                fronts = (body.front(int(one.cells[0])) + body.front(int(other.cells[0]))) / 2
                score = (
                    min(a, b, 0.35 * body.height) / body.height
                    - 0.3 * abs(a - b) / (a + b)
                    - 0.5 * abs(places[0] - places[1])
                    - 2.0 * max(0.0, max(places) - 0.75)
                    - 0.25 * self.unlike(int(one.cells[0]), int(other.cells[0]))
                    - 0.2 * max(0.0, -fronts)
                )
                if score > best:
                    best, arms = score, (one, other) if lefts[0] > 0 else (other, one)
        return arms

    def outwards(self, limb: _Limb) -> float:
        """Return how far left a limb is where it leaves the body."""
        return float(limb.points[limb.along > 0.5 * limb.length, 0].mean())

    def arm_pair(self, arms: tuple[_Limb, _Limb]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        left, right = (self.arm(limb) for limb in arms)
        return self.symmetric(left, right)

    def symmetric(
        self, left: NDArray[np.float64], right: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Make limbs equal that nearly mirror each other."""
        mirror = np.array([-1.0, 1.0, 1.0])
        offset = np.array([2 * self.body.middle, 0.0, 0.0])
        middle = (left[:, 0] + right[:, 0]).mean() / 2
        offset = np.array([2 * middle, 0.0, 0.0])
        image = right * mirror + offset
        if np.linalg.norm(left - image, axis=1).max() > SYMMETRIC * self.body.height:
            return left, right
        both = (left + image) / 2
        return both, both * mirror + offset

    def arm(self, limb: _Limb) -> NDArray[np.float64]:
        """Return shoulder, elbow, wrist and the end of the hand."""
        body = self.body
        curve = cKDTree(self.trunk.points)
        from_trunk, _ = curve.query(limb.points)
        near = np.flatnonzero(from_trunk < ARM_PARTING * limb.depth)
        inner = near[limb.along[near] > 0.4 * limb.length]
        shoulder = limb.along[inner[0]] if len(inner) else limb.length
        end = self.end_of_hand(limb, float(shoulder))
        total = float(shoulder) - end
        wrist = self.narrowest(limb, end, total)
        elbow = float(shoulder) - UPPER_ARM * (shoulder - wrist)
        elbow = self.bend(limb, float(wrist), elbow, float(shoulder))
        _ = body
        return np.array([limb.at(way) for way in (float(shoulder), elbow, wrist, end)])

    def end_of_hand(self, limb: _Limb, shoulder: float) -> float:
        """Return where a hand ends, on the way from the tip: what it holds is long and thin."""
        top = limb.index(shoulder)
        for place in range(top - 1, 0, -1):
            so_far = shoulder - limb.along[place]
            if so_far < 2 * limb.depth[top]:
                continue
            if limb.depth[place] < 0.5 * np.median(limb.depth[place:top]):
                outside = limb.depth[:place]
                thin = np.flatnonzero(outside >= 0.5 * np.median(limb.depth[place:top]))
                start = limb.along[thin[-1]] if len(thin) else 0.0
                if limb.along[place] - start > HELD * so_far:
                    return float(limb.along[place])
                return 0.0
        return 0.0

    def narrowest(self, limb: _Limb, end: float, total: float) -> float:
        """Return where the wrist is, on the way from the tip: narrow, and about where wrists are."""
        body = self.body
        inside = body.behind(int(limb.cells[limb.index(end + total)]))
        chosen = np.flatnonzero(inside)
        _, nearest = cKDTree(limb.points).query(body.cells[chosen])
        ways = limb.along[nearest]
        share = np.linspace(0.55, 0.85, 31)
        places = end + (1 - share) * total
        reach = max(0.04 * total, 1.5 * body.size)
        counts = np.array([np.count_nonzero(np.abs(ways - way) < reach) for way in places])
        radius = np.sqrt(np.maximum(counts, 1))
        score = radius / np.median(radius) + 0.3 * ((share - WRIST) / 0.15) ** 2
        return float(places[score.argmin()])

    def bend(self, limb: _Limb, low: float, middle: float, high: float) -> float:
        """Return where a joint is between two others: where the limb is bent, or else where joints usually are."""
        start, end = limb.at(low), limb.at(high)
        ways = np.linspace(low + 0.3 * (high - low), low + 0.7 * (high - low), 41)
        points = np.array([limb.at(way) for way in ways])
        axis = (end - start) / max(float(np.linalg.norm(end - start)), 1e-12)
        aside = np.linalg.norm((points - start) - ((points - start) @ axis)[:, None] * axis, axis=1)
        corner = int(aside.argmax())
        a, b = points[corner] - start, end - points[corner]
        angle = np.degrees(np.arccos(np.clip(a @ b / (np.linalg.norm(a) * np.linalg.norm(b)), -1, 1)))
        return float(ways[corner]) if angle > BENT else middle

    def leg_pair(self, feet: _Pair) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return hip, knee, ankle and the end of the foot of both legs."""
        body, fork = self.body, self.skeleton.fork(*feet)
        limbs = [body.limb(self.skeleton.between(foot, fork)) for foot in feet]
        inwards = np.arange(0.0, min(limb.length for limb in limbs), body.size / 2)
        left, right = (np.array([limb.at(limb.length - way) for way in inwards]) for limb in limbs)
        depth = np.mean(
            [np.interp(limb.length - inwards, limb.along, limb.depth) for limb in limbs], axis=0
        )
        ratio = np.linalg.norm(left - right, axis=1) / 2 / depth
        parted = inwards[int(np.argmax(ratio > LEG_PARTING))]
        clear = inwards[int(np.argmax(ratio > 2 * LEG_PARTING))]
        legs = [self.leg(limb, limb.length - parted, limb.length - max(clear, parted)) for limb in limbs]
        return self.symmetric(*legs)

    def leg(self, limb: _Limb, hip: float, clear: float) -> NDArray[np.float64]:
        ankle = self.ankle(limb, hip)
        knee = self.bend(limb, ankle, hip - THIGH * (hip - ankle), hip)
        below = limb.at(clear - 0.25 * (clear - ankle))
        axis = limb.at(clear) - below
        axis /= max(float(np.linalg.norm(axis)), 1e-12)
        top = limb.at(clear) + (hip - clear) * axis
        return np.array([top, limb.at(knee), limb.at(ankle), limb.at(0.0)])

    def ankle(self, limb: _Limb, hip: float) -> float:
        """Return where the curve turns from the foot into the shin."""
        ways = np.linspace(0.0, 0.4 * hip, 81)
        points = np.array([limb.at(way) for way in ways])
        start, end = points[0], limb.at(0.5 * hip)
        axis = (end - start) / max(float(np.linalg.norm(end - start)), 1e-12)
        aside = np.linalg.norm((points - start) - ((points - start) @ axis)[:, None] * axis, axis=1)
        return float(ways[aside.argmax()])

    def tail(self, branches: list[_Limb], arms: tuple[_Limb, _Limb] | None) -> _Limb | None:
        """Return the longest branch in the middle behind."""
        body = self.body
        behind = [
            limb
            for limb in branches
            if (arms is None or limb not in arms)
            and abs(body.left(int(limb.cells[0]))) < 0.15
            and body.front(int(limb.cells[0])) < -0.15
            and self.place_on_trunk(limb) < 0.4
        ]
        tail = max(behind, key=lambda limb: limb.length, default=None)
        if tail is None:
            return None
        root = np.flatnonzero(tail.along < tail.length - tail.depth[-1])
        return body.limb(tail.cells[: max(int(root[-1]), 2)].tolist()) if len(root) else None

    def wings(
        self, branches: list[_Limb], arms: tuple[_Limb, _Limb] | None, tail: _Limb | None, four_legged: bool
    ) -> tuple[_Limb, _Limb] | None:
        return None

    def trunk_and_head(
        self, roots: list[NDArray[np.float64]], head: int, four_legged: bool
    ) -> dict[str, NDArray[np.float64]]:
        trunk = self.trunk
        if not roots:
            return {"trunk": evenly(trunk.points, 3)}
        low = roots[0]
        tree = cKDTree(trunk.points)
        if len(roots) < 2:
            place = trunk.index(0.6 * trunk.length)
        else:
            place = int(tree.query(roots[1])[1])
        high = trunk.points[place]
        start = int(tree.query(low)[1])
        middle = trunk.points[max((start + place) // 2, 0)]
        result = {"trunk": np.array([low, middle, high])}
        rest = np.arange(place, len(trunk.points))
        if len(rest) > 1:
            bulb = int(rest[trunk.depth[rest].argmax()])
            tip = trunk.points[-1]
            _ = bulb
            result["head"] = np.array([high, tip])
        return result
