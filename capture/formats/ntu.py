"""NTU RGB+D `.skeleton`: Kinect v2 bodies as lines of text.

The first line counts the frames; each frame starts with a line that counts its bodies (0 where nobody was seen); each
body is a line of 10 values that starts with its id, a line ``25``, and 25 lines of 12 values: x y z in metres in the
sensor frame, four pixel coordinates, a quaternion w x y z that turns with the bone that ends at the joint, and the
state 0 lost, 1 inferred, 2 tracked. The recordings have no clock; the sensor ran at 30 frames a second.
"""

from pathlib import Path

from capture.clip import SkeletonClip
from capture.formats._clips import frame_rate
from capture.formats._performers import clips_by_performer
from capture.formats._rows import (
    CutOffError,
    Line,
    LineSource,
    RowLayout,
    bad_line,
    confidence_of,
    count_note,
    cut_note,
    cut_off,
    head_lines,
    read_lines,
)
from capture.formats.layouts import K25, orientations_to_kinect20, to_kinect20
from capture.formats.options import ReadOptions
from capture.orientations import of_bones_that_begin
from capture.skeleton import INFERRED, LOST, TRACKED, SkeletonFrame
from puppetline.errors import SkeletonLogError, at

FPS = 30.0
HEAD_LINES = 1000
"""More than a take has empty frames before its first body."""
STATES = (LOST, INFERRED, TRACKED)
BODY = RowLayout(
    10,
    "body id, clipped edges, confidence and state of each hand, restricted, lean x and y, state",
    unused=range(1, 10),
)
JOINT = RowLayout(12, "x y z, depth x y, colour x y, quaternion w x y z, state", unused=range(3, 11))
"""The sensor's SDK gives infinite pixels to a joint that neither camera sees."""


def matches(head: bytes) -> bool:
    """Tell whether a file's head is one: counts, then a body's 10 values, 25, and a joint's 12."""
    lines = head_lines(head, HEAD_LINES)
    counts = next((index for index, line in enumerate(lines) if not line.strip().isdecimal()), len(lines))
    if counts < 2 or counts + 2 >= len(lines):
        return False
    body, joints, joint = lines[counts : counts + 3]
    return BODY.fits(body) and joints.strip() == str(len(K25)) and JOINT.fits(joint)


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:
    """Read every body, one clip for each body id.

    Parameters
    ----------
    path : Path
    options : ReadOptions
        `fps` replaces the sensor's 30.

    Returns
    -------
    list of SkeletonClip

    Raises
    ------
    SkeletonLogError
        A line does not fit, the file ends before a first body is whole, or nobody is tracked.
    """
    fps, notes = frame_rate(options, FPS)
    lines = LineSource(path, read_lines(path))
    announced = _count(path, lines.take("the number of frames"), "the number of frames")
    frames: list[list[SkeletonFrame]] = []
    for line in lines:
        try:
            bodies = _count(path, line, f"the number of bodies in frame {len(frames)}")
            frames.append([_body(lines, len(frames) / fps) for _ in range(bodies)])
        except CutOffError:
            if not any(frames):
                raise
            notes = (*notes, cut_note(line))
            break
    if len(frames) != announced:
        notes = (*notes, count_note(announced, len(frames)))
    return clips_by_performer(path, "ntu", [body for bodies in frames for body in bodies], notes)


def _count(path: Path, line: Line, meaning: str) -> int:
    text = line[1].strip()
    if not (text.isascii() and text.isdecimal() and len(text) <= 9):
        raise bad_line(path, line, repr(text[:40]), f"{meaning}, a whole number")
    return int(text)


def _body(lines: LineSource, time: float) -> SkeletonFrame:
    line = lines.take("a body")
    BODY.numbers(lines.path, line)
    user = line[1].split()[0]
    if not (user.isascii() and user.isdecimal() and len(user) <= 18):  # float would round an id of 17 digits
        raise bad_line(lines.path, line, f"the body id {user!r}", "a whole number of up to 18 digits")
    count = lines.take("the number of joints, 25")
    if not count[1].endswith("\n"):
        raise cut_off(lines.path, line, "the end of the file after a body's number of joints", "25 lines of joints")
    if _count(lines.path, count, "the number of joints, 25") != len(K25):
        raise SkeletonLogError(
            at(lines.path, count[0]), found="another number of joints", expected="25", fix="Copy the file again."
        )
    rows = [lines.take(f"joint {joint} of 25") for joint in range(len(K25))]
    table = JOINT.table(lines.path, rows)
    confidence = confidence_of(lines.path, rows, table[:, -1:], STATES)[:, 0]
    turns = of_bones_that_begin(orientations_to_kinect20(K25, table[:, 7:11]))
    return SkeletonFrame(time, int(user), *to_kinect20(K25, table[:, :3], confidence), turns)
