"""Distance of a skinned surface from that of the reduced model."""

import numpy as np
from numpy.typing import NDArray

from engine_bridge.performance.prepared_character import PreparedCharacter
from solver.model.batch import BatchBinding
from solver.skinning.weights import Weights, as_matrix, blend_lines


def distances(
    prepared: PreparedCharacter,
    weights: Weights,
    vertices: NDArray[np.float64],
    controls: NDArray[np.floating],
    motions: NDArray[np.floating],
) -> tuple[float, float]:
    """Return the root mean square and the maximum distance of vertices, as fractions of the diagonal.

    Parameters
    ----------
    prepared : PreparedCharacter
    weights : Weights
        Of bones and handles.
    vertices : (n, 3) float64
        Positions that the bones move, mesh file's coordinates.
    controls : (F, 4m, 3)
        Control variables, model units.
    motions : (F, b, 4, 3)
        Motions of bones and handles for row vectors, mesh file's coordinates.
    """
    model, surface = prepared.model, BatchBinding.of_solver_mesh(prepared.model, prepared.mesh)
    lines = blend_lines(vertices - model.center, as_matrix(weights, motions.shape[1]))
    largest = total = 0.0
    for start in range(0, len(controls), surface.batch_frames):
        part = slice(start, start + surface.batch_frames)
        moved = motions[part].astype(np.float64)
        # about the middle, like the displacements of the surface
        moved[:, :, 3] += np.einsum("i,fbij->fbj", model.center, moved[:, :, :3]) - model.center
        placed = lines @ moved.transpose(2, 1, 3, 0).reshape(lines.shape[1], -1)
        off = placed.reshape(len(vertices), 3, -1) - surface.displacements(controls[part])
        square = np.einsum("nxf,nxf->nf", off, off)
        largest, total = max(largest, float(square.max())), total + float(square.mean(axis=0).sum())
    size = float(model.diagonal)
    return float(np.sqrt(total / len(controls))) / size, float(np.sqrt(largest)) / size
