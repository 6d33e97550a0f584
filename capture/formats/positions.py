"""Named positions of a person in any unit and any axes, as tables, arrays and motion capture have them, as a clip.

Names tell which position is which joint (`capture.bone_names`). `capture.formats.placement` finds the rest. A head that
has no position continues the neck; a joint between two others is placed between them; any other joint is lost.
"""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from capture.body import TYPICAL_BONE_METRES, typical_bone_length
from capture.bone_names import find_bones, find_points
from capture.clip import SkeletonClip
from capture.formats.clips import DEFAULT_FPS, build_clip, frame_rate
from capture.formats.options import ReadOptions
from capture.formats.placement import bone_length, place
from capture.formats.skeleton_joints import BONES, MIDPOINTS
from capture.skeleton import INFERRED, JOINT_INDEX, JOINTS, LOST, PARENTS
from puppetline.errors import SkeletonLogError

Floats = NDArray[np.float64]

TYPICAL_TRUNK_METRES = TYPICAL_BONE_METRES["spine"] + TYPICAL_BONE_METRES["shoulder_center"]

SPINE_SHARE = TYPICAL_BONE_METRES["spine"] / TYPICAL_TRUNK_METRES
"""Distance of the spine from the hips, as a share of the trunk's length."""

WRIST_SHARE = 0.75
"""Distance of the wrist from the elbow, as a share of the hand's (`capture.formats.layouts`)."""

NECK_SHARE = TYPICAL_BONE_METRES["head"] / TYPICAL_TRUNK_METRES
"""Length of the neck and half of the head, as a share of the trunk's."""

MAX_BONE_RATIO = 2.0
"""How many times longer or shorter than a typical person's a bone can be, beside the other bones."""

_SIDES = "left", "right"
_LANDMARKS = {
    **{joint: (joint,) for joint in ("hip_center", "spine", "shoulder_center")},
    **{f"{joint}_{side}": (f"{joint}_{side}",) for joint in ("wrist", "ankle") for side in _SIDES},
    **{f"hand_{side}": (f"knuckle_{side}", f"hand_tip_{side}") for side in _SIDES},
    **{f"foot_{side}": (f"toe_{side}",) for side in _SIDES},
}
"""Points (`bone_names.find_points`) that each joint may be, in order of priority."""

_ENDS = {"hand": ("Hand", "wrist", "elbow"), "foot": ("Foot", "ankle", "")}
"""Joints at the ends of limbs: the bone of that name, the joint before, and the one before that, if its name counts.

Rigs call hand or foot where it begins, at wrist or ankle. In a skeleton that has these too, or an elbow, it is the end.
"""

_HEADS = (("ear_left", "ear_right"), ("eye_left", "eye_right"), ("nose",), ("head_top",))
"""Points whose middle replaces a head that has no name, in order of priority."""

_REQUIRED = ("hip_center", *(f"{joint}_{side}" for side in _SIDES for joint in ("shoulder", "elbow")))
"""Joints without which positions are no person's; all others may be lost."""

_BONES = tuple(
    (joint, parent) for joint, parent in PARENTS.items() if joint.split("_")[0] in ("elbow", "wrist", "knee", "ankle")
)
"""The long bones of the limbs, by which a person is recognised."""


@dataclass(frozen=True, slots=True)
class Selection:
    """The 20 joints among named positions.

    Attributes
    ----------
    points : (T, 20, 3) float64
        In the unit and axes of the file; NaN for lost joints.
    confidence : (T, 20) float32
    sources : dict
        Indices of the positions whose mean each joint is; without joints that are placed between others.
    front : (T, 3) float64
        Sum of the directions from heels or ankles to toes and from ears to the nose; NaN if unknown.
    notes : tuple of str
    """

    points: Floats
    confidence: NDArray[np.float32]
    sources: dict[str, tuple[int, ...]]
    front: Floats
    notes: tuple[str, ...]


