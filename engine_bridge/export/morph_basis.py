"""A small number of morph targets for a clip, by SVD in the space of control variables, whatever the size of the mesh.

Every frame is X = W R, so displacements D = W (R − R_0) of all frames span at most 960 dimensions. With WᵀW = CᵀC the
map R ↦ C R keeps lengths of vertex displacements; an SVD of the frames' C (R − R_0) gives the best basis of any size in
the least-squares sense, and the targets are W times that basis. The number of targets is then the smallest whose
*largest* error over all vertices and frames is within tolerance. Coordinates in that basis have both signs; one more
target converts them to weights within [0, 1] (`unit_weights`). The remainder of a frame is also W times control
variables; its length at each vertex is the error. The error includes the rounding of the weights that are written, but
not that of the float32 targets, which is about 1e-7 of the diagonal.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy
from numpy.typing import NDArray

from engine_bridge.character.character import CharacterMesh
from engine_bridge.export.animation import Displacements
from engine_bridge.export.normals import FRAMES_PER_CHUNK, TurningNormals
from engine_bridge.export.unit_weights import UnitWeights
from engine_bridge.performance.frame_store import Frames, evenly
from engine_bridge.performance.prepared_character import PreparedCharacter
from engine_bridge.performance.settings import Settings
from solver.model.batch import MAX_BATCH_FRAMES as CHUNK
from solver.model.batch import BatchBinding
from solver.model.reduced_model import MAX_NULL_EIGENVALUE_RATIO, ReducedModel
from solver.surface.mesh import SolverMesh

SAMPLE_SIZE = 500
"""Number of vertices, and of frames, for the estimate of the number of targets."""

MAX_ADDED_SAMPLES = 8
"""Maximum number of frames and of vertices with large errors that are added to the sample after a wrong estimate."""

NOISE_ENERGY_SHARE = 1e-14
"""Share of a clip's energy below which a direction is a rounding error."""

NORMAL_FRAMES_PER_TARGET = 3
"""Number of frames per target to which normals are fitted."""

Progress = Callable[[float], None]


@dataclass(frozen=True)
class MorphBasis:
    """Morph targets as control variables, and their weights over a clip.

    Attributes
    ----------
    directions : (K, 4m, 3) float64
        Directions whose sums are the poses, model units, orthogonal in the metric WᵀW. The clip's coordinates along
        each have the maximum 1 and a minimum of −1 or more.
    unit_weights : UnitWeights
        Conversion of coordinates along the directions to weights of the targets.
    weights : (F, unit_weights.count) float32
        Weights of the targets, within [0, 1].
    error : float
        Maximum distance of a vertex from the solver's position, over all vertices and frames; mesh units.
    """

    directions: NDArray[np.float64]
    unit_weights: UnitWeights
    weights: NDArray[np.float32]
    error: float

    def targets(self, binding: BatchBinding) -> NDArray[np.float32]:
        """Return the displacements (count, n, 3) float32 of bound vertices, mesh file's coordinates."""
        moved = binding.displacements(self.unit_weights.targets(self.directions))
        return np.ascontiguousarray(moved.transpose(2, 0, 1))


def fit(
    model: ReducedModel,
    binding: BatchBinding,
    frames: Frames,
    *,
    tolerance: float,
    max_targets: int | None = None,
    reach: float | None = None,
    progress: Progress = lambda _: None,
) -> MorphBasis:
    """Find the fewest morph targets that reproduce a clip.

    Parameters
    ----------
    model : ReducedModel
    binding : BatchBinding
        Binding of the solver mesh's vertices.
    frames : (F, 4m, 3) float32
        Control variables, model units.
    tolerance : float
        Maximum error as a fraction of the diagonal.
    max_targets : int, optional
        Maximum number of targets, regardless of the error; at least 2.
    reach : float, optional
        Maximum absolute coordinate along any direction that has weights within [0, 1]; the clip's own are at most 1. By
        default, the range is that of the clip.
    progress : callable, optional
        Receives the share of the work that is done.

    Returns
    -------
    MorphBasis
    """
    directions = _directions(model, frames)
    limit = len(directions) if max_targets is None else min(max_targets - 1, len(directions))
    allowed = tolerance * float(model.diagonal)
    sample = _Sample(model, binding, frames, directions)
    count = sample.count_for(allowed, limit)
    while True:
        basis, worst = _measure(model, binding, frames, directions[:count], reach, progress)
        if basis.error <= allowed or count == limit:
            return basis
        sample.include(*worst)
        count = max(count + 1, sample.count_for(allowed, limit))


