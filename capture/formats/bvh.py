"""BVH: a hierarchy of joints and their motion, as text.

A frame's joint positions are forward kinematics down the hierarchy: position = parent's position + parent's rotation ·
translation, rotation = parent's rotation · the joint's own, whose turns about its axes are multiplied in the order of
its channels. Names are mapped to the 20 joints by `capture.formats.bvh_names`.

A file may have several ROOTs. Each whose joints have the names of a human body is a performer of its own; others, as
props are, are left out. Where only all of them together make a body, they are one performer.

BVH knows no sensor, no unit and no up. Up is the axis along which the head lies from the ankles in the median pose; the
unit is the usual one in which the body is of human height; both can be given. Then the whole take is moved as one: the
performer's left-to-right line lies along +x in the first frame, so that the performer faces the sensor, with the hips
2.5 m in front of it.
"""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from capture.clip import SkeletonClip
from capture.formats._clips import clip_of
from capture.formats._rows import Line, LineSource, RowLayout, bad_line, count_note, is_number, read_lines
from capture.formats.bvh_names import kinect_points
from capture.formats.options import ReadOptions
from capture.orientations import none as unknown
from capture.skeleton import JOINT_INDEX, LOST, TRACKED
from puppetline.errors import SkeletonLogError, at

FRAMES = re.compile(r"frames\s*:?\s*(\d{1,9})", re.IGNORECASE)
FRAME_TIME = re.compile(r"frame\s*time\s*:?(.*)", re.IGNORECASE)
MAX_JOINTS = 500
"""A hand-made rig with fingers and face has some 150."""
MAX_NUMBER = 1e9
"""Beyond any length or angle, and small enough that no arithmetic on it overflows."""
MAX_PLACES = 10_000_000
"""Joints times frames, some 100 bytes each: half an hour of CMU's skeleton at 120 frames a second."""
DISTANCE = 2.5
"""Metres from the sensor to the hips in the first frame."""
UNITS = {
    "metres": 1.0,
    "decimetres": 0.1,
    "CMU units of 1/0.45 inch": 0.0254 / 0.45,
    "inches": 0.0254,
    "centimetres": 0.01,
    "millimetres": 0.001,
}
"""No two are within a factor of 1.43, the width of `HUMAN`, so at most one fits."""
HUMAN = (1.4, 2.0)
"""Metres of stature that nobody has to be told of."""
USUAL_HEIGHT = 1.7
CROWN_AND_SOLE = 1.15
"""Stature to the sum of the bones from head to ankle, which end at the head's centre and above the sole."""


@dataclass(frozen=True, slots=True)
class Node:
    """A joint, or the end of one that has no children.

    Attributes
    ----------
    name : str
        Empty for an end site.
    parent : int
        Index of the parent, which comes first; −1 for the root.
    offset : (3,) float64
        From the parent, in its frame.
    channels : tuple of (str, str)
        Axis and "position" or "rotation", in the order of the numbers in a frame.
    """

    name: str
    parent: int
    offset: NDArray[np.float64]
    channels: tuple[tuple[str, str], ...]


def matches(head: bytes) -> bool:
    """Tell whether a file's head starts as every BVH does."""
    return head.removeprefix(b"\xef\xbb\xbf").upper().split(maxsplit=1)[:1] == [b"HIERARCHY"]


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:
    """Read every performer.

    Parameters
    ----------
    path : Path
    options : ReadOptions
        `up` and `unit` replace what is found by looking at the body; `fps` serves where the file's frame time is none.

    Returns
    -------
    list of SkeletonClip
        One for each ROOT that is a human body, numbered from 0.

    Raises
    ------
    SkeletonLogError
        A line does not fit, there is no motion, the file has no frame time and `options` neither, or the joints of a
        human body cannot be found by name.
    """
    nodes, motion, frame_time, notes = parse(path, options.fps)
    times = frame_time * np.arange(len(motion), dtype=np.float64)
    if (motion == motion[0]).all():
        notes = ("All frames are the same: a pose and not a motion.", *notes)
    bodies, prop_notes = _bodies(path, nodes, *forward_kinematics(nodes, motion))
    return [
        replace(_clip(path, times, body, options, (*notes, *prop_notes, *body.notes)), user=user)
        for user, body in enumerate(bodies)
    ]


