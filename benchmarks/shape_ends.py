"""The ends of a character's curves and the pairs among them, and what is measured of both.

Lengths are shares of the character's largest extent, and heights are shares of its height.
"""

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from solver.anatomy.curve_skeleton import CurveSkeleton

Measures = dict[str, NDArray[np.float64]]
"""What is measured of each end or pair, by name."""

MIN_SEPARATION, MAX_UNLIKE_PLACES, MAX_UNLIKE_LENGTHS, MIN_LENGTH = 0.03, 0.35, 0.75, 0.02
"""Which ends may be a pair: their minimum distance from left to right, the maximum distance of one from the mirror
image of the other, the maximum difference of their lengths as a share of the longer one, and their minimum length."""

GROUND_HEIGHT = 0.06
"""Height at which the measure `on the ground` has fallen to 1/e."""

TRUNK_DEPTH = 0.75
"""Minimum thickness of the trunk, as a share of the thickest place. Where the way from an end reaches it, its limb
begins."""

MIDDLE, MIN_NEW_END = 0.05, 0.08
"""Maximum distance from the middle of an end that is far out in one direction without being the end of a curve, as a
head may be, and its minimum distance from other ends."""

SAME_SHARE = 0.5
"""Minimum share of its length that an end has in common with another one of the same limb."""

MIN_LYING_RATIO = 1.2
"""Minimum spread of a body that lies from back to front, as a multiple of its spread in height."""

BULGE_LENGTH = 0.12
"""Length of the part of a limb at its end whose largest thickness is measured."""


