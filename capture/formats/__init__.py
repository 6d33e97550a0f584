"""Foreign skeleton logs: one module a format, found by content and not by a file's name.

A format module has two functions::

    def matches(head: bytes) -> bool      # the file's first 64 KiB: is it this format?
    def read(path: Path, options: ReadOptions) -> list[SkeletonClip]     # one clip a performer

`read` raises `SkeletonLogError` where the file does not fit, with the line number where the format has lines.
"""

from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np

from capture.clip import SkeletonClip
from capture.formats.options import ReadOptions
from capture.skeleton import JOINTS
from puppetline.errors import SkeletonLogError, at

FORMATS: dict[str, str] = {
    "puppetline_log": "Puppetline's own recordings",
    "bvh": "BVH motion capture",
    "azure_json": "Azure Kinect offline_processor JSON",
    "kinect_v2_json": "Kinect v2 JSON in depth pixels",
    "ntu": "NTU RGB+D .skeleton",
    "utd_mhad": "UTD-MHAD .mat",
    "cad60": "CAD-60 text",
    "msrc12": "MSRC-12, 81 columns",
    "kinect_v2_csv": "Kinect v2 CSV, 101 columns",
    "utkinect": "UTKinect-Action3D, 61 columns",
    "kinect_v2_sparse": "Kinect v2 text with tracked joints only",
    "msr_action3d": "MSR Action3D, 20 rows a frame",
}
"""Module names, in the order in which they are asked, and what users call them."""

FARTHEST = 1000.0
"""Metres from the origin beyond which a position is a fault of the log."""

HEAD_SIZE = 65536
"""Bytes from which a format is recognised."""


def recognize(path: Path) -> ModuleType | None:
    """Find the format module for a file by its content.

    Raises
    ------
    SkeletonLogError
        A file that cannot be opened.
    """
    try:
        with path.open("rb") as file:
            head = file.read(HEAD_SIZE)
    except OSError as error:
        raise SkeletonLogError(
            path,
            found=f"a file that cannot be read ({error.strerror})",
            expected="a skeleton log",
            fix="Check the path and its permissions.",
        ) from error
    modules = (import_module(f"{__name__}.{name}") for name in FORMATS)
    return next((module for module in modules if module.matches(head)), None)


def read_log(path: Path, options: ReadOptions | None = None) -> list[SkeletonClip]:
    """Read a skeleton log of any known format.

    Parameters
    ----------
    path : Path
    options : ReadOptions, optional

    Returns
    -------
    list of SkeletonClip
        One for each performer.

    Raises
    ------
    SkeletonLogError
        No known format, or a file that does not keep to its format.
    """
    module = recognize(path)
    if module is None:
        empty = path.stat().st_size == 0
        raise SkeletonLogError(
            path,
            found="an empty file" if empty else "no skeleton log that is known here",
            expected="; ".join(FORMATS.values()),
            fix="Record it again." if empty else "Check that this is the log, or export it to one of these formats.",
        )
    clips = module.read(path, options or ReadOptions())
    for clip in clips:
        _check_distances(path, clip)
    return clips


def _check_distances(path: Path, clip: SkeletonClip) -> None:
    """Refuse positions that are no performer's, whatever the format."""
    far = np.argwhere(np.abs(clip.positions) > FARTHEST)
    if len(far):
        frame, joint, axis = map(int, far[0])
        raise SkeletonLogError(
            at(path, field=f"frame {frame} (second {clip.times[frame]:g}), {JOINTS[joint]}"),
            found=f"{clip.positions[frame, joint, axis]:.4g} m",
            expected=f"a place within {FARTHEST:g} m of the sensor",
            fix="Mend or delete that frame; for BVH, say how many metres one unit is.",
        )
