"""Quantises morph targets to small integers within a tolerance.

Displacements of positions are rounded to multiples of one step for all targets of a character: the largest step that a
search finds with which every vertex stays within the tolerance in every frame. The error of a vertex is the distance
from the solver's position to the position that a player computes from the file. It includes the errors of the rounded
rest pose, of rounded weights, of omitted keyframes, and of the limited number of targets.

A player multiplies the integers by the scale of the mesh's node (KHR_mesh_quantization), by which all other positions
of the mesh are divided. If the scale of a node cannot be changed, its targets are floats. Their step is then a power of
two, so that they can be compressed as well as integers.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.character import Character
from engine_bridge.character.document import Document
from engine_bridge.export.animation import Displacements, Keyframes, LocalSpace
from engine_bridge.export.key_thinning import interpolated, thin
from engine_bridge.performance.frame_store import evenly

Solved = Callable[[int, NDArray[np.int64]], NDArray[np.float32]]
"""Returns the solver's displacements (n, 3, F) of a part in some frames, world coordinates, without the root's."""

FRAMES_PER_CHUNK = 64
"""Number of frames that are compared with the solver at once."""

SEARCH_FRAMES = 64
"""Number of frames in the search for the step; all frames are checked afterwards."""

THINNING_VERTICES = 400
"""Number of vertices by which keyframes are chosen."""

THINNING_SHARE = 0.25
"""Share of the tolerance for omitted keyframes."""

FIRST_STEP = 0.25
"""First step that is tried, as a fraction of the tolerance."""

MAX_TRIALS = 8
"""Maximum number of steps that are tried on a sample."""

SMALLER = 0.93
"""Factor from a step that exceeds the tolerance in some frame to the next one."""

MIN_STEP = 1e-3
"""Minimum step as a fraction of the tolerance, if the targets themselves leave no room for rounding."""

REST_STEPS = 16
"""Number of steps of rest positions per step of displacements."""

MAX_WEIGHT = 65535
"""Integer that is a weight of 1."""


@dataclass(frozen=True)
class Grid:
    """Rounding of one node's displacements.

    Attributes
    ----------
    step : float
        Units of the node's mesh.
    is_scale : bool
        Whether the step becomes a part of the node's scale.
    """

    step: float
    is_scale: bool


def stored_weights(weights: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return weights as a file has them, in 16 bits."""
    return np.round(weights * MAX_WEIGHT).astype(np.float32) / np.float32(MAX_WEIGHT)