class ShapeEnds:
    """A character's ends and pairs.

    Parameters
    ----------
    skeleton : CurveSkeleton
        In the character's directions: left, up and front.

    Attributes
    ----------
    tips : (k,) int64
        Cells at the ends: those of the curves, and some that are far out without a curve.
    is_tip : (k,) bool
        Whether each is the end of a curve.
    ways, along : list of (n,) arrays
        Cells from each end to the root of the curves, and their distances from the end along the way.
    begins : (k,) int64
        Where on its way each limb leaves the trunk.
    lengths : (k,) float64
        Distance from each end to that place, in the units of the mesh.
    meets : (k, k) int64
        Where each way meets each other way.
    aside, up, front : (k,) float64
        Place of each end: left of the middle, above the ground, before the middle.
    left, right : (p,) int64
        Numbers of the two ends of each pair.
    lies : bool
    """

    def __init__(self, skeleton: CurveSkeleton) -> None:
        solid = skeleton.solid
        self.cells, self.depth, self.thickest = solid.centers, solid.depth, float(solid.depth.max())
        self.low, self.high = self.cells.min(axis=0) - solid.size / 2, self.cells.max(axis=0) + solid.size / 2
        self.height, self.size = float(self.high[1] - self.low[1]), float((self.high - self.low).max())
        self.middle = np.average(self.cells, axis=0, weights=self.depth**2)
        spread = np.sqrt(np.cov(self.cells.T, aweights=self.depth**2).diagonal())
        self.lies = bool(spread[2] > MIN_LYING_RATIO * spread[1])
        self.tips = np.array([*skeleton.tips, *self._other_ends(skeleton)], dtype=np.int64)
        self.is_tip = np.arange(len(self.tips)) < len(skeleton.tips)
        self.places = self.cells[self.tips]
        self.ways = [np.array(skeleton.path(tip)) for tip in self.tips]
        self.along = [self._lengths(way) for way in self.ways]
        self.begins = np.array([self._begin(way) for way in self.ways], dtype=np.int64)
        self.lengths = np.array([along[begin] for along, begin in zip(self.along, self.begins, strict=True)])
        self.meets = self._meetings()
        self.aside = (self.places[:, 0] - self.middle[0]) / self.size
        self.up = (self.places[:, 1] - self.low[1]) / self.height
        self.front = (self.places[:, 2] - (self.low[2] + self.high[2]) / 2) / self.size
        self._find_pairs()

    def _other_ends(self, skeleton: CurveSkeleton) -> list[int]:
        """Return cells that are farthest out in a direction near the middle, and away from the ends of curves."""
        found: list[int] = []
        for axis in range(3):
            for sign in (1.0, -1.0):
                out = sign * (self.cells[:, axis] - self.middle[axis])
                for other in (other for other in range(3) if other != axis):
                    near = np.abs(self.cells[:, other] - self.middle[other]) < MIDDLE * self.size
                    cell = int(np.where(near, out, -np.inf).argmax())
                    away = np.linalg.norm(self.cells[[*skeleton.tips, *found]] - self.cells[cell], axis=1)
                    if near.any() and out[cell] > MIDDLE * self.size and (away > MIN_NEW_END * self.size).all():
                        found.append(cell)
        return found

    def _lengths(self, way: NDArray[np.int64]) -> NDArray[np.float64]:
        steps = np.linalg.norm(np.diff(self.cells[way], axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    def _begin(self, way: NDArray[np.int64]) -> int:
        thick = np.flatnonzero(self.depth[way] > TRUNK_DEPTH * self.thickest)
        return min(max(int(thick[0]) if len(thick) else len(way) - 1, 1), len(way) - 1)

    def _meetings(self) -> NDArray[np.int64]:
        found = np.zeros((len(self.tips), len(self.tips)), dtype=np.int64)
        for one, way in enumerate(self.ways):
            for other, there in enumerate(self.ways):
                shared = np.isin(way, there)
                found[one, other] = int(shared.argmax()) if shared.any() else len(way) - 1
        return found

    def _at(self, ends: NDArray[np.int64], numbers: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the cells at these numbers of the ways from ends."""
        return np.array([self.ways[end][number] for end, number in zip(ends, numbers, strict=True)], dtype=np.int64)

    def _way_to(self, ends: NDArray[np.int64], numbers: NDArray[np.int64]) -> NDArray[np.float64]:
        return np.array([self.along[end][number] for end, number in zip(ends, numbers, strict=True)]) / self.size

    def _thickness(self, ends: NDArray[np.int64], numbers: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the median thickness of limbs from their ends to these numbers of their ways."""
        depths = (self.depth[self.ways[end][: number + 1]] for end, number in zip(ends, numbers, strict=True))
        return np.array([np.median(depth) for depth in depths]) / self.size

    def _find_pairs(self) -> None:
        """Find pairs, the roots of both limbs, and the forks where their ways meet."""
        every = [(i, j) for i in np.flatnonzero(self.aside > 0) for j in np.flatnonzero(self.aside < 0)]
        ends = np.array(every, dtype=np.int64).reshape(-1, 2).T
        forks = np.stack([self.meets[ends[0], ends[1]], self.meets[ends[1], ends[0]]])
        roots = np.minimum(forks, self.begins[ends])
        lengths = np.stack([self._way_to(*each) for each in zip(ends, roots, strict=True)])
        thickness = np.stack([self._thickness(*each) for each in zip(ends, roots, strict=True)])
        image = self.places[ends[1]] * [-1.0, 1.0, 1.0] + [2 * self.middle[0], 0.0, 0.0]
        unlike = np.linalg.norm(self.places[ends[0]] - image, axis=1) / self.size
        apart = self.aside[ends[0]] - self.aside[ends[1]]
        kept = (apart > MIN_SEPARATION) & (lengths.min(axis=0) > MIN_LENGTH)
        kept &= (unlike < MAX_UNLIKE_PLACES) & (_unlike(lengths) < MAX_UNLIKE_LENGTHS)
        self.left, self.right = ends = ends[:, kept]
        self.apart, self.unlike = apart[kept], np.stack([unlike, _unlike(lengths), _unlike(thickness)])[:, kept]
        self.pair_lengths, self.thickness = lengths[:, kept], thickness[:, kept].mean(axis=0)
        self.fork_lengths = np.stack([self._way_to(*each) for each in zip(ends, forks[:, kept], strict=True)])
        self.roots = np.stack([self.cells[self._at(*each)] for each in zip(ends, roots[:, kept], strict=True)])
        self.forks = self.cells[self._at(self.left, forks[0, kept])]
        self.fork_heights = (self.forks[:, 1] - self.low[1]) / self.height
        self.pair_front, self.pair_low = self.front[ends].mean(axis=0), self.up[ends].min(axis=0)

    @cached_property
    def bulges(self) -> NDArray[np.float64]:
        """Largest thickness (k,) near each end."""
        near = (way[along <= BULGE_LENGTH * self.size] for way, along in zip(self.ways, self.along, strict=True))
        return np.array([self.depth[way].max() for way in near]) / self.size

    @cached_property
    def pair_measures(self) -> Measures:
        """What is measured of each pair (p,)."""
        low, apart, lies = self.pair_low, self.apart, float(self.lies)
        ends, root = self.places[[self.left, self.right]], self.roots.mean(axis=0)
        length = self.pair_lengths.mean(axis=0)
        widths = (np.abs(sides[0, :, 0] - sides[1, :, 0]) for sides in (ends, self.roots))
        place, outwards = ends.mean(axis=0), np.subtract(*widths) / 2
        runs = np.stack([root[:, 1] - place[:, 1], outwards, place[:, 2] - root[:, 2]]) / self.size
        down, aside, forward = np.clip(runs / np.maximum(length, 1e-9), -1.5, 1.5)
        alike = (self.unlike[0] < 0.12) & (self.unlike[1] < 0.4) & (length > 0.06)
        others = alike & (np.abs(self.pair_front[:, None] - self.pair_front) < 0.2)
        higher, wider = low - low[:, None], apart - apart[:, None]
        lowest = ~(others & (higher < -0.03)).any(axis=1)
        inside = (others & (wider < -0.05) & (np.abs(higher) < 0.15)).any(axis=1)
        outside = (others & (wider > 0.05) & (np.abs(higher) < 0.25)).any(axis=1)
        return {
            "bias": np.ones(len(low)),
            "on the ground": np.exp(-low / GROUND_HEIGHT),
            "lower end": low,
            "upper end": self.up[[self.left, self.right]].max(axis=0),
            "root height": (root[:, 1] - self.low[1]) / self.height,
            "down": down,
            "aside": aside,
            "forward": forward,
            "front": self.pair_front,
            "off the middle": np.abs(self.pair_front),
            "length": length,
            "shorter length": self.pair_lengths.min(axis=0),
            "thickness": self.thickness,
            "share of the thickest": self.thickness * self.size / self.thickest,
            "bulge": self.bulges[[self.left, self.right]].mean(axis=0),
            "distance": apart,
            "share of the width": apart * self.size / max(float(self.high[0] - self.low[0]), 1e-9),
            "unlike places": self.unlike[0],
            "unlike lengths": self.unlike[1],
            "unlike thicknesses": self.unlike[2],
            "ends of curves": (self.is_tip[self.left] & self.is_tip[self.right]).astype(float),
            "lowest": lowest.astype(float),
            "another inside": inside.astype(float),
            "lowest with another inside": (lowest & inside).astype(float),
            "another outside": outside.astype(float),
            "fork height": self.fork_heights,
            "length to the fork": self.fork_lengths.mean(axis=0),
            "lies": np.full(len(low), lies),
            "length down": length * down,
            "lower end if it lies": lies * low,
        }

    @cached_property
    def single_measures(self) -> Measures:
        """What is measured of each end (k,)."""
        count, lies, length = len(self.tips), float(self.lies), self.lengths / self.size
        number = np.arange(count)
        runs = (self.places - self.cells[self._at(number, self.begins)]) / np.maximum(self.lengths, 1e-9)[:, None]
        _, up, forward = np.clip(runs, -1.5, 1.5).T
        twins = (self.unlike[0] < 0.06) & (self.apart > 0.08)
        near = np.abs(self.aside) < 0.06
        outermost = {
            name: (values >= values[near].max(initial=-np.inf) - 0.02) & near.any()
            for name, values in (("top", self.up), ("front", self.front), ("back", -self.front))
        }
        return {
            "bias": np.ones(count),
            "height": self.up,
            "front": self.front,
            "aside": np.abs(self.aside),
            "up": up,
            "forward": forward,
            "length": length,
            "thickness": self._thickness(number, self.begins),
            "bulge": self.bulges,
            "share of the thickest": self.bulges * self.size / self.thickest,
            "has a twin": np.isin(number, [*self.left[twins], *self.right[twins]]).astype(float),
            "end of a curve": self.is_tip.astype(float),
            "lies": np.full(count, lies),
            "front if it lies": lies * self.front,
            "height if it lies": lies * self.up,
            "at the top": outermost["top"].astype(float),
            "at the front": outermost["front"].astype(float),
            "at the back": outermost["back"].astype(float),
            "on the ground": np.exp(-self.up / GROUND_HEIGHT),
            "distance": np.linalg.norm(self.places - self.middle, axis=1) / self.size,
            "length backwards": -length * forward,
        }

    @cached_property
    def same(self) -> NDArray[np.bool_]:
        """Whether two ends (k, k) are of one limb: their ways meet close to them."""
        shared = np.array(
            [
                [self.lengths[one] - self.along[one][meet] for meet in np.minimum(meets, self.begins[one])]
                for one, meets in enumerate(self.meets)
            ]
        ).reshape(self.meets.shape)
        alone = self.meets >= self.begins[:, None]
        close = shared > SAME_SHARE * self.lengths[:, None]
        return np.asarray(((close | close.T) & ~(alone | alone.T)) | np.eye(len(self.tips), dtype=bool))

    def clash(self, pair: int, chosen: tuple[int, ...]) -> bool:
        """Return whether a pair shares a limb with one of the chosen pairs."""
        return any(self.same[side[pair], side[list(chosen)]].any() for side in (self.left, self.right))


def _unlike(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the differences of two rows of values, as shares of the larger ones."""
    return np.asarray(np.abs(values[0] - values[1]) / np.maximum(values.max(axis=0), 1e-9))
