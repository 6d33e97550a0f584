"""MSR Action3D: 20 lines per frame, one per joint, without a clock.

The world form has x y z c in metres. The screen form has u v depth c: pixels of a 320 × 240 image with v down, and
depth in units of 4 mm. Many joints with good positions have c = 0, so c only lowers the confidence. A joint at 0 0 0 is
lost; in the screen form, so is a joint whose v is an integer after an overflow.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from capture.clip import SkeletonClip
from capture.formats._rows import WHOLE_FRAME, Line, RowLayout, cut_off_error, cut_off_note, head_lines, read_lines
from capture.formats.clips import build_clip, frame_rate
from capture.formats.layouts import MSR_ACTION3D, to_kinect20
from capture.formats.options import ReadOptions
from capture.skeleton import INFERRED, TRACKED

_ROW = RowLayout(4, "x y z c or u v depth c", frame=WHOLE_FRAME)
_JOINTS = len(MSR_ACTION3D)
_MAX_WORLD_DEPTH_METRES = 20.0
"""Depth that separates the forms: no sensor reaches 20 m, and a screen depth of 20 is 8 cm, too near for a sensor."""
_METRES_PER_DEPTH_UNIT = 0.004
_FOCAL_LENGTH_PIXELS = 285.6
_CENTRE_PIXELS = np.array([160.0, 120.0])
_MAX_SCREEN_NUMBER = 1e6


def matches(head: bytes) -> bool:
    """Return whether each of the first 20 lines has four numbers, the last from 0 to 1."""
    lines = head_lines(head, _JOINTS)
    return len(lines) == _JOINTS and all(_ROW.fits(line) and 0 <= float(line.split()[3]) <= 1 for line in lines)


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:
    """Read the one performer in either form, detected by the depths; `options.fps` replaces 15 frames per second.

    Raises
    ------
    SkeletonLogError
        A line violates the format, the last frame lacks lines although its last line is complete, or no frame is
        tracked.
    """
    lines, cut_off = _complete_frames(path, read_lines(path))
    frames = _ROW.table(path, lines).reshape(-1, _JOINTS, 4)
    fps, notes = frame_rate(options, 15.0)
    notes += cut_off
    positions = frames[..., :3]
    if (positions[..., 2] > _MAX_WORLD_DEPTH_METRES).any():
        positions = _unproject(positions)
        notes = (*notes, "Positions are computed from pixels and depth with a Kinect's focal length of 285.6 pixels.")
    confidence = frames[..., 3].clip(INFERRED, TRACKED).astype(np.float32)
    times = np.arange(len(frames)) / fps
    return [build_clip(path, "msr_action3d", times, *to_kinect20(MSR_ACTION3D, positions, confidence), notes)]


def _complete_frames(path: Path, lines: list[Line]) -> tuple[list[Line], tuple[str, ...]]:
    """Return the lines without the frame within whose line the file ends, and the note on it.

    If the last frame lacks lines but its last line is complete, a line may be missing anywhere before it. All joints
    after the missing line would be read as other joints, so this is an error.
    """
    is_cut_off = bool(lines) and _ROW.is_cut_off(lines[-1])
    end = (len(lines) - is_cut_off) // _JOINTS * _JOINTS
    if is_cut_off and end:
        return lines[:end], (cut_off_note(lines[end]),)
    if rest := len(lines) % _JOINTS:
        expected = f"{_JOINTS} lines per frame, one per joint"
        raise cut_off_error(path, lines[-rest], f"{rest} lines for the last frame", expected)
    return lines, ()


def _unproject(screen: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convert (..., 3) u, v, depth to sensor coordinates by the pinhole model; lost joints are at the origin."""
    valid = (np.abs(screen) < _MAX_SCREEN_NUMBER).all(axis=-1, keepdims=True)
    depth = np.where(valid, screen[..., 2:], 0.0) * _METRES_PER_DEPTH_UNIT
    xy = (screen[..., :2] - _CENTRE_PIXELS) * [1.0, -1.0] * depth / _FOCAL_LENGTH_PIXELS
    return np.concatenate([xy, depth], axis=-1)
