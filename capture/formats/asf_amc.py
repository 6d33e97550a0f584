"""ASF/AMC of Acclaim: a skeleton (.asf), and its motion (.amc), which needs the skeleton beside it.

A bone has a direction and a length in the axes of the rest pose. Its angles are about axes of its own, C: the rotation
of a bone is C · R · C⁻¹, with the rotations R about x, y and z in the order of its degrees of freedom.
"""

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from capture.clip import SkeletonClip
from capture.formats._rows import Line, is_number, line_error, read_lines
from capture.formats.clips import MAX_JOINTS, frame_rate, refuse_too_many
from capture.formats.options import ReadOptions
from capture.formats.skeleton_motion import SkeletonMotion, clips_of, forward_kinematics, rest_positions
from puppetline.errors import SkeletonLogError, at

Floats = NDArray[np.float64]

DEFAULT_FPS = 120.0
"""Frame rate of CMU's recordings, in frames per second; the format states none."""

MAX_FRAMES = 1_000_000

FREEDOMS = {"tx", "ty", "tz", "rx", "ry", "rz", "l"}
"""Degrees of freedom of a bone: translations, rotations, and the length."""


@dataclass(slots=True)
class Bone:
    """A bone: its vector at rest, the rotation of its axes, its degrees of freedom, and the bone it hangs on."""

    name: str
    vector: Floats = field(default_factory=lambda: np.zeros(3))
    axes: Floats = field(default_factory=lambda: np.eye(3))
    freedoms: tuple[str, ...] = ()
    parent: int = -1


def matches(head: bytes) -> bool:
    """Return whether a file's head is that of a skeleton or of its motion."""
    text = re.sub(rb"#[^\r\n]*", b"", head[:4096]).split()
    is_motion = bytes(head[:16]).upper().startswith(b"#!OML:ASF") or b":FULLY-SPECIFIED" in text[:4]
    return is_motion or text[:1] == [b":version"]


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:
    """Read the motion of an .amc file, or the rest pose of an .asf file, as one clip.

    Raises
    ------
    SkeletonLogError
        A line violates the format, or no .asf file beside an .amc file has its skeleton.
    """
    lines = _words(path)
    if lines and lines[0][1][0].startswith(":version"):
        bones, unit = _skeleton(path, lines)
        values, notes = [np.zeros((1, len(bone.freedoms))) for bone in bones], ("It is a skeleton without motion.",)
    else:
        skeleton_path = _skeleton_of(path)
        bones, unit = _skeleton(skeleton_path, _words(skeleton_path))
        values, notes = _motion(path, lines, bones), (f"The skeleton is that of {skeleton_path.name}.",)
    fps, rate_notes = frame_rate(options, DEFAULT_FPS)
    times = np.arange(len(values[0])) / fps
    return clips_of(path, "asf_amc", times, _motion_of(bones, values, unit), options, (*notes, *rate_notes))


def _words(path: Path) -> list[tuple[int, list[str]]]:
    """Return the words of the lines that are no comments."""
    lines = ((number, text.split("#", 1)[0].split()) for number, text in read_lines(path))
    return [(number, words) for number, words in lines if words]


def _skeleton_of(path: Path) -> Path:
    """Return the skeleton beside a motion: that which it names, or whose name its own begins with, or the only one."""
    beside = sorted(each for each in path.parent.iterdir() if each.suffix.lower() == ".asf")
    with path.open(errors="replace") as file:
        stated = re.split(r"[\\/]", file.readline(1000).strip().partition(" ")[2])[-1].lower()
    named = [each for each in beside if each.name.lower() == stated]
    begun = sorted((each for each in beside if path.stem.startswith(each.stem)), key=lambda each: len(each.stem))
    found = named or begun[-1:] or (beside if len(beside) == 1 else [])
    if not found:
        raise SkeletonLogError(
            path,
            found=f"motion without its skeleton: {len(beside)} .asf files beside it, none of its name",
            expected="the .asf file of the same person in the same folder, such as 01.asf for 01_02.amc",
            fix="Copy the .asf file of this data set beside it.",
        )
    return found[0]


def _skeleton(path: Path, lines: list[tuple[int, list[str]]]) -> tuple[list[Bone], float]:
    """Return the bones, parents first, the root as the first one, and the radians per unit of angle."""
    bones = {"root": Bone("root", freedoms=("tx", "ty", "tz", "rx", "ry", "rz"))}
    order, section, bone = ["root"], "", bones["root"]
    angle_unit = np.radians(1.0)
    number, word, rest = 0, "", [""]
    try:
        for number, (word, *rest) in lines:  # noqa: B007 (named in the error)
            key = word.lower()
            if key.startswith(":"):
                section = key
            elif section == ":units" and key == "angle":
                angle_unit = 1.0 if rest[0].lower().startswith("rad") else angle_unit
            elif section == ":root" and key == "order":
                bones["root"].freedoms = _freedoms(rest)
            elif section == ":hierarchy" and key not in ("begin", "end"):
                for child in rest:
                    if child in order or len(order) >= MAX_JOINTS:
                        raise ValueError(child)
                    bones[child].parent = order.index(word)
                    order.append(child)
            elif section == ":bonedata":
                bone = _with_property(bone, key, rest, angle_unit, bones)
    except (KeyError, ValueError, IndexError) as error:
        line: Line = (number, "")
        expected = f"a bone of an ASF skeleton, which has at most {MAX_JOINTS} bones and each only once"
        raise line_error(path, line, f"{word!r} with {' '.join(rest)[:60]!r}", expected) from error
    return [bones[name] for name in order], angle_unit


