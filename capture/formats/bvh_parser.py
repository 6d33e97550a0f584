"""The parser of BVH files: the hierarchy of nodes and the motion of their channels.

Keywords may be in any case. Tabs, blank lines and braces on the line of another keyword are accepted.
"""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from capture.formats._rows import Line, LineSource, RowLayout, count_note, is_number, line_error, read_lines
from capture.formats.clips import DEFAULT_FPS, MAX_JOINTS, refuse_too_many
from puppetline.errors import SkeletonLogError, at

FRAMES = re.compile(r"frames\s*:?\s*(\d{1,9})", re.IGNORECASE)
FRAME_TIME = re.compile(r"frame\s*time\s*:?(.*)", re.IGNORECASE)
LONGEST_SECONDS = 2.0
"""Frame time from which it is in milliseconds, in seconds."""
MAX_DAMAGED_SHARE = 0.05
"""Largest share of lines of motion with too few or too many numbers, of which none is known then."""
MAX_NUMBER = 1e9
"""Bound of the magnitude of a number: larger than any length or angle, small enough that nothing overflows."""


@dataclass(frozen=True, slots=True)
class Node:
    """A joint or an end site of the hierarchy.

    Attributes
    ----------
    name : str
        Empty for an end site.
    parent : int
        Index of the parent, which precedes its children; −1 for a root.
    offset : (3,) float64
        Offset from the parent, in the parent's axes.
    channels : tuple of (str, str)
        Axis and "position" or "rotation", in the order of the numbers in a frame.
    """

    name: str
    parent: int
    offset: NDArray[np.float64]
    channels: tuple[tuple[str, str], ...]


def parse(path: Path, fps: float | None = None) -> tuple[list[Node], NDArray[np.float64], float, tuple[str, ...]]:
    """Parse a file.

    Parameters
    ----------
    path : Path
    fps : float, optional
        Frames per second, in place of the file's frame time.

    Returns
    -------
    nodes : list of Node
    motion : (T, C) float64
        Numbers of all channels of all nodes, in file units and degrees; NaN in damaged lines.
    frame_time : float
        Seconds per frame.
    notes : tuple of str
        Notes on contradictions in the file.

    Raises
    ------
    SkeletonLogError
        A line violates the format, or the file has too much motion or none.
    """
    lines = _Lines(path)
    nodes, has_motion = _hierarchy(lines)
    count, stated_time, rest = _motion_header(path, lines) if has_motion else (0, None, [])
    if not rest and count == 0:
        return nodes, _rest_values(nodes), 1 / (fps or DEFAULT_FPS), ("The file has no motion; it is a rest pose.",)
    frame_time, time_notes = _seconds_per_frame(stated_time, fps)
    width = sum(len(node.channels) for node in nodes)
    layout = RowLayout(width, "one number per channel", unused=range(width))
    rows, row_notes = _motion_lines(layout, rest, count)
    if not rows:
        raise SkeletonLogError(
            at(path, lines.last),
            found=f"Frames: {count or 0}, and 0 lines of motion",
            expected="at least one line of motion",
            fix="The file may be incomplete. Copy it again, or export the motion with the skeleton.",
        )
    refuse_too_many(at(path, lines.last), len(rows), len(nodes))
    counts = np.array([len(layout.split(text)) for _, text in rows])
    count, _ = Counter(counts.tolist()).most_common(1)[0]
    if len(rows) > 1 and count != layout.columns:
        raise SkeletonLogError(
            at(path, rows[0][0]),
            found=f"{count} numbers in most frames, for a skeleton with {layout.columns} channels",
            expected="the motion of this skeleton",
            fix="Export the skeleton and its motion together again.",
        )
    read = np.flatnonzero((counts == count) | (np.mean(counts != count) > MAX_DAMAGED_SHARE))
    motion = np.full((len(rows), width), np.nan)
    motion[read] = layout.table(path, [rows[index] for index in read])
    for row, values in zip(rows, motion, strict=True):
        _check_size(path, row, values)
    return nodes, motion, frame_time, (*time_notes, *row_notes)


def _motion_header(path: Path, lines: "_Lines") -> tuple[int | None, float | None, list[Line]]:
    """Return the stated number of frames and seconds per frame, None if they are missing, and the lines of motion."""
    count, frame_time = None, None
    rest = list(lines)
    while rest and not is_number(rest[0][1].split()[0]):
        line = (rest[0][0], rest[0][1].strip())
        if (stated := FRAMES.fullmatch(line[1])) is not None:
            count = int(stated[1])
        elif (stated := FRAME_TIME.fullmatch(line[1])) is not None:
            frame_time = RowLayout(1, "seconds per frame").numbers(path, (line[0], stated[1] + "\n"))[0]
        else:
            raise line_error(path, line, repr(line[1][:40]), "Frames: and an integer, or Frame Time: and seconds")
        del rest[0]
    return count, frame_time, rest


def _seconds_per_frame(stated: float | None, fps: float | None) -> tuple[float, tuple[str, ...]]:
    """Return the seconds per frame, and notes: of the option, of the file if it states a time, or of `DEFAULT_FPS`."""
    if fps is not None:
        return 1 / fps, (f"{fps:g} frames per second, as given.",)
    if stated is not None and 1e-5 <= stated < LONGEST_SECONDS:
        return stated, ()
    if stated is not None and LONGEST_SECONDS <= stated <= 1000:
        return stated / 1000, (f"The frame time of {stated:g} s is assumed to be milliseconds.",)
    found = "The file states no frame time" if stated is None else f"The frame time of {stated:g} s is invalid"
    return 1 / DEFAULT_FPS, (f"{found}; {DEFAULT_FPS:g} frames per second are assumed.",)


