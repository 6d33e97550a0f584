"""MSR Action3D: 20 lines a frame, one a joint, no clock.

The world form has x y z c in metres; the screen form has u v depth c, pixels of a 320 × 240 image with v down and depth
in units of 4 mm. c is 0 on many joints whose positions are good, so that it only lowers the confidence and never loses
a joint. A joint at 0 0 0 is lost, in the screen form also one whose v is an overflowed integer.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from capture.clip import SkeletonClip
from capture.formats._clips import clip_of, frame_rate
from capture.formats._rows import WHOLE_FRAME, Line, RowLayout, cut_note, cut_off, head_lines, read_lines
from capture.formats.layouts import MSR_ACTION3D, to_kinect20
from capture.formats.options import ReadOptions
from capture.skeleton import INFERRED, TRACKED

_ROW = RowLayout(4, "x y z c or u v depth c", frame=WHOLE_FRAME)
_JOINTS = len(MSR_ACTION3D)
_FAR = 20.0  # no sensor sees 20 m, and a screen depth of 20 is 8 cm: nearer than any sensor sees
_DEPTH_UNIT = 0.004
_FOCAL = 285.6
_CENTRE = np.array([160.0, 120.0])
_OVERFLOW = 1e6


def matches(head: bytes) -> bool:
    """Tell whether each of the first 20 lines has four numbers, the last from 0 to 1."""
    lines = head_lines(head, _JOINTS)
    return len(lines) == _JOINTS and all(_ROW.fits(line) and 0 <= float(line.split()[3]) <= 1 for line in lines)


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:
    """Read a log of either form, told apart by the depths; 15 frames a second unless `options.fps` says otherwise.

    Raises
    ------
    SkeletonLogError
        A line does not fit, the last frame is incomplete although its last line is whole, or no frame is tracked.
    """
    lines, cut = _whole_frames(path, read_lines(path))
    frames = _ROW.table(path, lines).reshape(-1, _JOINTS, 4)
    fps, notes = frame_rate(options, 15.0)
    notes += cut
    positions = frames[..., :3]
    if (positions[..., 2] > _FAR).any():
        positions = _unproject(positions)
        notes = (*notes, "Positions computed from pixels and depth with a Kinect's focal length of 285.6 pixels.")
    confidence = frames[..., 3].clip(INFERRED, TRACKED).astype(np.float32)
    times = np.arange(len(frames)) / fps
    return [clip_of(path, "msr_action3d", times, *to_kinect20(MSR_ACTION3D, positions, confidence), notes)]


def _whole_frames(path: Path, lines: list[Line]) -> tuple[list[Line], tuple[str, ...]]:
    """Leave out the frame in a line of which the file ends.

    A last frame that lacks lines but ends with a whole one may as well be a line that is missing earlier on, which
    gives every joint after it the place of another: that is an error.
    """
    is_torn = bool(lines) and _ROW.is_torn(lines[-1])
    end = (len(lines) - is_torn) // _JOINTS * _JOINTS
    if is_torn and end:
        return lines[:end], (cut_note(lines[end]),)
    if rest := len(lines) % _JOINTS:
        raise cut_off(path, lines[-rest], f"{rest} lines for the last frame", f"{_JOINTS} lines a frame, one a joint")
    return lines, ()


def _unproject(screen: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn (..., 3) u, v, depth into sensor coordinates by the pinhole model; lost joints come out at the origin."""
    depth = np.where((np.abs(screen) < _OVERFLOW).all(axis=-1, keepdims=True), screen[..., 2:], 0.0) * _DEPTH_UNIT
    across = (screen[..., :2] - _CENTRE) * [1.0, -1.0] * depth / _FOCAL
    return np.concatenate([across, depth], axis=-1)
