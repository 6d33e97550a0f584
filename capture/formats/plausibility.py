"""What no person's body does: recordings that have it are read with a note, or refused if nearly all frames have it.

Wrong names, orders or sides of joints, rotations in another order, frames of different people and turned pictures give
a body that is contorted, changes its size or leans.
"""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from capture.clip import SkeletonClip
from capture.formats.placement import bone_length
from capture.formats.proportions import BONES, other_proportions, uneven_sides
from capture.skeleton import JOINT_INDEX, LOST
from puppetline.errors import SkeletonLogError

Floats = NDArray[np.float64]

NECK_COSINE = -0.2
"""Cosine of the angle between trunk and neck from which the head hangs down further than a neck allows."""

THIGH_COSINE = -0.75
"""Cosine of the angle between a thigh and the trunk's front from which it points back further than a hip allows."""

KNEE_SHARE = -0.1
"""Distance of a knee to the front of the line from hip to ankle, as a share of the leg, below which it is broken."""

CONTORTED_SHARES = (0.2, 0.75)
"""Shares of frames with a contorted body from which there is a note, and an error; noisy sensors have up to 0.4."""

MAX_CHANGE, MAX_SPREAD = 0.1, 0.5
"""Median relative change of a bone's length from frame to frame, up to 0.08 in trackers with few images a second, and
its range over the recording beside the size of the body, up to 0.4."""

MAX_PROPORTIONS_CHANGE, MIN_FRAMES = 0.35, 20
"""Median relative change of a bone's length beside the size of the body, from frame to frame, above which positions are
no body's, and number of frames that tell it; recordings have up to 0.06, and many pictures of people 0.11."""

STRETCHED, STRETCHED_SHARE = 0.85, 0.5
"""A body is stretched out if its legs are this share of their length long, and have this cosine to the trunk; a note on
its lean requires that it is in this share of the frames."""

MAX_LEAN = 25.0
"""Median angle from upright at which nobody stands stretched out, in degrees; tilted sensors give up to 18."""


class _Changes(NamedTuple):
    """Median relative changes of bones.

    Attributes
    ----------
    lengths, proportions : float
        From frame to frame; proportions are lengths beside the size of the body.
    spread : float
        Range of the proportions over the recording.
    """

    lengths: float
    proportions: float
    spread: float


def checked(path: Path, clips: Sequence[SkeletonClip]) -> list[SkeletonClip]:
    """Return clips with notes on what no person's body does.

    Raises
    ------
    SkeletonLogError
        The bodies of all clips are contorted in nearly all frames, or have other proportions in each.
    """
    changes = [_changes(_points(clip)) for clip in clips]
    least = min((change.proportions for change in changes), default=0.0)
    if least > MAX_PROPORTIONS_CHANGE and all(clip.legs == 2 and len(clip.times) >= MIN_FRAMES for clip in clips):
        raise SkeletonLogError(
            path,
            found=f"a body whose proportions change by {100 * least:.0f} % from frame to frame",
            expected="a person's body",
            fix="Check that the file has positions of joints; in a table, --columns names them.",
        )
    contorted = [_contorted(_points(clip)) if clip.legs == 2 else {} for clip in clips]
    shares = [float(np.mean(np.any(list(each.values()), axis=0))) if each else 0.0 for each in contorted]
    if clips and min(shares) > CONTORTED_SHARES[1]:
        raise SkeletonLogError(
            path,
            found=f"a contorted body: {_listed(contorted[0])}",
            expected="a person's body",
            fix="Check the names, the order and the sides of the joints (--joints and --columns set them); "
            "in motion capture, the order of the rotations.",
        )
    return [
        replace(clip, notes=(*clip.notes, *_notes(_points(clip), each, share, change))) if clip.legs == 2 else clip
        for clip, each, share, change in zip(clips, contorted, shares, changes, strict=True)
    ]


def _notes(points: Floats, contorted: dict[str, NDArray[np.bool_]], share: float, change: _Changes) -> list[str]:
    notes = []
    if share > CONTORTED_SHARES[0]:
        notes.append(f"The body is contorted: {_listed(contorted)}. The tracking failed, or joints have wrong names.")
    by = (
        (change.lengths, "from frame to frame")
        if change.lengths > MAX_CHANGE
        else (change.spread, "over the recording")
    )
    if change.lengths > MAX_CHANGE or change.spread > MAX_SPREAD:
        cause = "The tracking failed, or they are different people."
        notes.append(f"Bones change their length by {100 * by[0]:.0f} % {by[1]}. {cause}")
    if listed := other_proportions(points):
        notes.append(f"The proportions are not those of a person: {listed}.")
    if listed := uneven_sides(points):
        notes.append(f"The sides of the body differ: {listed} on one side. The tracking failed, or joints are swapped.")
    lean = _lean(points)
    if lean > MAX_LEAN:
        notes.append(
            f"The body is stretched out and leans {lean:.0f}° from upright in most frames. If the performer stood, the "
            "camera was tilted or its pictures were turned: turn the positions, or the video, upright."
        )
    return notes


