"""Which order of joints unnamed positions have: that in which the body has a person's proportions.

`capture/joint_sets.toml` has the orders that programs and data sets use.
"""

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from capture.formats import image_positions
from capture.formats.clips import refuse_nobody
from capture.formats.layouts import HOLISTIC, JOINT_SETS
from capture.formats.placement import bone_length
from capture.formats.positions import is_person, select
from capture.formats.proportions import MAX_BONE_RATIO, bone_ratios, refuse_flat, uneven_sides
from capture.skeleton import JOINT_INDEX, PARENTS
from puppetline.errors import SkeletonLogError

Floats = NDArray[np.float64]

SAMPLE_FRAMES = 60
"""Number of frames by which sets are compared."""

MAX_MISFIT = 0.75
"""Largest misfit of a person; recordings of sensors have up to 0.7, wrong orders at least 1.0."""

MAX_MISFITS = {name: 1.6 for name in ("mediapipe", *HOLISTIC) if name.startswith("mediapipe")}
"""The same for landmarks in images, whose depths are rough; no other sets have as many joints."""

MAX_CENTRE_SHARE = 0.6
"""Maximum distance of the centres of hips and shoulders from their joints, as a share of the trunk's length."""

_LEFT, _RIGHT = ([index for index, joint in enumerate(PARENTS) if joint.endswith(side)] for side in ("left", "right"))

CLEAR_RATIO = 1.15
"""How much worse the next best set must be."""


_OTHERS = {21: "a hand", 68: "a face", 468: "a face", 478: "a face"}
"""What else has so many points in common trackers."""


class Fit(NamedTuple):
    """How well a set fits: from 0, and the positions of the 20 joints that it leads to."""

    misfit: float
    name: str
    points: Floats


class UnclearOrderError(SkeletonLogError):
    """Several orders of joints give a person."""


