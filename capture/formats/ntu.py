"""NTU RGB+D `.skeleton`: Kinect v2 bodies as lines of text.

The first line is the number of frames. Each frame begins with a line that holds its number of bodies, which may be 0.
Each body has a line of 10 values, a line ``25``, and 25 lines of 12 values. The first of the 10 is the body's id; the
third to sixth are confidence and state of the left and of the right hand, which become channels where the confidence is
high. The 12 are x y z in metres in sensor coordinates, four pixel coordinates, the orientation w x y z of the bone that
ends at the joint, and the state: 0 lost, 1 inferred, 2 tracked. There is no clock; the sensor ran at 30 frames per
second.
"""

from pathlib import Path

from capture.clip import SkeletonClip
from capture.formats import _rows as rows
from capture.formats._hand_states import hand_channels
from capture.formats.clips import DEFAULT_FPS, clips_by_performer, frame_rate
from capture.formats.layouts import K25, orientations_to_kinect20, to_kinect20
from capture.formats.options import ReadOptions
from capture.orientations import move_to_bone_starts
from capture.skeleton import INFERRED, LOST, TRACKED, SkeletonFrame
from puppetline.errors import SkeletonLogError, at

MAX_HEAD_LINES = 1000
"""Number of lines that are searched for the first body: more than the empty frames before it."""
BODY = rows.RowLayout(
    10,
    "body id, clipped edges, confidence and state of each hand, restricted, lean x and y, state",
    unused=range(1, 10),
)
HIGH_CONFIDENCE = 1
"""The SDK's high confidence in the state of a hand; the low one is 0."""
JOINT = rows.RowLayout(12, "x y z, depth x y, colour x y, quaternion w x y z, state", unused=range(3, 11))
"""Columns of a joint. The sensor's SDK writes infinite pixels for a joint outside the view of both cameras."""


def matches(head: bytes) -> bool:
    """Return whether a file's head has counts, then a body's 10 values, the number 25, and a joint's 12 values."""
    lines = rows.head_lines(head, MAX_HEAD_LINES)
    counts = next((index for index, line in enumerate(lines) if not line.strip().isdecimal()), len(lines))
    if counts < 2 or counts + 2 >= len(lines):
        return False
    body, joints, joint = lines[counts : counts + 3]
    return BODY.fits(body) and joints.strip() == str(len(K25)) and JOINT.fits(joint)


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:
    """Read one clip per body id; `options.fps` replaces 30 frames per second.

    Raises
    ------
    SkeletonLogError
        A line violates the format, the file ends before the first body is complete, or no performer is tracked.
    """
    fps, notes = frame_rate(options, DEFAULT_FPS)
    lines = rows.LineSource(path, rows.read_lines(path))
    stated = _count(path, lines.take("the number of frames"), "the number of frames")
    frames: list[list[SkeletonFrame]] = []
    for line in lines:
        try:
            bodies = _count(path, line, f"the number of bodies in frame {len(frames)}")
            frames.append([_body(lines, len(frames) / fps) for _ in range(bodies)])
        except rows.CutOffError:
            if not any(frames):
                raise
            notes = (*notes, rows.cut_off_note(line))
            break
    if len(frames) != stated:
        notes = (*notes, rows.count_note(stated, len(frames)))
    return clips_by_performer(path, "ntu", [body for bodies in frames for body in bodies], notes)


def _count(path: Path, line: rows.Line, meaning: str) -> int:
    text = line[1].strip()
    if not (text.isascii() and text.isdecimal() and len(text) <= 9):
        raise rows.line_error(path, line, repr(text[:40]), f"{meaning}, an integer")
    return int(text)


def _body(lines: rows.LineSource, time: float) -> SkeletonFrame:
    line = lines.take("a body")
    _, _, *hands, _, _, _, _ = BODY.numbers(lines.path, line)
    user = line[1].split()[0]
    if not (user.isascii() and user.isdecimal() and len(user) <= 18):  # float would round an id of 17 digits
        raise rows.line_error(lines.path, line, f"the body id {user!r}", "an integer of up to 18 digits")
    count = lines.take("the number of joints, 25")
    if not count[1].endswith("\n"):
        found = "the end of the file after a body's number of joints"
        raise rows.cut_off_error(lines.path, line, found, "25 lines of joints")
    if _count(lines.path, count, "the number of joints, 25") != len(K25):
        raise SkeletonLogError(
            at(lines.path, count[0]),
            found=f"{count[1].strip()} joints",
            expected="25 joints",
            fix="Copy the file again.",
        )
    joints = [lines.take(f"joint {joint} of 25") for joint in range(len(K25))]
    table = JOINT.table(lines.path, joints)
    confidence = rows.confidence_from_states(lines.path, joints, table[:, -1:], (LOST, INFERRED, TRACKED))[:, 0]
    orientations = move_to_bone_starts(orientations_to_kinect20(K25, table[:, 7:11]))
    states = [state if sure == HIGH_CONFIDENCE else 0 for sure, state in (hands[:2], hands[2:])]
    joints20 = to_kinect20(K25, table[:, :3], confidence)
    return SkeletonFrame(time, int(user), *joints20, orientations, hand_channels(*states))