class _Body(NamedTuple):
    """A human body in a file: points (T, 20, 3), the turn (T, 3, 3) of each joint that has one, and notes."""

    points: NDArray[np.float64]
    turns: dict[str, NDArray[np.float64]]
    notes: list[str]


def _bodies(
    path: Path, nodes: list[Node], positions: list[NDArray[np.float64]], turns: list[NDArray[np.float64]]
) -> tuple[list[_Body], list[str]]:
    """Find the human bodies among the skeletons of a file.

    Returns
    -------
    bodies : list of _Body
    notes : list of str
        On the skeletons that are left out.
    """
    roots = [index for index, node in enumerate(nodes) if node.parent < 0]
    bodies, notes = [], []
    if len(roots) > 1:
        for start, end in pairwise([*roots, len(nodes)]):
            tree = [(node.name, max(node.parent - start, -1)) for node in nodes[start:end]]
            try:
                bodies.append(_body(path, tree, positions[start:end], turns[start:end]))
            except SkeletonLogError:
                notes.append(f"The skeleton of ROOT {nodes[start].name} has no human joint names. It is omitted.")
    if bodies:
        return bodies, notes
    return [_body(path, [(node.name, node.parent) for node in nodes], positions, turns)], []


def _body(
    path: Path,
    tree: list[tuple[str, int]],
    positions: list[NDArray[np.float64]],
    turns: list[NDArray[np.float64]],
) -> _Body:
    """Pick the 20 joints out of a skeleton, and note names that it has more than once."""
    points, chosen, notes = kinect_points(path, tree, positions)
    repeated = [name for name, times in Counter(name for name, _ in tree if name).items() if times > 1]
    if repeated:
        notes.append(f"Several joints are named {', '.join(repeated)[:100]}. The first of each name is used.")
    return _Body(points, {name: turns[node] for name, node in chosen.items()}, notes)


def _clip(
    path: Path, times: NDArray[np.float64], body: _Body, options: ReadOptions, notes: tuple[str, ...]
) -> SkeletonClip:
    """Give a body its unit and put it before the sensor."""
    points = body.points
    height = _stature(path, points)
    up, up_note = _up(points, options)
    unit, unit_note = _unit(height, options)
    facing_note = f"Turned to face the sensor in the first frame and put {DISTANCE:g} m before it."
    basis = _sensor_axes(path, points, up)
    positions = unit * (points - points[0, JOINT_INDEX["hip_center"]]) @ basis.T + np.array([0.0, 0.0, DISTANCE])
    orientations = unknown((len(times),))
    for name, turns in body.turns.items():
        orientations[:, JOINT_INDEX[name]] = Rotation.from_matrix(basis @ turns).as_quat()[:, [3, 0, 1, 2]]
    confidence = np.where(np.isnan(positions[..., 0]), LOST, TRACKED).astype(np.float32)
    notes = (unit_note, up_note, facing_note, *notes)
    return clip_of(path, "bvh", times, positions, confidence, notes, orientations)


