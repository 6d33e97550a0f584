"""What is pre-computed once for a mesh (Section 3.1): 320 unknowns and a few small matrices stand for every vertex.

X = W R, with R the stack of 4 × 3 affine transforms of the isolines (row vectors: x' = [x y z 1] · R_ik) and
W = w_i φ_ik(v) [x y z 1]. The energy ‖M^(−1/2) (L X − δ)‖², an integral over the surface, becomes Rᵀ A R − 2 Rᵀ B Rot
with A = (KW)ᵀ(KW), B = (KW)ᵀ M^(−1/2) W_δ and K = M^(−1/2) L; A and B are the two matrices that the paper stores.

Everything here is in *model units*: the character centred on its bounding box, whose diagonal is 1.
"""

import hashlib
import logging
import os
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, diags

from puppetline.errors import MeshError
from solver import fields as propagation
from solver import rotations
from solver.mesh import SolverMesh, snap
from solver.parts import contacts

log = logging.getLogger(__name__)

CACHE_VERSION = 3
"""Goes up whenever a stored model would differ from a new one."""

GRAM_CHUNK = 8192
"""Rows of a sparse factor that are made dense at a time."""

NULL_SPACE = 1e-14
"""Eigenvalues of WᵀW below this fraction of the largest belong to directions that move no vertex."""


@dataclass(frozen=True)
class ModelParameters:
    """What a reduced model depends on besides the mesh.

    Attributes
    ----------
    fields : int
        n_e, propagation fields.
    isolines : int
        n_iso, isolines a field.
    """

    fields: int = 8
    isolines: int = 10