def _rest_values(nodes: list[Node]) -> NDArray[np.float64]:
    """Return the values (1, C) of all channels in the rest pose."""
    kinds = [(kind, node.offset["XYZ".index(axis)]) for node in nodes for axis, kind in node.channels]
    return np.array([[offset if kind == "position" else 0.0 for kind, offset in kinds]])


def _motion_lines(layout: RowLayout, lines: list[Line], stated: int | None) -> tuple[list[Line], tuple[str, ...]]:
    """Return the lines of motion, and notes on differences from the stated number of frames.

    Lines after the stated frames are motion too, except for words at the end of the file.
    """
    end = len(lines)
    while end > (stated or 0) and not is_number(lines[end - 1][1].split()[0]):
        end -= 1
    rows, notes = layout.complete(lines[:end])
    if stated is not None and len(rows) != stated:
        notes = (*notes, count_note(stated, len(rows)))
    if end < len(lines):
        notes = (*notes, f"The text from line {lines[end][0]} on, after the last frame, is omitted.")
    return rows, notes


class _Lines(LineSource):
    """The lines that are not blank, with each brace on a line of its own."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, self._split(read_lines(path, errors="replace")))

    @staticmethod
    def _split(lines: list[Line]) -> Iterator[Line]:
        for number, text in lines:
            if "{" in text or "}" in text:
                yield from ((number, part) for part in re.split("([{}])", text) if part.strip())
            else:
                yield number, text

    def take(self, expected: str) -> Line:
        """Return the next line without surrounding white space."""
        number, text = super().take(expected)
        return number, text.strip()

    def next_word(self) -> str:
        """Return the first word of the next line, in capitals; empty at the end."""
        line = next(self._lines, None)
        if line is None:
            return ""
        self._lines = chain([line], self._lines)
        return line[1].split()[0].upper()


def _hierarchy(lines: _Lines) -> tuple[list[Node], bool]:
    """Return the nodes, and whether motion follows."""
    path = lines.path
    line = lines.take("HIERARCHY")
    if line[1].upper() != "HIERARCHY":
        raise line_error(path, line, repr(line[1][:40]), "HIERARCHY")
    nodes: list[Node] = []
    parents: list[int] = []
    while True:
        if nodes and not parents and ((word := lines.next_word()) == "" or word.startswith("FRAME")):
            return nodes, word != ""  # some files lack the word MOTION
        line = lines.take("the rest of the hierarchy")
        word, name = _keyword(line)
        if word == "}" and parents:
            parents.pop()
        elif word == "MOTION" and nodes and not parents:
            return nodes, True
        elif (word == "ROOT" and not parents) or (word in ("JOINT", "END") and parents and nodes[parents[-1]].name):
            if len(nodes) == MAX_JOINTS:
                raise line_error(path, line, f"more than {MAX_JOINTS} joints", "the skeleton of one body")
            nodes.append(_node(lines, "" if word == "END" else name or "unnamed", parents[-1] if parents else -1))
            parents.append(len(nodes) - 1)
        else:
            raise line_error(path, line, repr(line[1][:40]), "ROOT, JOINT, End Site, } or, after the last }, MOTION")


def _node(lines: _Lines, name: str, parent: int) -> Node:
    path = lines.path
    line = lines.take("{")
    if line[1] != "{":
        raise line_error(path, line, repr(line[1][:40]), "{")
    offset: NDArray[np.float64] = np.zeros(3)
    channels: tuple[tuple[str, str], ...] = ()
    missing = {"OFFSET", "CHANNELS"}
    while (word := lines.next_word()) in missing or "OFFSET" in missing:
        line = lines.take("OFFSET")
        if word not in missing:
            raise line_error(path, line, repr(line[1][:40]), "OFFSET and three numbers")
        missing.discard(word)
        _, numbers = _keyword(line)
        if word == "OFFSET":
            offset = np.array(RowLayout(3, "OFFSET x y z").numbers(path, (line[0], numbers + "\n")))
            _check_size(path, line, offset)
        else:
            channels = _channels(path, line)
    return Node(name, parent, offset, channels if name else ())


def _check_size(path: Path, line: Line, values: NDArray[np.float64]) -> None:
    if values.size and np.abs(values).max() > MAX_NUMBER:
        raise line_error(path, line, f"the number {values[np.abs(values).argmax()]:g}", f"numbers up to {MAX_NUMBER:g}")


def _keyword(line: Line) -> tuple[str, str]:
    """Return a line's first word in capitals, which some programs do not write, and the rest of the line."""
    word, *rest = line[1].split(maxsplit=1)
    return word.upper(), "".join(rest)


def _channels(path: Path, line: Line) -> tuple[tuple[str, str], ...]:
    word, *count = line[1].split()
    names = count[1:]
    channels = tuple((name[:1].upper(), name[1:].lower()) for name in names)
    known = all(axis in "XYZ" and kind in ("position", "rotation") for axis, kind in channels)
    if word.upper() != "CHANNELS" or count[:1] != [str(len(names))] or not known or len(set(channels)) != len(names):
        expected = "CHANNELS, their number, and that many different channels of Xposition … Zrotation"
        raise line_error(path, line, repr(line[1][:80]), expected)
    return channels
