"""Writes a performer's motion as BVH.

The zero pose is the T-pose, in which the performer faces +z with the feet on y = 0. Lengths are in centimetres, as in
files of Mixamo, MotionBuilder and Rokoko. The root has channels of its position and rotation, other joints of their
rotation, in the order Z, X, Y: R = Rz Rx Ry for column vectors.
"""

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from engine_bridge.export.performer.motion import PerformerMotion
from puppetline.files import written_whole

UNITS_PER_METRE = 100.0

HALF_TURN = np.array([180.0, 180.0, 180.0])


def write_bvh(path: Path, motion: PerformerMotion) -> None:
    """Write a .bvh, completely or not at all.

    Raises
    ------
    OutputError
    """
    order = list(_depth_first(motion.body.skeleton.parents, 0))
    values = np.concatenate([UNITS_PER_METRE * motion.hips[:, None], _angles(motion.rotations[:, order])], axis=1)
    text = io.StringIO()
    text.write("HIERARCHY\n")
    text.writelines(f"{line}\n" for line in _hierarchy(motion, 0))
    text.write(f"MOTION\nFrames: {len(values)}\nFrame Time: {1 / motion.fps:.9g}\n")
    np.savetxt(text, values.reshape(len(values), -1), fmt="%.6f")
    with written_whole(path) as beside:
        beside.write_text(text.getvalue(), encoding="ascii", newline="\n")


def _depth_first(parents: NDArray[np.int64], row: int) -> Iterator[int]:
    """Yield the rows of a joint and of all joints below it in the order of the file."""
    yield row
    for child in np.flatnonzero(parents == row):
        yield from _depth_first(parents, int(child))


def _hierarchy(motion: PerformerMotion, row: int) -> Iterator[str]:
    """Yield the lines of a joint and of all joints below it."""
    skeleton, tips = motion.body.skeleton, motion.body.tips
    name, parent = skeleton.names[row], skeleton.parents[row]
    above = skeleton.heads[parent] if parent >= 0 else np.zeros(3)
    position = "" if parent >= 0 else "Xposition Yposition Zposition "
    yield f"{'JOINT' if parent >= 0 else 'ROOT'} {name}"
    yield "{"
    yield f"  OFFSET {_numbers(skeleton.heads[row] - above)}"
    yield f"  CHANNELS {3 if parent >= 0 else 6} {position}Zrotation Xrotation Yrotation"
    for child in np.flatnonzero(skeleton.parents == row):
        yield from (f"  {line}" for line in _hierarchy(motion, int(child)))
    if name in tips:
        yield "  End Site"
        yield "  {"
        yield f"    OFFSET {_numbers(tips[name] - skeleton.heads[row])}"
        yield "  }"
    yield "}"


def _numbers(offset: NDArray[np.float64]) -> str:
    return " ".join(f"{value:.6f}" for value in UNITS_PER_METRE * offset)


def _angles(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return angles (F, n, 3) about Z, X and Y in degrees, each frame near the one before it.

    Three angles and their counterparts (Z + 180, 180 − X, Y + 180) are the same rotation.
    """
    frames, joints, _ = rotations.shape
    one = Rotation.from_quat(rotations.reshape(-1, 4)).as_euler("ZXY", degrees=True).reshape(frames, joints, 3)
    other = HALF_TURN + [1.0, -1.0, 1.0] * one
    for number in range(1, frames):
        before = one[number - 1]
        candidates = np.stack([one[number], other[number]])
        candidates += 360 * np.round((before - candidates) / 360)
        nearer = np.abs(candidates - before).sum(axis=2).argmin(axis=0)
        one[number] = candidates[nearer, np.arange(joints)]
    return one
