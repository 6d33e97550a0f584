"""Named positions of a person in any unit and any axes, as tables, arrays and motion capture have them, as a clip.

Names tell which position is which joint (`capture.bone_names`). `capture.formats.placement` finds the rest. A head that
has no position, or is at the hips as the origin of OpenSim's body "head", continues the neck; a joint between two
others is placed between them; hips are placed below shoulders that have a head; any other joint is lost.
"""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from capture.body import TYPICAL_BONE_METRES
from capture.bone_names import find_bones, find_points
from capture.clip import SkeletonClip
from capture.formats import image_positions
from capture.formats.clips import DEFAULT_FPS, build_clip, frame_rate
from capture.formats.markers import has_markers, joints_of_markers, places_of
from capture.formats.options import ReadOptions
from capture.formats.placement import place, size_of, toes_ahead, without_far_frames
from capture.formats.proportions import (
    MIN_THICKNESS,
    MIN_THICKNESS_WITHOUT_HIPS,
    TYPICAL_TRUNK_METRES,
    refuse_flat,
    refuse_other_bodies,
    without_stray_end,
)
from capture.formats.skeleton_joints import BONES, MIDPOINTS
from capture.skeleton import INFERRED, JOINT_INDEX, JOINTS, LOST
from puppetline.errors import SkeletonLogError

Floats = NDArray[np.float64]

SPINE_SHARE = TYPICAL_BONE_METRES["spine"] / TYPICAL_TRUNK_METRES
"""Distance of the spine from the hips, as a share of the trunk's length."""

WRIST_SHARE = 0.75
"""Distance of the wrist from the elbow, as a share of the hand's (`capture.formats.layouts`)."""

BELOW_SHOULDERS, HIP_WIDTH = (
    length / (2 * TYPICAL_BONE_METRES["shoulder"]) for length in (TYPICAL_TRUNK_METRES, 2 * TYPICAL_BONE_METRES["hip"])
)
"""Distances of the hips from the shoulders and from each other, as shares of that between the shoulders."""

NECK_SHARE = TYPICAL_BONE_METRES["head"] / TYPICAL_TRUNK_METRES
"""Length of the neck and half of the head, as a share of the trunk's."""

WHOLE_BODY = "Use a recording of the whole body."
"""What to do with positions of legs or of arms only."""

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

_ELBOWS, _WRISTS, _HANDS, _KNEES, _ANKLES = (
    {f"{joint}_{side}" for side in _SIDES} for joint in ("elbow", "wrist", "hand", "knee", "ankle")
)
_REQUIRED = ("hip_center", *(f"shoulder_{side}" for side in _SIDES))
"""Joints without which positions are no person's; elbows too, if there are no wrists and no knees. All others may be
lost, and the hips of a body with a head, elbows and wrists.
"""


def _share(joint: str, other: str) -> float:
    """Return how far a joint is along a straight limb from the joint before to another one after, as a share."""
    length = TYPICAL_BONE_METRES[joint]
    return length / (length + TYPICAL_BONE_METRES[other])


_BETWEEN: tuple[tuple[str, str, str, float], ...] = (
    *((joint, *pair, 0.5 if joint != "spine" else SPINE_SHARE) for joint, pair in MIDPOINTS.items()),
    *(
        (f"{joint}_{side}", f"{before}_{side}", f"{after}_{side}", share)
        for side in _SIDES
        for joint, before, after, share in (
            ("elbow", "shoulder", "wrist", _share("elbow", "wrist")),
            ("wrist", "elbow", "hand", WRIST_SHARE),
            ("knee", "hip", "ankle", _share("knee", "ankle")),
        )
    ),
)
"""Joints that are placed between two others if they have no position, and how far from the first one, as a share."""


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
        The J names of joints, in the words of any program, or of the markers of a whole body.
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
    known = positions if confidence is None else np.where(confidence[..., None] > LOST, positions, np.nan)
    if joints := joints_of_markers(names, known):
        names, positions, confidence = list(joints), np.stack(list(joints.values()), axis=1), None
        notes = (*notes, "The joints follow from the markers on both sides of them.")
    body = select(path, names, positions, confidence)
    seen = {joint: own for joint, own in body.sources.items() if np.isfinite(body.points[:, JOINT_INDEX[joint]]).any()}
    if seen and _missing(seen):
        refuse_incomplete(path, [names[index] for own in seen.values() for index in own])
    factors, image_note = image_positions.unit_of(body.points)
    if image_note:
        body = select(path, names, positions * factors, confidence)
    has_hips = bool(body.sources.keys() & {"hip_center", "hip_left"})
    refuse_flat(path, body.points, MIN_THICKNESS if has_hips else MIN_THICKNESS_WITHOUT_HIPS)
    points, stray_notes = without_stray_end(body.points)
    refuse_other_bodies(path, points)
    size = size_of(path, points, options, in_image=bool(image_note))
    points, far_notes = without_far_frames(points, size.unit)
    where = place(path, points, body.front, size, options, in_image=bool(image_note))
    if times is None:
        fps, rate_notes = frame_rate(options, DEFAULT_FPS)
        times, notes = np.arange(len(positions)) / fps, (*notes, *rate_notes)
    notes = (*notes, *((image_note,) if image_note else ()), *stray_notes, *far_notes, *body.notes, *where.notes)
    confidence = np.where(np.isnan(points).any(axis=2), np.float32(LOST), body.confidence)
    return build_clip(path, log_format, times, where.apply(points), confidence, notes)


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
    if _missing(sources):
        refuse_incomplete(path, names)
    given = np.ones(positions.shape[:2], np.float32) if confidence is None else confidence
    at_origin = (positions == 0).all(axis=2)
    at_origin &= ~_is_origin(positions, at_origin)
    given = np.where(at_origin | ~np.isfinite(positions).all(axis=2), np.float32(LOST), given)
    known = np.where(given[..., None] > LOST, positions, np.nan)
    heads = {head: int(np.isfinite(known[:, list(head)]).all(axis=(1, 2)).sum()) for head in _heads(landmarks)}
    if sources.get("head") in heads:
        sources["head"] = next(head for head, seen in heads.items() if 2 * seen >= max(heads.values()))
    points = np.full((len(positions), len(JOINTS), 3), np.nan)
    sure = np.zeros((len(positions), len(JOINTS)), np.float32)
    for joint, indices in sources.items():
        points[:, JOINT_INDEX[joint]] = known[:, list(indices)].mean(axis=1)
        sure[:, JOINT_INDEX[joint]] = given[:, list(indices)].min(axis=1)
    notes = _fill(points, sure, sources)
    return Selection(points, sure, sources, _front(known, landmarks, sources), notes)