def forward_kinematics(
    nodes: list[Node], motion: NDArray[np.float64]
) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]]:
    """Compute where every node is, and how it is turned, in every frame.

    Parameters
    ----------
    nodes : list of Node
        Parents before children.
    motion : (T, C) float64
        All channels of all nodes in order; file units and degrees.

    Returns
    -------
    positions : list of (T, 3) float64
        One for each node, in file units and axes.
    rotations : list of (T, 3, 3) float64
        From a node's axes to those of the file.
    """
    positions: list[NDArray[np.float64]] = []
    rotations: list[NDArray[np.float64]] = []
    column = 0
    for node in nodes:
        values = motion[:, column : column + len(node.channels)].T
        column += len(node.channels)
        translation = _translation(node, values)
        rotation = np.eye(3)
        for (axis, kind), value in zip(node.channels, values, strict=True):
            if kind == "rotation":
                rotation = rotation @ _turn("XYZ".index(axis), np.radians(value))
        rotation = np.broadcast_to(rotation, (len(motion), 3, 3))
        if node.parent < 0:
            positions.append(translation)
            rotations.append(rotation)
        else:
            parent = rotations[node.parent]
            positions.append(positions[node.parent] + (parent @ translation[..., None])[..., 0])
            rotations.append(parent @ rotation)
    return positions, rotations


