"""The feet and the head of a character, found among the ends of the curves inside it."""

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
import scipy
from numpy.typing import NDArray

from solver.anatomy.curve_skeleton import curve_skeleton
from solver.anatomy.limb_curve import curve_through
from solver.anatomy.solid import fill, parted
from solver.surface.mesh import SolverMesh

MAX_FOOT_HEIGHT, MAX_GROUND_HEIGHT = 0.2, 0.1
"""Height below which both feet of a pair end, and height above the lowest foot of any pair below which at least one of
them ends, as shares of the height. For a body that lies, both are heights above its lowest place. The second is also
the height above the lowest place of a foot up to which its end may be: the hem of trousers is higher."""

MAX_LEVEL_DIFFERENCE = 0.05
"""Maximum difference in height between pairs of feet that both stand on the ground, as a share of the height. Of
several such pairs, the inner one counts: hands may reach the ground beside the feet."""

TOE_DISTANCE = 0.15
"""Two ends are toes of one foot if their curves meet below this share of the height, or if they are on one side of an
upright body and closer together than this share of the unit."""

MIN_TRUNK_SHARE, MAX_FORK_SHARE = 0.6, 0.3
"""Minimum thickness of a trunk that lies, and maximum thickness of one of its legs where toes, heel or knee branch off,
as shares of the thickest place."""

MAX_SINGLE_HEIGHT, MAX_SINGLE_THICKNESS = 0.03, 0.5
"""Maximum height of the foot of a single leg, as a share of the height, and maximum thickness of that leg, as a share
of the thickest place."""

MIN_BELLY_HEIGHT = 0.35
"""Minimum height of the belly of a body that lies above its only row of feet, in heights of the body without thin
parts: two legs carry it above the ground, and lower ones are the fins of a fish."""

MIN_RISE_COSINE = np.cos(np.radians(40))
"""Minimum cosine between up and the direction from the foot of a single leg to the body."""

MIN_FOOT_THICKNESS = 0.3
"""Minimum thickness of a foot, as a share of the thickest one; the hem of a cape is thinner."""

THICKNESS_WEIGHT = 0.3
"""Weight of the relative difference in thickness of two feet, compared with the distance of their places. The point of
a sword differs from a foot by nearly all of its thickness."""

MIN_HEIGHT_SHARE = 0.75
"""Height of a body that lies for the first two of these constants, as a share of the unit, if it is lower than that."""

MIN_STRIDE, MIN_LYING_STRIDE = 0.25, 0.12
"""Minimum distance from hind feet to front feet, and that of a body that lies, whose tail may be longer. This and most
of the following constants are shares of the unit: the largest of height, width and length."""

MIN_ROW_STRIDE = 0.04
"""Minimum distance from a pair of feet to the next one, if there are more than two pairs."""

MIN_ROW_THICKNESS = 0.5
"""Minimum thickness of feet between two other pairs, as a share of theirs."""

MAX_MIRROR_DISTANCE = 0.3
"""Maximum distance between the places of two feet, ears or wings of a pair after mirroring one of them."""

HEAD_THICKNESS_WEIGHT = 12.0
"""Weight of a head's thickness, as a share of the height, compared with how far up and to the front it is."""

MAX_TWIN_DISTANCE = 0.1
"""Ends are a pair, and not heads, if they are farther apart than this and mirror each other to within it."""

MAX_NECK_RATIO, MIN_HEAD_TO_EAR_RATIO = 0.8, 1.5
"""Maximum thickness of a neck, as a share of that of the head, and minimum thickness of a head, as a multiple of that
of an ear."""

HEAD_SCORE_MARGIN = 0.5
"""If a pair of ends has the highest head score, a single end whose score is lower by less than this is the head. If
there is none, the head is where the pair branches off."""

MIN_LYING_RATIO = 1.2
"""Minimum spread of a body that lies from back to front, as a multiple of its spread in height."""

TAIL_SHARE = 0.35
"""Length of the tail of a body that lies without feet, as a share of that of the body."""

MIRROR = np.array([-1.0, 1.0, 1.0])