def clip_of_positions(
    path: Path,
    log_format: str,
    names: Sequence[str],
    positions: Floats,
    options: ReadOptions,
    *,
    times: Floats | None = None,
    confidence: NDArray[np.float32] | None = None,
    notes: tuple[str, ...] = (),
) -> SkeletonClip:
    """Return the clip of one performer.

    Parameters
    ----------
    path : Path
        The recording, for error messages.
    log_format : str
        Name of the recording's format.
    names : sequence of str
        The J names, in the words of any program.
    positions : (T, J, 3) float64
        In any unit and axes. Positions that are NaN or exactly (0, 0, 0) are lost.
    options : ReadOptions
        `up` and `unit` replace what is detected, `fps` is the rate without `times`.
    times : (T,) float64, optional
        Seconds.
    confidence : (T, J) float32, optional
        1 tracked, 0.5 inferred, 0 lost.
    notes : tuple of str

    Raises
    ------
    SkeletonLogError
        Joints of a person are missing, or the positions are no person's.
    """
    positions, image_notes = without_image_shares(names, positions)
    body = select(path, names, positions, confidence)
    refuse_other_bodies(path, body.points)
    where = place(path, body.points, body.front, options, is_picture=bool(image_notes))
    if times is None:
        fps, rate_notes = frame_rate(options, DEFAULT_FPS)
        times, notes = np.arange(len(positions)) / fps, (*notes, *rate_notes)
    notes = (*notes, *image_notes, *body.notes, *where.notes)
    return build_clip(path, log_format, times, where.apply(body.points), body.confidence, notes)


def select(
    path: Path, names: Sequence[str], positions: Floats, confidence: NDArray[np.float32] | None = None
) -> Selection:
    """Select the 20 joints among named positions; the parameters are those of `clip_of_positions`.

    Raises
    ------
    SkeletonLogError
        Joints of a person are missing among the names.
    """
    sources, landmarks = _sources(names)
    if missing := _missing(sources):
        listed = ", ".join(names)
        raise SkeletonLogError(
            path,
            found=f"no position for {', '.join(missing)} among {listed[:200]}{' …' if len(listed) > 200 else ''}",
            expected="the joints of a person, for example ShoulderLeft, left_knee or RWrist",
            fix="Rename the joints, or name the columns that have them with --columns.",
        )
    given = np.ones(positions.shape[:2], np.float32) if confidence is None else confidence
    at_origin = (positions == 0).all(axis=2)
    at_origin &= ~_is_origin(positions, at_origin)
    given = np.where(at_origin | ~np.isfinite(positions).all(axis=2), np.float32(LOST), given)
    known = np.where(given[..., None] > LOST, positions, np.nan)
    points = np.full((len(positions), len(JOINTS), 3), np.nan)
    sure = np.zeros((len(positions), len(JOINTS)), np.float32)
    for joint, indices in sources.items():
        points[:, JOINT_INDEX[joint]] = known[:, list(indices)].mean(axis=1)
        sure[:, JOINT_INDEX[joint]] = given[:, list(indices)].min(axis=1)
    notes = _fill(points, sure, sources)
    return Selection(points, sure, sources, _front(known, landmarks, sources), notes)


def is_person(names: Sequence[str]) -> bool:
    """Return whether names are those of a person's joints, or of enough of them."""
    return not _missing(_sources(names)[0])


def _missing(sources: Mapping[str, object]) -> list[str]:
    found = {*sources, *(joint for joint, pair in MIDPOINTS.items() if sources.keys() >= set(pair))}
    return [joint for joint in _REQUIRED if joint not in found]


