"""Documents of trackers (JSON, XML and others): in each frame the positions of landmarks, by name or in a known order.

Programs that use MediaPipe, OpenPose and other trackers write frames as a list, or as an object with numbers for keys;
somewhere in each is a pose, or one for each person. A pose is an object of names, a list of points, or a list of
numbers, or has joints with names at any depth. A point is ``[x, y, z]`` or ``{x, y, z}``, perhaps with a confidence. Of
several poses in a frame, one in space (*world*, *3d*) counts. A document may also be one pose, or a table in records or
in columns, which may be points over time (`capture.formats.table`). A point that is missing, null or NaN is lost.
"""

import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from capture.clip import SkeletonClip
from capture.formats import smpl, table
from capture.formats._cells import vector
from capture.formats._columns import of_angles, parse
from capture.formats._documents import is_document, load
from capture.formats._files import opened
from capture.formats._rows import Line
from capture.formats._table import EXPORT, Table
from capture.formats.clips import DEFAULT_FPS, MAX_JOINTS, frame_rate, with_stated_rate
from capture.formats.joint_sets import as_of, clearest, fits, joint_set, numbered
from capture.formats.layouts import JOINT_SETS
from capture.formats.options import ReadOptions
from capture.formats.positions import clip_of_positions, is_person, refuse_incomplete
from capture.formats.table import confidence_of, moments, seconds_of
from puppetline.errors import SkeletonLogError

_HINT = re.compile(
    rb"elbow|joint|body_?pose|upper_?arm|humerus|keypoints|landmarks|\[\s*\[\s*-?[0-9]"
    rb"|[\"'](?:camera|world|pos|position)?_?x[\"']\s*:|[\"'][0-9]+[\"']\s*:\s*[\[(]\s*-?[0-9]",
    re.IGNORECASE,
)
_CONFIDENCES = ("visibility", "confidence", "score", "presence", "c", "v", "likelihood")
_TIMES = (
    *("time", "timestamp", "timestamp_ms", "timestampMs", "t", "time_s", "time_ms", "frame_time", "timestamp_usec"),
    "record_timestamp",
)
_FRAMES = ("frame", "frame_id", "frame_index", "frameNumber", "index")
_PERSON_IDS = ("person_id", "track_id", "trackingId", "body_id", "user")
_IDS = (*_PERSON_IDS, "id")
_POSITIONS = (
    "position",
    "positions",
    "pos",
    "location",
    "translation",
    "camera",
    "pose",
    "transform",
    "modeltransform",
    "matrix",
    "columns",
)
_NAME = re.compile("name|tag|type|joint|part|keypoint|label|landmark|bone|^id$", re.IGNORECASE)
_NO_POSE = re.compile("2d|hand|face|orient|rotat|quat", re.IGNORECASE)
_IN_SPACE = re.compile("world|3d", re.IGNORECASE)
_SIZES = {len(joints) for joints in JOINT_SETS.values()}
MAX_NUMBER = 2.0**63
"""Bound of the magnitude of a number: larger than any time in nanoseconds, small enough for calculations."""

MIN_NAMES = 6
"""Number of names from which points are those of a pose."""

MAX_POSES = 3
"""Number of poses up to which an object with names for them is a frame; more are frames, with names of images."""

MAX_DEPTH = 4
"""Number of levels of a frame in which its poses are searched."""

MAX_CONTAINERS = 20_000
"""Number of lists and objects of a document by which it is described."""

MAX_PEOPLE = 16
"""Number of people in a frame; a longer list of poses has the frames of a recording."""

_LOST = [math.nan] * 3


class _Pose(NamedTuple):
    """The names of points, if they have some, and the numbers of each; of a list of numbers, each one apart.

    `in_space` tells that the document calls them so; poses beside them are in an image.
    """

    names: tuple[str, ...] | None
    rows: list[list[float]]
    in_space: bool = False


def matches(head: bytes) -> bool:
    """Return whether a file's head is a document with names or lists of landmarks."""
    return is_document(head) and _HINT.search(head) is not None


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:
    """Read one clip per person.

    Raises
    ------
    SkeletonLogError
        The document cannot be read, or has no positions in space of a person's landmarks.
    """
    document = load(path)
    options, notes = with_stated_rate(options, _values(document))
    return [replace(clip, notes=(*notes, *clip.notes)) for clip in _read(path, document, options)]


