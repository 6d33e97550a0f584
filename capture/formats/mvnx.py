"""MVNX of Xsens: positions and orientations of 23 segments, as XML. z points up, lengths are metres."""

from pathlib import Path
from typing import Any
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from capture.clip import SkeletonClip
from capture.formats._files import opened
from capture.formats._rows import is_number
from capture.formats.clips import refuse_too_many
from capture.formats.options import ReadOptions
from capture.formats.skeleton_motion import SkeletonMotion, clips_of
from puppetline.errors import SkeletonLogError, at

_LEG, _ARM = ("UpperLeg", "LowerLeg", "Foot", "Toe"), ("Shoulder", "UpperArm", "Forearm", "Hand")
SEGMENTS = (
    *("Pelvis", "L5", "L3", "T12", "T8", "Neck", "Head"),
    *(f"{side}{part}" for chain in (_ARM, _LEG) for side in ("Right", "Left") for part in chain),
)
"""Names of the segments in the order in which files have them, if a file does not name them."""

MAX_CHARACTERS = 1_000_000_000
"""Maximum number of characters of numbers, so that a damaged file does not fill the memory."""


def matches(head: bytes) -> bool:
    """Return whether a file's head is XML with the root element of MVNX."""
    return b"<mvnx" in head or (b"<frames" in head and b"segmentCount" in head)


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:
    """Read one clip; `options.fps` replaces the file's times.

    Raises
    ------
    SkeletonLogError
        The file is damaged, has document types or entities, or has no frames.
    """
    file = _File()
    try:
        with opened(path) as source:
            file.parser.ParseFile(source)
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise SkeletonLogError(
            at(path, file.parser.CurrentLineNumber),
            found=f"XML that cannot be read ({error})",
            expected="an MVNX file",
            fix="Export the file again.",
        ) from error
    names = file.names or list(SEGMENTS)
    count = len(names)
    frames = [each for each in file.frames if len(each[1]) == 3 * count and len(each[2]) == 4 * count]
    moving = [each for each in frames if each[0] == "normal"]
    if not moving or set(SEGMENTS[:7]) - set(names):
        raise SkeletonLogError(
            path,
            found=f"{len(moving)} frames of {count} segments",
            expected="frames with the position and orientation of each segment",
            fix="Export the file again, with positions and orientations.",
        )
    refuse_too_many(path, len(moving), count)
    positions = np.array([each[1] for each in moving]).reshape(len(moving), count, 3)
    turns = np.array([each[2] for each in moving]).reshape(-1, 4)
    lengths = np.linalg.norm(turns, axis=1, keepdims=True)
    turns = np.where(lengths > 0, turns, [1.0, 0.0, 0.0, 0.0])
    rotations = Rotation.from_quat(turns[:, [1, 2, 3, 0]]).as_matrix().reshape(len(moving), count, 3, 3)
    rest = np.array(next((each[1] for each in frames if each[0] != "normal"), moving[0][1])).reshape(count, 3)
    fps = options.fps or file.fps
    times = np.array([each[3] for each in moving]) / 1000 if options.fps is None else np.full(len(moving), np.nan)
    if np.isnan(times).any() or (np.diff(times) <= 0).any():
        times = np.arange(len(moving)) / fps
    parents = [names.index(parent) if (parent := _parent(name)) in names else -1 for name in names]
    motion = SkeletonMotion(names, parents, rest, list(positions.swapaxes(0, 1)), list(rotations.swapaxes(0, 1)))
    return clips_of(path, "mvnx", times, motion, options)


def _parent(name: str) -> str:
    """Return the segment that a segment hangs on."""
    for side in ("Right", "Left"):
        for chain, root in ((_ARM, "T8"), (_LEG, "Pelvis")):
            if name.removeprefix(side) in chain and name != name.removeprefix(side):
                place = chain.index(name.removeprefix(side))
                return side + chain[place - 1] if place else root
    trunk = SEGMENTS[:7]
    return trunk[trunk.index(name) - 1] if name in trunk[1:] else ""


class _File:
    """What a file has: names of segments, frames per second, and type, positions, orientations and ms of each frame."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.fps = 60.0
        self.frames: list[tuple[str, NDArray[np.float64], NDArray[np.float64], float]] = []
        self._frame: dict[str, str] | None = None
        self._values: dict[str, list[str]] = {}
        self._inside, self._size = "", 0
        self.parser = expat.ParserCreate()
        self.parser.StartDoctypeDeclHandler = self._refuse
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._text

    def _refuse(self, *_: Any) -> None:
        raise ValueError("a document type, which no MVNX file needs")

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        if name == "subject" and is_number(rate := attributes.get("frameRate", "")) and float(rate) > 0:
            self.fps = float(rate)
        elif name == "segment" and "label" in attributes:
            self.names.append(attributes["label"])
        elif name == "frame":
            self._frame, self._values = attributes, {}
        elif self._frame is not None and name in ("position", "orientation"):
            self._inside = name

    def _text(self, text: str) -> None:
        if self._inside:
            self._size += len(text)
            if self._size > MAX_CHARACTERS:
                raise ValueError("more numbers than an hour of motion has")
            self._values.setdefault(self._inside, []).append(text)

    def _end(self, name: str) -> None:
        self._inside = ""
        if name == "frame" and self._frame is not None:
            position, turn = (
                np.array("".join(self._values.get(key, [])).split(), dtype=np.float64)
                for key in ("position", "orientation")
            )
            time = self._frame.get("time", "")
            self.frames.append(
                (self._frame.get("type", "normal"), position, turn, float(time) if is_number(time) else np.nan)
            )
            self._frame = None
