"""Shares of bones in the motion of a surface without a skin: heat that spreads from bones over the surface.

I. Baran and J. Popović, *Automatic Rigging and Animation of 3D Characters* (2007), section 4: the share w_b of bone b
solves −Δ w_b + H w_b = H p_b, with p_b = 1 on vertices whose nearest bone is b, and H = c / d² with the distance d. H
is 0 on vertices that do not see their nearest bone, such as those of ears; heat reaches them over the surface.

Two rules are ours. A bone of the trunk also reaches to each child that begins beside it: the rump belongs to the trunk,
not to the tail or to a thigh. And the last bone of a limb, such as the head, is stiff: d is small where rays from the
bone (`solver.model.bones`) give it the vertex too.
"""

from typing import TYPE_CHECKING

import igl
import numpy as np
import scipy
from numpy.typing import NDArray

from solver.model.bones import BoneRegions, Bones
from solver.model.fields import solve
from solver.surface.mesh import SolverMesh
from solver.surface.surface_tree import SurfaceTree

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

HEAT = 6.0
"""The factor c. With 4 to 8, distances from artists' skins differ by less than 5 %."""

MIN_DISTANCE_DIAGONALS = 1e-3
"""Smallest distance d, as a fraction of the diagonal."""

STIFF_DISTANCE_DIAGONALS = 0.03
"""Largest distance d of vertices that belong to the last bone of a limb."""

NEGLIGIBLE_SHARE = 1e-3
"""Largest share that is left out; far bones have a little of the heat everywhere."""

HIDING_DIAGONALS = 2e-3
"""Smallest distance from a vertex, as a fraction of the diagonal, at which other surface hides a bone from it."""

EQUAL_DISTANCE_RATIO = 1 + 1e-4
"""Largest ratio of two distances that count as equal: at a joint, two bones share a vertex."""

VERTICES_PER_CHUNK = 65_536
"""Number of vertices whose distances are computed at once, to save memory."""

OUTSIDE_COSINE = 1.001
"""Added to the cosine between the outward normal and the direction from a bone; distances are divided by half of this
sum, so that a bone outside the surface is far away."""


def heat_shares(
    L: "csr_matrix", mass: NDArray[np.float64], mesh: SolverMesh, bones: Bones, regions: BoneRegions
) -> NDArray[np.float64]:
    """Return the share of each bone in the motion of each vertex.

    Parameters
    ----------
    L : (n, n) sparse
        From `fields.energy_operator` with all contacts, model units.
    mass : (n,) float64
        Model units.
    mesh : SolverMesh
        In the units of the bones.
    bones : Bones
        At least one.
    regions : BoneRegions
        From `bones.bone_regions`. A part that one bone holds as a whole has this bone only, and a part that one limb
        owns as a whole the bones of this limb.

    Returns
    -------
    (n, b) float64
        Rows sum to 1.
    """
    source, distance = _sources(mesh, bones)
    owner = np.maximum(regions.owner, 0)
    stiff = regions.held & bones.terminal[owner] & (source[np.arange(len(owner)), owner] > 0)
    distance = np.where(stiff, np.minimum(distance, STIFF_DISTANCE_DIAGONALS), distance)
    seen = source.any(axis=1)
    if not seen.any():
        seen, source = regions.owner >= 0, np.eye(len(bones))[owner]
    heat = np.where(seen, mass * HEAT / np.maximum(distance, MIN_DISTANCE_DIAGONALS) ** 2, 0.0)
    shares = solve(scipy.sparse.csr_matrix(scipy.sparse.diags(heat) - L), heat[:, None] * source, mesh.vertices)
    np.maximum(shares, 0.0, out=shares)
    limb = regions.limb_parts(mesh, bones)[:, None]
    shares[(limb >= 0) & (bones.limbs != limb)] = 0.0  # contacts do not carry the body's heat into an arm's part
    shares[shares < NEGLIGIBLE_SHARE * shares.max(axis=1, keepdims=True)] = 0.0
    cold = ~shares.any(axis=1)  # such as a plate of an arm that no bone of the arm is seen from
    shares[cold] = np.eye(len(bones))[owner[cold]]
    shares /= shares.sum(axis=1, keepdims=True)
    whole = regions.whole_parts(mesh)
    shares[whole >= 0] = np.eye(len(bones))[whole[whole >= 0]]
    return shares


def _sources(mesh: SolverMesh, bones: Bones) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return p (n, b), whose rows are 0 where no bone is seen, and d (n,), as a fraction of the diagonal."""
    heads, tails, bone = _segments(bones, mesh.diagonal)
    axes, size = tails - heads, mesh.diagonal
    normals = np.nan_to_num(igl.per_vertex_normals(mesh.vertices, mesh.faces))
    tree = SurfaceTree(mesh.vertices[mesh.faces])
    source, nearest = np.zeros((len(normals), len(bones))), np.empty(len(normals))
    for start in range(0, len(normals), VERTICES_PER_CHUNK):
        rows = slice(start, start + VERTICES_PER_CHUNK)
        vertices = mesh.vertices[rows]
        distance = np.empty((len(vertices), len(bone)))
        for number, (head, axis) in enumerate(zip(heads, axes, strict=True)):
            offset = vertices - _foot(vertices, head, axis)
            away = np.maximum(np.linalg.norm(offset, axis=1), 1e-12 * size)
            cosine = np.einsum("nx,nx->n", offset, normals[rows]) / away
            distance[:, number] = away / size / (0.5 * (cosine + OUTSIDE_COSINE))
        nearest[rows] = distance.min(axis=1)
        vertex, segment = np.nonzero(distance <= EQUAL_DISTANCE_RATIO * nearest[rows, None])
        foot = _foot(vertices[vertex], heads[segment], axes[segment])
        hidden = tree.crossed(vertices[vertex], foot, np.full(len(vertex), HIDING_DIAGONALS * size))
        source[start + vertex[~hidden], bone[segment[~hidden]]] = 1.0
    source /= np.maximum(source.sum(axis=1, keepdims=True), 1.0)
    return source, nearest


def _foot(points: NDArray[np.float64], head: NDArray[np.float64], axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the nearest point (n, 3) of a segment, or of one for each point."""
    along = np.einsum("...x,...x->...", points - head, axis) / np.einsum("...x,...x->...", axis, axis)
    return np.asarray(head + np.clip(along, 0.0, 1.0)[:, None] * axis)


def _segments(bones: Bones, diagonal: float) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Return heads (s, 3), tails (s, 3) and the bone (s,) of the bones and the trunk's ways to children beside it."""
    child = np.flatnonzero((bones.parents >= 0) & (bones.limbs[bones.parents] < 0))
    parent = bones.parents[child]
    axes = bones.tails[parent] - bones.heads[parent]
    along = np.einsum("sx,sx->s", bones.heads[child] - bones.heads[parent], axes) / bones.lengths[parent] ** 2
    start = bones.heads[parent] + np.clip(along, 0.0, 1.0)[:, None] * axes
    beside = np.linalg.norm(bones.heads[child] - start, axis=1) > MIN_DISTANCE_DIAGONALS * diagonal
    return (
        np.concatenate([bones.heads, start[beside]]),
        np.concatenate([bones.tails, bones.heads[child][beside]]),
        np.concatenate([np.arange(len(bones)), parent[beside]]),
    )
