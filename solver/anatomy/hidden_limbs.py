"""Limbs that do not show, by the proportions of people: legs under a skirt, arms that are one with the body."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from solver.anatomy.limb_curve import UPPER_ARM, WRIST

SHOULDER_WIDTH = 0.7
"""Where shoulders are that do not show, as a share of half the body's width."""

HIDDEN = 1.3
"""Where arms are this many times as long as what is seen of the legs, the rest of those is under a skirt."""

LONG_LEGS, HEM = 0.75, 0.1
"""Where arms are no longer than the first share of the legs, hips are no lower than people's: a skirt hides them, but
no more of them than the second share of the height."""

HIP_HEIGHT, HIP_WIDTH = 0.63, 0.5
"""Height of the hips, and distance between them, as a share of those of the shoulders."""


def hidden_arm(
    root: NDArray[np.float64], beside: NDArray[np.float64], hand: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the joints (4, 3) of an arm that is one with the body: straight from the shoulder to a known end.

    Parameters
    ----------
    root : (3,) float64
        The middle between the shoulders.
    beside : (3,) float64
        From there to the body's side.
    hand : (3,) float64
    """
    shoulder = root + SHOULDER_WIDTH * beside
    shares = np.array([0.0, UPPER_ARM * WRIST, WRIST, 1.0])[:, None]
    return np.asarray(shoulder + shares * (hand - shoulder))


def uncovered(
    legs: Sequence[NDArray[np.float64]],
    arms: Sequence[NDArray[np.float64]],
    middle: float,
    ground: float,
    height: float,
) -> tuple[list[NDArray[np.float64]], bool]:
    """Lengthen legs that a skirt hides.

    Parameters
    ----------
    legs, arms : 2 of (4, 3) float64
        Joints: left, up, front.
    middle, ground, height : float
        The trunk's place from left to right, the lowest place, and the body's height.

    Returns
    -------
    legs : 2 of (4, 3) float64
    hidden : bool
        Whether hips and knees do not show at all.
    """
    seen, reach = (
        np.mean([np.linalg.norm(np.diff(points[:3], axis=0), axis=1).sum() for points in limbs])
        for limbs in (legs, arms)
    )
    usual = ground + HIP_HEIGHT * (np.mean([arm[0, 1] for arm in arms]) - ground)
    result = [leg.copy() for leg in legs]
    for leg, arm in zip(result, arms, strict=True):
        if reach < LONG_LEGS * seen:
            leg[0, 1] = max(leg[0, 1], min(usual, leg[0, 1] + HEM * height))
        elif reach >= HIDDEN * seen:
            leg[0] = middle + HIP_WIDTH * (arm[0, 0] - middle), usual, leg[2, 2]
            leg[1] = (leg[0] + leg[2]) / 2
    return result, bool(reach >= HIDDEN * seen)
