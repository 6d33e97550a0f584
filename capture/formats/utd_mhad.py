"""UTD-MHAD `*_skeleton.mat`: a MATLAB 5 file with ``d_skel``, 20 Kinect v1 joints × 3 × T, metres, sensor frame.

The recordings have no clock; the sensor ran at 30 frames a second.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from capture.clip import SkeletonClip
from capture.formats._clips import clip_of, frame_rate
from capture.formats._mat5 import Mat5Error, variables
from capture.formats.layouts import UTD_MHAD, to_kinect20
from capture.formats.options import ReadOptions
from capture.skeleton import TRACKED
from puppetline.errors import SkeletonLogError, at

FPS = 30.0


def matches(head: bytes) -> bool:
    """Tell whether a file's head is that of a MATLAB 5 file; `read` says what is wrong with other contents."""
    return head.startswith(b"MATLAB 5.0 MAT-file") and head[126:128] in (b"IM", b"MI")


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:
    """Read the one performer.

    Parameters
    ----------
    path : Path
    options : ReadOptions
        `fps` replaces the sensor's 30.

    Returns
    -------
    list of SkeletonClip
        One.

    Raises
    ------
    SkeletonLogError
        The file is damaged, holds no skeleton, or a number in it is not finite.
    """
    fps, notes = frame_rate(options, FPS)
    joints = _skeleton(path)
    bad = np.argwhere(~np.isfinite(joints))
    if bad.size:
        joint, axis, frame = bad[0]
        raise _error(path, f"d_skel({joint + 1},{axis + 1},{frame + 1})", str(joints[tuple(bad[0])]), "a finite number")
    positions, confidence = to_kinect20(
        UTD_MHAD, joints.transpose(2, 0, 1), np.full(joints.shape[::2][::-1], TRACKED, dtype=np.float32)
    )
    times = np.arange(len(positions)) / fps
    return [clip_of(path, "utd_mhad", times, positions, confidence, notes)]


def _skeleton(path: Path) -> NDArray[np.float64]:
    try:
        contents = variables(path.read_bytes())
        skeleton = contents.get("d_skel")
        if skeleton is not None:
            if not skeleton.is_real or skeleton.shape[:2] != (20, 3) or len(skeleton.shape) > 3:
                shape = " × ".join(map(str, skeleton.shape))
                raise _error(path, "d_skel", f"{shape} of other content", "real numbers, 20 × 3 × frames")
            return skeleton.numbers().reshape(20, 3, -1)
    except OSError as error:
        raise SkeletonLogError(
            path, found=f"“{error.strerror}”", expected="a readable file", fix="Check its path and permissions."
        ) from error
    except Mat5Error as error:
        raise _error(path, None, f"a file in which {error}", "a whole MATLAB 5 file") from error
    if "d_depth" in contents:
        raise SkeletonLogError(
            path,
            found="a depth recording (d_depth)",
            expected="a skeleton recording (d_skel, 20 joints × 3 × frames)",
            fix="Give the take's …_skeleton.mat, which lies beside its …_depth.mat in the data set.",
        )
    raise _error(path, None, f"the variables {sorted(contents)}", "d_skel, 20 joints × 3 × frames")


def _error(path: Path, field: str | None, found: str, expected: str) -> SkeletonLogError:
    return SkeletonLogError(
        at(path, field=field), found=found, expected=expected, fix="Copy the file again from the data set."
    )