def _with_property(bone: Bone, key: str, rest: list[str], unit: float, bones: dict[str, Bone]) -> Bone:
    """Set a property of a bone; return the bone that the next line describes."""
    if key == "name":
        bone = bones.setdefault(rest[0], Bone(rest[0]))
    elif key == "direction":
        bone.vector = np.array(rest[:3], dtype=np.float64).reshape(3)
    elif key == "length":
        bone.vector = bone.vector * float(rest[0])
    elif key == "axis":
        angles = unit * np.array(rest[:3], dtype=np.float64)
        order = (rest[3] if len(rest) > 3 else "XYZ").lower()
        bone.axes = Rotation.from_euler(order, [angles["xyz".index(axis)] for axis in order]).as_matrix()
    elif key == "dof":
        bone.freedoms = _freedoms(rest)
    return bone


def _freedoms(words: list[str]) -> tuple[str, ...]:
    """Return degrees of freedom; an error if one is unknown or repeated."""
    freedoms = tuple(word.lower() for word in words)
    if len(set(freedoms) & FREEDOMS) != len(freedoms):
        raise ValueError(words)
    return freedoms


def _motion(path: Path, lines: list[tuple[int, list[str]]], bones: list[Bone]) -> list[Floats]:
    """Return the values (T, freedoms) of each bone; a bone without a line in a frame has zeros."""
    index = {bone.name: number for number, bone in enumerate(bones)}
    frames: list[list[list[float] | None]] = []
    for number, words in lines:
        line: Line = (number, " ".join(words))
        if words[0].startswith(":"):
            continue
        if len(words) == 1 and is_number(words[0]):
            frames.append([None] * len(bones))
            continue
        bone = index.get(words[0])
        if bone is None or not frames:
            raise line_error(path, line, repr(words[0][:40]), "a frame number, or a bone of the skeleton")
        expected = len(bones[bone].freedoms)
        if len(words) != expected + 1 or not all(map(is_number, words[1:])):
            if number == lines[-1][0] and len(frames) > 1:
                frames.pop()
                break
            raise line_error(path, line, f"{len(words) - 1} values", f"{expected} numbers")
        frames[-1][bone] = [float(word) for word in words[1:]]
    if not 0 < len(frames) <= MAX_FRAMES:
        raise SkeletonLogError(
            path,
            found=f"{len(frames)} frames",
            expected=f"1 to {MAX_FRAMES} frames of motion",
            fix="Copy or export the file again.",
        )
    refuse_too_many(path, len(frames), len(bones))
    values = [
        np.array([frame[number] or np.zeros(len(bone.freedoms)) for frame in frames], dtype=np.float64)
        for number, bone in enumerate(bones)
    ]
    for moved, each in zip(bones, values, strict=True):
        if not np.isfinite(each).all():
            raise SkeletonLogError(
                at(path, field=moved.name),
                found="a number that is not finite",
                expected="numbers",
                fix="Export it again.",
            )
    return values


def _motion_of(bones: list[Bone], values: list[Floats], unit: float) -> SkeletonMotion:
    """Return the motion of joints at the beginnings of the bones, and of the ends of the last ones."""
    parents = [bone.parent for bone in bones]
    last = [number for number in range(len(bones)) if number not in parents]
    offsets = [bones[parent].vector if parent >= 0 else np.zeros(3) for parent in [*parents, *last]]
    count = len(values[0])
    translations = [np.tile(offset, (count, 1)) for offset in offsets]
    moved = [freedom for freedom in bones[0].freedoms if freedom.startswith("t")]
    for freedom in moved:
        translations[0][:, "xyz".index(freedom[1])] = values[0][:, bones[0].freedoms.index(freedom)]
    rotations = [_rotation(bone, each, unit) for bone, each in zip(bones, values, strict=True)]
    rotations += [np.broadcast_to(np.eye(3), (count, 3, 3))] * len(last)
    names = [bone.name for bone in bones] + [""] * len(last)
    every = [*parents, *last]
    return SkeletonMotion(
        names, every, rest_positions(every, offsets), *forward_kinematics(every, translations, rotations)
    )


def _rotation(bone: Bone, values: Floats, unit: float) -> Floats:
    """Return the rotations (T, 3, 3) of a bone in the axes of the rest pose."""
    turns = [(freedom[1], column) for column, freedom in enumerate(bone.freedoms) if freedom.startswith("r")]
    if not turns:
        return np.broadcast_to(np.eye(3), (len(values), 3, 3))
    order, columns = "".join(axis for axis, _ in turns), [column for _, column in turns]
    turned = Rotation.from_euler(order, unit * values[:, columns]).as_matrix()
    rotations: Floats = bone.axes @ turned @ bone.axes.T
    return rotations
