"""A reduced model bound to handles: handle targets in, 80 affine transforms out (Section 3.4, Eq. 8-9)."""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.transform import Rotation

from puppetline.errors import MeshError
from solver import rotations
from solver.mesh import SolverMesh
from solver.reduced_model import ReducedModel
from solver.rotations import RotationMode

HANDLE_STIFFNESS = 1.0
"""λ in units of trace(A) / trace((ΦW)ᵀ(ΦW)): at 1 the Armadillo's handles are met to 3e-5 of its diagonal."""

ON_A_LINE = 0.02
"""Handles that leave a line by less than this share of the diagonal do not hold the character against rolling."""

Controls = NDArray[np.float32]
"""(n_e · n_iso, 3, 4) float32: an affine transform [linear | translation] for each isoline, acting on rest positions in
the mesh file's coordinates. Field i's isolines are rows i · n_iso … (i + 1) · n_iso − 1."""


class Deformer:
    """Moves a reduced model by its handles, each frame starting where the last one ended.

    The normal matrix N = A + λ (ΦW)ᵀ(ΦW) + the null-space projector is factored once. W always has directions that
    move no vertex, and Eq. 8 says nothing about them; the projector pins just these to the rest pose, so that N is
    positive definite and no deformation is biased. The iteration of Eq. 9 is folded into the space of rotations:
    with P the linear map that reads the surface (`rotations`), P R = P N⁻¹ (B Rot + λ (ΦW)ᵀ C + …), so an iteration is
    one small product and m polar decompositions, and R itself is solved for once a frame.

    Parameters
    ----------
    model : ReducedModel
    mesh : SolverMesh
        What the model was made of.
    handles : (h, 3) float64
        Rest positions in the mesh file's coordinates, taken to the nearest surface point; at least one.
    iterations : int
        Rotation updates a frame.
    mode : {"covariance", "triangles"}
        Rotations from all crossed triangles (default), or from the paper's 10 an isoline.

    Raises
    ------
    MeshError
        A surface so broken that its energy has no minimum.
    """

    def __init__(
        self,
        model: ReducedModel,
        mesh: SolverMesh,
        handles: NDArray[np.float64],
        *,
        iterations: int = 4,
        mode: RotationMode = "covariance",
    ) -> None:
        if not len(handles):
            raise ValueError("a deformer needs at least one handle")
        self.model = model
        self.iterations = iterations
        rest = model.rest_controls
        rows = model.rows(mesh, handles)
        self.handles = (rows @ rest) * model.diagonal + model.center
        """(h, 3) float64: the handles on the surface, in the mesh file's coordinates."""

        stiffness = HANDLE_STIFFNESS * np.trace(model.A) / np.einsum("hj,hj->", rows, rows)
        pin = np.trace(model.A) / len(model.A)
        try:
            factor = cho_factor(model.A + stiffness * rows.T @ rows + pin * model.null_space)
        except np.linalg.LinAlgError as error:
            raise MeshError(
                mesh.name,
                found=f"a surface whose deformation has no single answer ({error})",
                expected="one whose triangles are not all needles or crossed",
                fix="Remesh it, or ask for fewer fields in the puppet file's [solver] table.",
            ) from error
        self._from_turns = cho_solve(factor, model.B)
        self._from_handles = cho_solve(factor, stiffness * rows.T)
        self._constant = cho_solve(factor, pin * model.null_space @ rest)

        self._mode: RotationMode = mode
        reader = model.covariance if mode == "covariance" else model.edges
        self._rest_frames = rotations.triangle_frames(model.edges @ rest)
        self._read_turns = reader @ self._from_turns
        self._read_handles = reader @ self._from_handles
        self._read_constant = reader @ self._constant
        spread = np.linalg.svd(self.handles - self.handles.mean(axis=0), compute_uv=False)
        self._on_a_line = len(handles) < 3 or spread[1] < ON_A_LINE * float(model.diagonal)
        self._turns: NDArray[np.float64] | None = None

    def reset(self) -> None:
        """Forget the last frame: the next one starts from the rigid motion that fits the handles best."""
        self._turns = None

    def _rigid_start(self, targets: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (3, 3) rotation nearest to the handles' motion, the least where they leave it open."""
        rest, now = (points - points.mean(axis=0) for points in (self.handles, targets))
        S = rest.T @ now
        return rotations.from_covariance(S + 1e-9 * (np.linalg.norm(S) + 1e-300) * np.eye(3))[0]

    def _without_roll(self, turns: NDArray[np.float64], targets: NDArray[np.float64]) -> NDArray[np.float64]:
        """Take back the mean turn about the line through the handles, which they leave open.

        One handle, or several on a line, hold neither the deformation energy nor themselves against a rotation about
        them; without this the character would roll a little with every motion and never come back.
        """
        mean = rotations.from_covariance(turns.reshape(-1, 3, 3).sum(axis=0))[0]
        x, y, z, w = Rotation.from_matrix(mean.T @ self._rigid_start(targets)).as_quat()
        direction = np.linalg.svd(targets - targets.mean(axis=0))[2][0]
        about = (np.array([x, y, z]) @ direction) * direction if len(targets) > 1 else np.array([x, y, z])
        return turns @ Rotation.from_quat([*about, w]).as_matrix()

    def solve(self, targets: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the control variables R that bring the handles to their targets.

        Parameters
        ----------
        targets : (h, 3) float64
            In the mesh file's coordinates.

        Returns
        -------
        (4m, 3) float64
            Model units.
        """
        wanted = self.model.to_model(targets)
        if self._turns is None:
            self._turns = np.tile(self._rigid_start(targets), (self.model.B.shape[1] // 3, 1))
        fixed = self._read_handles @ wanted + self._read_constant
        for _ in range(self.iterations):
            seen = self._read_turns @ self._turns + fixed
            turns = (
                rotations.from_covariance(seen)
                if self._mode == "covariance"
                else rotations.from_edges(seen, self._rest_frames)
            )
            self._turns = turns.reshape(-1, 3)
        if self._on_a_line:
            self._turns = self._without_roll(self._turns, targets)
        return self._from_turns @ self._turns + self._from_handles @ wanted + self._constant

    def step(self, targets: NDArray[np.float64]) -> Controls:
        """Bring the handles to their targets, warm-started from the previous call.

        Parameters
        ----------
        targets : (h, 3) float64
            In the mesh file's coordinates.

        Returns
        -------
        Controls
            (m, 3, 4) float32.
        """
        return to_file_units(self.solve(targets), self.model)


def displacement_to_file_units(R: NDArray[np.floating], model: ReducedModel) -> Controls:
    """Turn a difference of control variables into affine maps from rest positions to displacements.

    Parameters
    ----------
    R : (..., 4m, 3)
        Model units.

    Returns
    -------
    (..., m, 3, 4) float32
        Mesh file's coordinates.
    """
    return _to_file_units(R, model, np.zeros(3))


def to_file_units(R: NDArray[np.floating], model: ReducedModel) -> Controls:
    """Turn control variables in model units into affine transforms of the mesh file's coordinates.

    Parameters
    ----------
    R : (..., 4m, 3)

    Returns
    -------
    (..., m, 3, 4) float32
    """
    return _to_file_units(R, model, model.center)


def _to_file_units(R: NDArray[np.floating], model: ReducedModel, origin: NDArray[np.float64]) -> Controls:
    transforms = np.swapaxes(R.reshape(*R.shape[:-2], -1, 4, 3).astype(np.float64), -1, -2).copy()
    linear = transforms[..., :3]
    transforms[..., 3] = transforms[..., 3] * model.diagonal + origin - linear @ model.center
    return transforms.astype(np.float32)
