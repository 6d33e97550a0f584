"""Kinect v2 JSON with joints in depth pixels: a list of frames, each a list of bodies.

A body is ``{bodyIndex, trackingId, leftHandState, rightHandState, joints}`` and a joint ``{x, y, z, px}``. The joints
are the first 21 of the Kinect SDK. The states of the hands, which may be absent, become channels. x and y are pixels of
the 512 × 424 depth image, y down. The image is mirrored, so the performer's right is at larger x. `px` lists depth
pixels around the joint and is not used. There is no clock.

z is the depth at the joint's pixel. It maps 0…4.5 m, the sensor's specified range, to −500…500; −500 is depth 0, the
sensor's value for "no depth". This is not documented but follows from recordings: −500 is the smallest value and occurs
only at pixels without depth. With 4.5 mm per step, a standing performer has thighs of 0.35 m, upper arms of 0.24 m and
1.40 m from head to feet, equal within 11 % at two distances. The sensor's other range, 8 m, would give 2.5 m.

The depth belongs to the pixel, not to the joint: a hand at the edge of the silhouette has the depth of the wall behind
it. A joint that is further from the body's middle than a limb can reach is therefore lost.
"""

from pathlib import Path

import numpy as np

from capture.clip import SkeletonClip
from capture.formats._hand_states import hand_channels
from capture.formats._json import Value, load
from capture.formats.clips import DEFAULT_FPS, clips_by_performer, frame_rate
from capture.formats.layouts import K25, to_kinect20
from capture.formats.options import ReadOptions
from capture.skeleton import LOST, TRACKED, SkeletonFrame

JOINT_COUNT = 21
NO_DEPTH = -500.0
METRES_PER_STEP = 4.5e-3
FOCAL_LENGTH_PIXELS = 366.0
CENTRE_PIXELS = (256.0, 212.0)
"""Centre of the depth camera's image; the calibration of a device differs by a few pixels."""
MAX_REACH_METRES = 1.2
"""Maximum difference in depth between a joint and the body's median; a larger one is the background."""


def matches(head: bytes) -> bool:
    """Return whether a file's head is a list with the bodies of this format."""
    is_list = head.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"[")
    return is_list and b'"bodyIndex"' in head and b'"joints"' in head and b'"cameraX"' not in head


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:
    """Read one clip per tracking id; `options.fps` replaces 30 frames per second.

    Raises
    ------
    SkeletonLogError
        The document violates the format, or no performer is tracked.
    """
    fps, notes = frame_rate(options, DEFAULT_FPS)
    frames = [_body(body, index / fps) for index, frame in enumerate(load(path).items()) for body in frame.items()]
    notes += (
        "Depth pixels are converted to metres with a focal length of 366 pixels and 4.5 mm per step of depth.",
        f"A joint is lost if it has no depth, or if its depth is more than {MAX_REACH_METRES:g} m from the body's.",
    )
    return clips_by_performer(path, "kinect_v2_json", frames, notes)


def _body(body: Value, time: float) -> SkeletonFrame:
    joints = body["joints"].items()
    if len(joints) != JOINT_COUNT:
        raise body["joints"].error(f"{len(joints)} joints", f"the first {JOINT_COUNT} joints of the Kinect SDK")
    x, y, z = np.array([[joint[axis].number() for axis in "xyz"] for joint in joints]).T
    depth = (z - NO_DEPTH) * METRES_PER_STEP
    seen = depth > 0
    if seen.any():
        seen &= np.abs(depth - np.median(depth[seen])) <= MAX_REACH_METRES
    focal = np.full(JOINT_COUNT, FOCAL_LENGTH_PIXELS)
    pixels = np.stack([x - CENTRE_PIXELS[0], CENTRE_PIXELS[1] - y, focal], axis=1)
    confidence = np.where(seen, TRACKED, LOST).astype(np.float32)
    positions = pixels * (depth / FOCAL_LENGTH_PIXELS)[:, None]
    user = body["trackingId"].integer()
    states = [body[key].integer() if key in body else 0 for key in ("leftHandState", "rightHandState")]
    joints20 = to_kinect20(K25[:JOINT_COUNT], positions, confidence)
    return SkeletonFrame(time, user, *joints20, channels=hand_channels(*states))
