"""NTU RGB+D `.skeleton`: Kinect v2 bodies as lines of text.

The first line counts the frames; each frame starts with a line that counts its bodies (0 where nobody was seen); each
body is a line of 10 values that starts with its id, a line ``25``, and 25 lines of 12 values: x y z in metres in the
sensor frame, four pixel coordinates, a quaternion, and the state 0 lost, 1 inferred, 2 tracked. The recordings have no
clock; the sensor ran at 30 frames a second.
"""

from pathlib import Path

from capture.clip import SkeletonClip
from capture.formats._clips import frame_rate
from capture.formats._performers import clips_by_performer
from capture.formats._rows import LineSource, RowLayout, bad_line, confidence_of, head_lines, read_lines
from capture.formats.layouts import K25, to_kinect20
from capture.formats.options import ReadOptions
from capture.skeleton import INFERRED, LOST, TRACKED, SkeletonFrame
from puppetline.errors import SkeletonLogError, at

FPS = 30.0
HEAD_LINES = 1000
"""More than a take has empty frames before its first body."""
STATES = (LOST, INFERRED, TRACKED)
BODY = RowLayout(10, "body id, clipped edges, confidence and state of each hand, restricted, lean x and y, state")
JOINT = RowLayout(12, "x y z, depth x y, colour x y, quaternion w x y z, state")


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
        A line does not fit, the counts disagree with what is there, or nobody is tracked.
    """
    fps, notes = frame_rate(options, FPS)
    lines = _Lines(path, read_lines(path))
    frames: list[SkeletonFrame] = []
    for frame in range(lines.count("the number of frames")):
        bodies = lines.count(f"the number of bodies in frame {frame}")
        frames.extend(_body(lines, frame / fps) for _ in range(bodies))
    lines.end()
    return clips_by_performer(path, "ntu", frames, notes)


class _Lines(LineSource):
    """A file whose counts say how much follows."""

    def count(self, meaning: str) -> int:
        line = self.take(meaning)
        text = line[1].strip()
        if not (text.isascii() and text.isdecimal() and len(text) <= 9):
            raise bad_line(self.path, line, repr(text[:40]), f"{meaning}, a whole number")
        return int(text)

    def end(self) -> None:
        line = next(self._lines, None)
        if line is not None:
            raise bad_line(self.path, line, "more lines", "the end of the file after the frames that line 1 counts")


def _body(lines: _Lines, time: float) -> SkeletonFrame:
    line = lines.take("a body")
    BODY.numbers(lines.path, line)
    user = line[1].split()[0]
    if not (user.isascii() and user.isdecimal() and len(user) <= 18):  # float would round an id of 17 digits
        raise bad_line(lines.path, line, f"the body id {user!r}", "a whole number of up to 18 digits")
    if lines.count("the number of joints, 25") != len(K25):
        raise SkeletonLogError(
            at(lines.path, line[0] + 1), found="another number of joints", expected="25", fix="Copy the file again."
        )
    rows = [lines.take(f"joint {joint} of 25") for joint in range(len(K25))]
    table = JOINT.table(lines.path, rows)
    confidence = confidence_of(lines.path, rows, table[:, -1:], STATES)[:, 0]
    return SkeletonFrame(time, int(user), *to_kinect20(K25, table[:, :3], confidence))
