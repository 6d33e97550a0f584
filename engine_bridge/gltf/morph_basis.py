"""A clip as a few morph targets: SVD in the space of control variables, where the number of vertices does not matter.

Every frame is X = W R, so displacements D = W (R − R_0) of all frames span at most 960 dimensions. With WᵀW = CᵀC the
map R ↦ C R keeps lengths of vertex displacements; an SVD of the frames' C (R − R_0) gives the best basis of any size in
the least-squares sense, and the targets are W times that basis. The number of targets is then the smallest whose
*largest* error over all vertices and frames, measured on the very numbers that are written, is within tolerance.
"""

from collections.abc import Callable
from dataclasses import dataclass

import igl
import numpy as np
from numpy.typing import NDArray

from solver.binding import Binding
from solver.deformer import displacement_to_file_units, to_file_units
from solver.mesh import SolverMesh
from solver.reduced_model import NULL_SPACE, ReducedModel

CHUNK = 32
"""Frames that are compared at a time."""

SAMPLE = 1500
"""Vertices, and frames, by which the number of targets is first estimated."""

NORMAL_FRAMES_PER_TARGET = 3
"""Frames a target from which its normals are fitted."""

Progress = Callable[[float], None]


@dataclass(frozen=True)
class MorphBasis:
    """Morph targets in control variables, and their weights over a clip.

    Attributes
    ----------
    directions : (K, 4m, 3) float64
        Model units; target k is W times direction k.
    weights : (F, K) float32
        Scaled so that each target's largest weight is 1 in size.
    error : float
        Largest distance of a vertex from where the solver puts it, over all vertices and frames; mesh units.
    """

    directions: NDArray[np.float64]
    weights: NDArray[np.float32]
    error: float

    def targets(self, model: ReducedModel, binding: Binding) -> NDArray[np.float32]:
        """Return the (K, n, 3) float32 displacements of bound vertices, mesh file's coordinates."""
        targets = np.empty((len(self.directions), *binding.rest.shape), dtype=np.float32)
        for target, direction in zip(targets, self.directions, strict=True):
            target[:] = binding.vertices(displacement_to_file_units(direction, model))
        return targets


def fit(
    model: ReducedModel,
    binding: Binding,
    frames: NDArray[np.float32],
    *,
    tolerance: float,
    most: int | None = None,
    progress: Progress = lambda _: None,
) -> MorphBasis:
    """Find the fewest morph targets that reproduce a clip.

    Parameters
    ----------
    model : ReducedModel
    binding : Binding
        The solver mesh's vertices.
    frames : (F, 4m, 3) float32
        Control variables, model units.
    tolerance : float
        Largest error that is allowed, as a fraction of the diagonal.
    most : int, optional
        A limit to the number of targets, whatever the error.
    progress : callable, optional
        Told the share of the work that is done.

    Returns
    -------
    MorphBasis
    """
    directions, weights = _decompose(model, frames)
    limit = len(directions) if most is None else min(most, len(directions))
    allowed = tolerance * float(model.diagonal)
    sample = _Sample(model, binding, frames, directions, weights)
    count = sample.count_for(allowed, limit)
    while True:
        basis, worst_frame, worst_vertex = _measure(
            model, binding, frames, directions[:count], weights[:, :count], progress
        )
        if basis.error <= allowed or count == limit:
            return basis
        sample.include(worst_frame, worst_vertex)
        count = max(count + 1, sample.count_for(allowed, limit))


