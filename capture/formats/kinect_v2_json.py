"""Kinect v2 JSON with joints in depth pixels: a list of frames, each a list of bodies.

A body is ``{bodyIndex, trackingId, leftHandState, rightHandState, joints}``, a joint ``{x, y, z, px}``: the first 21
joints of the Kinect SDK, x and y in pixels of the 512 × 424 depth picture, y down. The picture is a mirror's, so the
person's right is at larger x. `px` lists depth pixels around the joint and is not used. There is no clock.

z is the depth under the joint's pixel with 0…4.5 m, the range the sensor is specified for, mapped to −500…500, so that
−500 is depth 0, the sensor's "no depth". No document says so; recordings do: −500 is the least value and stands where
no depth can be, and 4.5 mm a step gives a standing person thighs of 0.35 m, upper arms of 0.24 m and 1.40 m from head
to feet, the same within 11 % at two distances. The sensor's other round range, 8 m, would give a giant of 2.5 m.

The depth is that of the pixel and not of the joint: a hand at the silhouette's edge gets the depth of the wall behind.
A joint further from the body's middle than any limb reaches is therefore taken as lost.
"""

from pathlib import Path

import numpy as np

from capture.clip import SkeletonClip
from capture.formats._clips import frame_rate
from capture.formats._json import Value, load
from capture.formats._performers import clips_by_performer
from capture.formats.layouts import K25, to_kinect20
from capture.formats.options import ReadOptions
from capture.skeleton import LOST, TRACKED, SkeletonFrame

FPS = 30.0
JOINT_COUNT = 21
NO_DEPTH = -500.0
STEP = 4.5e-3
"""Metres in one unit of z."""
FOCAL_LENGTH = 366.0
CENTRE = (256.0, 212.0)
"""Of the depth camera, in pixels; a camera's own calibration differs by a few."""
REACH = 1.2
"""Metres of depth from the middle of the body beyond which a joint is the background."""


def matches(head: bytes) -> bool:
    """Tell whether a file's head is a list with the bodies of this format."""
    return (
        head.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"[") and b'"bodyIndex"' in head and b'"joints"' in head
    )


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:
    """Read every body, one clip for each tracking id.

    Parameters
    ----------
    path : Path
    options : ReadOptions
        `fps` replaces 30.

    Returns
    -------
    list of SkeletonClip

    Raises
    ------
    SkeletonLogError
        The document is no such list of frames, or nobody is tracked.
    """
    fps, notes = frame_rate(options, FPS)
    frames = [_body(body, index / fps) for index, frame in enumerate(load(path).items()) for body in frame.items()]
    notes += (
        "Joints are depth pixels: turned into metres with a focal length of 366 pixels and 4.5 mm a step of depth.",
        f"A joint without depth, or whose depth is over {REACH:g} m from the body's, is lost.",
    )
    return clips_by_performer(path, "kinect_v2_json", frames, notes)


def _body(body: Value, time: float) -> SkeletonFrame:
    joints = body["joints"].items()
    if len(joints) != JOINT_COUNT:
        raise body["joints"].error(f"{len(joints)} joints", f"the first {JOINT_COUNT} of the Kinect SDK")
    x, y, z = np.array([[joint[axis].number() for axis in "xyz"] for joint in joints]).T
    depth = (z - NO_DEPTH) * STEP
    seen = depth > 0
    if seen.any():
        seen &= np.abs(depth - np.median(depth[seen])) <= REACH
    pixels = np.stack([x - CENTRE[0], CENTRE[1] - y, np.full(JOINT_COUNT, FOCAL_LENGTH)], axis=1)
    confidence = np.where(seen, TRACKED, LOST).astype(np.float32)
    return SkeletonFrame(
        time,
        body["trackingId"].integer(),
        *to_kinect20(K25[:JOINT_COUNT], pixels * (depth / FOCAL_LENGTH)[:, None], confidence),
    )
