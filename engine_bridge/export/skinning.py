"""A skeleton for a clip: a few rigid bones, and weights with which each vertex follows at most four of them.

Dem Bones (B. H. Le, Z. Deng, *Smooth Skinning Decomposition with Rigid Bones*, 2012) finds bones and weights for a
sample of the vertices in a sample of the frames. Weights of all vertices and motion of the bones in all frames follow
from these. The error is measured for all vertices and frames, with the numbers that are written.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from engine_bridge.export import bone_motion, skin_weights
from engine_bridge.performance.frame_store import evenly
from puppetline.errors import OutputError
from solver.model.binding import Binding
from solver.model.reduced_model import ReducedModel, position_matrix
from solver.motion.deformer import to_file_units
from solver.skinning.weights import blend_lines
from solver.surface.mesh import SolverMesh

BONE_COUNTS = (4, 6, 8, 12, 16, 24, 32, 48, 64)
"""Numbers of bones that are tried, in this order."""

SAMPLE_FRAMES, SAMPLE_VERTICES = 60, 2000
"""Numbers of frames and vertices in the sample for Dem Bones."""

ITERATIONS = 40
"""Number of iterations of Dem Bones."""

PROBE_VERTICES = 500
"""Number of vertices with which frames are compared."""

COMPARED_POSES = 5
"""Number of poses, including the rest pose, in which vertices are compared; those near each other in all move alike."""

CANDIDATE_VERTICES = 20_000
"""Number of vertices from which the sample is chosen."""

NEIGHBOUR_COUNT = 6
"""Number of vertices of the sample that determine a vertex's expected weights."""

CANDIDATE_BONES = 8
"""Number of bones that are tried for a vertex."""

DISTANCE_OFFSET = 1e-4
"""Offset of distances, in diagonals, that keeps the nearness of a vertex to itself finite."""

FRAMES_PER_CHUNK = 16
"""Number of frames that are compared at once."""

VERTICES_PER_CHUNK = 512
"""Number of vertices that are solved at once."""


@dataclass(frozen=True)
class Skinning:
    """A skeleton with its motion, and skin weights of the solver mesh's vertices.

    Attributes
    ----------
    weights : (n, 4) float32
        Weights, whose sum is 1.
    bones : (n, 4) uint8
        Bone of each weight.
    joints : (B, 3) float32
        Positions of the bones at rest, where they have no rotation; mesh file's coordinates.
    rotations : (F, B, 4) float32
        Unit quaternions x, y, z, w, without jumps of sign.
    translations : (F, B, 3) float32
        Positions of the bones.
    error, rms : float
        Maximum and root mean square distance of a vertex from the solver's position, over all vertices and frames; mesh
        units.
    """

    weights: NDArray[np.float32]
    bones: NDArray[np.uint8]
    joints: NDArray[np.float32]
    rotations: NDArray[np.float32]
    translations: NDArray[np.float32]
    error: float
    rms: float


def require_dem_bones() -> None:
    """Check that Dem Bones is installed.

    Raises
    ------
    OutputError
    """
    if find_spec("py_dem_bones") is None or find_spec("threadpoolctl") is None:
        raise OutputError(
            "--as skin",
            found="no installation of Dem Bones",
            expected="the Python package py-dem-bones",
            fix="Install it: pip install 'puppetline[skin]'. If it is not available for your system, use --as morph.",
        )


def fit(
    model: ReducedModel,
    mesh: SolverMesh,
    frames: NDArray[np.float32],
    *,
    tolerance: float,
    bones: int | None = None,
    progress: Callable[[float], None] = lambda _: None,
) -> Skinning:
    """Find the smallest skeleton that reproduces a clip.

    Parameters
    ----------
    model : ReducedModel
    mesh : SolverMesh
    frames : (F, 4m, 3) float32
        Control variables, model units.
    tolerance : float
        Maximum error as a fraction of the diagonal.
    bones : int, optional
        Number of bones, regardless of the error; at most 128. Simple motion may need fewer.
    progress : callable, optional
        Receives the share of the work that is done.

    Returns
    -------
    Skinning
        Result with the first of `BONE_COUNTS` within the tolerance, else the one with the smallest error.

    Raises
    ------
    OutputError
        Dem Bones is not installed.
    """
    require_dem_bones()
    sample = _Sample(model, mesh, frames)
    counts = BONE_COUNTS if bones is None else (bones,)
    best: Skinning | None = None
    for step, count in enumerate(counts):
        found = sample.decompose(count)
        if found.error <= tolerance or count == counts[-1]:
            made = sample.skin(found)
            best = made if best is None or made.error < best.error else best
            if best.error <= tolerance * float(model.diagonal):
                break
        progress((step + 1) / len(counts))
    progress(1.0)
    assert best is not None  # noqa: S101  # the last count is always tried
    return best