@dataclass(frozen=True)
class ReducedModel:
    """A mesh, reduced.

    Attributes
    ----------
    center : (3,) float64
        Middle of the bounding box in the mesh file's coordinates.
    diagonal : float64 scalar array
        Its diagonal: one model unit.
    weights : (n_e,) float64
        Field weights w_i.
    ladder : (n, n_e) float32
        Ladder coordinates t_i(v) of each solver vertex.
    A : (4m, 4m) float64
        Energy, with m = n_e · n_iso isolines.
    B : (4m, 3m) float64
        Energy against the stacked isoline rotations.
    gram : (4m, 4m) float64
        WᵀW: what a difference of control variables is worth in vertices.
    null_space : (4m, 4m) float64
        Projector on the directions that move no vertex (every field reproduces the same affine maps, so there are
        always at least 4 (n_e − 1) of them).
    covariance : (3m, 4m) float64
        Q of `rotations.covariance_map`.
    edges : (2 · m · 10, 4m) float64
        T of `rotations.edge_map`.
    """

    center: NDArray[np.float64]
    diagonal: NDArray[np.float64]
    weights: NDArray[np.float64]
    ladder: NDArray[np.float32]
    A: NDArray[np.float64]
    B: NDArray[np.float64]
    gram: NDArray[np.float64]
    null_space: NDArray[np.float64]
    covariance: NDArray[np.float64]
    edges: NDArray[np.float64]

    @property
    def isolines(self) -> int:
        """n_iso, isolines in each field."""
        return self.B.shape[1] // 3 // len(self.weights)

    @property
    def rest_controls(self) -> NDArray[np.float64]:
        """(4m, 3) float64: R of the rest pose, the identity for every isoline."""
        return np.tile(np.eye(4, 3), (self.B.shape[1] // 3, 1))

    def rows(self, mesh: SolverMesh, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return Φ W for the surface points nearest to some points.

        Parameters
        ----------
        mesh : SolverMesh
            The mesh that this model was made of.
        points : (h, 3) float64
            In the mesh file's coordinates.

        Returns
        -------
        (h, 4m) float64
            Times R: where those points are, in model units.
        """
        corners, blend = snap(mesh, points)
        rest = self.to_model(mesh.vertices[corners.ravel()])
        W = position_matrix(rest, self.ladder[corners.ravel()].astype(np.float64), self.weights, self.isolines)
        return np.einsum("hc,hcj->hj", blend, W.toarray().reshape(*corners.shape, -1))

    def to_model(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Turn (..., 3) points of the mesh file into model units."""
        return (points - self.center) / self.diagonal


def position_matrix(
    rest: NDArray[np.float64], ladder: NDArray[np.float64], weights: NDArray[np.float64], isolines: int
) -> csr_matrix:
    """Build W for some vertices.

    Parameters
    ----------
    rest : (n, 3) float64
        Model units.
    ladder : (n, n_e) float64
    weights : (n_e,) float64
    isolines : int

    Returns
    -------
    (n, 4m) sparse float64
    """
    phi = propagation.interpolation(ladder, isolines) @ diags(np.repeat(weights, isolines))
    homogeneous = np.column_stack([rest, np.ones(len(rest))])
    return _spread(csr_matrix(phi), homogeneous)


def _spread(phi: csr_matrix, values: NDArray[np.float64]) -> csr_matrix:
    """Multiply each entry φ(v, j) by the c values of its vertex: (n, m) and (n, c) give (n, c·m)."""
    count = values.shape[1]
    columns = (count * phi.indices[:, None] + np.arange(count)).ravel()
    vertex = np.repeat(np.arange(phi.shape[0]), np.diff(phi.indptr))
    entries = (phi.data[:, None] * values[vertex]).ravel()
    return csr_matrix((entries, columns, count * phi.indptr), shape=(phi.shape[0], count * phi.shape[1]))


def _product(left: csr_matrix, right: csr_matrix) -> NDArray[np.float64]:
    """Return leftᵀ right as a dense matrix, a chunk of rows at a time: BLAS is faster here than sparse products."""
    result = np.zeros((left.shape[1], right.shape[1]))
    for start in range(0, left.shape[0], GRAM_CHUNK):
        rows = slice(start, start + GRAM_CHUNK)
        result += left[rows].toarray().T @ right[rows].toarray()
    return result


def build(mesh: SolverMesh, parameters: ModelParameters | None = None) -> ReducedModel:
    """Pre-compute the reduced model of a mesh.

    Parameters
    ----------
    mesh : SolverMesh
    parameters : ModelParameters, optional

    Returns
    -------
    ReducedModel

    Raises
    ------
    MeshError
        A mesh with too few vertices for that many fields.
    """
    parameters = parameters or ModelParameters()
    if len(mesh.vertices) < 2 * (parameters.fields + 2):
        raise MeshError(
            mesh.name,
            found=f"{len(mesh.vertices)} vertices",
            expected=f"at least {2 * (parameters.fields + 2)} for {parameters.fields} propagation fields",
            fix="Subdivide the mesh, or ask for fewer fields in the puppet file's [solver] table.",
        )
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    center, diagonal = (low + high) / 2, np.asarray(mesh.diagonal)
    rest = (mesh.vertices - center) / diagonal
    unit = SolverMesh(vertices=rest, faces=mesh.faces, of_render=mesh.of_render)

    surface, mass = propagation.laplacian(unit)
    ties = contacts(unit)
    try:
        tied = propagation.for_fields(surface, ties, unit.diagonal)
        modes = propagation.propagation_fields(tied, mass, parameters.fields)
    except RuntimeError as error:  # SuperLU finds the matrix singular, or ARPACK does not converge
        raise MeshError(
            mesh.name,
            found=f"a surface that has no smooth functions ({error})",
            expected="parts that are near each other for their size, and triangles that are not all needles",
            fix="Remove what lies far away from the character, or remesh it.",
        ) from error
    weights = propagation.field_weights(rest, mass, modes)
    ladder = propagation.ladder_coordinates(modes, parameters.isolines).astype(np.float32).astype(np.float64)

    W = position_matrix(rest, ladder, weights, parameters.isolines)
    phi = csr_matrix(
        propagation.interpolation(ladder, parameters.isolines) @ diags(np.repeat(weights, parameters.isolines))
    )
    per_area = diags(1 / np.sqrt(mass))
    L = propagation.for_energy(surface, ties, mass, unit.diagonal)
    KW = csr_matrix(per_area @ (L @ W))
    W_delta = _spread(csr_matrix(per_area @ phi), L @ rest)
    gram = _product(W, W)
    strips = rotations.crossed_triangles(ladder, unit.faces, parameters.isolines)
    return ReducedModel(
        center=center,
        diagonal=diagonal,
        weights=weights,
        ladder=ladder.astype(np.float32),
        A=_product(KW, KW),
        B=_product(KW, W_delta),
        gram=gram,
        null_space=_null_projector(gram),
        covariance=rotations.covariance_map(unit, strips, W),
        edges=rotations.edge_map(unit, rotations.sample_strips(unit, strips), W),
    )


def _null_projector(gram: NDArray[np.float64]) -> NDArray[np.float64]:
    values, vectors = np.linalg.eigh(gram)
    null = vectors[:, values < NULL_SPACE * values[-1]]
    return null @ null.T


def cache_key(mesh: SolverMesh, parameters: ModelParameters) -> str:
    """Return a name for the model of a mesh: equal for equal vertices, faces and parameters, and only then."""
    digest = hashlib.sha256(repr((CACHE_VERSION, parameters)).encode())
    for array in (mesh.vertices, mesh.faces):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:32]


def load_or_build(mesh: SolverMesh, parameters: ModelParameters, folder: Path) -> tuple[ReducedModel, bool]:
    """Take the model from its cache file, or build it and write that file.

    A file that is damaged, or holds something else, is rebuilt with a warning in the log; a folder that cannot be
    written costs the next start its speed and nothing more.

    Parameters
    ----------
    mesh : SolverMesh
    parameters : ModelParameters
    folder : Path
        Made where it does not exist.

    Returns
    -------
    model : ReducedModel
    reused : bool
        Whether it came from the file (the paper's t̃_1 instead of t_1).
    """
    key = cache_key(mesh, parameters)
    path = folder / f"{key}.npz"
    if path.exists():
        try:
            return load(path, key), True
        except Exception as error:  # whatever is wrong with a cache, the cure is the same
            log.warning("%s: %s: the reduced model is built anew", path, error)
    model = build(mesh, parameters)
    try:
        save(model, path, key)
    except OSError as error:
        log.warning("%s: %s: the reduced model is not kept for the next start", path, error)
    return model, False


def save(model: ReducedModel, path: Path, key: str) -> None:
    """Write a model and its key into one file, beside and then renamed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    arrays = {field.name: getattr(model, field.name) for field in fields(model)}
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with beside.open("wb") as file:
            np.savez(file, key=np.array(key), **arrays)
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


def load(path: Path, key: str) -> ReducedModel:
    """Read a model back.

    Raises
    ------
    Exception
        Of whatever kind NumPy and zipfile raise on a damaged file (each array carries a checksum); ValueError where
        the file is whole but belongs to another mesh, other parameters or another version.
    """
    with np.load(path, allow_pickle=False) as file:
        if str(file["key"]) != key:
            raise ValueError("it belongs to another mesh, or was made with other parameters")
        return ReducedModel(**{field.name: file[field.name] for field in fields(ReducedModel)})
