"""Where a character's feet and head are, among the ends of the curves inside it."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from solver.anatomy.curve_skeleton import curve_skeleton
from solver.anatomy.limb_curve import curve_through
from solver.anatomy.solid import fill
from solver.surface.mesh import SolverMesh

LOW, GROUND = 0.2, 0.1
"""Legs end below the first of these shares of the height, and one of each pair below the second."""

LEVEL = 0.05
"""Two feet stand on the ground within this share of the height; of several pairs the one that is farthest apart."""

TOES = 0.15
"""Ends whose ways meet below this share of the height, or that are no farther apart on one side, are toes of a foot."""

THINNEST_FOOT = 0.3
"""What is thinner than this share of the thickest foot, as the hem of a cape, is no foot."""

UNEQUAL = 0.3
"""What the thickness of two feet counts beside their place: a sword's point beside a foot differs by nearly this."""

STRIDE = 0.25
"""Feet this far behind others are hind feet. This and most of what follows are shares of the largest of height, width
and length."""

LIKE = 0.3
"""Feet, ears or wings whose places differ by more than this from mirroring each other are no pair."""

BULB = 12.0
"""What the thickness of a head, as a share of the height, counts beside how far up and front it is."""

TWINS = 0.1
"""Ends that are this far apart, and mirror each other but for this, are a pair and no head: shares of the unit."""

NECK, THICKER_THAN_EARS = 0.8, 1.5
"""A neck is thinner than this share of the head, and a head this many times as thick as an ear."""

LESS_LIKE = 0.5
"""If a pair is most like a head, an end may be less like one by this; else the head is where the pair branches off."""

ONE_IMAGE = np.array([-1.0, 1.0, 1.0])

Points = NDArray[np.float64]
_Pair = tuple[int, int]


