"""A clip as a skeleton: a few rigid bones, and weights by which every vertex follows at most four of them.

Dem Bones (B. H. Le, Z. Deng, *Smooth Skinning Decomposition with Rigid Bones*, 2012) finds bones and weights for a
sample of the vertices in a sample of the frames. From there every vertex gets its weights, the bones their motion in
every frame, and the error is measured on all vertices and all frames, on the very numbers that are written.
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
from solver.surface.mesh import SolverMesh

BONE_COUNTS = (4, 6, 8, 12, 16, 24, 32, 48, 64)
"""Numbers of bones that are tried, the fewest first."""

SAMPLE_FRAMES, SAMPLE_VERTICES = 60, 2000
"""Size of the sample that Dem Bones sees."""

ITERATIONS = 40
"""Turns of Dem Bones between weights and motion."""

PROBE_VERTICES = 500
"""Vertices by which frames are compared."""

COMPARED_POSES = 5
"""Poses, the rest pose among them, by which vertices are compared: what is near in all of them moves alike."""

CANDIDATE_VERTICES = 20_000
"""Vertices among which the sample is chosen."""

NEIGHBOURS = 6
"""Vertices of the sample that a vertex looks at."""

CANDIDATE_BONES = 8
"""Bones that are tried for a vertex."""

DISTANCE_OFFSET = 1e-4
"""Diagonals that keep the nearness of a vertex to itself finite."""

FRAMES_PER_CHUNK = 16
"""Frames that are compared at a time."""

VERTICES_PER_CHUNK = 512
"""Vertices that are solved for at a time."""

Progress = Callable[[float], None]


@dataclass(frozen=True)
class Skinning:
    """A skeleton with its motion, and the weights of the solver mesh's vertices.

    Attributes
    ----------
    weights : (n, 4) float32
        Sum 1.
    bones : (n, 4) uint8
        Bone of each weight.
    joints : (B, 3) float32
        Where the bones are at rest, unturned; mesh file's coordinates.
    rotations : (F, B, 4) float32
        Unit quaternions x, y, z, w, without jumps of sign.
    translations : (F, B, 3) float32
        Where the bones are.
    error, rms : float
        Largest and root mean square distance of a vertex from where the solver puts it, over all vertices and frames;
        mesh units.
    """

    weights: NDArray[np.float32]
    bones: NDArray[np.uint8]
    joints: NDArray[np.float32]
    rotations: NDArray[np.float32]
    translations: NDArray[np.float32]
    error: float
    rms: float


def require_dem_bones() -> None:
    """Find out before the work whether Dem Bones is there.

    Raises
    ------
    OutputError
    """
    if find_spec("py_dem_bones") is None or find_spec("threadpoolctl") is None:
        raise OutputError(
            "--as skin",
            found="no Dem Bones, which finds the bones",
            expected="the Python package py-dem-bones",
            fix="Install it with: pip install 'puppetline[skin]'. Where there is none for your system, use --as morph.",
        )


def fit(
    model: ReducedModel,
    mesh: SolverMesh,
    frames: NDArray[np.float32],
    *,
    tolerance: float,
    bones: int | None = None,
    progress: Progress = lambda _: None,
) -> Skinning:
    """Find the smallest skeleton that reproduces a clip.

    Parameters
    ----------
    model : ReducedModel
    mesh : SolverMesh
    frames : (F, 4m, 3) float32
        Control variables, model units.
    tolerance : float
        Largest error that is allowed, as a fraction of the diagonal.
    bones : int, optional
        The number of bones, whatever the error; at most 128. There may be fewer where the motion has no use for more.
    progress : callable, optional
        Told the share of the work that is done.

    Returns
    -------
    Skinning
        The first of `BONE_COUNTS` within the tolerance, else the closest.

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
    assert best is not None  # noqa: S101  # the last count is always carried out
    return best


