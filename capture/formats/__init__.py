"""Readers of recordings in all supported formats, one module per format.

The format is detected by content; the name of the file does not matter. A format module has two functions::

    def matches(head: bytes) -> bool      # whether the file that begins with these 64 KiB has this format
    def read(path: Path, options: ReadOptions) -> list[SkeletonClip]     # one clip per performer

`read` raises `SkeletonLogError` if the file violates the format. The error names the line if the format has lines.
"""

from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np

from capture.clip import SkeletonClip
from capture.formats import puppetline_log, table
from capture.formats._files import HEAD_BYTES, opened
from capture.formats.kinds import refusal
from capture.formats.options import ReadOptions
from capture.formats.plausibility import checked
from capture.skeleton import JOINTS, MAX_DISTANCE_METRES
from puppetline.errors import SkeletonLogError, at

FORMATS: dict[str, str] = {
    "puppetline_log": "Puppetline's own recordings",
    "bvh": "BVH motion capture",
    "asf_amc": "ASF/AMC motion capture",
    "mvnx": "Xsens MVNX",
    "c3d_file": "C3D markers",
    "azure_json": "Azure Kinect offline_processor JSON",
    "kinect_v2_json": "Kinect v2 JSON in depth pixels",
    "landmarks_json": "JSON, XML and YARP logs of trackers (MediaPipe, OpenPose in 3D)",
    "ntu": "NTU RGB+D .skeleton",
    "arrays": "arrays of joint positions or SMPL parameters (.npy, .npz, .mat)",
    "kinect_v2_sparse": "Kinect v2 text with tracked joints only",
    "msr_action3d": "MSR Action3D, 20 rows per frame",
    "table": "tables of joint positions as text, TRC",
}
"""Name of each format module and the format's name for users, in the order in which the modules are tried."""


def recognize(path: Path, options: ReadOptions | None = None) -> ModuleType | None:
    """Find the format module for a file by its content; text is a table if `options` name its columns or joints.

    Raises
    ------
    SkeletonLogError
        The file cannot be read.
    """
    with opened(path) as file:
        head = file.read(HEAD_BYTES)
    modules = (import_module(f"{__name__}.{name}") for name in FORMATS)
    found = next((module for module in modules if module.matches(head)), None)
    if found is None and options is not None and (options.columns or options.joints) and table.may_be(head):
        return table
    return found


def read_log(path: Path, options: ReadOptions | None = None) -> list[SkeletonClip]:
    """Read a recording in any supported format, one clip per performer.

    Raises
    ------
    SkeletonLogError
        The file has no supported format, violates its format, or has a position that no sensor measures, or a body
        that is no person's (`capture.formats.plausibility`).
    """
    module = recognize(path, options)
    if module is None:
        raise refusal(path)
    clips: list[SkeletonClip] = module.read(path, options or ReadOptions())
    for clip in clips:
        _check_distances(path, clip)
    return clips if module is puppetline_log else checked(path, clips)  # its joints are no guess


def _check_distances(path: Path, clip: SkeletonClip) -> None:
    far = np.argwhere(np.abs(clip.positions) > MAX_DISTANCE_METRES)
    if len(far):
        frame, joint, axis = map(int, far[0])
        raise SkeletonLogError(
            at(path, field=f"frame {frame} (second {clip.times[frame]:g}), {JOINTS[joint]}"),
            found=f"{clip.positions[frame, joint, axis]:.4g} m",
            expected=f"a position within {MAX_DISTANCE_METRES:g} m of the sensor",
            fix="Correct or delete that frame; for BVH, set the metres per unit.",
        )