def is_person(names: Sequence[str]) -> bool:
    """Return whether names are those of enough of a person's joints, or of the markers of a whole body."""
    return has_markers(names) or not missing_joints(names)


def missing_joints(names: Sequence[str]) -> list[str]:
    """Return the joints that a person must have and that no name is of."""
    return _missing(_sources(names)[0])


def refuse_incomplete(path: Path, names: Sequence[str]) -> NoReturn:
    """Raise the error for names that are no whole person's."""
    listed = ", ".join(names)
    raise SkeletonLogError(
        path,
        found=f"no position for {', '.join(missing_joints(names))} among {listed[:200]}"
        f"{' …' if len(listed) > 200 else ''}{part_of_a_person(names)}",
        expected="the joints of a person, such as ShoulderLeft, or all markers of Plug-in Gait or OpenSim",
        fix="Export them too, or rename the joints. In a table, --columns names the columns that have them.",
    )


def part_of_a_person(names: Sequence[str]) -> str:
    """Return that names are of legs or of arms only, for messages; "" for others."""
    places = {f"{place.split()[0]}_{side.lower()}" for place, side in filter(None, places_of(names))}
    found = {*_sources(names)[0], *places}
    has_legs, has_arms = (any(found >= own for own in both) for both in ((_KNEES, _ANKLES), (_ELBOWS, _WRISTS, _HANDS)))
    is_part = has_legs != has_arms and bool(missing_joints(names))
    return (": legs without arms and shoulders" if has_legs else ": arms without hips and legs") if is_part else ""


def _missing(sources: Mapping[str, object]) -> list[str]:
    found = {*sources, *(joint for joint, pair in MIDPOINTS.items() if sources.keys() >= set(pair))}
    found |= {"hip_center"} if {"head", *_ELBOWS, *_WRISTS} <= found else set()
    ends = {f"elbow_{side}" for side in _SIDES if found & {f"wrist_{side}", f"hand_{side}"}}
    needs_elbows = bool(ends) or not found >= _KNEES
    required = (*_REQUIRED, *(sorted(_ELBOWS - ends) if needs_elbows else ()))
    return [joint for joint in required if joint not in found]


