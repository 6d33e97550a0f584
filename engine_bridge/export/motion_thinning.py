"""Skeletal animations with fewer keyframes, within a tolerance.

The position of a vertex is a weighted mean of its positions by its joints. Its error is therefore at most the largest
error of the corners of boxes around the vertices of each joint, which move with that joint: the distance between two
affine motions is a convex function of the point.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from engine_bridge.character.document import Document
from engine_bridge.character.scene import influences, local_transform, tree
from engine_bridge.character.schema import Animation
from engine_bridge.export.key_thinning import interpolated, thin

THINNING_SHARES = (0.8, 0.4, 0.2, 0.1, 0.0)
"""Shares of the tolerance for omitted keyframes; the first one whose result is within the tolerance is used."""

Tracks = dict[tuple[int, str], NDArray[np.float32]]
"""Node and path to values (F, width) in all frames."""

WEIGHT_TOLERANCE = 0.02
"""Maximum error of the weights of morph targets that the file has."""


def thin_motion(document: Document, tolerance: float) -> tuple[int, float]:
    """Reduce the first animation of a document, all of whose channels have the same key times.

    Parameters
    ----------
    document : Document
    tolerance : float
        Maximum distance of a vertex from its position by the original animation, world units.

    Returns
    -------
    keyframes : int
        Number of keyframes that are left.
    error : float
        Upper bound of the distance of a vertex from its previous position, in any frame.
    """
    animation = document.gltf["animations"][0]
    channels = [(channel["target"], animation["samplers"][channel["sampler"]]) for channel in animation["channels"]]
    times = document.array(channels[0][1]["input"])
    tracks = {
        (target["node"], target["path"]): document.array(sampler["output"]).reshape(len(times), -1)
        for target, sampler in channels
    }
    boxes = list(_boxes(document))
    exact = _moved(document, tracks, boxes, len(times))
    # weights are watched as points that move by the tolerance where a weight changes by its own
    apart = np.array([tolerance / WEIGHT_TOLERANCE, 0.0, 0.0])
    weights = [values[:, :, None] * apart for (_, path), values in tracks.items() if path == "weights"]
    watched = np.concatenate([exact, *weights], axis=1)
    for share in THINNING_SHARES:
        kept = thin(watched, share * tolerance) if share else np.arange(len(times))
        stored = {key: values[kept] for key, values in tracks.items()}
        played = {key: _played(key[1], values, kept) for key, values in stored.items()}
        missed = _moved(document, played, boxes, len(times)) - exact
        error = float(np.sqrt(np.einsum("fpc,fpc->fp", missed, missed).max(initial=0)))
        if error <= tolerance:
            break
    _rewrite(document, animation, times[kept], stored)
    return len(kept), error


def _boxes(document: Document) -> Iterator[tuple[int, NDArray[np.float64]]]:
    """Yield nodes, and boxes (8, 4) in their coordinates around the vertices that move with them."""
    gltf = document.gltf
    for index, node in enumerate(gltf["nodes"]):
        for primitive in gltf["meshes"][node["mesh"]]["primitives"] if "mesh" in node else ():
            if "POSITION" not in primitive["attributes"]:
                continue
            positions = document.array(primitive["attributes"]["POSITION"]).astype(np.float64)
            if "skin" not in node or "JOINTS_0" not in primitive["attributes"]:
                yield index, _corners(positions)
                continue
            skin = gltf["skins"][node["skin"]]
            back = np.tile(np.eye(4), (len(skin["joints"]), 1, 1))
            if "inverseBindMatrices" in skin:
                matrices = document.array(skin["inverseBindMatrices"]).reshape(-1, 4, 4)
                back = matrices[: len(back)].transpose(0, 2, 1).astype(np.float64)
            which, share = influences(document, primitive, node["skin"], len(positions))
            for number in np.unique(which[share > 0]).tolist():
                own = positions[((which == number) & (share > 0)).any(axis=1)]
                yield skin["joints"][number], _corners(own @ back[number, :3, :3].T + back[number, :3, 3])


def _corners(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the corners (8, 4) of the box around points (n, 3), with a 1."""
    ends = np.stack([points.min(axis=0), points.max(axis=0)])
    x, y, z = (ends[:, axis] for axis in range(3))
    return np.stack([*(each.ravel() for each in np.meshgrid(x, y, z)), np.ones(8)], axis=1)


def _moved(
    document: Document, tracks: Tracks, boxes: list[tuple[int, NDArray[np.float64]]], count: int
) -> NDArray[np.float64]:
    """Return the corners of boxes (F, P, 3) in the world."""
    world: dict[int, NDArray[np.float64]] = {}
    for node, parent in tree(document):
        local = np.tile(local_transform(document.gltf["nodes"][node]), (count, 1, 1))
        own = document.gltf["nodes"][node]
        if (node, "rotation") in tracks:
            local[:, :3, :3] = Rotation.from_quat(tracks[node, "rotation"]).as_matrix() * np.array(
                own.get("scale", [1.0, 1.0, 1.0])
            )
        if (node, "translation") in tracks:
            local[:, :3, 3] = tracks[node, "translation"]
        world[node] = local if parent is None else world[parent] @ local
    return np.concatenate([corners @ world[node].swapaxes(1, 2) for node, corners in boxes], axis=1)[:, :, :3]


def _played(path: str, values: NDArray[np.float32], kept: NDArray[np.int64]) -> NDArray[np.float32]:
    """Return values in all frames by linear interpolation, which for rotations is along the shortest arc."""
    if path != "rotation":
        return interpolated(values, kept)
    if len(kept) == 1:
        return values[[0]]
    return Slerp(kept, Rotation.from_quat(values))(np.arange(kept[-1] + 1)).as_quat().astype(np.float32)


def _rewrite(document: Document, animation: Animation, times: NDArray[np.float32], stored: Tracks) -> None:
    """Replace the arrays of an animation."""
    samplers = animation["samplers"]
    document.replace(samplers[animation["channels"][0]["sampler"]]["input"], times, bounds=True)
    for channel in animation["channels"]:
        target, output = channel["target"], samplers[channel["sampler"]]["output"]
        values = stored[target["node"], target["path"]]
        document.replace(output, values if target["path"] != "weights" else values.ravel())
    document.repack()
