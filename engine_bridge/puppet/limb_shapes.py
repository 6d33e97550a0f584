"""Usual shapes of arms and legs, and how well three joints of a chain fit one."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from solver.motion.limbs import distance_from_segment

END_SHARE = 0.2
"""Length of a hand or foot without a joint, as a share of the last bone and it."""

NAME_SCORE = 4.0
"""Score of a joint whose name says which joint of a limb it is."""

SHARE_DEVIATION, BESIDE_DEVIATION = 0.1, 0.04
"""Standard deviations of the lengths of a limb's bones, and of the distances from its bones of joints that are omitted,
as shares of the limb's length."""


@dataclass(frozen=True, eq=False)
class LimbShape:
    """Usual shape of a limb of three joints.

    Attributes
    ----------
    shares : (4,) float64
        Lengths of what is before the first joint, of the two bones, and of the end, as shares of the whole.
    parts : tuple of tuple of str
        Parts in the names of the three joints.
    """

    shares: NDArray[np.float64]
    parts: tuple[tuple[str, ...], ...]

    def fit(self, points: NDArray[np.float64], chosen: Sequence[int], parts: Sequence[str | None]) -> float:
        """Return how well joints fit this limb: a log likelihood.

        Parameters
        ----------
        points : (n + 1, 3) float64
            Joints from root to tip, and the end.
        chosen : sequence of int
            Rows of two or three joints.
        parts : sequence of (str or None)
            Parts in the names of the chosen joints.
        """
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        at, length = [along[row] for row in chosen], max(float(along[-1]), 1e-12)
        if len(chosen) < 3:
            at.append(at[-1] + (1 - END_SHARE) * (along[-1] - at[-1]))
        misfits = [*((np.diff([0.0, *at, along[-1]]) / length - self.shares) / SHARE_DEVIATION)]
        for one, other in pairwise(chosen):
            away = [distance_from_segment(points[row], points[one], points[other]) for row in range(one + 1, other)]
            misfits += [each / length / BESIDE_DEVIATION for each in away]
        named = sum(part in own for part, own in zip(parts, self.parts, strict=False))
        return float(NAME_SCORE * named - np.square(misfits).sum() / 2)


ARM = LimbShape(np.array([0.1, 0.38, 0.32, 0.2]), (("upperArm",), ("lowerArm",), ("hand", "palm")))
LEG = LimbShape(np.array([0.02, 0.44, 0.4, 0.14]), (("upperLeg", "leg"), ("lowerLeg", "leg"), ("foot",)))
