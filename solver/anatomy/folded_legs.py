"""Joints of folded legs, such as those of birds and robots.

A curve skeleton takes the shortest way, which cuts the corner of a folded knee. The middle of a leg's cross-sections
does not.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from solver.anatomy.curve_skeleton import CurveSkeleton
from solver.anatomy.limb_curve import LimbCurve, below_axle, three_bones

FOLDED_DEGREES = 60.0
"""Angle of the knee in degrees, 0 for a straight leg, from which a leg is folded."""

MAX_MISFIT = 0.03
"""Maximum root mean square distance of the middles from three straight bones, as a share of the leg's length. Under a
skirt it is larger."""

MAX_HIP_RATIO = 1.8
"""Maximum thickness of a leg at the hip, as a multiple of the median over the outer half of its curve."""

SPRAWLING_JOINTS = 0.22, 0.6
"""Usual places of the ankle and the knee of a leg that sprawls, as shares of the way from the end of the foot."""

SECTION_COUNT = 41
"""Number of cross-sections of a leg."""

ROUND_COUNT = 3
"""Number of times that cells are assigned to cross-sections, each time along the curve through the last middles."""


def folded_leg(skeleton: CurveSkeleton, leg: LimbCurve, top: float) -> NDArray[np.float64] | None:
    """Return the joints of a leg if it is folded at the knee.

    Parameters
    ----------
    skeleton : CurveSkeleton
    leg : LimbCurve
    top : float
        Distance from the end of the leg at which the two legs part.

    Returns
    -------
    (4, 3) float64 or None
        Hip, knee, ankle and the end of the foot; None if the leg is not folded, or is not three straight bones.
    """
    hip = below_axle(leg, top)
    joints, misfit = three_bones(_middles(skeleton, leg, hip, with_heel=False))
    thigh, shin = joints[2] - joints[3], joints[1] - joints[2]
    cosine = thigh @ shin / max(float(np.linalg.norm(thigh) * np.linalg.norm(shin)), 1e-12)
    if cosine > np.cos(np.radians(FOLDED_DEGREES)) or misfit > MAX_MISFIT * hip:
        return None
    return np.array([*joints[:0:-1], leg.at(0.0)])


def sprawling_leg(skeleton: CurveSkeleton, leg: LimbCurve) -> NDArray[np.float64]:
    """Return the joints (4, 3) of a leg that does not stand below the body, as those of frogs and spiders.

    Its hip is where the curve begins to lead into a thicker body.

    Parameters
    ----------
    leg : LimbCurve
    """
    thin = np.flatnonzero(leg.depth < MAX_HIP_RATIO * np.median(leg.depth[leg.along < 0.5 * leg.length]))
    joints, _ = three_bones(_middles(skeleton, leg, float(leg.along[thin[-1]]), with_heel=True), usual=SPRAWLING_JOINTS)
    return np.array([*joints[:0:-1], leg.at(0.0)])


def _middles(skeleton: CurveSkeleton, leg: LimbCurve, hip: float, *, with_heel: bool) -> NDArray[np.float64]:
    """Return the middles (`SECTION_COUNT`, 3) of the cross-sections of a leg, from its end to the hip."""
    cells, ways = _cells_of(skeleton, leg, hip, with_heel)
    middles = _section_middles(cells, ways, hip)
    for _ in range(ROUND_COUNT - 1):
        middles = _section_middles(cells, _ways_along(middles, cells, hip), hip)
    return middles


def _section_middles(cells: NDArray[np.float64], ways: NDArray[np.float64], hip: float) -> NDArray[np.float64]:
    """Return the weighted means (`SECTION_COUNT`, 3) of cells at evenly spaced distances up to the hip."""
    width = hip / (SECTION_COUNT - 1)
    sections = width * np.arange(SECTION_COUNT)
    weights = np.exp(-0.5 * ((ways - sections[:, None]) / width) ** 2)
    return weights @ cells / np.maximum(weights.sum(axis=1, keepdims=True), 1e-300)


def _ways_along(middles: NDArray[np.float64], cells: NDArray[np.float64], hip: float) -> NDArray[np.float64]:
    """Return the distances (m,) of cells from the first middle, along the curve through all; the last is at `hip`."""
    steps = np.linalg.norm(np.diff(middles, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    fine = np.linspace(0.0, along[-1], 10 * SECTION_COUNT)
    curve = np.column_stack([np.interp(fine, along, column) for column in middles.T])
    return fine[cKDTree(curve).query(cells)[1]] * hip / along[-1]


def _cells_of(
    skeleton: CurveSkeleton, leg: LimbCurve, hip: float, with_heel: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the centres (m, 3) of the cells nearest to a leg, inside the solid, and their distances from its end.

    With a heel, what branches off the leg belongs to it, such as the heel and the knee of a frog.
    """
    solid = skeleton.solid
    own = set(leg.cells[leg.along < hip].tolist()) if with_heel else set[int]()
    paths = [skeleton.path(int(tip)) for tip in skeleton.tips]
    others = np.array([cell for path in paths if own.isdisjoint(path) for cell in path], dtype=np.int64)
    way = np.full(len(solid.centers), np.inf)
    way[leg.cells] = np.where(leg.along < hip, leg.along, np.inf)
    sources = np.union1d(others, leg.cells)
    _, _, nearest = dijkstra(solid.graph, directed=False, indices=sources, min_only=True, return_predecessors=True)
    ways = np.where(nearest < 0, np.inf, way[nearest])
    mine = np.isfinite(ways)
    return solid.centers[mine], ways[mine]