def fit_rig(
    prepared: PreparedCharacter,
    frames: Frames,
    settings: Settings,
    progress: Callable[[str, float], None],
    reach: float | None = None,
) -> MorphBasis:
    """Fit a basis to frames of a character as `fit` does, with the settings' tolerance and number of targets."""
    binding, limit = BatchBinding.of_solver_mesh(prepared.model, prepared.mesh), settings.targets
    fitting = partial(progress, "Fitting morph targets")
    return fit(
        prepared.model, binding, frames, tolerance=settings.max_error, max_targets=limit, reach=reach, progress=fitting
    )


def surface_coordinates(model: ReducedModel) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return C (r, 4m) with CᵀC = WᵀW, which keeps lengths of vertex displacements, and its inverse (4m, r).

    Directions that move no vertex are omitted.
    """
    values, vectors = np.linalg.eigh(model.gram)
    kept = values > MAX_NULL_EIGENVALUE_RATIO * values[-1]
    root = np.sqrt(values[kept])
    return root[:, None] * vectors[:, kept].T, vectors[:, kept] / root


def _directions(model: ReducedModel, frames: Frames) -> NDArray[np.float64]:
    """Return all directions (r, 4m, 3) of a clip, the most important first; orthonormal in the metric WᵀW."""
    C, C_inverse = surface_coordinates(model)

    def moved(chosen: slice) -> NDArray[np.float64]:
        frame = frames[chosen] - model.rest_controls
        return np.tensordot(frame, C, axes=(1, 1)).reshape(len(frame), -1)

    # the smaller one of the two Gram matrices
    width = 3 * len(C)
    if len(frames) < width:
        everything = moved(slice(None))
        energy, left = _significant(everything @ everything.T)
        right = (everything.T @ left) / np.sqrt(energy)
    else:
        gram = np.zeros((width, width))
        for start in range(0, len(frames), CHUNK):
            some = moved(slice(start, start + CHUNK))
            gram += some.T @ some
        _, right = _significant(gram)
    return np.einsum("jc,kxc->kjx", C_inverse, right.T.reshape(-1, 3, len(C)), optimize=True)


def _significant(gram: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the eigenvalues (r,) above rounding errors, the largest first, and their eigenvectors as columns."""
    energy, vectors = scipy.linalg.eigh(
        gram, subset_by_value=(NOISE_ENERGY_SHARE * max(np.trace(gram), 1e-300), np.inf)
    )
    return energy[::-1], vectors[:, ::-1]


