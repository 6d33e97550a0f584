"""BVH: a hierarchy of joints and their motion, as text (`capture.formats.bvh_parser`).

A joint's own rotation is the product of its rotations about the axes, in the order of its channels. BVH defines no
sensor, no unit and no up axis; see `capture.formats.skeleton_motion`.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from capture.clip import SkeletonClip
from capture.formats.bvh_parser import Node, parse
from capture.formats.options import ReadOptions
from capture.formats.skeleton_motion import SkeletonMotion, clips_of, forward_kinematics, rest_positions
from puppetline.errors import SkeletonLogError


def matches(head: bytes) -> bool:
    """Return whether a file's head begins with the keyword of every BVH."""
    return head.removeprefix(b"\xef\xbb\xbf").upper().split(maxsplit=1)[:1] == [b"HIERARCHY"]


def read(path: Path, options: ReadOptions) -> list[SkeletonClip]:
    """Read one clip per ROOT that is a human body, with user numbers from 0.

    `options.up`, `options.unit` and `options.fps` replace the values of the file.

    Raises
    ------
    SkeletonLogError
        A line violates the format, or the joints are not those of a human body.
    """
    nodes, motion, frame_time, notes = parse(path, options.fps)
    known = np.array(np.isfinite(motion).all(axis=1))
    if not known.any():
        raise SkeletonLogError(
            path, found="no frame whose numbers are all known", expected="motion", fix="Export the motion again."
        )
    if not known.all():
        missing = f"{np.count_nonzero(~known)} of {len(known)} frames"
        notes = (*notes, f"In {missing}, numbers are not known. These are omitted.")
    times = frame_time * np.flatnonzero(known).astype(np.float64)
    return clips_of(path, "bvh", times, motion_of(nodes, motion[known]), options, notes)


def motion_of(nodes: list[Node], motion: NDArray[np.float64]) -> SkeletonMotion:
    """Return the motion of the nodes of a file.

    A joint with positions only does not turn what hangs on it, so the end of its bone is nowhere, and left out. If all
    offsets are zero, the first frame is the rest pose.

    Parameters
    ----------
    nodes : list of Node
        Parents precede children.
    motion : (T, C) float64
        Numbers of all channels of all nodes in order; file units and degrees.
    """
    kinds = [{kind for _, kind in node.channels} for node in nodes]
    nodes = [node for node in nodes if node.name or node.parent < 0 or kinds[node.parent] != {"position"}]
    translations: list[NDArray[np.float64]] = []
    rotations: list[NDArray[np.float64]] = []
    column = 0
    for node in nodes:
        values = motion[:, column : column + len(node.channels)].T
        column += len(node.channels)
        translations.append(_translation(node, values))
        rotations.append(_rotation(node, values))
    parents = [node.parent for node in nodes]
    rest = rest_positions(parents, [node.offset for node in nodes])
    positions, turned = forward_kinematics(parents, translations, rotations)
    if not np.ptp(rest, axis=0).any():
        rest = rest_positions(parents, [each[0] for each in translations])
    return SkeletonMotion([node.name for node in nodes], parents, rest, positions, turned)


def _rotation(node: Node, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (T, 3, 3) rotations of a node from its axes to its parent's."""
    turns = [(axis, value) for (axis, kind), value in zip(node.channels, values, strict=True) if kind == "rotation"]
    if not turns:
        return np.broadcast_to(np.eye(3), (values.shape[1], 3, 3))
    order, angles = "".join(axis for axis, _ in turns), np.stack([value for _, value in turns], axis=1)
    return Rotation.from_euler(order, angles, degrees=True).as_matrix()


def _translation(node: Node, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (T, 3) translation of a node from its parent.

    In some programs position channels replace the offset, in others they are added to it. Values that replace the
    offset stay near it, because a joint does not move away from its parent; values that are added stay near zero.
    """
    axes = ["XYZ".index(axis) for axis, kind in node.channels if kind == "position"]
    channels = [value for (_, kind), value in zip(node.channels, values, strict=True) if kind == "position"]
    translation = np.tile(node.offset, (values.shape[1], 1))
    if axes:
        values_of_axes = np.stack(channels, axis=1)
        median = np.median(values_of_axes, axis=0)
        is_added = np.linalg.norm(median) < np.linalg.norm(median - node.offset[axes])
        translation[:, axes] = values_of_axes + node.offset[axes] if is_added else values_of_axes
    return translation