def _values(document: Any, depth: int = 2) -> Iterator[tuple[str, float]]:
    """Yield the numbers that a document has by their keys."""
    for key, value in document.items() if isinstance(document, dict) and depth else ():
        if _is_number(value):
            yield key, float(value)
        yield from _values(value, depth - 1)


def _read(path: Path, document: Any, options: ReadOptions) -> list[SkeletonClip]:
    if bodies := list(smpl.in_document(document)):
        own = [smpl.clip_of(path, "landmarks_json", body, options) for body in bodies[:MAX_PEOPLE]]
        return [replace(clip, user=user) for user, clip in enumerate(own)]
    if lines := _as_table(document):
        return table.clips_of(Table(path, lines, options), "landmarks_json")
    if clips := clips_of(path, "landmarks_json", document, options):
        return clips
    names = dict.fromkeys(name for name, _ in islice(_joints(document), MAX_JOINTS))
    if len(names) >= MIN_NAMES:
        refuse_incomplete(path, list(names))
    found, is_flat = described(document)
    with opened(path) as file:
        start = file.read(99).lstrip(b"\xef\xbb\xbf \r\n\t")[:1]
    kind = "XML" if start == b"<" else "JSON" if start in (b"{", b"[") else "lists in brackets"
    raise SkeletonLogError(
        path,
        found=f"{kind}{found}",
        expected="x, y and z of a person's landmarks in each frame",
        fix="Use the tracker's positions in space (MediaPipe: pose_world_landmarks), or the video itself."
        if is_flat
        else EXPORT,
    )


def _as_table(document: Any) -> list[Line]:
    """Return the lines of the table of joints that a document is, in records or in columns; none of others."""
    for part in (document, *(document.values() if isinstance(document, dict) else ())):
        rows: list[Any] = []
        names: dict[str, Any] = {}
        if isinstance(part, dict):
            every = dict(_columns(part))
            longest = max(map(len, every.values()), default=0)
            names = {name: values for name, values in every.items() if len(values) == longest}
            rows = list(zip(*names.values(), strict=True))
        elif isinstance(part, list) and part and isinstance(part[0], dict):
            names = {name: each for name, each in part[0].items() if not isinstance(each, (dict, list))}
            rows = [[record.get(name) for name in names] for record in part if isinstance(record, dict)]
        if is_person([column.joint for column in parse([[name] for name in names]) if column.role == "z"]):
            return [(at, "\t".join(map(str, row)) + "\n") for at, row in enumerate([names, *rows], start=1)]
    return []


def _columns(value: dict[str, Any], name: str = "") -> Iterator[tuple[str, list[Any]]]:
    """Yield lists of numbers, and the coordinates of lists of points, in dictionaries by their joined keys.

    Objects with names may be a list, and the values of a list may be numbered.
    """
    for key, each in value.items():
        own = f"{name}_{key}" if name else key
        if isinstance(each, list) and each and all(isinstance(part, dict) and _name(part) for part in each):
            each = {_name(part): part for part in each}
        if isinstance(each, dict) and not all(map(str.isdecimal, each)):
            yield from _columns(each, own)
        elif isinstance(each, (dict, list)) and each:
            values = list(each.values()) if isinstance(each, dict) else each
            if all(part is None or _is_number(part) for part in values):
                yield own, values
            elif all(points := [_point(part) for part in values]):
                yield from ((f"{own}_{axis}", [point[k] for point in points if point]) for k, axis in enumerate("xyz"))


def described(document: Any) -> tuple[str, bool]:
    """Return what a document without a person has, for messages, and whether these are positions in an image."""
    containers = list(islice(_containers(document), MAX_CONTAINERS))
    count, size = max(map(_points_in, containers), default=(0, 0))
    if size == 2 or any("2d" in str(key).lower() for own in containers if isinstance(own, dict) for key in own):
        return " with positions in an image (2D)", True
    if size == 3 and as_of(count):
        return f" of {count} points{as_of(count)}", False
    points = f"with {count} points that are no person's" if size == 3 else "without positions in space"
    is_list = isinstance(document, list)
    first = document[0] if is_list and document else document
    keys = list(map(str, first)) if isinstance(first, dict) else []
    listed = f" with the keys {', '.join(keys[:8])}" if keys else ""
    amount = f", a list of {len(document):,}" if is_list else ""
    return f"{amount}{listed}, {points}{of_angles(keys) if keys else ''}", False