class LimbEnds:
    """A character in its own directions (left, up, front), with its feet and its head.

    Parameters
    ----------
    mesh : SolverMesh
    basis : (3, 3) float64
        Rows are the mesh's directions of the character's left, up and front.
    ends : mapping of str to (3,) float64
        Where limbs end that the user knows, by their names; in the character's directions.

    Attributes
    ----------
    solid : Solid
    skeleton : CurveSkeleton
    cells : (n, 3) float64
        Centres of the solid's cells.
    height, unit, middle : float
        Height; the largest of height, width and length; the trunk's place from left to right.
    ends : dict
        Name to cell, of the ends that the user knows.
    feet : list of (int, int)
        Cells of no feet, a pair of feet, or hind and front feet; of a pair the left one first.
    four_legged : bool
    head : int
        The cell at its end.
    like_heads : dict
        How much each cell that could be the end of the head is like one.
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
        self.like_heads: dict[int, float] = {}
        self.feet = self._feet()
        self.four_legged = len(self.feet) > 1
        self.head = self._head()

    def place(self, cell: int) -> Points:
        """Return how far left of the middle, over the ground and before the middle a cell is."""
        middle = np.array([self.middle, self.low[1], (self.low[2] + self.high[2]) / 2])
        return np.asarray((self.cells[cell] - middle) / [self.unit, self.height, self.unit])

    def unlike(self, one: Points, other: Points) -> float:
        """Return how far two places are from mirroring each other."""
        image = other * ONE_IMAGE + [2 * self.middle, 0.0, 0.0]
        return float(np.linalg.norm(one - image) / self.unit)

    def text(self, place: Points) -> str:
        """Return a place as the command line takes it: mesh file's coordinates."""
        return ",".join(f"{value:.4g}" for value in place @ self.basis)

    def _feet(self) -> list[_Pair]:
        """Return no feet, a pair of feet, or hind feet and front feet; of a pair the left one first."""
        candidates = [tip for tip in self.skeleton.tips.tolist() if self.place(tip)[1] < LOW]
        stout = max((self._thicknesses(tip)[0] for tip in candidates), default=0.0)
        low: list[int] = []
        for tip in candidates:
            if self._thicknesses(tip)[0] < THINNEST_FOOT * stout:
                continue
            others = [other for other in low if self.same_foot(tip, other)]
            if all(self.cells[other, 2] < self.cells[tip, 2] for other in others):  # toes rather than a heel
                low = [*(other for other in low if other not in others), tip]
        left = [tip for tip in low if self.place(tip)[0] > 0]
        right = [tip for tip in low if self.place(tip)[0] <= 0]
        unlike = np.array([[self._unlike_feet(a, b) for b in right] for a in left])
        rows, columns = linear_sum_assignment(unlike.reshape(len(left), len(right)))
        pairs = [(left[i], right[j]) for i, j in zip(rows, columns, strict=True)]
        pairs = [pair for pair in pairs if self._unlike_feet(*pair, stride=0.0) < LIKE]
        pairs = [pair for pair in pairs if min(self.place(tip)[1] for tip in pair) < GROUND]
        pairs.sort(key=lambda pair: sum(self.place(tip)[2] for tip in pair))
        for given in ("leg", "hind leg", "front leg"):
            if {f"left {given}", f"right {given}"} <= self.ends.keys():
                pair = self.ends[f"left {given}"], self.ends[f"right {given}"]
                pairs = [pair] if given != "front leg" else [pairs[0], pair]
        if len(pairs) > 1 and self._stride(pairs[0], pairs[-1]) > STRIDE:
            return [pairs[0], pairs[-1]]
        heights = [max(self.place(tip)[1] for tip in pair) for pair in pairs]
        lowest = [pair for pair, height in zip(pairs, heights, strict=True) if height < min(heights) + LEVEL]
        return sorted(lowest, key=lambda pair: self.cells[pair[1], 0] - self.cells[pair[0], 0])[:1]

    def _unlike_feet(self, one: int, other: int, stride: float = 1.0) -> float:
        """Return how far two feet are from mirroring each other in place and thickness.

        Parameters
        ----------
        one, other : int
        stride : float
            Factor on how far one is before the other.
        """
        counts = np.array([1.0, 1.0, stride])
        thickness = sorted((self._thicknesses(one)[0], self._thicknesses(other)[0]))
        return self.unlike(counts * self.cells[one], counts * self.cells[other]) + UNEQUAL * (
            1 - thickness[0] / thickness[1]
        )

    def _stride(self, hind: _Pair, front: _Pair) -> float:
        places = [np.mean([self.place(tip)[2] for tip in pair]) for pair in (hind, front)]
        return float(places[1] - places[0])

    def same_foot(self, tip: int, other: int) -> bool:
        """Return whether two ends are toes, or toe and heel, of one foot."""
        if self.place(self.skeleton.fork(tip, other))[1] < TOES:
            return True
        one_side = (self.place(tip)[0] > 0) == (self.place(other)[0] > 0)
        return bool(one_side and np.linalg.norm(self.cells[tip] - self.cells[other]) < TOES * self.unit)

    def _head(self) -> int:
        """Return the end of the head: far to the front and up, near the middle, and thick."""
        if "head" in self.ends:
            return self.ends["head"]
        extent = np.array([self.unit, self.height, self.unit])
        left, up, front = (2 * (self.cells - (self.low + self.high) / 2) / extent).T
        left = 2 * np.abs(self.cells[:, 0] - self.middle) / self.unit
        forwards = (front + 0.25 * up if self.four_legged else up + 0.7 * front) - left
        feet = [foot for pair in self.feet for foot in pair]
        tips = [tip for tip in self.skeleton.tips.tolist() if not any(self.same_foot(tip, foot) for foot in feet)]
        for cell in [int(forwards.argmax()), *tips]:
            self.like_heads[cell] = float(forwards[cell]) + BULB * self._bulb(cell)
        best = max(self.like_heads, key=lambda cell: self.like_heads[cell])
        twins = {cell: twin for cell in self.like_heads if (twin := self.twin(cell, tips)) is not None}
        if best not in twins:
            return best
        single = [cell for cell in tips if cell not in twins and not self._is_aside(cell)]
        close = [cell for cell in single if self.like_heads[cell] > self.like_heads[best] - LESS_LIKE]
        return max(close, key=lambda cell: self.like_heads[cell], default=self._below_ears(best, twins[best]))

    def twin(self, cell: int, tips: Sequence[int]) -> int | None:
        """Return the end that mirrors another, as ears and hands do, and heads do not."""
        alike = (tip for tip in tips if self.unlike(self.cells[cell], self.cells[tip]) < TWINS)
        return next(alike, None) if self._is_aside(cell) else None

    def _below_ears(self, one: int, other: int) -> int:
        """Return the thickest place below an ear, before the neck; where there is no neck, where the ears meet."""
        way = self.skeleton.path(one)
        depth = self.solid.depth[way]
        thickest = np.maximum.accumulate(depth)
        past_ear = thickest > THICKER_THAN_EARS * np.median(depth[: len(depth) // 2])
        neck = np.flatnonzero(past_ear & (depth < NECK * thickest))
        return way[int(depth[: neck[0]].argmax())] if len(neck) else self.skeleton.fork(one, other)

    def _is_aside(self, cell: int) -> bool:
        return bool(2 * abs(self.cells[cell, 0] - self.middle) > TWINS * self.unit)

    def _bulb(self, cell: int) -> float:
        """Return how thick the end of a limb is at most, as a share of the height."""
        return self._thicknesses(cell)[1]

    def _thicknesses(self, cell: int) -> tuple[float, float]:
        """Return how thick the end of a limb is in its middle and at most, as shares of the height."""
        curve = curve_through(self.solid, self.skeleton.path(cell))
        depth = curve.depth[curve.along <= LOW * self.height] / self.height
        return float(np.median(depth)), float(depth.max())

    def base(self) -> int:
        """Return a cell in the middle of what a body without feet stands on."""
        low = np.flatnonzero(self.cells[:, 1] < self.low[1] + LOW * self.height)
        return int(low[self.solid.depth[low].argmax()])