class _Sample:
    """Vertices and frames that stand for all.

    Parameters
    ----------
    model : ReducedModel
    mesh : SolverMesh
    frames : (F, 4m, 3) float32
        Control variables, model units.
    """

    def __init__(self, model: ReducedModel, mesh: SolverMesh, frames: NDArray[np.float32]) -> None:
        self._model, self._mesh, self._all_frames = model, mesh, frames
        self._rest = model.to_model(mesh.vertices)
        self._W = position_matrix(self._rest, model.ladder.astype(np.float64), model.weights, model.isolines)
        count = len(self._rest)
        poses = np.concatenate([model.rest_controls[None], frames])
        seen = _places(self._W[evenly(count, PROBE_VERTICES)], poses)
        self._frames = poses[farthest(seen.swapaxes(0, 1).reshape(len(poses), -1), SAMPLE_FRAMES)]
        moves = _places(self._W, self._frames[:COMPARED_POSES]).reshape(count, -1)
        eligible = evenly(count, CANDIDATE_VERTICES)
        self._vertices = eligible[farthest(moves[eligible], SAMPLE_VERTICES)]
        ranks = range(1, min(NEIGHBOURS, len(self._vertices)) + 1)
        distance, near = cKDTree(moves[self._vertices]).query(moves, k=ranks)
        self._near: NDArray[np.int64] = np.asarray(near)
        nearness = 1 / (np.asarray(distance) + DISTANCE_OFFSET) ** 2
        self._share = nearness / nearness.sum(axis=1, keepdims=True)
        self._links = links(moves[self._vertices])

    def decompose(self, count: int) -> "_Bones":
        """Find so many bones, or fewer, by the sample."""
        rest, places = self._rest[self._vertices], _places(self._W[self._vertices], self._frames)
        weights, motion = dem_bones(rest, places, self._links, count)
        better = skin_weights.sparse(*self._weights(self._vertices, weights, motion), weights.shape[1])
        better = better[:, np.flatnonzero(better.max(axis=0).toarray())]
        sums = bone_motion.moments(rest, better, self._W[self._vertices])
        motion = bone_motion.solve(sums, self._frames)
        off = bone_motion.carried(bone_motion.blend_lines(rest, better), motion) - places
        return _Bones(better.toarray(), motion, float(np.linalg.norm(off, axis=-1).max()))

    def skin(self, found: "_Bones") -> Skinning:
        """Carry what was found for the sample over to all vertices and all frames."""
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
        # each bone is where its motion takes its joint, rounded as it is written
        turns = motion[..., :3]
        moved = np.einsum("fbij,bj->fbi", turns, self._model.to_model(joints.astype(np.float64))) + motion[..., 3]
        translations = (moved * size + center).astype(np.float32)
        rotations = _quaternions(turns)
        error, rms = self._error(sparse, joints, rotations, translations)
        return Skinning(weights, bones, joints, rotations, translations, error, rms)

    def _weights(
        self, chosen: NDArray[np.int64], of_sample: NDArray[np.float64], motion: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return the weights of some vertices and the bones that these belong to, both (n, K)."""
        count = of_sample.shape[1]
        lines = motion.transpose(3, 1, 0, 2).reshape(4, -1)
        weights, bones = [], []
        for start in range(0, len(chosen), VERTICES_PER_CHUNK):
            part = chosen[start : start + VERTICES_PER_CHUNK]
            expected = np.einsum("nk,nkb->nb", self._share[part], of_sample[self._near[part]])
            candidates = np.argsort(-expected, axis=1, kind="stable")[:, :CANDIDATE_BONES]
            carried = _with_one(self._rest[part]) @ lines
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
        """Play the skeleton as a viewer does; return the largest and the root mean square error, mesh units."""
        binding = Binding.of_solver_mesh(self._model, self._mesh)
        lines = bone_motion.blend_lines(binding.rest, weights)
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
    """Bones as far as the sample tells.

    Attributes
    ----------
    weights : (sample, B) float64
    motion : (frames of the sample, B, 3, 4) float64
    error : float
        The largest, in diagonals.
    """

    weights: NDArray[np.float64]
    motion: NDArray[np.float64]
    error: float


def dem_bones(
    rest: NDArray[np.float64], places: NDArray[np.float64], edges: NDArray[np.int64], count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Decompose the motion of some points into that of rigid bones.

    Parameters
    ----------
    rest : (n, 3) float64
        In diagonals.
    places : (n, F, 3) float64
    edges : (e, 2) int64
        A graph in one piece: a bone begins as a connected part of it.
    count : int
        Bones; fewer are found where the motion has no use for more.

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
    solver.transAffine = bone_motion.AFFINITY
    solver.fStart = np.array([0, solver.nF], dtype=np.int32)
    solver.subjectID = np.zeros(solver.nF, dtype=np.int32)
    solver.u = rest.T.copy()
    solver.v = places.reshape(len(rest), -1).T.copy()
    solver.fv = edges.tolist()
    with threadpool_limits(1, user_api="openmp"):  # sums of several threads come out differently each time
        solver.compute()
    blocks = solver.m.reshape(solver.nF, 4, solver.nB, 4)
    return solver.get_weights().T, blocks[:, :3].transpose(0, 2, 1, 3)


def _places(W: csr_matrix, frames: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return (n, F, 3) positions W R in model units."""
    return (W @ frames.swapaxes(0, 1).reshape(W.shape[1], -1)).reshape(W.shape[0], -1, 3)


def _with_one(points: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.column_stack([points, np.ones(len(points))])


def _quaternions(turns: NDArray[np.float64]) -> NDArray[np.float32]:
    """Turn (F, B, 3, 3) rotations into (F, B, 4) quaternions; of each two, the one nearer to the frame before."""
    quaternions = Rotation.from_matrix(turns.reshape(-1, 3, 3)).as_quat(canonical=True).reshape(*turns.shape[:2], 4)
    turned_over = np.einsum("fbc,fbc->fb", quaternions[1:], quaternions[:-1]) < 0
    quaternions[1:] *= np.cumprod(np.where(turned_over, -1, 1), axis=0)[..., None]
    return quaternions.astype(np.float32)


def farthest(points: NDArray[np.floating], count: int) -> NDArray[np.int64]:
    """Choose points that cover all others: the first, then always the one farthest from those chosen.

    Parameters
    ----------
    points : (n, d)
    count : int

    Returns
    -------
    (≤ count,) int64
        In that order; no two at one place.
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
    """Return the (e, 2) pairs of a graph that ties each point to those around it and leaves no part of it alone."""
    around = np.asarray(cKDTree(points).query(points, k=range(1, min(NEIGHBOURS + 1, len(points)) + 1))[1])
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