def _is_origin(positions: Floats, at_origin: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which positions (J,) are the origin of the coordinates, and therefore known: one in the body's middle."""
    is_lost = ~np.isfinite(positions).any(axis=2)
    always = np.all(at_origin | is_lost, axis=0) & np.any(at_origin, axis=0)
    others = positions[:, ~always].reshape(-1, 3)
    is_inside = len(others) > 0 and (np.nanmin(others, axis=0) <= 0).all() and (np.nanmax(others, axis=0) >= 0).all()
    return always if np.count_nonzero(always) == 1 and is_inside else np.zeros_like(always)


def _sources(names: Sequence[str]) -> tuple[dict[str, tuple[int, ...]], dict[str, list[int]]]:
    """Return the positions of each of the 20 joints, and of all landmarks."""
    landmarks = find_points(names)
    special = {index for indices in landmarks.values() for index in indices}
    order = sorted(range(len(names)), key=lambda index: names[index])  # the order of the columns says nothing
    found = find_bones(["" if index in special else names[index] for index in order])
    bones = {bone: order[index] for bone, index in found.items()}
    sources: dict[str, tuple[int, ...]] = {}
    for end, (bone, inner, outer) in _ENDS.items():
        for side in _SIDES:
            elbow = bones.get(f"{side}LowerArm")
            is_named = f"{inner}_{side}" in landmarks or (outer and elbow is not None and outer in names[elbow].lower())
            if is_named and f"{side}{bone}" in bones:
                sources[f"{end}_{side}"] = (bones.pop(f"{side}{bone}"),)
    for joint, candidates in BONES.items():
        points = [tuple(landmarks[point]) for point in _LANDMARKS.get(joint, ()) if point in landmarks]
        own: list[tuple[int, ...]] = [(bones[bone],) for bone in candidates if bone in bones]
        own = own + points if joint.startswith(("hand", "foot")) else points + own
        if joint == "spine" and not own and "hips" in bones and sources["hip_center"] != (bones["hips"],):
            own = [(bones["hips"],)]
        if own:
            sources.setdefault(joint, own[0])
    if "head" not in sources:
        heads = (tuple(index for point in points for index in landmarks.get(point, [])) for points in _HEADS)
        sources["head"] = next(filter(None, heads), ())
    if sources["head"] in ((), sources.get("shoulder_center")):
        del sources["head"]
    return sources, landmarks


def _fill(points: Floats, sure: NDArray[np.float32], sources: dict[str, tuple[int, ...]]) -> tuple[str, ...]:
    """Place the joints that no position has between the others, or at the end of the neck; return the notes."""
    notes = []
    for joint, pair in MIDPOINTS.items():
        if joint not in sources:
            one, other = (JOINT_INDEX[each] for each in pair)
            share = SPINE_SHARE if joint == "spine" else 0.5
            points[:, JOINT_INDEX[joint]] = (1 - share) * points[:, one] + share * points[:, other]
            sure[:, JOINT_INDEX[joint]] = np.minimum(sure[:, [one, other]].min(axis=1), INFERRED)
            notes.append(f"No position for {joint}. It is placed between {pair[0]} and {pair[1]}.")
    for side in _SIDES:
        if f"hand_{side}" in sources and f"wrist_{side}" not in sources:
            elbow, wrist, hand = (JOINT_INDEX[f"{joint}_{side}"] for joint in ("elbow", "wrist", "hand"))
            points[:, wrist] = (1 - WRIST_SHARE) * points[:, elbow] + WRIST_SHARE * points[:, hand]
            sure[:, wrist] = np.minimum(sure[:, [elbow, hand]].min(axis=1), INFERRED)
    if "head" not in sources:
        neck, hips = JOINT_INDEX["shoulder_center"], JOINT_INDEX["hip_center"]
        points[:, JOINT_INDEX["head"]] = points[:, neck] + NECK_SHARE * (points[:, neck] - points[:, hips])
        sure[:, JOINT_INDEX["head"]] = np.minimum(sure[:, [neck, hips]].min(axis=1), INFERRED)
        notes.append("No position for the head. It continues the neck.")
    placed = {"head", *MIDPOINTS, *(f"wrist_{side}" for side in _SIDES if f"hand_{side}" in sources)}
    lost = [joint for joint in JOINTS if joint not in sources and joint not in placed]
    notes += [f"No position for {joint}. It is lost." for joint in lost]
    return tuple(notes)


def _front(known: Floats, landmarks: dict[str, list[int]], sources: dict[str, tuple[int, ...]]) -> Floats:
    """Return the sum of unit vectors (T, 3) from heels to toes and from ears to the nose; NaN if unknown."""

    def point(name: str) -> Floats:
        indices = landmarks.get(name) or sources.get(name, ())
        return known[:, list(indices)].mean(axis=1) if indices else np.full((len(known), 3), np.nan)

    ways = [point("nose") - (point("ear_left") + point("ear_right")) / 2]
    for side in _SIDES:
        toe = point(f"toe_{side}") if f"toe_{side}" in landmarks else point(f"foot_{side}")
        heel = point(f"heel_{side}") if f"heel_{side}" in landmarks else point(f"ankle_{side}")
        ways.append(toe - heel)
    with np.errstate(invalid="ignore", divide="ignore"):
        units = [way / np.linalg.norm(way, axis=1, keepdims=True) for way in ways]
    total = np.nansum(units, axis=0)
    return np.where((total != 0).any(axis=1, keepdims=True), total, np.nan)


def bone_ratios(points: Floats) -> Floats:
    """Return how much longer the long bones are than a typical person's (9,), relative to their median.

    The bones are upper arms, forearms, thighs and shins, by the medians of their lengths, and the trunk. NaN if
    unknown.
    """
    typical = [*(typical_bone_length(joint) for joint, _ in _BONES), TYPICAL_TRUNK_METRES]
    with warnings.catch_warnings(action="ignore"):  # joints that are always lost
        lengths = [np.nanmedian(bone_length(points, *bone)) for bone in (*_BONES, ("shoulder_center", "hip_center"))]
        ratios = np.array(lengths) / typical
        return ratios / np.nanmedian(ratios)


def refuse_other_bodies(path: Path, points: Floats) -> None:
    """Check that the bones of points (T, 20, 3) have the proportions of a person.

    Raises
    ------
    SkeletonLogError
        A long bone is too long or too short.
    """
    ratios = bone_ratios(points)
    wrong = ~(np.abs(np.log(ratios)) < np.log(MAX_BONE_RATIO)) & np.isfinite(ratios)
    if wrong.any() or not np.isfinite(ratios).any():
        bones = (*_BONES, ("shoulder_center", "hip_center"))
        listed = ", ".join(
            f"{parent} to {joint} {ratio:.2g} times a person's"
            for (joint, parent), ratio, bad in zip(bones, ratios, wrong, strict=True)
            if bad
        )
        raise SkeletonLogError(
            path,
            found=f"distances between joints that no person has ({listed or 'none is known'})",
            expected="the joints of a person, in the order of their names",
            fix="Check the names and the order of the joints; --joints and --columns set them.",
        )


IMAGE_SIZES = {"16:9": 16 / 9, "4:3": 4 / 3, "1:1": 1.0, "3:4": 3 / 4, "9:16": 9 / 16}
"""Common ratios of an image's width to its height."""


def without_image_shares(names: Sequence[str], positions: Floats) -> tuple[Floats, tuple[str, ...]]:
    """Return positions with one unit for all axes, and a note, if x and y are shares of an image's width and height.

    Trackers write such positions: x and y from 0 to 1, and z in the unit of x from the hips. The ratio of the image's
    sides is the common one with which the person has the proportions of a typical one.
    """
    sources, _ = _sources(names)
    hips = [index for joint in ("hip_left", "hip_right") for index in sources.get(joint, ())]
    xy = positions[..., :2][np.isfinite(positions[..., :2]).all(axis=2)]
    if len(hips) != 2 or not len(xy):
        return positions, ()
    middle = np.nanmedian(positions[:, hips].mean(axis=1), axis=0)
    low, high = np.percentile(xy, [5, 95], axis=0)
    is_share = (low > -0.2).all() and (high < 1.2).all() and (middle[:2] > 0.05).all() and abs(middle[2]) < 0.05
    if not is_share:
        return positions, ()
    best = {}
    for name, ratio in IMAGE_SIZES.items():
        points = np.full((len(positions), len(JOINTS), 3), np.nan)
        for joint, indices in sources.items():
            points[:, JOINT_INDEX[joint]] = positions[:, list(indices)].mean(axis=1) / [1, ratio, 1]
        wide = [np.nanmedian(bone_length(points, f"{joint}_left", f"{joint}_right")) for joint in ("shoulder", "hip")]
        tall = [np.nanmedian(bone_length(points, *bone)) for bone in _BONES]
        best[name] = abs(np.log(sum(wide) / sum(tall) * sum(typical_bone_length(bone) for bone, _ in _BONES) / 0.55))
    name = min(best, key=best.__getitem__)
    note = f"x and y are shares of an image; its sides are assumed to be {name}. Depths of such positions are rough."
    return positions / [1, IMAGE_SIZES[name], 1], (note,)
