"""UTD-MHAD `*_skeleton.mat`: a MATLAB 5 file with ``d_skel``, 20 Kinect v1 joints × 3 × T, metres, sensor coordinates.

The recordings have no clock; the sensor ran at 30 frames per second.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from capture.clip import SkeletonClip
from capture.formats._clips import build_clip, frame_rate
from capture.formats._files import opened
from capture.formats._mat5 import Mat5Error, variables
from capture.formats.layouts import UTD_MHAD, to_kinect20
from capture.formats.options import ReadOptions
from capture.skeleton import TRACKED
from puppetline.errors import SkeletonLogError, at

DEFAULT_FPS = 30.0


def matches(head: bytes) -> bool:
    """Return whether a file's head is that of a MATLAB 5 file; `read` reports other contents as errors."""
    return head.startswith(b"MATLAB 5.0 MAT-file") and head[126:128] in (b"IM", b"MI")


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:
    """Read the one performer; `options.fps` replaces 30 frames per second.

    Raises
    ------
    SkeletonLogError
        The file is damaged, has no skeleton, or has a number that is not finite.
    """
    fps, notes = frame_rate(options, DEFAULT_FPS)
    joints = _skeleton(path)
    bad = np.argwhere(~np.isfinite(joints))
    if bad.size:
        joint, axis, frame = bad[0]
        raise _error(path, f"d_skel({joint + 1},{axis + 1},{frame + 1})", str(joints[tuple(bad[0])]), "a finite number")
    positions, confidence = to_kinect20(
        UTD_MHAD, joints.transpose(2, 0, 1), np.full(joints.shape[::2][::-1], TRACKED, dtype=np.float32)
    )
    times = np.arange(len(positions)) / fps
    return [build_clip(path, "utd_mhad", times, positions, confidence, notes)]


def _skeleton(path: Path) -> NDArray[np.float64]:
    with opened(path) as file:
        data = file.read()
    try:
        contents = variables(data)
        skeleton = contents.get("d_skel")
        if skeleton is not None:
            if not skeleton.is_real or skeleton.shape[:2] != (20, 3) or len(skeleton.shape) > 3:
                shape = " × ".join(map(str, skeleton.shape))
                raise _error(path, "d_skel", f"an array {shape} of other content", "real numbers, 20 × 3 × frames")
            return skeleton.numbers().reshape(20, 3, -1)
    except Mat5Error as error:
        raise _error(path, None, f"a file in which {error}", "a complete MATLAB 5 file") from error
    if "d_depth" in contents:
        raise SkeletonLogError(
            path,
            found="a depth recording (d_depth)",
            expected="a skeleton recording (d_skel, 20 joints × 3 × frames)",
            fix="Use the file …_skeleton.mat of the same recording, which is in the same data set.",
        )
    raise _error(path, None, f"the variables {sorted(contents)}", "d_skel, 20 joints × 3 × frames")


def _error(path: Path, field: str | None, found: str, expected: str) -> SkeletonLogError:
    return SkeletonLogError(
        at(path, field=field), found=found, expected=expected, fix="Copy the file again from the data set."
    )