def _is_origin(positions: Floats, at_origin: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which positions (J,) are the origin of the coordinates, and therefore known: one in the body's middle."""
    is_lost = ~np.isfinite(positions).any(axis=2)
    always = np.all(at_origin | is_lost, axis=0) & np.any(at_origin, axis=0)
    others = positions[:, ~always].reshape(-1, 3)
    others = others[np.isfinite(others).all(axis=1)]
    is_inside = len(others) > 0 and (others.min(axis=0) <= 0).all() and (others.max(axis=0) >= 0).all()
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
        if joint.startswith("shoulder_") and candidates[0].replace("Upper", "Lower") not in bones:  # no collar then
            candidates = (*candidates, candidates[0].replace("UpperArm", "Shoulder"))
        own: list[tuple[int, ...]] = [(bones[bone],) for bone in candidates if bone in bones]
        own = own + points if joint.startswith(("hand", "foot")) else points + own
        if joint == "spine" and not own and "hips" in bones and sources["hip_center"] != (bones["hips"],):
            own = [(bones["hips"],)]
        if own:
            sources.setdefault(joint, own[0])
    if "head" not in sources:
        sources["head"] = next(iter(_heads(landmarks)), ())
    if sources["head"] in ((), sources.get("shoulder_center")):
        del sources["head"]
    return sources, landmarks


def _heads(landmarks: Mapping[str, Sequence[int]]) -> list[tuple[int, ...]]:
    heads = [tuple(index for point in points for index in landmarks.get(point, ())) for points in _HEADS]
    return [head for head in heads if head]


def _fill(points: Floats, sure: NDArray[np.float32], sources: dict[str, tuple[int, ...]]) -> tuple[str, ...]:
    """Place the joints that no position has between the others, or at the end of the neck; return the notes."""
    notes = []
    if not sources.keys() & {"hip_center", "hip_left"}:
        _place_hips(points, sure)
        notes.append("No position for the hips. They are placed below the shoulders.")
    known = {*sources, "hip_left", "hip_right"}
    for joint, before, after, share in _BETWEEN:
        if joint not in known and (joint in MIDPOINTS or known >= {before, after}):
            one, other = JOINT_INDEX[before], JOINT_INDEX[after]
            points[:, JOINT_INDEX[joint]] = (1 - share) * points[:, one] + share * points[:, other]
            sure[:, JOINT_INDEX[joint]] = np.minimum(sure[:, [one, other]].min(axis=1), INFERRED)
            notes.append(f"No position for {joint}. It is placed between {before} and {after}.")
            known.add(joint)
    head, neck, hips = (JOINT_INDEX[joint] for joint in ("head", "shoulder_center", "hip_center"))
    to_hips, to_neck = (np.linalg.norm(points[:, head] - points[:, other], axis=1) for other in (hips, neck))
    is_low = 2 * np.count_nonzero(to_hips < to_neck) > np.count_nonzero(np.isfinite(to_hips))
    if "head" not in sources or is_low:
        points[:, head] = points[:, neck] + NECK_SHARE * (points[:, neck] - points[:, hips])
        sure[:, head] = np.minimum(sure[:, [neck, hips]].min(axis=1), INFERRED)
        low = "The position of the head is at the hips. The head continues the neck."
        notes.append(low if is_low else "No position for the head. It continues the neck.")
    lost = [joint for joint in JOINTS if joint not in known | {"head"}]
    notes += [f"No position for {joint}. It is lost." for joint in lost]
    return tuple(notes)


def _place_hips(points: Floats, sure: NDArray[np.float32]) -> None:
    """Place the hips below the shoulders, along the axis of the coordinates that is closest to the way to the head."""
    left, right, head = (JOINT_INDEX[joint] for joint in ("shoulder_left", "shoulder_right", "head"))
    across, middle = points[:, right] - points[:, left], (points[:, left] + points[:, right]) / 2
    with warnings.catch_warnings(action="ignore"):  # shoulders that are never known
        width = np.nanmedian(np.linalg.norm(across, axis=1))
        way = np.nan_to_num(np.nanmedian(points[:, head] - middle, axis=0))
    up = np.where(np.arange(3) == np.abs(way).argmax(), np.sign(way), 0)
    for joint, side in (("hip_left", -0.5), ("hip_right", 0.5)):
        points[:, JOINT_INDEX[joint]] = middle - BELOW_SHOULDERS * width * up + side * HIP_WIDTH * across
        sure[:, JOINT_INDEX[joint]] = np.minimum(sure[:, [left, right]].min(axis=1), INFERRED)


def _front(known: Floats, landmarks: dict[str, list[int]], sources: dict[str, tuple[int, ...]]) -> Floats:
    """Return the sum of unit vectors (T, 3) from heels to toes and from ears or head to the nose; NaN if unknown."""

    def point(name: str) -> Floats:
        indices = landmarks.get(name) or sources.get(name, ())
        return known[:, list(indices)].mean(axis=1) if indices else np.full((len(known), 3), np.nan)

    face = point("nose") - (point("ear_left") + point("ear_right")) / 2
    if {"ear_left", "ear_right"} - landmarks.keys():
        face = point("nose") - point("head")
    with np.errstate(invalid="ignore", divide="ignore"):
        ways = [face / np.linalg.norm(face, axis=1, keepdims=True)]
    for side in _SIDES:
        toe = point(f"toe_{side}") if f"toe_{side}" in landmarks else point(f"foot_{side}")
        heel = point(f"heel_{side}") if f"heel_{side}" in landmarks else point(f"ankle_{side}")
        ways.append(toes_ahead(toe - heel, point(f"ankle_{side}") - point(f"knee_{side}")))
    total = np.nansum(ways, axis=0)
    return np.where((total != 0).any(axis=1, keepdims=True), total, np.nan)
