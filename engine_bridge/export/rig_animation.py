"""Animation of a skeleton by rotations of its joints."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from engine_bridge.character.document import Document
from engine_bridge.character.scene import local_transform, rotation_matrix, show_all, tree, world_transforms
from engine_bridge.character.schema import Animation
from engine_bridge.export.animation import Keyframes, add_channel
from engine_bridge.performance.frame_store import Frames
from engine_bridge.puppet.rig_bones import RigBones
from puppetline.errors import MeshError, at
from solver.model import polar

FRAMES_PER_CHUNK = 1024
"""Number of frames that are solved at once."""

NO_ROTATION = [0.0, 0.0, 0.0, 1.0]

SCALE_TOLERANCE = 1e-4
"""Maximum relative difference of equal scales, because files hold rounded numbers."""


@dataclass(frozen=True)
class RigAnimation:
    """Numbers about an animated skeleton.

    Attributes
    ----------
    animated, following : int
        Numbers of joints with keyframes, and of joints that keep their transform relative to their parent.
    error : float
        Maximum distance of a joint from its position by its bones, mesh units. It is not zero if a joint is not where
        the bones bend, because joints keep their distances from their parents.
    uneven : tuple of str
        Names of joints below a scale that differs by axis, whose rotations are approximate.
    """

    animated: int
    following: int
    error: float
    uneven: tuple[str, ...]


def animate_rig(
    original: Document, keyframes: Keyframes, bones: RigBones, motions: Frames
) -> tuple[Document, RigAnimation]:
    """Add an animation to a copy of a document that turns the joints of its skeleton.

    With T_b the motion of a bone, a joint's rotation in the world becomes that of T_b times its own at rest. Its local
    rotation follows from the new transform of its parent. Local translations and scales do not change, except for the
    translations of joints that move with their bones: joints at the top of a skeleton, which include the root's
    translation, and targets of inverse kinematics. Nothing else in the document changes.

    Parameters
    ----------
    original : Document
    keyframes : Keyframes
        Keyframes, whose weights are ignored.
    bones : RigBones
        Bones of the document's joints.
    motions : (F, b, 4, 3) float32
        Motions of the bones for row vectors, mesh file's coordinates, without the root's motion.

    Returns
    -------
    document : Document
        Animated document.
    animation : RigAnimation

    Raises
    ------
    MeshError
        A joint has a sheared matrix, which glTF cannot animate.
    """
    document = original.copy()
    show_all(document.gltf)
    moves = bones.shares.any(axis=1) | (keyframes.root is not None and bool(keyframes.root.any()))
    shown = np.abs(np.linalg.det(_Rest.of(document, bones).above)) > 0  # a scale of 0 hides all nodes below it
    turning, travelling = bones.turning & shown, bones.placed & moves & shown
    for node in bones.nodes[turning | travelling].tolist():
        _unpack_matrix(document, node)
    rest = _Rest.of(document, bones)
    keys, error = _all_keys(rest, bones, motions, keyframes, turning, travelling)
    animation: Animation = {"name": keyframes.name, "channels": [], "samplers": []}
    clock = document.add(keyframes.times, bounds=True)
    for (row, path), values in keys.items():
        add_channel(document, animation, clock, values, int(bones.nodes[row]), path)
    if animation["channels"]:
        document.gltf["animations"].insert(0, animation)  # viewers play the first one
    animated = int((turning | travelling).sum())
    uneven = [int(bones.nodes[row]) for row in np.flatnonzero(turning) if not _even(rest.above[row])]
    names = tuple(document.gltf["nodes"][node].get("name", f"node {node}") for node in uneven)
    return document, RigAnimation(animated, len(bones.nodes) - animated, error, names)


@dataclass(frozen=True, eq=False)
class _Rest:
    """Transforms of a skeleton at rest, for column vectors.

    Attributes
    ----------
    world, above : (j, 4, 4) float64
        World transforms of the joints, and of their parent nodes.
    between : (j, 4, 4) float64
        Transforms of the parent nodes relative to the joints above them, or to the world.
    local : (j, 4, 4) float64
        Transforms of the joints relative to their parent nodes.
    rotations, scales : (j, 3, 3) float64
        Parts of `local`; valid for animated joints only.
    """

    world: NDArray[np.float64]
    above: NDArray[np.float64]
    between: NDArray[np.float64]
    local: NDArray[np.float64]
    rotations: NDArray[np.float64]
    scales: NDArray[np.float64]

    @classmethod
    def of(cls, document: Document, bones: RigBones) -> "_Rest":
        nodes, world = document.gltf["nodes"], world_transforms(document)
        joints, above, between = bones.nodes.tolist(), [], []
        parents = dict(tree(document))
        for node in joints:
            way, higher = np.eye(4), parents[node]
            above.append(np.eye(4) if higher is None else world[higher])
            while higher is not None and higher not in joints:
                way = local_transform(nodes[higher]) @ way
                higher = parents[higher]
            between.append(way)
        scales = [np.diag(nodes[node].get("scale", [1.0, 1.0, 1.0])) for node in joints]
        turns = [rotation_matrix(np.array(nodes[node].get("rotation", NO_ROTATION), dtype=float)) for node in joints]
        local = [local_transform(nodes[node]) for node in joints]
        return cls(
            world[joints], np.array(above), np.array(between), np.array(local), np.array(turns), np.array(scales)
        )


def _all_keys(
    rest: _Rest,
    bones: RigBones,
    motions: Frames,
    keyframes: Keyframes,
    turning: NDArray[np.bool_],
    travelling: NDArray[np.bool_],
) -> tuple[dict[tuple[int, str], NDArray[np.float32]], float]:
    """Return the keyframes of joints by row and path, and the maximum distance of joints from their bones."""
    count, error = len(keyframes.times), 0.0
    paths = [
        (row, path)
        for row in range(len(bones.nodes))
        for path, chosen in (("rotation", turning), ("translation", travelling))
        if chosen[row]
    ]
    keys = {(row, path): np.empty((count, 4 if path == "rotation" else 3), dtype=np.float32) for row, path in paths}
    for start in range(0, count, FRAMES_PER_CHUNK):
        chunk = slice(start, min(start + FRAMES_PER_CHUNK, count))
        root = np.zeros((chunk.stop - start, 3)) if keyframes.root is None else keyframes.root[chunk].astype(np.float64)
        solved, away = _solve(rest, bones, motions[chunk].astype(np.float64), root, turning, travelling)
        for (row, path), values in solved.items():
            before = keys[row, path][start - 1] if start else None
            keys[row, path][chunk] = _without_jumps(values, before) if path == "rotation" else values
        error = max(error, away)
    return keys, error


def _solve(
    rest: _Rest,
    bones: RigBones,
    motions: NDArray[np.float64],
    root: NDArray[np.float64],
    turning: NDArray[np.bool_],
    travelling: NDArray[np.bool_],
) -> tuple[dict[tuple[int, str], NDArray[np.float64]], float]:
    """Return the keyframes and the error for some frames, from the top down.

    A joint with the parent transform P and the rotation R at rest gets the rotation P⁻¹ Q P₀ R, where Q is the rotation
    of its bones and P₀ is P at rest. If the scale of P differs by axis, the nearest rotation is used.
    """
    turns = Rotation.from_matrix(motions[:, :, :3].swapaxes(2, 3).reshape(-1, 3, 3)).as_quat()
    turns = turns.reshape(*motions.shape[:2], 4)
    keys, error = {}, 0.0
    world = np.empty((len(rest.world), len(motions), 4, 4))
    for row, parent in enumerate(bones.parents.tolist()):
        above = rest.between[row] if parent < 0 else world[parent] @ rest.between[row]
        above = np.broadcast_to(above, (len(motions), 4, 4))
        local = np.tile(rest.local[row], (len(motions), 1, 1))
        place = rest.world[row, :3, 3]
        aim = place + root
        if bones.shares[row].any():  # a joint is on the first of its bones
            aim = np.append(place, 1) @ motions[:, np.flatnonzero(bones.shares[row])[0]] + root
        if turning[row]:
            turned = _blend(turns, bones.shares[row]) @ rest.above[row, :3, :3] @ rest.rotations[row]
            own = polar.of_matrices(np.linalg.solve(above[:, :3, :3], turned))
            keys[row, "rotation"] = Rotation.from_matrix(own).as_quat()
            local[:, :3, :3] = own @ rest.scales[row]
        if travelling[row]:
            local[:, :3, 3] = np.linalg.solve(above[:, :3, :3], (aim - above[:, :3, 3])[..., None])[..., 0]
            keys[row, "translation"] = local[:, :3, 3]
        world[row] = above @ local
        if np.linalg.det(rest.above[row]) != 0:
            error = max(error, float(np.linalg.norm(world[row, :, :3, 3] - aim, axis=1).max()))
    return keys, error


def _blend(turns: NDArray[np.float64], shares: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean (f, 3, 3) of the rotations of bones (f, b, 4) by their shares (b,)."""
    used = np.flatnonzero(shares)
    chosen = turns[:, used]
    nearer = np.where(np.einsum("fbc,fc->fb", chosen, chosen[:, 0]) < 0, -1.0, 1.0)
    mean = np.einsum("b,fb,fbc->fc", shares[used], nearer, chosen)
    return Rotation.from_quat(mean).as_matrix()