def _coordinates(model: ReducedModel, frames: Frames, directions: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return the coordinates (F, K) float32 of a clip in orthonormal directions."""
    coordinates = np.empty((len(frames), len(directions)), dtype=np.float32)
    duals = np.tensordot(directions, model.gram, axes=(1, 1)).transpose(0, 2, 1)
    for start in range(0, len(frames), CHUNK):
        chunk = slice(start, start + CHUNK)
        coordinates[chunk] = np.tensordot(frames[chunk] - model.rest_controls, duals, axes=((1, 2), (1, 2)))
    return coordinates


class _Sample:
    """A few vertices and frames, for an estimate of the number of targets."""

    def __init__(
        self, model: ReducedModel, binding: BatchBinding, frames: Frames, directions: NDArray[np.float64]
    ) -> None:
        self._model, self._binding = model, binding
        self._frames, self._directions = frames, directions
        self._vertices = evenly(len(binding), SAMPLE_SIZE)
        self._chosen = evenly(len(frames), SAMPLE_SIZE)

    def include(self, frames: NDArray[np.int64], vertices: NDArray[np.int64]) -> None:
        self._chosen = np.union1d(self._chosen, frames)
        self._vertices = np.union1d(self._vertices, vertices)

    def count_for(self, allowed: float, limit: int) -> int:
        """Return the minimum number of directions, up to `limit`, that keep the sample's error within `allowed`."""
        binding, frames = self._binding.only(self._vertices), self._frames[self._chosen]
        residual = binding.displacements(frames - self._model.rest_controls)
        coordinates = _coordinates(self._model, frames, self._directions[:limit])
        moved = binding.displacements(self._directions[:limit])
        for count in range(limit):
            if np.einsum("vcf,vcf->vf", residual, residual).max() <= allowed**2:
                return count
            residual -= moved[:, :, count, None] * coordinates[:, count]
        return limit


def _measure(
    model: ReducedModel,
    binding: BatchBinding,
    frames: Frames,
    directions: NDArray[np.float64],
    reach: float | None,
    progress: Progress,
) -> tuple[MorphBasis, tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Return a basis with its exact error, and frames and vertices with large errors."""
    coordinates = _coordinates(model, frames, directions)
    size = _signed_size(coordinates)
    coordinates /= size
    directions = directions * size[:, None, None].astype(np.float64)
    unit_weights = UnitWeights.of_clip(coordinates) if reach is None else UnitWeights.within(np.full(len(size), reach))
    weights, targets = unit_weights.weights(coordinates), unit_weights.targets(directions)
    distances, at_frames, at_vertices = [], [], []
    for start in range(0, len(frames), CHUNK):
        chunk = slice(start, start + CHUNK)
        left = frames[chunk] - model.rest_controls - np.tensordot(weights[chunk].astype(np.float64), targets, axes=1)
        distance, vertex = binding.largest_displacements(left)
        worst = int(distance.argmax())
        distances.append(float(distance[worst]))
        at_frames.append(start + worst)
        at_vertices.append(int(vertex[worst]))
        progress(min(1.0, (start + CHUNK) / len(frames)))
    far = np.argsort(distances)[-MAX_ADDED_SAMPLES:]
    basis = MorphBasis(directions, unit_weights, weights, max(distances))
    return basis, (np.array(at_frames)[far], np.array(at_vertices)[far])


def _signed_size(coordinates: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the coordinate (K,) of largest absolute value along each direction; 1 for an unused direction."""
    high, low = coordinates.max(axis=0, initial=0), coordinates.min(axis=0, initial=0)
    size = np.where(high >= -low, high, low)
    return np.where(size == 0, np.float32(1), size)


def displacements(
    character: CharacterMesh, mesh: SolverMesh, model: ReducedModel, frames: Frames, basis: MorphBasis
) -> Displacements:
    """Return the displacements (K, n, 3) of positions and normals for each part, world coordinates.

    Parameters
    ----------
    character : CharacterMesh
    mesh : SolverMesh
    model : ReducedModel
    frames : (F, 4m, 3) float32
        Control variables, model units.
    basis : MorphBasis
        Basis of these frames.
    """
    normals = None
    if any(part.normals is not None for part in character.parts):
        normals = _normal_targets(TurningNormals(character, mesh, model), frames, basis.weights)

    def of_part(number: int) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
        part, place = character.parts[number], character.vertex_slices[number]
        positions = basis.targets(BatchBinding(model, part.vertices, mesh.of_render[place]))
        return positions, None if normals is None or part.normals is None else normals[:, place]

    return of_part


def _normal_targets(turning: TurningNormals, frames: Frames, weights: NDArray[np.float32]) -> NDArray[np.float32]:
    """Fit normal displacements (K, N, 3) to a clip's weights by least squares.

    Unlike positions, normals are not linear in the weights, so that no basis is exact. This one is the best for a
    sample of frames, whose maximum number depends on the number of targets only.
    """
    count = weights.shape[1]
    chosen = evenly(len(frames), max(64, NORMAL_FRAMES_PER_TARGET * count))
    solve = np.linalg.pinv(weights[chosen].astype(np.float64), rcond=1e-4).T.astype(np.float32)
    fitted = np.zeros((3 * len(turning), count), dtype=np.float32)
    for start in range(0, len(chosen), FRAMES_PER_CHUNK):
        chunk = slice(start, start + FRAMES_PER_CHUNK)
        moved = turning.displacements(frames[chosen[chunk]])
        fitted += moved.reshape(len(fitted), -1) @ solve[chunk]
    return fitted.reshape(len(turning), 3, count).transpose(2, 0, 1)