def _changes(points: Floats) -> _Changes:
    with warnings.catch_warnings(action="ignore"):  # joints that are lost
        lengths = np.log([bone_length(points, *bone) for bone in BONES])
        size = np.nanmedian(lengths - np.nanmedian(lengths, axis=1, keepdims=True), axis=0)
        high, low = np.nanpercentile(lengths - size, [90, 10], axis=1)
        steps = [np.abs(np.diff(each, axis=1)) for each in (lengths, lengths - size)]
    return _Changes(*(float(np.expm1(np.nan_to_num(_median(each)))) for each in (*steps, high - low)))


def _points(clip: SkeletonClip) -> Floats:
    return np.where(clip.confidence[..., None] > LOST, clip.positions, np.nan)


def _contorted(points: Floats) -> dict[str, NDArray[np.bool_]]:
    """Return for each thing that no body does in which frames (T,) of points (T, 20, 3) it does it."""

    def way(start: str, end: str) -> Floats:
        return _unit(points[:, JOINT_INDEX[end]] - points[:, JOINT_INDEX[start]])

    trunk, hips = way("hip_center", "shoulder_center"), way("hip_left", "hip_right")
    ahead = _unit(np.cross(trunk, hips))
    found = {
        "shoulders face away from where the hips face": _dot(way("shoulder_left", "shoulder_right"), hips) < 0,
        "the head is below the shoulders": _dot(way("shoulder_center", "head"), trunk) < NECK_COSINE,
    }
    thighs, knees = [], []
    for side in ("left", "right"):
        hip, knee, ankle = (points[:, JOINT_INDEX[f"{joint}_{side}"]] for joint in ("hip", "knee", "ankle"))
        length = np.linalg.norm(knee - hip, axis=1) + np.linalg.norm(ankle - knee, axis=1)
        thighs.append(_dot(_unit(knee - hip), ahead) < THIGH_COSINE)
        with np.errstate(all="ignore"):
            knees.append(_dot(knee - (hip + ankle) / 2, ahead) / length < KNEE_SHARE)
    return {**found, "thighs point backwards": np.any(thighs, axis=0), "knees bend forwards": np.any(knees, axis=0)}


def _listed(contorted: dict[str, NDArray[np.bool_]]) -> str:
    """Return the things that no body does, and in which shares of frames, the most frequent ones first."""
    shares = {thing: float(np.mean(each)) for thing, each in contorted.items()}
    shares = {thing: share for thing, share in shares.items() if share > max(shares.values()) / 10}
    return ", ".join(
        f"{thing} in {100 * shares[thing]:.0f} % of the frames"
        for thing in sorted(shares, key=lambda thing: -shares[thing])
    )


def _lean(points: Floats) -> float:
    """Return the median angle in degrees from upright of a body that is mostly stretched out; 0 of others."""
    hips, ankles = (
        (points[:, JOINT_INDEX[f"{joint}_left"]] + points[:, JOINT_INDEX[f"{joint}_right"]]) / 2
        for joint in ("hip", "ankle")
    )
    bones = [bone_length(points, *bone) for bone in BONES if bone[0].split("_")[0] in ("knee", "ankle")]
    trunk = _unit(points[:, JOINT_INDEX["shoulder_center"]] - hips)
    with np.errstate(all="ignore"):
        is_straight = np.linalg.norm(hips - ankles, axis=1) > STRETCHED * np.sum(bones, axis=0) / 2
    stretched = is_straight & (_dot(_unit(hips - ankles), trunk) > STRETCHED)
    body = _unit(points[:, JOINT_INDEX["head"]] - ankles)[stretched]
    if not len(body) or np.mean(stretched) < STRETCHED_SHARE:
        return 0.0
    return float(np.degrees(np.arccos(np.clip(_median(body[:, 1]), -1, 1))))


def _median(values: Floats) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else np.nan


def _dot(one: Floats, other: Floats) -> Floats:
    product: Floats = np.einsum("ti,ti->t", one, other)
    return product


def _unit(ways: Floats) -> Floats:
    with np.errstate(all="ignore"):
        unit: Floats = ways / np.linalg.norm(ways, axis=1, keepdims=True)
    return unit