class PartTargets:
    """Targets of a part in the coordinates of its primitive.

    Parameters
    ----------
    character : Character
    number : int
        Number of the part.
    displacements : callable
        Returns the displacements of a part's targets, by the part's number.
    opposite : (K - 1,) float or None
        Coefficients with which the last target is the sum of the others.

    Attributes
    ----------
    node : int
    positions : (K, n, 3) float32
    normals : (K, n, 3) float32 or None
    size : float
        Largest length of a unit vector in the world.
    """

    def __init__(
        self,
        character: Character,
        number: int,
        displacements: Displacements,
        opposite: NDArray[np.floating] | None = None,
    ) -> None:
        part, gltf = character.parts[number], character.document.gltf
        self.node, self._opposite, self._local = part.node, opposite, LocalSpace(part)
        positions, normals = displacements(number)
        self.positions = np.array([self._local.positions(each) for each in positions], np.float32)
        self.normals = None
        if normals is not None:
            self.normals = np.array([self._local.normals(each) for each in normals], np.float32)
        self._linear = part.to_world[:, :3, :3].astype(np.float32)
        self._is_world = len(self._linear) == 1 and np.array_equal(self._linear[0], np.eye(3))
        self.size = float(np.linalg.norm(self._linear, ord=2, axis=(1, 2)).max())
        primitive = gltf["meshes"][gltf["nodes"][part.node]["mesh"]]["primitives"][part.primitive]
        self._rest = character.document.array(primitive["attributes"]["POSITION"]).astype(np.float32)

    def __len__(self) -> int:
        """Return the number of vertices."""
        return len(self._rest)

    def keep(self, used: NDArray[np.bool_]) -> None:
        """Drop the targets that are not used."""
        self.positions = self.positions[used]
        self.normals = None if self.normals is None else self.normals[used]

    def integers(self, grid: Grid) -> NDArray[np.float32]:
        """Return the targets (K, n, 3) as integers in float32.

        The last target is the sum of the rounded others, so that its share of their rounding cancels.
        """
        rounded = np.round(self.positions / np.float32(grid.step)) + np.float32(0)  # no negative zeros
        if self._opposite is not None:
            rounded[-1] = np.round(np.tensordot(self._opposite, rounded[:-1], axes=1)) + np.float32(0)
        return rounded

    def rest(self, grid: Grid) -> NDArray[np.float32]:
        """Return the rounded rest positions (n, 3) in steps."""
        steps = np.round(self._rest / np.float32(grid.step) * np.float32(REST_STEPS)) + np.float32(0)
        return steps / np.float32(REST_STEPS)

    def moved(self, vertices: NDArray[np.int64], weights: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return displacements (F, v, 3) of some vertices by exact targets, world coordinates."""
        linear = self._linear if len(self._linear) == 1 else self._linear[vertices]
        return np.matmul(linear, _blended(self.positions[:, vertices], weights)).transpose(2, 0, 1)

    def missed(self, grid: Grid) -> Callable[[NDArray[np.float32], NDArray[np.float32]], NDArray[np.float32]]:
        """Return a function that computes errors from weights (F, K), as a player reads them, and solved displacements.

        Displacements and errors are (n, 3, F) in the world.
        """
        integers = self.integers(grid)
        at_rest = (self.rest(grid) * np.float32(grid.step) - self._rest)[:, :, None]

        def errors(weights: NDArray[np.float32], solved: NDArray[np.float32]) -> NDArray[np.float32]:
            moved = _blended(integers, weights * np.float32(grid.step)) + at_rest
            if self._is_world:
                return moved - solved
            exact = np.array([self._local.positions(each) for each in solved.transpose(2, 0, 1)])
            return np.matmul(self._linear, moved - exact.transpose(1, 2, 0))

        return errors


def _blended(targets: NDArray[np.float32], weights: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return Σ w_k T_k (n, 3, F) of targets (K, n, 3) and weights (F, K)."""
    return (targets.reshape(len(targets), -1).T @ weights.T).reshape(*targets.shape[1:], len(weights))


@dataclass(frozen=True)
class QuantizedTargets:
    """Targets of a character, their grids, and the remaining keyframes.

    Attributes
    ----------
    parts : list of PartTargets
    keyframes : Keyframes
        The remaining keyframes, with exact weights.
    grids : dict
        Grid of each node, by the node's number.
    error : float
        Maximum distance of a vertex from the solver's position over all frames, world units.
    """

    parts: list[PartTargets]
    keyframes: Keyframes
    grids: dict[int, Grid]
    error: float


def fit(
    character: Character,
    keyframes: Keyframes,
    displacements: Displacements,
    solved: Solved,
    tolerance: float,
    *,
    opposite: NDArray[np.floating] | None = None,
    thinning: float = THINNING_SHARE,
) -> QuantizedTargets:
    """Omit keyframes and quantise targets as far as a tolerance allows.

    Parameters
    ----------
    character : Character
    keyframes : Keyframes
        All keyframes, with exact weights.
    displacements : callable
    solved : callable
    tolerance : float
        Maximum distance of a vertex from the solver's position, world units; more than the error of the exact targets.
    opposite : (K - 1,) float, optional
        Coefficients with which the last target is the sum of the others. By default, targets are independent; those
        without a weight at the remaining keyframes are omitted.
    thinning : float
        Share of the tolerance for omitted keyframes; less if the error would exceed the tolerance.

    Returns
    -------
    QuantizedTargets
    """
    for share in (thinning, thinning / 2, thinning / 4, 0.0):
        targets = _fitted(character, keyframes, displacements, solved, tolerance, opposite, share)
        if targets.error <= tolerance:
            break
    return targets


def _fitted(
    character: Character,
    keyframes: Keyframes,
    displacements: Displacements,
    solved: Solved,
    tolerance: float,
    opposite: NDArray[np.floating] | None,
    thinning: float,
) -> QuantizedTargets:
    """Return the targets of `fit` for a share of omitted keyframes, which were chosen by a part of the vertices."""
    parts = [PartTargets(character, number, displacements, opposite) for number in range(len(character.parts))]
    kept = np.arange(len(keyframes.times))
    if not keyframes.own:  # a mouth may move while everything else is still
        kept = thin(_watched(parts, keyframes), thinning * tolerance)
    root = None if keyframes.root is None else keyframes.root[kept]
    own = {name: weights[kept] for name, weights in keyframes.own.items()}
    left = replace(keyframes, times=keyframes.times[kept], weights=keyframes.weights[kept], root=root, own=own)
    if opposite is None:
        used: NDArray[np.bool_] = np.any(left.weights, axis=0)
        left = replace(left, weights=left.weights[:, used])
        for part in parts:
            part.keep(used)
    trials = _Trials(character.document, parts, keyframes, left, kept, solved)
    step = trials.search(tolerance)
    while (error := trials.error(step)) > tolerance and step > MIN_STEP * tolerance:
        step *= SMALLER
    return QuantizedTargets(parts, left, trials.grids(step), error)


def _watched(parts: list[PartTargets], keyframes: Keyframes) -> NDArray[np.float32]:
    """Return displacements (F, P, 3) of some vertices, with the root's."""
    chosen = evenly(sum(map(len, parts)), THINNING_VERTICES)
    moved, start = [], 0
    for part in parts:
        own = chosen[(chosen >= start) & (chosen < start + len(part))] - start
        moved.append(part.moved(own, keyframes.weights))
        start += len(part)
    points = np.concatenate(moved, axis=1)
    return points if keyframes.root is None else points + keyframes.root[:, None]


class _Trials:
    """Errors of targets by the step of their rounding."""

    def __init__(
        self,
        document: Document,
        parts: list[PartTargets],
        keyframes: Keyframes,
        left: Keyframes,
        kept: NDArray[np.int64],
        solved: Solved,
    ) -> None:
        self._parts, self._solved = parts, solved
        self._frames = np.arange(len(keyframes.times))
        self._weights, self._kept = left.weights, kept
        self._root = np.zeros((len(keyframes.times), 3), np.float32)
        if keyframes.root is not None and left.root is not None:
            self._root = interpolated(left.root, kept) - keyframes.root
        self._sizes: dict[int, float] = {}
        for part in parts:
            self._sizes[part.node] = max(part.size, self._sizes.get(part.node, 0.0))
        self._is_scale = {node: can_be_scaled(document, node) for node in self._sizes}

    def grids(self, step: float) -> dict[int, Grid]:
        """Return the grid of each node for a step in the world."""
        grids = {}
        for node, size in self._sizes.items():
            own = step / (size or 1.0)
            grids[node] = Grid(own if self._is_scale[node] else 2.0 ** np.floor(np.log2(own)), self._is_scale[node])
        return grids

    def search(self, tolerance: float) -> float:
        """Return the largest step that keeps a sample of frames within the tolerance.

        The squared error grows about linearly with the squared step, from that of exact targets.
        """
        frames = evenly(len(self._frames), SEARCH_FRAMES)
        good, bad = MIN_STEP * tolerance, np.inf
        at_rest, step = self.error(good, frames), FIRST_STEP * tolerance
        for _ in range(MAX_TRIALS):
            error = self.error(step, frames)
            good, bad = (max(good, step), bad) if error <= tolerance else (good, min(bad, step))
            slope = max(error**2 - at_rest**2, 1e-12 * tolerance**2) / step**2
            wanted = np.sqrt(max(tolerance**2 - at_rest**2, 0) / slope) * (1 + SMALLER) / 2
            step = min(wanted, 4 * step) if good < wanted < bad else min((good + bad) / 2, 4 * good)
            if SMALLER * tolerance <= error <= tolerance or step < MIN_STEP * tolerance:
                break
        return good

    def error(self, step: float, frames: NDArray[np.int64] | None = None) -> float:
        """Return the maximum distance of a vertex from the solver's position in some frames, or in all."""
        frames = self._frames if frames is None else frames
        grids, worst = self.grids(step), 0.0
        weights = interpolated(stored_weights(self._weights), self._kept)
        for number, part in enumerate(self._parts):
            errors = part.missed(grids[part.node])
            for start in range(0, len(frames), FRAMES_PER_CHUNK):
                chunk = frames[start : start + FRAMES_PER_CHUNK]
                missed = errors(weights[chunk], self._solved(number, chunk))
                missed += self._root[chunk].T
                worst = max(worst, float(np.einsum("ncf,ncf->nf", missed, missed).max()))
        return float(np.sqrt(worst))


def can_be_scaled(document: Document, node: int) -> bool:
    """Return whether the scale of a node can be changed without an effect on anything but its mesh.

    A skinned mesh ignores the scale of its node. Children, cameras and extensions such as lights would be scaled too.
    """
    shown = document.gltf["nodes"][node]
    if {"children", "skin", "camera", "extensions"} & shown.keys():
        return False
    targets = [channel["target"] for animation in document.gltf["animations"] for channel in animation["channels"]]
    return not any(
        target["path"] == "pointer" or (target["path"] == "scale" and target.get("node") == node) for target in targets
    )
