"""Limbs that are not visible, by the proportions of people: legs under a skirt, arms that touch the body."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from solver.anatomy.limb_curve import UPPER_ARM_SHARE, WRIST_SHARE

SHOULDER_WIDTH_SHARE = 0.7
"""Distance of hidden shoulders from the middle, as a share of half the body's width."""

HIDDEN_LEG_RATIO = 1.3
"""Minimum length of the arms, as a multiple of the visible length of the legs, at which a skirt hides the rest of the
legs."""

LONG_LEG_RATIO, MAX_HEM_SHARE = 0.75, 0.1
"""Length of the arms, as a share of that of the legs, below which hips are raised to the usual height, because the hem
of a skirt hides them; and the maximum raise, as a share of the body's height."""

HIP_HEIGHT_SHARE, HIP_WIDTH_SHARE = 0.63, 0.5
"""Height of the hips, and the distance between them, as shares of those of the shoulders."""


def hidden_arm(
    root: NDArray[np.float64], beside: NDArray[np.float64], hand: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the joints (4, 3) of an arm that touches the body: straight from the shoulder to a given end.

    Parameters
    ----------
    root : (3,) float64
        The middle between the shoulders.
    beside : (3,) float64
        Vector from there to the side of the body.
    hand : (3,) float64
    """
    shoulder = root + SHOULDER_WIDTH_SHARE * beside
    shares = np.array([0.0, UPPER_ARM_SHARE * WRIST_SHARE, WRIST_SHARE, 1.0])[:, None]
    return np.asarray(shoulder + shares * (hand - shoulder))


def lengthened(
    legs: Sequence[NDArray[np.float64]],
    arms: Sequence[NDArray[np.float64]],
    middle: float,
    ground: float,
    height: float,
) -> tuple[list[NDArray[np.float64]], bool]:
    """Return legs, lengthened if a skirt hides them.

    Parameters
    ----------
    legs, arms : 2 of (4, 3) float64
        Joints: left, up, front.
    middle, ground, height : float
        Position of the trunk from left to right, height of the ground, and height of the body.

    Returns
    -------
    legs : 2 of (4, 3) float64
    hidden : bool
        Whether hips and knees are hidden entirely.
    """
    seen, reach = (
        np.mean([np.linalg.norm(np.diff(points[:3], axis=0), axis=1).sum() for points in limbs])
        for limbs in (legs, arms)
    )
    usual = ground + HIP_HEIGHT_SHARE * (np.mean([arm[0, 1] for arm in arms]) - ground)
    result = [leg.copy() for leg in legs]
    for leg, arm in zip(result, arms, strict=True):
        if reach < LONG_LEG_RATIO * seen:
            leg[0, 1] = max(leg[0, 1], min(usual, leg[0, 1] + MAX_HEM_SHARE * height))
        elif reach >= HIDDEN_LEG_RATIO * seen:
            leg[0] = middle + HIP_WIDTH_SHARE * (arm[0, 0] - middle), usual, leg[2, 2]
            leg[1] = (leg[0] + leg[2]) / 2
    return result, bool(reach >= HIDDEN_LEG_RATIO * seen)