def fits(positions: Floats, names: Sequence[str]) -> list[Fit]:
    """Return the sets, of those with these names, in which a body has a person's proportions, the best one first.

    Parameters
    ----------
    positions : (T, J, 3) float64
    names : sequence of str
        Names of sets of J joints.
    """
    known = np.flatnonzero((np.isfinite(positions) & (positions != 0)).any(axis=(1, 2)))
    sample = positions[known[:: max(1, len(known) // SAMPLE_FRAMES)]]
    found = []
    for name in names:
        points = select(Path(name), JOINT_SETS[name], sample).points
        points = points * image_positions.unit_of(points)[0]
        with warnings.catch_warnings(action="ignore"):  # joints that are always lost
            misfit = _misfit(points, may_be_rough=name in MAX_MISFITS)
        if misfit < MAX_MISFITS.get(name, MAX_MISFIT):
            found.append(Fit(misfit, name, points))
    return sorted(found, key=lambda fit: fit.misfit)


def _misfit(points: Floats, *, may_be_rough: bool) -> float:
    """Return how far points (T, 20, 3) are from a person: 0 for a typical one of constant size, infinite for none.

    The sides of one whose depths may be rough can differ.
    """
    deviations = np.abs(np.log(bone_ratios(points)))
    lengths = np.array([bone_length(points, *bone) for bone in PARENTS.items()])
    lengths = lengths / np.nanmean(lengths, axis=0)  # the person of an image changes in size
    means = np.nanmean(lengths, axis=1)
    spread = np.nanmedian(np.nanstd(lengths, axis=1) / means)
    uneven = np.nanmean(np.abs(np.log(means[_LEFT] / means[_RIGHT])))
    trunk = np.nanmedian(bone_length(points, "shoulder_center", "hip_center"))
    off = [
        np.nanmedian(np.linalg.norm(_at(points, centre) - (_at(points, left) + _at(points, right)) / 2, axis=1))
        for centre, left, right in (
            ("hip_center", "hip_left", "hip_right"),
            ("shoulder_center", "shoulder_left", "shoulder_right"),
        )
    ]
    away = np.nanmax([*off, 0.0]) / trunk
    is_even = may_be_rough or not uneven_sides(points)
    if not (np.nanmax(deviations) < np.log(MAX_BONE_RATIO) and is_even and away < MAX_CENTRE_SHARE):
        return np.inf
    return float(np.nanmean(deviations) + spread + np.nan_to_num(uneven) + away)


def _at(points: Floats, joint: str) -> Floats:
    return points[:, JOINT_INDEX[joint]]


def joint_set(path: Path, positions: Floats, chosen: str | None = None, found: str = "positions") -> str:
    """Return the name of the set of joints that positions (T, J, 3) without names have.

    Parameters
    ----------
    path : Path
        The recording, for error messages.
    positions : (T, J, 3) float64
    chosen : str, optional
        The set that the user named.
    found : str
        What the file is, for error messages.

    Raises
    ------
    SkeletonLogError
        No set fits, or several do.
    """
    count = positions.shape[1]
    names = [name for name, joints in JOINT_SETS.items() if len(joints) == count]
    if chosen is not None:
        if chosen not in names:
            raise SkeletonLogError(
                path,
                found=f"{found} of {count} joints, and the joint set {chosen!r}",
                expected=f"one of {', '.join(names)}" if names else "a joint set of as many joints",
                fix="Choose another one with --joints.",
            )
        return chosen
    if len(names) == 1 and names[0] in MAX_MISFITS:
        return names[0]
    best = fits(positions, names)
    if not best:
        refuse_nobody(path, positions)
        refuse_image(path, positions)
        raise SkeletonLogError(
            path,
            found=f"{found} of {count} joints without names, in no order that gives a person{as_of(count)}",
            expected=f"a person in the order of {' or '.join(names)}" if names else "joints in a known order",
            fix="Name the order with --joints, or the columns with --columns.",
        )
    return clearest(path, best, f"{found} of {count} joints").name


def refuse_image(path: Path, positions: Floats) -> None:
    """Raise the error of `refuse_flat` if positions (T, J, 3) without names are in a plane; those at zero are lost."""
    at_zero = (positions[..., :2] == 0).any(axis=2, keepdims=True)  # of which only the score may differ
    refuse_flat(path, np.where(at_zero, np.nan, positions))


def numbered(
    path: Path, numbers: Sequence[int], positions: Floats, chosen: str | None = None, found: str = "positions"
) -> tuple[list[str], list[int]]:
    """Return the names of joints with numbers, in the order of the numbers, and the order itself.

    The numbers count a set's joints from 0 or 1, or are those of some of its joints from 0. The parameters are those of
    `joint_set`, whose errors are raised; `positions` are in the order of `numbers`.
    """
    order = sorted(range(len(numbers)), key=numbers.__getitem__)
    own, points = [numbers[index] for index in order], positions[:, order]
    count = len(own)
    refused = None
    if own in (list(range(count)), list(range(1, count + 1))):
        try:
            return list(JOINT_SETS[joint_set(path, points, chosen, found)]), order
        except UnclearOrderError:
            raise
        except SkeletonLogError as error:  # they may be the first joints of a larger set
            refused = error
    parts = {name: joints for name, joints in JOINT_SETS.items() if len(joints) > max(own[-1], count)}
    names = [name for name in parts if chosen in (None, name) and is_person([parts[name][k] for k in own])]
    if len(names) > 1 or (refused and not chosen):
        fitting = []
        for name in names:
            padded = np.full((len(points), len(parts[name]), 3), np.nan)
            padded[:, own] = points
            fitting += fits(padded, [name])
        names = [clearest(path, fitting, f"{found} of joints with numbers").name] if fitting else names
        refused = None if fitting else refused
    if len(names) == 1 and not (refused and not chosen):
        return [JOINT_SETS[names[0]][k] for k in own], order
    listed = f"{own[0]} to {own[-1]}" if own[-1] - own[0] == count - 1 else ", ".join(map(str, own))[:80]
    raise refused or SkeletonLogError(
        path,
        found=f"{found} of joints with the numbers {listed}, which are no person's",
        expected=f"a person in the order of {' or '.join(names)}" if names else "joints in a known order",
        fix="Name the order with --joints, or the columns with --columns.",
    )


def as_of(count: int) -> str:
    """Return what is no person and has so many points in common trackers, for messages; "" if nothing is known."""
    return f", as {_OTHERS[count]} has" if count in _OTHERS else ""


def clearest(path: Path, found: Sequence[Fit], what: str) -> Fit:
    """Return the best of several fits.

    Raises
    ------
    UnclearOrderError
        Another one, which leads to other positions, is nearly as good.
    """
    best, *others = sorted(found, key=lambda fit: fit.misfit)
    unclear = [
        fit
        for fit in others
        if fit.misfit < CLEAR_RATIO * best.misfit and not np.array_equal(fit.points, best.points, equal_nan=True)
    ]
    if unclear:
        orders = " and of ".join(dict.fromkeys(fit.name for fit in (best, *unclear)))
        raise UnclearOrderError(
            path,
            found=f"{what} without names, which are a person in the order of {orders}",
            expected="one order",
            fix=f"Choose it, for example with --joints {best.name}.",
        )
    return best