def _translation(node: Node, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (T, 3) translation of a node from its parent.

    Programs disagree whether position channels replace the offset or come on top. What replaces an offset stays near
    it, since joints do not leave their sockets; what comes on top stays near zero.
    """
    axes = ["XYZ".index(axis) for axis, kind in node.channels if kind == "position"]
    channels = [value for (_, kind), value in zip(node.channels, values, strict=True) if kind == "position"]
    translation = np.tile(node.offset, (values.shape[1], 1))
    if axes:
        moved = np.stack(channels, axis=1)
        middle = np.median(moved, axis=0)
        on_top = np.linalg.norm(middle) < np.linalg.norm(middle - node.offset[axes])
        translation[:, axes] = moved + node.offset[axes] if on_top else moved
    return translation


def _turn(axis: int, angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (T, 3, 3) rotations about a coordinate axis by (T,) radians."""
    j, k = (axis + 1) % 3, (axis + 2) % 3
    turn = np.zeros((len(angle), 3, 3))
    turn[:, axis, axis] = 1
    turn[:, j, j] = turn[:, k, k] = np.cos(angle)
    turn[:, k, j] = np.sin(angle)
    turn[:, j, k] = -turn[:, k, j]
    return turn


def _up(points: NDArray[np.float64], options: ReadOptions) -> tuple[NDArray[np.float64], str]:
    """Return the unit vector that points up."""
    if options.up is not None:
        return np.eye(3)["xyz".index(options.up)], f"Up is {options.up}, as given."
    ankles = (points[:, JOINT_INDEX["ankle_left"]] + points[:, JOINT_INDEX["ankle_right"]]) / 2
    body = np.median(points[:, JOINT_INDEX["head"]] - ankles, axis=0)
    axis = int(np.abs(body).argmax())
    sign = 1.0 if body[axis] > 0 else -1.0
    return sign * np.eye(3)[axis], f"Up is taken to be {'−' if sign < 0 else ''}{'xyz'[axis]}, from feet to head."


def _unit(height: float, options: ReadOptions) -> tuple[float, str]:
    """Return the metres in one unit of the file."""
    if options.unit is not None:
        return options.unit, f"One unit is {options.unit:g} m, as given."
    for name, unit in UNITS.items():
        if HUMAN[0] <= height * unit <= HUMAN[1]:
            return unit, f"Lengths are taken to be {name}: the body is then {height * unit:.2f} m tall."
    unit = USUAL_HEIGHT / height
    return unit, f"No usual unit makes the body a human's size: scaled to {USUAL_HEIGHT:g} m, {unit:.4g} m a unit."


def _stature(path: Path, points: NDArray[np.float64]) -> float:
    """Return the body's height in file units, from bones and thus in any pose."""
    chain = ("head", "shoulder_center", "spine", "hip_center"), ("hip_right", "knee_right", "ankle_right")
    bones = [
        np.linalg.norm(points[:, JOINT_INDEX[one]] - points[:, JOINT_INDEX[other]], axis=1)
        for part in chain
        for one, other in pairwise(part)
    ]
    height = CROWN_AND_SOLE * float(np.median(np.sum(bones, axis=0)))
    if height < 1 / MAX_NUMBER:
        raise SkeletonLogError(
            path,
            found="a body without size",
            expected="bones with a length",
            fix="Export the motion again with the offsets of its skeleton.",
        )
    return height


def _sensor_axes(path: Path, points: NDArray[np.float64], up: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the file's directions of the sensor frame's axes (3, 3), for a performer who faces it at first."""
    first = {name: points[0, index] for name, index in JOINT_INDEX.items()}
    across = first["hip_right"] - first["hip_left"] + first["shoulder_right"] - first["shoulder_left"]
    right = across - up * (across @ up)
    if np.linalg.norm(right) < 0.1 * np.linalg.norm(across) or not np.any(across):
        raise SkeletonLogError(
            path,
            found="a first frame in which the left-to-right line of hips and shoulders points up",
            expected="a performer whose facing can be told",
            fix="Say which axis points up (y or z), or cut the first frames.",
        )
    right = right / np.linalg.norm(right)
    return np.stack([right, up, np.cross(right, up)])


def parse(path: Path, fps: float | None = None) -> tuple[list[Node], NDArray[np.float64], float, tuple[str, ...]]:
    """Read the file's text.

    Parameters
    ----------
    path : Path
    fps : float, optional
        Frames a second where the file has no usable frame time.

    Returns
    -------
    nodes : list of Node
    motion : (T, C) float64
    frame_time : float
        Seconds.
    notes : tuple of str
        On what the file says of itself and what it holds.

    Raises
    ------
    SkeletonLogError
        At the first line that does not fit.
    """
    lines = _Lines(path)
    nodes = _hierarchy(lines)
    count_line = lines.take("Frames: and a number")
    count = FRAMES.fullmatch(count_line[1])
    if count is None:
        raise bad_line(path, count_line, repr(count_line[1][:40]), "Frames: and a whole number")
    frame_time, time_notes = _frame_time(path, lines.take("Frame Time: and seconds"), fps)
    layout = RowLayout(sum(len(node.channels) for node in nodes), "one number a channel")
    rows, row_notes = _rows(layout, list(lines), int(count[1]))
    if not rows:
        raise SkeletonLogError(
            at(path, count_line[0]),
            found=f"Frames: {count[1]}, and 0 lines of motion",
            expected="at least one line of motion",
            fix="The file may be cut short: copy it again, or export the motion with the skeleton.",
        )
    if len(rows) * len(nodes) > MAX_PLACES:
        raise SkeletonLogError(
            at(path, count_line[0]),
            found=f"{len(rows)} frames of {len(nodes)} joints",
            expected=f"at most {MAX_PLACES // len(nodes)} frames",
            fix="Cut the take, or store it at a lower frame rate.",
        )
    motion = layout.table(path, rows)
    for row, values in zip(rows, motion, strict=True):
        _check_size(path, row, values)
    return nodes, motion, frame_time, (*time_notes, *row_notes)


def _frame_time(path: Path, line: Line, fps: float | None) -> tuple[float, tuple[str, ...]]:
    """Return the seconds a frame, from `fps` where the file's are none."""
    stated = FRAME_TIME.fullmatch(line[1])
    if stated is None:
        raise bad_line(path, line, repr(line[1][:40]), "Frame Time: and seconds")
    frame_time = RowLayout(1, "seconds a frame").numbers(path, (line[0], stated[1] + "\n"))[0]
    if 1e-5 <= frame_time <= 3600:
        return frame_time, ()
    if fps is None:
        raise SkeletonLogError(
            at(path, line[0]),
            found=f"a frame time of {frame_time:g} s",
            expected="more than 0, as 0.0333",
            fix="Give the frames per second, or correct the line.",
        )
    return 1 / fps, (f"The frame time of {frame_time:g} s is none. {fps:g} frames per second are used, as given.",)


def _rows(layout: RowLayout, lines: list[Line], announced: int) -> tuple[list[Line], tuple[str, ...]]:
    """Return the lines of motion, and notes on what is not as the file announces it.

    What follows the announced frames is motion too, unless it is words at the end of the file.
    """
    end = len(lines)
    while end > announced and not is_number(lines[end - 1][1].split()[0]):
        end -= 1
    rows, notes = layout.whole(lines[:end])
    if len(rows) != announced:
        notes = (*notes, count_note(announced, len(rows)))
    if end < len(lines):
        notes = (*notes, f"The text from line {lines[end][0]} on, after the last frame, is omitted.")
    return rows, notes


class _Lines(LineSource):
    """The lines that are not blank, with each brace on a line of its own."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, self._split(read_lines(path)))

    @staticmethod
    def _split(lines: list[Line]) -> Iterator[Line]:
        for number, text in lines:
            if "{" in text or "}" in text:
                yield from ((number, part) for part in re.split("([{}])", text) if part.strip())
            else:
                yield number, text

    def take(self, expected: str) -> Line:
        """Return the next line without the space around it."""
        number, text = super().take(expected)
        return number, text.strip()


def _hierarchy(lines: _Lines) -> list[Node]:
    path = lines.path
    line = lines.take("HIERARCHY")
    if line[1].upper() != "HIERARCHY":
        raise bad_line(path, line, repr(line[1][:40]), "HIERARCHY")
    nodes: list[Node] = []
    parents: list[int] = []
    while True:
        line = lines.take("the rest of the hierarchy")
        word, name = _keyword(line)
        if word == "}" and parents:
            parents.pop()
        elif word == "MOTION" and nodes and not parents:
            return nodes
        elif (word == "ROOT" and not parents) or (word in ("JOINT", "END") and parents and nodes[parents[-1]].name):
            if len(nodes) == MAX_JOINTS:
                raise bad_line(path, line, f"more than {MAX_JOINTS} joints", "the skeleton of one body")
            nodes.append(_node(lines, "" if word == "END" else name or "unnamed", parents[-1] if parents else -1))
            parents.append(len(nodes) - 1)
        else:
            raise bad_line(path, line, repr(line[1][:40]), "ROOT, JOINT, End Site, } or, after the last }, MOTION")


def _node(lines: _Lines, name: str, parent: int) -> Node:
    path = lines.path
    line = lines.take("{")
    if line[1] != "{":
        raise bad_line(path, line, repr(line[1][:40]), "{")
    line = lines.take("OFFSET")
    word, numbers = _keyword(line)
    if word != "OFFSET":
        raise bad_line(path, line, repr(line[1][:40]), "OFFSET and three numbers")
    offset = np.array(RowLayout(3, "OFFSET x y z").numbers(path, (line[0], numbers + "\n")))
    _check_size(path, line, offset)
    return Node(name, parent, offset, _channels(path, lines.take("CHANNELS")) if name else ())


def _check_size(path: Path, line: Line, values: NDArray[np.float64]) -> None:
    if values.size and np.abs(values).max() > MAX_NUMBER:
        raise bad_line(path, line, f"the number {values[np.abs(values).argmax()]:g}", f"numbers up to {MAX_NUMBER:g}")


def _keyword(line: Line) -> tuple[str, str]:
    """Return a line's first word in capitals, as some programs do not write it, and the rest."""
    word, *rest = line[1].split(maxsplit=1)
    return word.upper(), "".join(rest)


def _channels(path: Path, line: Line) -> tuple[tuple[str, str], ...]:
    word, *count = line[1].split()
    names = count[1:]
    channels = tuple((name[:1].upper(), name[1:].lower()) for name in names)
    known = all(axis in "XYZ" and kind in ("position", "rotation") for axis, kind in channels)
    if word.upper() != "CHANNELS" or count[:1] != [str(len(names))] or not known or len(set(channels)) != len(names):
        raise bad_line(
            path,
            line,
            repr(line[1][:80]),
            "CHANNELS, their number, and that many different ones of Xposition … Zrotation",
        )
    return channels