def _without_jumps(keys: NDArray[np.float64], before: NDArray[np.float32] | None) -> NDArray[np.float64]:
    """Return quaternions (f, 4) with the signs that are nearest to the previous frame."""
    earlier = keys[:1] if before is None else before[None].astype(np.float64)
    products = np.einsum("fc,fc->f", keys, np.concatenate([earlier, keys[:-1]]))
    return keys * np.cumprod(np.where(products < 0, -1, 1))[:, None]


def _even(transform: NDArray[np.float64]) -> bool:
    """Return whether a transform has the same scale in all directions."""
    squares = transform[:3, :3].T @ transform[:3, :3]
    size = np.trace(squares) / 3
    return bool(np.abs(squares - size * np.eye(3)).max() <= SCALE_TOLERANCE * size)


def _unpack_matrix(document: Document, index: int) -> None:
    """Replace a node's matrix by translation, rotation and scale, which glTF can animate."""
    node = document.gltf["nodes"][index]
    if "matrix" not in node:
        return
    matrix = local_transform(node)
    scale = np.linalg.norm(matrix[:3, :3], axis=0)
    if np.linalg.det(matrix[:3, :3]) < 0:
        scale[0] = -scale[0]
    if not scale.all() or not _even(turned := matrix[:3, :3] / scale):
        raise MeshError(
            at(document.name, field=f"nodes[{index}].matrix"),
            found="a joint with a sheared matrix",
            expected="a matrix of translation, rotation and scale, which can be animated",
            fix="Use --as morph, or export the character again without the shear.",
        )
    del node["matrix"]
    node["translation"] = matrix[:3, 3].tolist()
    node["rotation"] = Rotation.from_matrix(turned).as_quat().tolist()
    node["scale"] = scale.tolist()
