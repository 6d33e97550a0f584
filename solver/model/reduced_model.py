"""The reduced model, which is pre-computed once per mesh (Section 3.1): 320 unknowns and a few small matrices.

X = W R, with R the stack of 4 × 3 affine transforms of the isolines (row vectors: x' = [x y z 1] · R_ik) and
W = w_i φ_ik(v) [x y z 1]. The energy ‖M^(−1/2) (L X − δ)‖², an integral over the surface, becomes Rᵀ A R − 2 Rᵀ B Rot
with A = (KW)ᵀ(KW), B = (KW)ᵀ M^(−1/2) W_δ and K = M^(−1/2) L. A and B are the two matrices that the paper stores.

*Model units*: the origin is the centre of the character's bounding box, whose diagonal is 1.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from puppetline.errors import MeshError
from solver.model import clusters, energy_matrices, limb_fields, rotations
from solver.model import fields as propagation
from solver.model.bone_heat import heat_shares
from solver.model.bones import NO_BONES, BoneRegions, Bones, bone_regions, plates_of, regions_of_shares
from solver.model.coarse_fields import MAX_EXACT_VERTICES, CoarseFields
from solver.model.feet import feet_held
from solver.surface.contacts import contacts
from solver.surface.mesh import SolverMesh, snap

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

MAX_NULL_EIGENVALUE_RATIO = 1e-14
"""Largest ratio of an eigenvalue of WᵀW to the largest one for directions that move no vertex."""

Controls = NDArray[np.float32]
"""(n_e · n_iso, 3, 4) float32: an affine transform [linear | translation] for each isoline, acting on rest positions in
the mesh file's coordinates. Field i's isolines are rows i · n_iso … (i + 1) · n_iso − 1."""


@dataclass(frozen=True)
class ModelParameters:
    """Parameters of a reduced model.

    Attributes
    ----------
    fields : int
        n_e, the number of propagation fields.
    isolines : int
        n_iso, the number of isolines per field.
    """

    fields: int = 8
    isolines: int = 10


@dataclass(frozen=True)
class ReducedModel:
    """The pre-computed matrices of a mesh.

    Attributes
    ----------
    center : (3,) float64
        Middle of the bounding box in the mesh file's coordinates.
    diagonal : float64 scalar array
        Diagonal of the bounding box: one model unit.
    weights : (n_e,) float64
        Field weights w_i.
    isoline_coordinates : (n, n_e) float32
        Isoline coordinates t_i(v) of each solver vertex.
    A : (4m, 4m) float64
        Matrix of the energy, with m = n_e · n_iso isolines.
    B : (4m, 3m) float64
        Energy against the stacked isoline rotations.
    gram : (4m, 4m) float64
        The Gram matrix WᵀW: the squared displacement of the vertices by a difference of control variables.
    null_space : (4m, 4m) float64
        Projector on the directions that move no vertex. Every field reproduces the same affine maps, so there are at
        least 4 (n_e − 1) of them.
    covariance : (3m, 4m) float64
        Q of `rotations.covariance_map`.
    cluster : (n,) int32
        Rotation cluster of each solver vertex, from 0 to r − 1.
    A_clusters : (4m, 4m) float64
        Matrix of the energy with a rotation per cluster, from `clusters.energy`.
    B_clusters : (4m, 3r) float64
        That energy against the stacked rotations of the clusters; its transpose maps R to their covariances.
    bones : Bones
        Bones for which the model was made.
    regions : BoneRegions
        The part of the surface that belongs to each bone.
    shares : (n, b) float32
        Share of each bone in the motion of each vertex, whose rows sum to 1, or to 0 for vertices that no bone moves.
    """

    center: NDArray[np.float64]
    diagonal: NDArray[np.float64]
    weights: NDArray[np.float64]
    isoline_coordinates: NDArray[np.float32]
    A: NDArray[np.float64]
    B: NDArray[np.float64]
    gram: NDArray[np.float64]
    null_space: NDArray[np.float64]
    covariance: NDArray[np.float64]
    cluster: NDArray[np.int32]
    A_clusters: NDArray[np.float64]
    B_clusters: NDArray[np.float64]
    bones: Bones
    regions: BoneRegions
    shares: NDArray[np.float32]

    @property
    def isolines(self) -> int:
        """n_iso, the number of isolines per field."""
        return self.B.shape[1] // 3 // len(self.weights)

    @property
    def rest_controls(self) -> NDArray[np.float64]:
        """(4m, 3) float64: R of the rest pose, the identity for every isoline."""
        return np.tile(np.eye(4, 3), (self.B.shape[1] // 3, 1))

    def held_shares(self) -> "csr_matrix":
        """Return the share (n, b) of each bone in each vertex; rows of vertices that no bone moves are 0."""
        return scipy.sparse.csr_matrix(_unit_rows(self.shares.astype(np.float64)))

    def rows(self, mesh: SolverMesh, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return Φ W for the surface points nearest to some points.

        Parameters
        ----------
        mesh : SolverMesh
            The mesh of this model.
        points : (h, 3) float64
            In the mesh file's coordinates.

        Returns
        -------
        (h, 4m) float64
            Times R, these are the positions of the surface points in model units.
        """
        corners, blend = snap(mesh, points)
        W = self.position_matrix(mesh.vertices[corners.ravel()], corners.ravel())
        return np.einsum("hc,hcj->hj", blend, W.toarray().reshape(*corners.shape, -1))

    def position_matrix(
        self, points: NDArray[np.float64], vertices: NDArray[np.integer] | slice = slice(None)
    ) -> "csr_matrix":
        """Return the (n, 4m) rows of W for (n, 3) points of the mesh file that have the blends of solver vertices."""
        isoline_coordinates = self.isoline_coordinates[vertices].astype(np.float64)
        return position_matrix(self.to_model(points), isoline_coordinates, self.weights, self.isolines)

    def to_model(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Convert (..., 3) points of the mesh file to model units."""
        return (points - self.center) / self.diagonal


def position_matrix(
    rest: NDArray[np.float64], isoline_coordinates: NDArray[np.float64], weights: NDArray[np.float64], isolines: int
) -> "csr_matrix":
    """Build the rows of W for some vertices.

    Parameters
    ----------
    rest : (n, 3) float64
        Model units.
    isoline_coordinates : (n, n_e) float64
    weights : (n_e,) float64
    isolines : int

    Returns
    -------
    (n, 4m) sparse float64
    """
    phi = scipy.sparse.csr_matrix(
        propagation.interpolation(isoline_coordinates, isolines) @ scipy.sparse.diags(np.repeat(weights, isolines))
    )
    homogeneous = np.column_stack([rest, np.ones(len(rest))])
    columns = (4 * phi.indices[:, None] + np.arange(4)).ravel()
    entries = (phi.data[:, None] * homogeneous[np.repeat(np.arange(len(rest)), np.diff(phi.indptr))]).ravel()
    return scipy.sparse.csr_matrix((entries, columns, 4 * phi.indptr), shape=(len(rest), 4 * phi.shape[1]))


def build(
    mesh: SolverMesh,
    parameters: ModelParameters | None = None,
    bones: Bones = NO_BONES,
    shares: NDArray[np.float64] | None = None,
) -> ReducedModel:
    """Pre-compute the reduced model of a mesh, and of the bones inside it.

    Parameters
    ----------
    mesh : SolverMesh
    parameters : ModelParameters, optional
    bones : Bones, optional
    shares : (n, b) float64, optional
        Weight of each bone in each vertex, from the skin of a file; by default a vertex belongs to the bone nearest
        along the surface.

    Returns
    -------
    ReducedModel

    Raises
    ------
    MeshError
        A mesh with too few vertices for the number of fields, or one without smooth functions.
    """
    parameters = parameters or ModelParameters()
    if len(mesh.vertices) < 2 * (parameters.fields + 2):
        raise MeshError(
            mesh.name,
            found=f"{len(mesh.vertices)} vertices",
            expected=f"at least {2 * (parameters.fields + 2)} for {parameters.fields} propagation fields",
            fix="Subdivide the mesh, or ask for fewer fields.",
        )
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    center, diagonal = (low + high) / 2, np.asarray(mesh.diagonal)
    rest = (mesh.vertices - center) / diagonal
    unit = SolverMesh(vertices=rest, faces=mesh.faces, of_render=mesh.of_render)

    is_large, is_skinned = len(rest) > MAX_EXACT_VERTICES, shares is not None
    surface, mass = propagation.laplacian(unit)
    ties = replace(contacts(mesh), gap=contacts(mesh).gap / diagonal)
    if shares is None:
        regions, shares = bone_regions(mesh, bones), np.zeros((len(rest), len(bones)))
    else:
        shares = feet_held(shares, mesh.vertices, bones, plates_of(shares, mesh))
        regions = regions_of_shares(shares)
    own_fields = parameters.fields - limb_fields.limb_field_count(bones, regions, parameters.fields)
    holds = limb_fields.contacts_that_hold(ties, rest, regions, bones, skinned=is_skinned)
    L = propagation.energy_operator(surface, ties.only(holds), mass, unit.diagonal)
    try:
        tied = propagation.field_operator(surface, ties, unit.diagonal, holds)
        operator = CoarseFields(tied, L, mass, unit) if is_large else propagation.SurfaceOperator(tied, mass, rest)
        with ThreadPoolExecutor(1) as other:  # both consist of factorisations
            fields = other.submit(operator.propagation_fields, own_fields)
            if not is_skinned and (regions.owner >= 0).any():
                connected = propagation.energy_operator(surface, ties, mass, unit.diagonal)
                shares = heat_shares(connected, mass, mesh, bones, regions)
                shares = feet_held(shares, mesh.vertices, bones, plates_of(shares, mesh))
                regions = regions_of_shares(shares)
            modes = fields.result()
        along_limbs = limb_fields.limb_field_count(bones, regions, parameters.fields)
        if own_fields + along_limbs < parameters.fields:  # the heat of a bone that is hidden reaches nothing
            modes = operator.propagation_fields(parameters.fields - along_limbs)
        limb_modes = limb_fields.limb_fields(operator.smoothed, mesh.vertices, bones, regions, along_limbs, shares)
    except RuntimeError as error:  # SuperLU finds the matrix singular, or ARPACK does not converge
        raise MeshError(
            mesh.name,
            found=f"a surface that has no smooth functions ({error})",
            expected="parts that are near each other for their size, and triangles that are not all needles",
            fix="Remove what lies far away from the character, or remesh it.",
        ) from error
    modes = modes[:, : parameters.fields - along_limbs]
    weights = propagation.field_weights(rest, mass, modes)
    modes = np.column_stack([modes, limb_modes])
    own = 1 - along_limbs / parameters.fields
    weights = np.append(own * weights, np.full(along_limbs, 1 / parameters.fields))
    isoline_coordinates = (
        propagation.compute_isoline_coordinates(modes, parameters.isolines).astype(np.float32).astype(np.float64)
    )

    cluster = clusters.rotation_clusters(isoline_coordinates, weights, operator.areas, operator.samples)
    with ThreadPoolExecutor(1) as other:  # both take seconds with a million vertices
        products = other.submit(
            energy_matrices.products,
            *(L, surface, mass, rest, isoline_coordinates, weights, parameters.isolines, cluster),
        )
        covariance = clusters.covariance_map(surface, rest, isoline_coordinates, weights, parameters.isolines, cluster)
        strips = rotations.crossed_triangles(isoline_coordinates, unit.faces, parameters.isolines)
        reduced = products.result()
    A_clusters, B_clusters = clusters.energy(reduced, covariance)
    return ReducedModel(
        center=center,
        diagonal=diagonal,
        weights=weights,
        isoline_coordinates=isoline_coordinates.astype(np.float32),
        A=reduced.A,
        B=reduced.B,
        gram=reduced.gram,
        null_space=_null_projector(reduced.gram),
        covariance=rotations.covariance_map(unit, strips, isoline_coordinates, weights),
        cluster=cluster,
        A_clusters=A_clusters,
        B_clusters=B_clusters,
        bones=bones,
        regions=regions,
        shares=_unit_rows(shares).astype(np.float32),
    )


def _unit_rows(shares: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rows (n, b) whose sum is 1; rows of zeros are kept."""
    total = shares.sum(axis=1, keepdims=True)
    return np.asarray(np.divide(shares, total, out=np.zeros_like(shares), where=total > 0))


def _null_projector(gram: NDArray[np.float64]) -> NDArray[np.float64]:
    values, vectors = np.linalg.eigh(gram)
    null = vectors[:, values < MAX_NULL_EIGENVALUE_RATIO * values[-1]]
    return null @ null.T