class _Sample:
    """A sample of the vertices and frames."""

    def __init__(self, model: ReducedModel, mesh: SolverMesh, frames: NDArray[np.float32]) -> None:
        self._model, self._mesh, self._all_frames = model, mesh, frames
        self._rest = model.to_model(mesh.vertices)
        self._W = position_matrix(
            self._rest, model.isoline_coordinates.astype(np.float64), model.weights, model.isolines
        )
        count = len(self._rest)
        poses = np.concatenate([model.rest_controls[None], frames])
        seen = _places(self._W[evenly(count, PROBE_VERTICES)], poses)
        self._frames = poses[farthest(seen.swapaxes(0, 1).reshape(len(poses), -1), SAMPLE_FRAMES)]
        moves = _places(self._W, self._frames[:COMPARED_POSES]).reshape(count, -1)
        eligible = evenly(count, CANDIDATE_VERTICES)
        self._vertices = eligible[farthest(moves[eligible], SAMPLE_VERTICES)]
        ranks = range(1, min(NEIGHBOUR_COUNT, len(self._vertices)) + 1)
        distance, near = cKDTree(moves[self._vertices]).query(moves, k=ranks)
        self._near: NDArray[np.int64] = np.asarray(near)
        nearness = 1 / (np.asarray(distance) + DISTANCE_OFFSET) ** 2
        self._share = nearness / nearness.sum(axis=1, keepdims=True)
        self._links = links(moves[self._vertices])

    def decompose(self, count: int) -> "_Bones":
        """Find up to `count` bones for the sample."""
        rest, places = self._rest[self._vertices], _places(self._W[self._vertices], self._frames)
        weights, motion = dem_bones(rest, places, self._links, count)
        better = skin_weights.sparse(*self._weights(self._vertices, weights, motion), weights.shape[1])
        better = better[:, np.flatnonzero(better.max(axis=0).toarray())]
        sums = bone_motion.moments(rest, better, self._W[self._vertices])
        motion = bone_motion.solve(sums, self._frames)
        off = bone_motion.carried(blend_lines(rest, better), motion) - places
        return _Bones(better.toarray(), motion, float(np.linalg.norm(off, axis=-1).max()))

    def skin(self, found: "_Bones") -> Skinning:
        """Extend the bones of the sample to all vertices and frames."""
        every = np.arange(len(self._rest))
        weights, bones = skin_weights.packed(*self._weights(every, found.weights, found.motion))
        used, numbers = np.unique(bones[weights > 0], return_inverse=True)
        bones[weights > 0] = numbers
        sparse = skin_weights.sparse(weights, bones, len(used))
        sums = bone_motion.moments(self._rest, sparse, self._W)
        motion = bone_motion.solve(sums, self._all_frames)

        size, center = float(self._model.diagonal), self._model.center
        middles = sums.own[:, :3] / sums.own[:, 3:]
        joints = (middles * size + center).astype(np.float32)
        # each bone is at the moved position of its joint, which is rounded as in the file
        turns = motion[..., :3]
        moved = np.einsum("fbij,bj->fbi", turns, self._model.to_model(joints.astype(np.float64))) + motion[..., 3]
        translations = (moved * size + center).astype(np.float32)
        rotations = _quaternions(turns)
        error, rms = self._error(sparse, joints, rotations, translations)
        return Skinning(weights, bones, joints, rotations, translations, error, rms)

    def _weights(
        self, chosen: NDArray[np.int64], of_sample: NDArray[np.float64], motion: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return the weights of some vertices and their bones, both (n, K)."""
        count = of_sample.shape[1]
        lines = motion.transpose(3, 1, 0, 2).reshape(4, -1)
        weights, bones = [], []
        for start in range(0, len(chosen), VERTICES_PER_CHUNK):
            part = chosen[start : start + VERTICES_PER_CHUNK]
            expected = np.einsum("nk,nkb->nb", self._share[part], of_sample[self._near[part]])
            candidates = np.argsort(-expected, axis=1, kind="stable")[:, :CANDIDATE_BONES]
            carried = np.column_stack([self._rest[part], np.ones(len(part))]) @ lines
            missed = carried.reshape(len(part), count, -1)[np.arange(len(part))[:, None], candidates]
            missed -= _places(self._W[part], self._frames).reshape(len(part), 1, -1)
            weights.append(skin_weights.solve(missed, np.take_along_axis(expected, candidates, axis=1)))
            bones.append(candidates)
        return np.concatenate(weights), np.concatenate(bones)

    def _error(
        self,
        weights: csr_matrix,
        joints: NDArray[np.float32],
        rotations: NDArray[np.float32],
        translations: NDArray[np.float32],
    ) -> tuple[float, float]:
        """Return the maximum and the root mean square error when the skeleton is played, mesh units."""
        binding = Binding.of_solver_mesh(self._model, self._mesh)
        lines = blend_lines(binding.rest, weights)
        largest = total = 0.0
        for start in range(0, len(rotations), FRAMES_PER_CHUNK):
            part = slice(start, start + FRAMES_PER_CHUNK)
            turns = Rotation.from_quat(rotations[part].reshape(-1, 4)).as_matrix().reshape(-1, len(joints), 3, 3)
            offset = translations[part] - np.einsum("fbij,bj->fbi", turns, joints)
            played = bone_motion.carried(lines, np.concatenate([turns, offset[..., None]], axis=-1))
            for place, frame in zip(played.swapaxes(0, 1), self._all_frames[part], strict=True):
                off = place - binding.vertices(to_file_units(frame, self._model))
                square = np.einsum("vc,vc->v", off, off)
                largest, total = max(largest, float(square.max())), total + float(square.mean())
        return float(np.sqrt(largest)), float(np.sqrt(total / len(rotations)))


@dataclass(frozen=True)
class _Bones:
    """Bones of the sample.

    Attributes
    ----------
    weights : (sample, B) float64
    motion : (frames of the sample, B, 3, 4) float64
    error : float
        Maximum error in diagonals.
    """

    weights: NDArray[np.float64]
    motion: NDArray[np.float64]
    error: float


def dem_bones(
    rest: NDArray[np.float64], places: NDArray[np.float64], edges: NDArray[np.int64], count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Decompose the motion of points into that of rigid bones.

    Parameters
    ----------
    rest : (n, 3) float64
        Rest positions in diagonals.
    places : (n, F, 3) float64
        Positions in the frames.
    edges : (e, 2) int64
        Edges of a connected graph of the points, whose connected parts Dem Bones uses as first bones.
    count : int
        Number of bones; simple motion may need fewer.

    Returns
    -------
    weights : (n, B) float64
    motion : (F, B, 3, 4) float64
    """
    from py_dem_bones import DemBones
    from threadpoolctl import threadpool_limits

    solver = DemBones()
    solver.nV, solver.nF, _ = places.shape
    solver.nS, solver.nB, solver.nnz, solver.nIters = 1, count, skin_weights.MAX_INFLUENCES, ITERATIONS
    solver.transAffine = bone_motion.AFFINITY_WEIGHT
    solver.fStart = np.array([0, solver.nF], dtype=np.int32)
    solver.subjectID = np.zeros(solver.nF, dtype=np.int32)
    solver.u = rest.T.copy()
    solver.v = places.reshape(len(rest), -1).T.copy()
    solver.fv = edges.tolist()
    with threadpool_limits(1, user_api="openmp"):  # sums over several threads are not deterministic
        solver.compute()
    blocks = solver.m.reshape(solver.nF, 4, solver.nB, 4)
    return solver.get_weights().T, blocks[:, :3].transpose(0, 2, 1, 3)


def _places(W: csr_matrix, frames: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the positions W R (n, F, 3) in model units."""
    return (W @ frames.swapaxes(0, 1).reshape(W.shape[1], -1)).reshape(W.shape[0], -1, 3)


def _quaternions(turns: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return quaternions (F, B, 4) of rotations (F, B, 3, 3), with the signs that are nearest to the previous frame."""
    quaternions = Rotation.from_matrix(turns.reshape(-1, 3, 3)).as_quat(canonical=True).reshape(*turns.shape[:2], 4)
    turned_over = np.einsum("fbc,fbc->fb", quaternions[1:], quaternions[:-1]) < 0
    quaternions[1:] *= np.cumprod(np.where(turned_over, -1, 1), axis=0)[..., None]
    return quaternions.astype(np.float32)


def farthest(points: NDArray[np.floating], count: int) -> NDArray[np.int64]:
    """Choose the first point, then repeatedly the one farthest from all chosen points.

    Parameters
    ----------
    points : (n, d)
    count : int

    Returns
    -------
    (≤ count,) int64
        Indices in that order, of distinct points.
    """
    chosen = [0]
    distance = np.full(len(points), np.inf)
    while len(chosen) < count:
        offset = points - points[chosen[-1]]
        np.minimum(distance, np.einsum("nd,nd->n", offset, offset), out=distance)
        if not distance.max() > 0:
            break
        chosen.append(int(distance.argmax()))
    return np.array(chosen)


def links(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the edges (e, 2) of a connected graph that links each point to its neighbours."""
    around = np.asarray(cKDTree(points).query(points, k=range(1, min(NEIGHBOUR_COUNT + 1, len(points)) + 1))[1])
    found = np.column_stack([np.repeat(np.arange(len(points)), around.shape[1] - 1), around[:, 1:].ravel()])
    while True:
        graph = coo_matrix((np.ones(len(found)), found.T), shape=(len(points), len(points)))
        count, part = connected_components(graph, directed=False)
        if count == 1:
            return found
        ties = []
        for number in range(count):
            inside, outside = np.flatnonzero(part == number), np.flatnonzero(part != number)
            distance, nearest = map(np.asarray, cKDTree(points[outside]).query(points[inside]))
            ties.append((inside[distance.argmin()], outside[nearest[distance.argmin()]]))
        found = np.concatenate([found, ties])