def _decompose(model: ReducedModel, frames: NDArray[np.float32]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return all directions (r, 4m, 3) and weights (F, r) that a clip needs, the most important first."""
    values, vectors = np.linalg.eigh(model.gram)
    kept = values > NULL_SPACE * values[-1]
    root = np.sqrt(values[kept])
    C, C_inverse = root[:, None] * vectors[:, kept].T, vectors[:, kept] / root
    rest = model.rest_controls
    moved = np.stack([(C @ (frame - rest)).ravel() for frame in frames])
    # the smaller of the two Gram matrices: neither grows with both frames and unknowns
    if len(moved) < moved.shape[1]:
        energy, left = np.linalg.eigh(moved @ moved.T)
        order = _significant(energy)
        right = (moved.T @ left[:, order]) / np.sqrt(energy[order])
    else:
        energy, right = np.linalg.eigh(moved.T @ moved)
        right = right[:, _significant(energy)]
    directions = C_inverse @ right.T.reshape(right.shape[1], len(root), 3)
    return directions, moved @ right


def _significant(energy: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the indices of eigenvalues above rounding, largest first."""
    order = np.argsort(energy)[::-1]
    return order[energy[order] > 1e-14 * max(float(energy[order[0]]), 1e-300)]


class _Sample:
    """Errors at a few vertices and frames for every number of targets, to guess how many it takes."""

    def __init__(
        self,
        model: ReducedModel,
        binding: Binding,
        frames: NDArray[np.float32],
        directions: NDArray[np.float64],
        weights: NDArray[np.float64],
    ) -> None:
        self._model, self._binding = model, binding
        self._frames, self._directions, self._weights = frames, directions, weights
        n = len(binding.rest)
        self._vertices = np.unique(np.linspace(0, n - 1, min(n, SAMPLE)).astype(int))
        self._chosen = np.unique(np.linspace(0, len(frames) - 1, min(len(frames), SAMPLE)).astype(int))

    def include(self, frame: int, vertex: int) -> None:
        self._chosen = np.union1d(self._chosen, frame)
        self._vertices = np.union1d(self._vertices, vertex)

    def count_for(self, allowed: float, limit: int) -> int:
        """Return the fewest targets, at most `limit`, that keep the sample's error within `allowed`."""
        binding, model = self._binding.only(self._vertices), self._model

        def displacement(direction: NDArray[np.floating]) -> NDArray[np.float32]:
            return binding.vertices(displacement_to_file_units(direction, model))

        residual = np.array([displacement(frame - model.rest_controls) for frame in self._frames[self._chosen]])
        for count in range(limit):
            if np.einsum("fvc,fvc->fv", residual, residual).max() <= allowed**2:
                return count
            by = self._weights[self._chosen, count].astype(np.float32)
            residual -= by[:, None, None] * displacement(self._directions[count])
        return limit


def _measure(
    model: ReducedModel,
    binding: Binding,
    frames: NDArray[np.float32],
    directions: NDArray[np.float64],
    weights: NDArray[np.float64],
    progress: Progress,
) -> tuple[MorphBasis, int, int]:
    """Return a basis with its true error, and the frame and vertex where it is largest."""
    size = np.abs(weights).max(axis=0, initial=0)
    size[size == 0] = 1
    scaled = MorphBasis(directions * size[:, None, None], (weights / size).astype(np.float32), 0.0)
    targets = scaled.targets(model, binding).reshape(len(size), binding.rest.size)
    worst, worst_frame, worst_vertex = -1.0, 0, 0
    for start in range(0, len(frames), CHUNK):
        chunk = slice(start, start + CHUNK)
        played = scaled.weights[chunk] @ targets + binding.rest.ravel()
        for offset, frame in enumerate(frames[chunk]):
            error = played[offset].reshape(-1, 3) - binding.vertices(to_file_units(frame, model))
            square = np.einsum("vc,vc->v", error, error)
            vertex = int(np.argmax(square))
            if square[vertex] > worst:
                worst, worst_frame, worst_vertex = float(square[vertex]), start + offset, vertex
        progress(min(1.0, (start + CHUNK) / len(frames)))
    return MorphBasis(scaled.directions, scaled.weights, float(np.sqrt(worst))), worst_frame, worst_vertex


def normal_targets(
    model: ReducedModel,
    mesh: SolverMesh,
    follows: NDArray[np.int64],
    normals: NDArray[np.float64],
    frames: NDArray[np.float32],
    weights: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Fit normal displacements to a clip's weights by least squares.

    A rest normal turns as the smooth normal of the solver mesh does at its vertex, so that hard edges stay hard.
    Normals are not linear in the weights as positions are, so no basis is exact; this one is the best on the frames
    that are looked at, whose number depends on the number of targets only.

    Parameters
    ----------
    model : ReducedModel
    mesh : SolverMesh
    follows : (n,) int64
        The solver vertex of each normal.
    normals : (n, 3) float64
        Unit rest normals.
    frames : (F, 4m, 3) float32
    weights : (F, K) float32

    Returns
    -------
    (K, n, 3) float32
    """
    count = weights.shape[1]
    looked_at = min(len(frames), max(64, NORMAL_FRAMES_PER_TARGET * count))
    chosen = np.unique(np.linspace(0, len(frames) - 1, looked_at).astype(int))
    solve = np.linalg.pinv(weights[chosen].astype(np.float64), rcond=1e-4).astype(np.float32)
    binding = Binding.of_solver_mesh(model, mesh)
    smooth = igl.per_vertex_normals(mesh.vertices, mesh.faces)
    fitted = np.zeros((count, normals.size), dtype=np.float32)
    for column, frame in zip(solve.T, frames[chosen], strict=True):
        now = igl.per_vertex_normals(binding.vertices(to_file_units(frame, model)).astype(np.float64), mesh.faces)
        turned = turn(normals, smooth[follows], now[follows])
        fitted += column[:, None] * (turned - normals).astype(np.float32).ravel()
    return fitted.reshape(count, *normals.shape)


def turn(vectors: NDArray[np.float64], before: NDArray[np.float64], after: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn each vector by the smallest rotation that takes one unit vector to another (Rodrigues); all (n, 3)."""
    axis = np.cross(before, after)
    cosine = np.einsum("nc,nc->n", before, after)[:, None]
    once = np.cross(axis, vectors)
    turned = vectors + once + np.cross(axis, once) / np.maximum(1 + cosine, 1e-6)
    return np.where(np.isfinite(turned), turned, vectors)
