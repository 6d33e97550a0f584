"""Curves in the middle of a character's limbs: a tree inside its solid, from the thickest place to every end."""

import heapq
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from puppetline.compiled import compiled
from solver.anatomy.solid import Solid

MIN_END_RATIO = 1.8
"""Minimum distance of an end from the tree, as a multiple of the tree's distance to the surface; the corner of a box is
closer."""

MIN_END_LENGTH = 0.04
"""Minimum distance of an end beyond that, as a share of the diagonal."""

MAX_END_COUNT = 24
"""Maximum number of ends."""


@dataclass(frozen=True, eq=False)
class CurveSkeleton:
    """A tree of cells.

    Attributes
    ----------
    solid : Solid
    parents : (n,) int64
        Next cell on the path to the root, for every cell of the solid; −1 for the root.
    tips : (k,) int64
        Cells at the ends of limbs, the longest limb first.
    """

    solid: Solid
    parents: NDArray[np.int64]
    tips: NDArray[np.int64]

    def path(self, cell: int) -> list[int]:
        """Return the cells from a cell to the root."""
        cells = [int(cell)]
        while self.parents[cells[-1]] >= 0:
            cells.append(int(self.parents[cells[-1]]))
        return cells

    def between(self, start: int, end: int) -> list[int]:
        """Return the cells from one cell to another along the tree."""
        there, back = self.path(start), self.path(end)
        shared = set(there) & set(back)
        fork = next(cell for cell in there if cell in shared)
        return there[: there.index(fork) + 1] + back[: back.index(fork)][::-1]

    def beyond(self, cell: int) -> NDArray[np.bool_]:
        """Return which cells (n,) have a cell on their path to the root."""
        return np.asarray(_beyond(self.parents, cell))

    def fork(self, start: int, end: int) -> int:
        """Return the cell where the paths from two cells to the root meet."""
        back = set(self.path(end))
        return next(cell for cell in self.path(start) if cell in back)


def curve_skeleton(solid: Solid) -> CurveSkeleton:
    """Find the ends of limbs, and paths to them in the middle of the solid.

    The paths are the shortest if a step costs its length divided by the square of the distance to the surface. The tree
    starts at the thickest place; the cell that is farthest from it, inside the solid, is the next end (Sato et al.,
    *TEASAR*, 2000).

    Parameters
    ----------
    solid : Solid
    """
    steps = solid.graph.tocoo()
    thickness = np.minimum(solid.depth[steps.row], solid.depth[steps.col])
    costs = csr_matrix((steps.data * (solid.size / thickness) ** 2, (steps.row, steps.col)), steps.shape)
    root = int(solid.depth.argmax())
    _, before = dijkstra(costs, directed=False, indices=np.array([root]), return_predecessors=True)
    parents = np.maximum(before[0], -1).astype(np.int64)
    both = csr_matrix(solid.graph + solid.graph.T)
    diagonal = float(np.linalg.norm(np.ptp(solid.centers, axis=0)))
    uncovered = np.full(len(parents), np.inf)
    on_tree = np.zeros(len(parents), dtype=bool)
    branch, tips = [root], list[int]()
    while True:
        on_tree[branch] = True
        cells = np.array(branch, dtype=np.int64)
        _relax(both.indptr, both.indices, both.data, uncovered, cells, -MIN_END_RATIO * solid.depth[cells])
        tip = int(uncovered.argmax())
        if uncovered[tip] < MIN_END_LENGTH * diagonal or len(tips) == MAX_END_COUNT:
            return CurveSkeleton(solid, parents, np.array(tips, dtype=np.int64))
        tips.append(tip)
        branch = [tip]
        while not on_tree[branch[-1]]:
            branch.append(int(parents[branch[-1]]))


@compiled
def _relax(starts, neighbours, lengths, distance, cells, values):
    """Lower the distances on a graph to the smallest sum of a cell's value and the distance from it (Dijkstra 1959).

    Parameters
    ----------
    starts : (n + 1,) int
    neighbours : (e,) int
    lengths : (e,) float64
        Adjacency in compressed rows.
    distance : (n,) float64
        Updated in place.
    cells : (m,) int64
    values : (m,) float64
    """
    waiting = [(np.inf, np.int64(-1))]
    for i in range(len(cells)):
        if values[i] < distance[cells[i]]:
            distance[cells[i]] = values[i]
            heapq.heappush(waiting, (values[i], cells[i]))
    while True:
        reached, cell = heapq.heappop(waiting)
        if cell < 0:
            break
        if reached > distance[cell]:
            continue
        for j in range(starts[cell], starts[cell + 1]):
            further = reached + lengths[j]
            if further < distance[neighbours[j]]:
                distance[neighbours[j]] = further
                heapq.heappush(waiting, (further, np.int64(neighbours[j])))


@compiled
def _beyond(parents, cell):
    """Return which cells (n,) of a tree have a cell on their path to the root."""
    unknown, outside, inside = 0, 1, 2
    state = np.zeros(len(parents), np.int8)
    state[cell] = inside
    for start in range(len(parents)):
        last = start
        while state[last] == unknown and parents[last] >= 0:
            last = parents[last]
        found = state[last] if state[last] != unknown else outside
        way = start
        while state[way] == unknown:
            state[way] = found
            if parents[way] < 0:
                break
            way = parents[way]
    return state == inside