Points = NDArray[np.float64]
Feet = tuple[int, ...]
"""Cells at the feet of a row of legs: the left and the right one, or a single one."""


class LimbEnds:
    """A character in its own directions (left, up, front), with its feet and its head.

    Parameters
    ----------
    mesh : SolverMesh
    basis : (3, 3) float64
        Rows are the mesh's directions of the character's left, up and front.
    ends : mapping of str to (3,) float64
        Ends of limbs that the user has given, by name; in the character's directions.

    Attributes
    ----------
    solid : Solid
    skeleton : CurveSkeleton
    cells : (n, 3) float64
        Centres of the solid's cells.
    height, unit, middle : float
        Height; the largest of height, width and length; position of the trunk from left to right.
    ends : dict
        Cells of the ends that the user has given, by name.
    feet : list of tuple of int
        Cells at the feet: no row, one row, or several from hind to front. A row is a pair, the left foot first, or the
        foot of a single leg.
    four_legged : bool
    lies : bool
        Whether the body is longer than it is high, regardless of thin parts.
    head : int
        Cell at the end of the head.
    head_scores : dict
        Score of each cell that may be the end of the head.
    """

    def __init__(self, mesh: SolverMesh, basis: NDArray[np.float64], ends: Mapping[str, Points]) -> None:
        self.basis = basis
        self.solid = fill(mesh.vertices @ basis.T, mesh.faces, mesh.components)
        self.skeleton = curve_skeleton(self.solid)
        self.cells = self.solid.centers
        self.ends = {name: int(np.linalg.norm(self.cells - end, axis=1).argmin()) for name, end in ends.items()}
        self.low, self.high = self.cells.min(axis=0), self.cells.max(axis=0)
        self.height = float(self.high[1] - self.low[1]) + self.solid.size
        self.unit = float((self.high - self.low).max()) + self.solid.size
        self.middle = float(np.average(self.cells[:, 0], weights=self.solid.depth**2))  # the trunk's, not a shield's
        self.head_scores: dict[int, float] = {}
        spread = np.sqrt(np.cov(self.cells.T, aweights=self.solid.depth**2).diagonal())
        self.lies = bool(spread[2] > MIN_LYING_RATIO * spread[1])
        if self._feet_touch():
            low = self.cells[:, 1] < self.low[1] + TOE_DISTANCE * self.height
            self.skeleton = curve_skeleton(parted(self.solid, self.cells[:, 0] > self.middle, low))
        self.feet = [self._amid_blocks(row) for row in self._feet()]
        self.four_legged = len(self.feet) > 1
        self.head = self._head()

    def place(self, cell: int) -> Points:
        """Return a cell's position (3,): left of the middle and in front of it in units; the height in heights."""
        middle = np.array([self.middle, self.low[1], (self.low[2] + self.high[2]) / 2])
        return np.asarray((self.cells[cell] - middle) / [self.unit, self.height, self.unit])

    def mirror_distance(self, one: Points, other: Points) -> float:
        """Return the distance between a place and the mirror image of another, as a share of the unit."""
        image = other * MIRROR + [2 * self.middle, 0.0, 0.0]
        return float(np.linalg.norm(one - image) / self.unit)

    def option_value(self, place: Points) -> str:
        """Return a position as the value of a command-line option, in the mesh file's coordinates."""
        return ",".join(f"{value:.4g}" for value in place @ self.basis)

    def _feet_touch(self) -> bool:
        """Return whether the curves of two feet of an upright body meet near the ground, where the feet touch."""
        low = [tip for tip in self.skeleton.tips.tolist() if self.place(tip)[1] < MAX_FOOT_HEIGHT]
        return not self.lies and any(
            (self.cells[one, 0] - self.middle) * (self.cells[other, 0] - self.middle) < 0
            and self.mirror_distance(self.cells[one], self.cells[other]) < MAX_TWIN_DISTANCE
            and self.place(self.skeleton.fork(one, other))[1] < TOE_DISTANCE
            for one, other in combinations(low, 2)
        )

    def _feet(self) -> list[Feet]:
        """Return the rows of feet."""
        scale = max(MIN_HEIGHT_SHARE * self.unit / self.height, 1.0) if self.lies else 1.0
        tips: list[int] = self.skeleton.tips.tolist()
        candidates = [tip for tip in tips if self.place(tip)[1] < MAX_FOOT_HEIGHT * scale]
        stout = max((self._thicknesses(tip)[0] for tip in candidates), default=0.0)
        candidates = [tip for tip in candidates if self._thicknesses(tip)[0] >= MIN_FOOT_THICKNESS * stout]
        sole: dict[int, float] = {end: self.place(end)[1] for end in self.ends.values()}
        low: list[int] = []
        while candidates:
            one = candidates.pop(0)
            foot = [one, *(tip for tip in (tips if self.lies else candidates) if self.same_foot(tip, one))]
            heights = [self.place(tip)[1] for tip in foot]
            level = [tip for tip, each in zip(foot, heights, strict=True) if each < min(heights) + MAX_GROUND_HEIGHT]
            low.append(max(level, key=lambda tip: self.cells[tip, 2]))  # toes rather than a heel
            sole[low[-1]] = min(heights)
            candidates = [tip for tip in candidates if tip not in foot]
        middle = self._between(low)
        left = [tip for tip in low if self.cells[tip, 0] > middle]
        right = [tip for tip in low if self.cells[tip, 0] <= middle]
        unlike = np.array([[self._foot_distance(a, b) for b in right] for a in left])
        rows, columns = scipy.optimize.linear_sum_assignment(unlike.reshape(len(left), len(right)))
        pairs: list[Feet] = [(left[i], right[j]) for i, j in zip(rows, columns, strict=True)]
        pairs = [pair for pair in pairs if self._foot_distance(pair[0], pair[1], stride=0.0) < MAX_MIRROR_DISTANCE]
        # a gun may hang below the feet of a body that stands
        ground = 0.0 if self.lies else min((sole[tip] for pair in pairs for tip in pair), default=0.0)
        pairs = [pair for pair in pairs if min(sole[tip] for tip in pair) < ground + MAX_GROUND_HEIGHT * scale]
        pairs.sort(key=lambda pair: sum(self.place(tip)[2] for tip in pair))
        for given in ("leg", "hind leg", "front leg"):
            if {f"left {given}", f"right {given}"} <= self.ends.keys():
                pair = self.ends[f"left {given}"], self.ends[f"right {given}"]
                pairs = [pair] if given != "front leg" else [pairs[0], pair]
        if len(pairs) > 1 and self._stride(pairs[0], pairs[-1]) > (MIN_LYING_STRIDE if self.lies else MIN_STRIDE):
            between = [pair for pair in pairs[1:-1] if self._is_row(pair, pairs[0], pairs[-1])]
            return [pairs[0], *between, pairs[-1]]
        heights = [max(sole[tip] for tip in pair) for pair in pairs]
        lowest = [
            pair for pair, height in zip(pairs, heights, strict=True) if height < min(heights) + MAX_LEVEL_DIFFERENCE
        ]
        inner = sorted(lowest, key=lambda pair: self.cells[pair[0], 0] - self.cells[pair[1], 0])[:1]
        standing = self._with_single(inner, low) if self.lies or not inner else inner
        given_legs = any("leg" in name for name in self.ends)
        fins = self.lies and len(standing) == 1 and self._belly_height(standing[0]) < MIN_BELLY_HEIGHT
        return [] if fins and not given_legs else standing

    def _amid_blocks(self, row: Feet) -> Feet:
        """Return cells amid feet from left to right, if the ends of all of them are corners of blocks."""
        amid = []
        for tip in row:
            away = self.cells - self.cells[tip]
            reach = self._thicknesses(tip)[1] * self.height
            beside = (np.abs(away[:, 1:]) < reach).all(axis=1) & (np.abs(away[:, 0]) < 3 * reach)
            beside &= (self.cells[:, 0] > self.middle) == (self.cells[tip, 0] > self.middle)
            aside = away[beside, 0].mean()
            if tip in self.ends.values() or abs(aside) < reach:
                return row
            amid.append(int(np.hypot(away[:, 0] - aside, np.linalg.norm(away[:, 1:], axis=1)).argmin()))
        return tuple(amid)

    def _belly_height(self, feet: Feet) -> float:
        """Return the height of the belly above feet, in heights of the body without thin parts."""
        thick = self.solid.depth > MAX_SINGLE_THICKNESS * self.solid.depth.max()
        place, depth = self.cells[thick, 1], self.solid.depth[thick]
        belly, back = float((place - depth).min()), float((place + depth).max())
        return (belly - float(self.cells[list(feet), 1].min())) / (back - belly)

    def _between(self, low: Sequence[int]) -> float:
        """Return where left feet begin: at the middle, or between the two feet of a stride on one side of it."""
        aside = self.cells[low, 0] - self.middle
        strides = not self.lies and len(low) == 2 and aside.prod() > 0
        return self.middle + (float(aside.mean()) if strides else 0.0)

    def _with_single(self, rows: list[Feet], low: Sequence[int]) -> list[Feet]:
        """Add the foot of a single leg, such as the third leg of a dog, to one row of feet or none."""
        singles: list[Feet] = [
            (tip,)
            for tip in low
            if all(tip not in row and abs(self._stride(row, (tip,))) > MIN_LYING_STRIDE for row in rows)
            and self.place(tip)[1] < MAX_SINGLE_HEIGHT
            and self._rises(tip)
        ]
        return sorted([*rows, *singles], key=lambda row: self.place(row[0])[2]) if len(singles) == 1 else rows

    def _rises(self, tip: int) -> bool:
        """Return whether a thin leg leads up from a foot to a thick body; tails on the ground do not rise."""
        way = self.skeleton.path(tip)
        thick = self.solid.depth[way] > MIN_TRUNK_SHARE * self.solid.depth.max()
        leg = way[: int(np.argmax(thick))]
        if not leg:
            return False
        up = self.cells[leg[-1]] - self.cells[tip]
        thin = np.median(self.solid.depth[leg]) < MAX_SINGLE_THICKNESS * self.solid.depth.max()
        return bool(thin and up[1] > max(MIN_RISE_COSINE * float(np.linalg.norm(up)), MAX_FOOT_HEIGHT * self.height))

    def _is_row(self, pair: Feet, hind: Feet, front: Feet) -> bool:
        """Return whether a pair of feet between two others stands on the ground as they do, on legs of its own."""
        on_ground = max(self.place(tip)[1] for tip in pair) < MAX_GROUND_HEIGHT
        apart = min(self._stride(hind, pair), self._stride(pair, front)) > MIN_ROW_STRIDE
        thickness = min(self._thicknesses(tip)[0] for tip in pair)
        stout = min(self._thicknesses(tip)[0] for other in (hind, front) for tip in other)
        return on_ground and apart and thickness > MIN_ROW_THICKNESS * stout

    def _foot_distance(self, one: int, other: int, stride: float = 1.0) -> float:
        """Return how far two feet are from mirroring each other in place and thickness, as a share of the unit.

        Parameters
        ----------
        one, other : int
        stride : float
            Factor on the distance from front to back.
        """
        counts = np.array([1.0, 1.0, stride])
        thickness = sorted((self._thicknesses(one)[0], self._thicknesses(other)[0]))
        return self.mirror_distance(counts * self.cells[one], counts * self.cells[other]) + THICKNESS_WEIGHT * (
            1 - thickness[0] / thickness[1]
        )

    def _stride(self, hind: Feet, front: Feet) -> float:
        places = [np.mean([self.place(tip)[2] for tip in pair]) for pair in (hind, front)]
        return float(places[1] - places[0])

    def same_foot(self, tip: int, other: int) -> bool:
        """Return whether two ends are toes of one foot, or its toe and heel."""
        fork = self.skeleton.fork(tip, other)
        if self.place(fork)[1] < TOE_DISTANCE:
            return True
        one_side = (self.place(tip)[0] > 0) == (self.place(other)[0] > 0)
        if self.lies:  # legs of neighbouring rows meet in the trunk
            return bool(one_side and self.solid.depth[fork] < MAX_FORK_SHARE * self.solid.depth.max())
        return bool(one_side and np.linalg.norm(self.cells[tip] - self.cells[other]) < TOE_DISTANCE * self.unit)

    def _head(self) -> int:
        """Return the cell at the end of the head: far to the front and up, near the middle, and thick."""
        if "head" in self.ends:
            return self.ends["head"]
        extent = np.array([self.unit, self.height, self.unit])
        left, up, front = (2 * (self.cells - (self.low + self.high) / 2) / extent).T
        left = 2 * np.abs(self.cells[:, 0] - self.middle) / self.unit
        forwards = (front + 0.25 * up if self.four_legged or self.crawls else up + 0.7 * front) - left
        feet = [foot for pair in self.feet for foot in pair]
        tips = [tip for tip in self.skeleton.tips.tolist() if not any(self.same_foot(tip, foot) for foot in feet)]
        for cell in [int(forwards.argmax()), *tips]:
            self.head_scores[cell] = float(forwards[cell]) + HEAD_THICKNESS_WEIGHT * self._thicknesses(cell)[1]
        best = max(self.head_scores, key=lambda cell: self.head_scores[cell])
        twins = {cell: twin for cell in self.head_scores if (twin := self.twin(cell, tips)) is not None}
        if best not in twins:
            return best
        single = [cell for cell in tips if cell not in twins and not self._is_off_middle(cell)]
        close = [cell for cell in single if self.head_scores[cell] > self.head_scores[best] - HEAD_SCORE_MARGIN]
        return max(close, key=lambda cell: self.head_scores[cell], default=self._below_ears(best, twins[best]))

    def twin(self, cell: int, tips: Sequence[int]) -> int | None:
        """Return the end that mirrors a cell, if there is one; ears and hands have such a twin, heads do not."""
        alike = (tip for tip in tips if self.mirror_distance(self.cells[cell], self.cells[tip]) < MAX_TWIN_DISTANCE)
        return next(alike, None) if self._is_off_middle(cell) else None

    def _below_ears(self, one: int, other: int) -> int:
        """Return the thickest cell between an ear and the neck, or without a neck the cell where the two ears meet."""
        way = self.skeleton.path(one)
        depth = self.solid.depth[way]
        thickest = np.maximum.accumulate(depth)
        past_ear = thickest > MIN_HEAD_TO_EAR_RATIO * np.median(depth[: len(depth) // 2])
        neck = np.flatnonzero(past_ear & (depth < MAX_NECK_RATIO * thickest))
        return way[int(depth[: neck[0]].argmax())] if len(neck) else self.skeleton.fork(one, other)

    def _is_off_middle(self, cell: int) -> bool:
        return bool(2 * abs(self.cells[cell, 0] - self.middle) > MAX_TWIN_DISTANCE * self.unit)

    def _thicknesses(self, cell: int) -> tuple[float, float]:
        """Return the median and the maximum thickness of the end of a limb, as shares of the height."""
        curve = curve_through(self.solid, self.skeleton.path(cell))
        depth = curve.depth[curve.along <= MAX_FOOT_HEIGHT * self.height] / self.height
        return float(np.median(depth)), float(depth.max())

    @property
    def crawls(self) -> bool:
        """Whether a body lies and has no feet, as that of a snake or a fish."""
        return self.lies and not self.feet

    @property
    def rear(self) -> int:
        """The cell that is farthest to the back."""
        return int(self.cells[:, 2].argmin())

    def base(self) -> int:
        """Return the cell at the hips of a body without feet.

        It is the thickest one near the ground, or between the tail and the trunk of a body that lies.
        """
        if self.crawls:
            way = self.skeleton.between(self.rear, self.head)
            return way[round(TAIL_SHARE * len(way))]
        low = np.flatnonzero(self.cells[:, 1] < self.low[1] + MAX_FOOT_HEIGHT * self.height)
        return int(low[self.solid.depth[low].argmax()])
