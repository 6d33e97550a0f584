"""Depth images of a patch of skin for each joint, in front of a wall."""

import numpy as np

from capture.skeleton import TRACKED
from capture.trackers.joint_depth import SKIN_TO_JOINT_METRES
from capture.trackers.picture import Lens

LENS = Lens(640, 480, 500.0)
TRACKED_ALL = np.full(20, TRACKED, np.float32)
WALL_METRES = 4.5
PATCH = 12  # pixels from a joint's pixel to the edge of its skin


def drawn(joints, skin=None, without=(), size=PATCH):
    """Return a depth image of patches around the joints' pixels, the nearest on top; `skin` (20,) is in metres."""
    skin = joints[:, 2] - SKIN_TO_JOINT_METRES if skin is None else skin
    depth = np.full((LENS.height, LENS.width), WALL_METRES, np.float32)
    for joint in np.argsort(-skin):
        if joint not in without:
            patch(depth, joints[joint], skin[joint], size=size)
    return depth


def patch(depth, joint, metres, beside=0, size=PATCH):
    column, row = LENS.project(joint).astype(int)
    rows, columns = (np.s_[middle - size : middle + size + 1] for middle in (row, column + beside))
    depth[rows, columns] = round(metres, 3)
