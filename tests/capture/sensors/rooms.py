"""Depth images of rooms, computed ray by ray."""

import numpy as np

from capture.sensor_pose import SensorPose
from capture.trackers.picture import Lens

LENS = Lens(640, 480, 525.0)
WALL, CEILING = 5.0, 3.0


def room(tilt, roll, height, noise=0.0, *, table=False, floor=True, desk=0.0, wall=WALL):
    """Return the depth, in metres, of a room with floor, wall, ceiling and a board as the performer."""
    pose = SensorPose.of_degrees(tilt, 0.0, roll, np.array([0.0, height, 0.0]))
    rows, columns = np.indices((LENS.height, LENS.width)) + 0.5
    rays = LENS.unproject(np.stack([columns, rows], axis=-1), np.ones(rows.shape)) @ pose.rotation.T
    x, y, z = np.moveaxis(rays, -1, 0)  # room coordinates; depth is the parameter of each ray
    with np.errstate(divide="ignore"):
        depth = wall / z
        depth = np.minimum(depth, np.where(y > 0, (CEILING - height) / y, np.inf))
        depth = np.minimum(depth, np.where((y < 0) & floor, -height / y, np.inf))
        board = 2.5 / z
        depth = np.where((abs(board * x) < 0.25) & (board * y + height < 1.75), np.minimum(depth, board), depth)
        if desk:  # depth of the desk under the sensor, in metres
            top = np.where(y < 0, (0.8 - height) / y, np.inf)
            depth = np.where((abs(top * x) < 0.8) & (top * z < desk), np.minimum(depth, top), depth)
        if table:
            top = np.where(y < 0, (0.75 - height) / y, np.inf)
            on_it = (abs(top * x - 0.3) < 0.6) & (abs(top * z - 1.8) < 0.4)
            depth = np.where(on_it, np.minimum(depth, top), depth)
    if noise:
        depth += np.random.default_rng(1).normal(0, 1, depth.shape) * noise * depth**2
    return (np.rint(1000 * depth) / 1000).astype(np.float32)
