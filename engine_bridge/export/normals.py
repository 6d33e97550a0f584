"""Rotation of the normals of a moving surface, in many frames at once."""

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.character import CharacterMesh
from puppetline.compiled import compiled
from solver.model.batch import BatchBinding
from solver.model.reduced_model import ReducedModel
from solver.surface.mesh import SolverMesh

FRAMES_PER_CHUNK = 32
"""Number of frames per chunk, which bounds the memory for three arrays of all normals."""


class TurningNormals:
    """Displacements of a character's normals.

    A normal has the rotation of the solver mesh's smooth normal at its vertex, so that hard edges stay hard.

    Parameters
    ----------
    character : CharacterMesh
    mesh : SolverMesh
    model : ReducedModel
    """

    def __init__(self, character: CharacterMesh, mesh: SolverMesh, model: ReducedModel) -> None:
        none = [np.zeros_like(part.vertices) if part.normals is None else part.normals for part in character.parts]
        self._normals = np.concatenate(none).astype(np.float32)
        self._follows = mesh.of_render
        self._faces = mesh.faces.astype(np.int32)
        self._binding = BatchBinding.of_solver_mesh(model, mesh)
        self._per_unit = np.float32(1 / mesh.diagonal)
        rest = (mesh.vertices - model.center).astype(np.float32)[:, :, None]
        self._smooth = smooth_normals(rest, self._faces, self._per_unit)[:, :, 0]

    def __len__(self) -> int:
        """Return N, the number of normals."""
        return len(self._normals)

    def displacements(self, frames: NDArray[np.floating]) -> NDArray[np.float32]:
        """Return the displacement of each normal in given frames.

        Parameters
        ----------
        frames : (F, 4m, 3)
            Control variables, model units.

        Returns
        -------
        (N, 3, F) float32
            Displacements for all parts, one after another; 0 for parts without normals.
        """
        now = smooth_normals(self._binding.displacements(frames), self._faces, self._per_unit)
        out = np.empty((*self._normals.shape, len(frames)), dtype=np.float32)
        _turn(self._normals, self._smooth, now, self._follows, out)
        return out


def smooth_normals(
    positions: NDArray[np.float32], faces: NDArray[np.int32], per_unit: np.float32
) -> NDArray[np.float32]:
    """Return unit normals of vertices, as means of face normals by area; 0 if the faces have no area.

    Parameters
    ----------
    positions : (n, 3, F) float32
    faces : (f, 3) int32
    per_unit : float32
        Inverse of the size of the mesh, which keeps areas within the range of float32.

    Returns
    -------
    (n, 3, F) float32
    """
    normals = np.zeros_like(positions)
    _sum_faces(positions, faces, per_unit, normals)
    return normals


@compiled
def _sum_faces(positions, faces, per_unit, normals):
    frames = positions.shape[2]
    for j in range(len(faces)):
        a, b, c = positions[faces[j, 0]], positions[faces[j, 1]], positions[faces[j, 2]]
        at_a, at_b, at_c = normals[faces[j, 0]], normals[faces[j, 1]], normals[faces[j, 2]]
        for f in range(frames):
            ux, uy, uz = (b[0, f] - a[0, f]) * per_unit, (b[1, f] - a[1, f]) * per_unit, (b[2, f] - a[2, f]) * per_unit
            vx, vy, vz = (c[0, f] - a[0, f]) * per_unit, (c[1, f] - a[1, f]) * per_unit, (c[2, f] - a[2, f]) * per_unit
            x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
            at_a[0, f] += x
            at_a[1, f] += y
            at_a[2, f] += z
            at_b[0, f] += x
            at_b[1, f] += y
            at_b[2, f] += z
            at_c[0, f] += x
            at_c[1, f] += y
            at_c[2, f] += z
    for v in range(len(normals)):
        at = normals[v]
        for f in range(frames):
            length = np.sqrt(at[0, f] * at[0, f] + at[1, f] * at[1, f] + at[2, f] * at[2, f])
            scale = np.float32(1) / length if length > 0 else np.float32(0)
            at[0, f] *= scale
            at[1, f] *= scale
            at[2, f] *= scale


@compiled
def _turn(normals, before, after, follows, out):
    """Write the change of each normal by the smallest rotation from one unit vector to another (Rodrigues)."""
    least, one = np.float32(1e-6), np.float32(1)
    for v in range(len(normals)):
        x, y, z = normals[v, 0], normals[v, 1], normals[v, 2]
        p, now, turned = before[follows[v]], after[follows[v]], out[v]
        px, py, pz = p[0], p[1], p[2]
        for f in range(out.shape[2]):
            qx, qy, qz = now[0, f], now[1, f], now[2, f]
            ax, ay, az = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
            nearly = one + px * qx + py * qy + pz * qz
            by = one / (nearly if nearly > least else least)
            ux, uy, uz = ay * z - az * y, az * x - ax * z, ax * y - ay * x
            turned[0, f] = ux + (ay * uz - az * uy) * by
            turned[1, f] = uy + (az * ux - ax * uz) * by
            turned[2, f] = uz + (ax * uy - ay * ux) * by
