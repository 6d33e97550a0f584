"""Feet that stand: their surface stays on the floor while the legs above them move."""

import numpy as np
from numpy.typing import NDArray

from solver.model.bones import Bones

SOLE_HEIGHTS = 1.0, 1.5
"""Heights over the floor, in those of the ankle, up to which a leg's surface follows its foot alone, and from which it
does not need to."""

HEEL_LENGTHS = 0.5, 1.0
"""Distances from the ankle, in lengths of the foot, up to which a leg's surface at this height is the heel, and from
which it is a leg that lies on the floor, such as a frog's."""

MIN_LENGTH_HEIGHTS = 5.0
"""Smallest length of a foot in this sense, in heights of the ankle: below a stout leg the bone of the foot is short."""


def feet_held(
    shares: NDArray[np.float64], vertices: NDArray[np.float64], bones: Bones, plates: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Return shares with which soles follow their foot alone.

    In many files, and where heat spreads, soles also follow the shin or the hips a little, and would sink into the
    floor with them. A vertex of a foot follows the bone before it only near the ankle. A heel that the shin is nearer
    to follows the foot, but not a rigid plate of the shin.

    Parameters
    ----------
    shares : (n, b) float64
        Share of each bone in the motion of each vertex.
    vertices : (n, 3) float64
        In the units of the bones.
    bones : Bones
    plates : (n,) bool
        Vertices of parts that one bone moves alone.

    Returns
    -------
    (n, b) float64
    """
    shares = shares.copy()
    owner = shares.argmax(axis=1)
    heights = vertices @ bones.up
    for foot in bones.feet:
        away = np.linalg.norm(vertices - bones.heads[foot], axis=1) / bones.lengths[foot]
        of_foot = np.flatnonzero(owner == foot)
        own = shares[of_foot, foot - 1 : foot + 1]
        shin = np.maximum(1 - away[of_foot], 0) * own[:, 0] / own.sum(axis=1)
        shares[of_foot] = 0.0
        shares[of_foot, foot - 1], shares[of_foot, foot] = shin, 1 - shin
        of_leg = np.flatnonzero((bones.limbs[owner] == bones.limbs[foot]) & (shares.max(axis=1) > 0))
        floor = heights[of_leg].min(initial=np.inf)
        ankle = bones.heads[foot] @ bones.up
        if ankle > floor:
            blended = of_leg[~plates[of_leg]]
            sole = _fading((heights[blended] - floor) / (ankle - floor), *SOLE_HEIGHTS)
            longer = max(1.0, MIN_LENGTH_HEIGHTS * (ankle - floor) / bones.lengths[foot])
            sole *= _fading(away[blended] / longer, *HEEL_LENGTHS)
            shares[blended] *= 1 - sole[:, None]
            shares[blended, foot] += sole
    return shares


def _fading(values: NDArray[np.float64], low: float, high: float) -> NDArray[np.float64]:
    """Return 1 up to a value, 0 from another one on, and a straight line between them."""
    return 1 - np.clip((values - low) / (high - low), 0, 1)