def _points_in(value: Any) -> tuple[int, int]:
    """Return how many points a list or dictionary has, and how many coordinates these have; 0 if it has others."""
    each = list(value.values()) if isinstance(value, dict) else value
    if all(map(_is_number, each)):  # x and y in turn
        is_flat = len(each) % 2 == 0 and len(each) // 2 in _SIZES and not _point_sizes(len(each)) and min(each) >= 0
        return (len(each) // 2, 2) if is_flat else (0, 0)
    sizes = [2 if _is_flat(point) else 3 if _point(point) not in (None, _LOST) else 0 for point in each]
    others = sizes.count(0)
    return (len(sizes) - others, max(sizes)) if others < MIN_NAMES < len(sizes) else (0, 0)


def _containers(value: Any) -> Iterator[Any]:
    """Yield the lists and dictionaries in a value, itself included."""
    if isinstance(value, (list, dict)):
        yield value
        for each in value.values() if isinstance(value, dict) else value:
            yield from _containers(each)


def _is_flat(value: Any) -> bool:
    """Return whether a value is a point of an image: x and y only, or with a score."""
    if isinstance(value, dict):
        own = {str(key).lower(): each for key, each in value.items()}
        return _is_number(own.get("x")) and _is_number(own.get("y")) and "z" not in own
    return isinstance(value, list) and len(value) == 2 and all(map(_is_number, value))


def clips_of(path: Path, log_format: str, document: Any, options: ReadOptions) -> list[SkeletonClip]:
    """Return one clip per person in a document of dictionaries, lists, texts and numbers; none if it has no pose.

    Raises
    ------
    SkeletonLogError
        The poses are no person's.
    """
    people: dict[int, list[tuple[int, dict[str, Any], _Pose]]] = {}
    for named in (True, False):
        frames, count = _frames(document, named)
        if frames:
            break
    notes = (f"The file has {count} recordings. The longest one is read.",) if count > 1 else ()
    for index, frame in enumerate(frames):
        for order, (owner, pose) in enumerate(_poses(frame, named)):
            keys = _PERSON_IDS if owner is frame else _IDS  # a frame's own id may be its number
            user = next((int(owner[key]) for key in keys if str(owner.get(key, "")).isdecimal()), order)
            people.setdefault(user, []).append((index, frame if isinstance(frame, dict) else {}, pose))
    clips = {user: _clip(path, log_format, seen, options) for user, seen in people.items()}
    return [replace(clip, user=user, notes=(*notes, *clip.notes)) for user, clip in clips.items()]


def _clip(
    path: Path, log_format: str, seen: Sequence[tuple[int, dict[str, Any], _Pose]], options: ReadOptions
) -> SkeletonClip:
    """Return the clip of one person, of the poses with names if there are some, or else of those of most points."""
    seen = [each for each in seen if each[2].in_space] or seen
    names: Sequence[str] = tuple(dict.fromkeys(name for _, _, pose in seen for name in pose.names or ()))[:MAX_JOINTS]
    width = len(names) or Counter(len(pose.rows) for _, _, pose in seen).most_common(1)[0][0]
    same = [each for each in seen if (each[2].names if names else len(each[2].rows) == width)]
    rows = np.full((len(same), width, 4), np.nan)
    place = {name: index for index, name in enumerate(names)}
    for row, (_, _, pose) in zip(rows, same, strict=True):
        for index, values in zip(map(place.get, pose.names) if pose.names else range(width), pose.rows, strict=True):
            if index is not None:
                row[index, : min(len(values), 4)] = values[:4]
    if len(same[0][2].rows[0]) == 1:
        rows = _as_points(rows[..., 0], options)
    names, rows = _in_order(path, names, rows, options)
    confidence = confidence_of(rows[..., 3]) if np.isfinite(rows[..., 3]).any() else None
    times = None
    notes: tuple[str, ...] = ()
    for keys, counts in ((_TIMES, False), (_FRAMES, True)):
        stamps = (moments([str(frame[key]) for _, frame, _ in same]) for key in keys if key in same[0][1])
        stamp = None if times is not None else next((each for each in stamps if each is not None), None)
        if stamp is not None:
            times, notes = seconds_of(stamp, options, counts=counts)
    if times is None:
        fps, notes = frame_rate(options, DEFAULT_FPS)
        times = np.array([index for index, _, _ in same]) / fps
    return clip_of_positions(
        path, log_format, names, rows[..., :3], options, times=times, confidence=confidence, notes=notes
    )


def _in_order(
    path: Path, names: Sequence[str], rows: NDArray[np.float64], options: ReadOptions
) -> tuple[Sequence[str], NDArray[np.float64]]:
    """Return the names of joints and rows (T, J, 4) of these.

    Names are those of the document, those for its numbers of joints, or those of a known order with as many joints.
    """
    if not names:
        return JOINT_SETS[joint_set(path, rows[..., :3], options.joints, "JSON")], rows
    if all(map(str.isdecimal, names)):
        found, order = numbered(path, list(map(int, names)), rows[..., :3], options.joints, "JSON")
        return found, rows[:, order]
    if is_person(names):
        return names, rows
    orders = fits(rows[..., :3], [name for name, joints in JOINT_SETS.items() if len(joints) == len(names)])
    if not orders:
        refuse_incomplete(path, names)
    return JOINT_SETS[clearest(path, orders, "JSON").name], rows


def _as_points(numbers: NDArray[np.float64], options: ReadOptions) -> NDArray[np.float64]:
    """Return numbers (T, N) as points (T, J, 4), NaN after three numbers; they are four if only these are a person."""
    shapes = [numbers.reshape(len(numbers), -1, size) for size in _point_sizes(numbers.shape[1])]
    if len(shapes) > 1:
        names = [name for name in JOINT_SETS if options.joints in (None, name)]
        own = [[name for name in names if len(JOINT_SETS[name]) == points.shape[1]] for points in shapes]
        fitting = [points for points, sets in zip(shapes, own, strict=True) if fits(points[..., :3], sets)]
        shapes = fitting if len(fitting) == 1 else shapes
    return np.pad(shapes[0], ((0, 0), (0, 0), (0, 4 - shapes[0].shape[2])), constant_values=np.nan)


def _point_sizes(count: int) -> list[int]:
    """Return how many numbers a point may have, if a pose has so many in all."""
    return [size for size in (3, 4) if count % size == 0 and count // size in _SIZES]


def _frames(document: Any, named: bool) -> tuple[list[Any], int]:
    """Return the frames of a document, and of how many recordings they are the longest; `named` as in `_pose`."""
    if _pose(document, named) is not None:
        return [document], 1
    if isinstance(document, list) and any(_poses(frame, named) for frame in document[:: len(document) // 50 + 1]):
        inner = [frames for each in document if isinstance(each, dict) and len(frames := _frames(each, named)[0]) > 1]
        longest: list[Any] = max(inner, key=len, default=[])
        are_recordings = len(longest) > (MAX_PEOPLE if len(document) > 1 else 1)
        return (longest, len(inner)) if are_recordings else (document, 1)
    if isinstance(document, dict):
        is_numbered = all(key.replace(".", "", 1).isdecimal() for key in document)
        are_frames = len(document) > MAX_POSES and not any(map(_NO_POSE.search, document))
        if document and (is_numbered or (are_frames and all(_poses(value, named) for value in document.values()))):
            return list(document.values()), 1
        for value in document.values():
            if isinstance(value, (list, dict)) and _pose(value, named) is None and (found := _frames(value, named))[0]:
                return found
    return [document] if _poses(document, named) else [], 1


def _name(value: dict[str, Any]) -> str:
    """Return the name or number that an object has; "" without one."""
    own = [each for key, each in value.items() if _NAME.search(key) and not isinstance(each, bool)]
    return next((str(each) for kind in (str, int) for each in own if isinstance(each, kind)), "")


def _poses(value: Any, named: bool, depth: int = MAX_DEPTH) -> list[tuple[dict[str, Any], _Pose]]:
    """Return the poses of the people in a frame, each with the object that has it; `named` as in `_pose`."""
    if (pose := _pose(value, named)) is not None:
        return [(value if isinstance(value, dict) else {}, pose)]
    if depth == 0:
        return []
    if isinstance(value, list):
        return [found for each in value[:MAX_PEOPLE] for found in _poses(each, named, depth - 1)]
    if isinstance(value, dict):
        for key in sorted(value, key=lambda key: (not _IN_SPACE.search(key), key)):
            if not _NO_POSE.search(key) and (found := _poses(value[key], named, depth - 1)):
                is_known = _IN_SPACE.search(key) is not None
                return [(own or value, pose._replace(in_space=pose.in_space or is_known)) for own, pose in found]
    return []


def _pose(value: Any, named: bool) -> _Pose | None:
    """Return the pose that a value is; None if it is none, or if `named` and names tell nothing of a person."""
    if isinstance(value, dict):
        own = {name: point for name, each in value.items() if (point := _point(each)) is not None}
        if len(own) >= MIN_NAMES and (all(map(str.isdecimal, own)) or is_person(list(own))):
            return _Pose(tuple(own), list(own.values()))
        axes = [value.get(axis, value.get(axis.upper())) for axis in "xyz"]
        if all(isinstance(axis, list) for axis in axes):  # of all joints
            return _pose([list(point) for point in zip(*axes, strict=False)], named)
    joints = list(islice(_joints(value), MAX_JOINTS + 1))
    names = tuple(name for name, _ in joints)
    if MIN_NAMES <= len(set(names)) == len(names) <= MAX_JOINTS:
        is_known = all(map(str.isdecimal, names)) or is_person(names)
        return (
            _Pose(names, [point for _, point in joints]) if is_known or (not named and len(joints) in _SIZES) else None
        )
    if not isinstance(value, list) or len(value) < min(_SIZES):
        return None
    if all(_is_number(each) for each in value):
        return _Pose(None, [[float(each)] for each in value]) if _point_sizes(len(value)) else None
    found = [_point(each) for each in value]
    points = [point for point in found if point is not None]
    return _Pose(None, points) if len(points) == len(value) in _SIZES else None


def _joints(value: Any) -> Iterator[tuple[str, list[float]]]:
    """Yield the points with names in a value, at any depth."""
    if isinstance(value, dict):
        name = _name(value)
        if name and (point := _point(value)) is not None:
            yield name, point
    for each in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        yield from _joints(each)


def _point(value: Any) -> list[float] | None:
    """Return x, y, z and perhaps the confidence of a point in space, or of a matrix's origin; NaN if it is lost."""
    if value is None:
        return _LOST
    if isinstance(value, str):
        return vector(value)
    if isinstance(value, list) and len(value) in (4, 16) and (origin := _origin(value)):
        return origin
    if isinstance(value, list) and 3 <= len(value) <= 5 and all(each is None or _is_number(each) for each in value):
        return [math.nan if each is None else float(each) for each in value]
    if isinstance(value, dict):
        own = {key.lower(): each for key, each in value.items()}
        sure = [float(own[key]) for key in _CONFIDENCES if _is_number(own.get(key))][:1]
        place = [_as_number(own.get(axis, own.get(f"camera{axis}"))) for axis in "xyz"]
        if all(_is_number(each) for each in place):
            return [*map(float, place), *sure]
        inner = next((own[key] for key in _POSITIONS if key in own), None)
        point = _point(inner) if inner is not None else None
        return [*point[:3], *sure] if point else None
    return None


def _origin(value: list[Any]) -> list[float] | None:
    """Return the origin of the axes that a matrix (4, 4) gives, by rows or columns; None for other lists."""
    rows = value if len(value) == 4 else [value[k : k + 4] for k in range(0, 16, 4)]
    if not all(isinstance(row, list) and len(row) == 4 and all(map(_is_number, row)) for row in rows):
        return None
    for matrix in (rows, [list(column) for column in zip(*rows, strict=True)]):
        if matrix[3] == [0, 0, 0, 1]:
            return [float(row[3]) for row in matrix[:3]]
    return None


def _as_number(value: Any) -> Any:
    """Return a value, or the number that it is the text of."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and not abs(value) >= MAX_NUMBER
