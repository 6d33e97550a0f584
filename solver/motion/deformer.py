"""Deformation of a reduced model by handles and bones: their motion to 80 affine transforms (Section 3.4, Eq. 8-9)."""

from copy import copy
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from puppetline.compiled import compiled
from puppetline.errors import MeshError
from solver.model import matrix_blocks as blocks
from solver.model.matrix_blocks import ROWS, add_product, apply_change, place_of_row
from solver.model.polar import nearest_rotations
from solver.model.reduced_model import Controls, ReducedModel
from solver.model.rotations import RotationMode
from solver.motion import twist
from solver.motion.bone_terms import bone_shares, bone_terms, nearby_motions, nearby_rotations, prior, rotation_weights
from solver.surface.mesh import SolverMesh

HANDLE_STIFFNESS: dict[RotationMode, float] = {"clusters": 10.0, "covariance": 1.0}
"""Weight λ of handles in units of trace(A) / trace((ΦW)ᵀ(ΦW)), larger for the stiffer energy of clusters. The
Armadillo's handles are met to 3e-5 of its diagonal."""

MIN_HANDLE_SPREAD_DIAGONALS = 0.02
"""Smallest spread of handles across a line, as a share of the diagonal, with which they determine the character's roll
about that line."""

NEARBY_BONE_WEIGHT = 3e-5
"""Weight of the distance between a transform and the mean motion of nearby bones, in units of trace(A) / 4m. It bounds
directions that hardly move a vertex, and changes the rotation of limbs by less than 0.5°."""


class _Affine(NamedTuple):
    """An affine function of the rotations and the inputs (targets and motions), in the layout of `matrix_blocks`."""

    turns: NDArray[np.float64]
    inputs: NDArray[np.float64]
    constant: NDArray[np.float64]


class DeformerState(NamedTuple):
    """State of a deformer after a frame."""

    turns: NDArray[np.float64]
    carried: NDArray[np.float64]
    started: bool


class Deformer:
    """Deforms a reduced model by its handles and bones; each frame starts from the previous one.

    The normal matrix N = A + λ (ΦW)ᵀ(ΦW) + Σ_b G_b + P is factored once. W always has directions that move no vertex,
    which Eq. 8 does not determine. The projector P pins these directions only, so N is positive definite and the
    deformation is not biased. They are pinned to the rest pose, or with bones to the mean motion of nearby bones, to
    which `NEARBY_BONE_WEIGHT` also draws all other directions. G_b = λ W_bᵀ M_b W_b holds the surface around bone b to
    its motion T_b. W R is an affine map of the rest pose if all transforms are that map, so the right-hand side
    W_bᵀ M_b [X_b 1] T_b is G_b times a stack of T_b.

    The iteration of Eq. 9 runs in the space of rotations. With the linear map Q from R to covariances (`rotations`,
    `clusters`), Q R = Q N⁻¹ (B Rot + λ (ΦW)ᵀ C + Σ_b G_b T_b + …). An iteration is one small product and one polar
    decomposition per rotation; R itself is solved for once per frame. Rotations are drawn to those of the bones that
    hold their vertices: S_c + μ Σ_b a_cb s_c Q_b is decomposed instead of S_c, with a_cb the share of bone b in the
    area of c, s_c a third of the trace of S_c at rest, and Q_b the linear part of T_b. Before each frame, rotations are
    multiplied by the change of nearby bones, so that turning the whole character does not change its shape.

    Parameters
    ----------
    model : ReducedModel
        Built for the bones that move the mesh, if any.
    mesh : SolverMesh
        The mesh of the model.
    handles : (h, 3) float64
        Rest positions in the mesh file's coordinates, moved to the nearest surface points; at least one without bones.
    iterations : int
        Rotation updates per frame.
    mode : {"clusters", "covariance"}, optional
        One rotation per cluster of vertices, the default with bones; or one per isoline, from the triangles that it
        crosses, the default without bones. Clusters stretch edges least, but surface that no bone holds takes many
        iterations to follow its handles.

    Raises
    ------
    MeshError
        The surface's energy has no unique minimum, or there is no handle and the bones hold no surface.
    """

    def __init__(
        self,
        model: ReducedModel,
        mesh: SolverMesh,
        handles: NDArray[np.float64],
        *,
        iterations: int = 4,
        mode: RotationMode | None = None,
    ) -> None:
        handles = np.asarray(handles, dtype=np.float64).reshape(-1, 3)
        self.bones = model.bones
        if not len(handles) and not len(self.bones):
            raise ValueError("found no handle and no bone; expected at least one")
        self.model = model
        self.iterations = iterations
        rest = model.rest_controls
        rows = model.rows(mesh, handles) if len(handles) else np.zeros((0, len(rest)))
        self.handles = (rows @ rest) * model.diagonal + model.center
        """(h, 3) float64: the handles on the surface, in the mesh file's coordinates."""

        self._mode: RotationMode = mode or ("clusters" if len(self.bones) else "covariance")
        A, B, reader = {
            "clusters": (model.A_clusters, model.B_clusters, model.B_clusters.T),
            "covariance": (model.A, model.B, model.covariance),
        }[self._mode]
        scale = np.trace(A)
        regions = model.regions
        if not len(handles) and not regions.held.any():
            raise MeshError(
                mesh.name,
                found="bones that hold no part of the surface",
                expected="bones inside the character",
                fix="Move the points of the limbs into the mesh.",
            )
        held = bone_terms(model, mesh, scale)
        stiffness = HANDLE_STIFFNESS[self._mode] * scale / max(np.einsum("hj,hj->", rows, rows), 1e-12)
        pinned = scale / len(A) * model.null_space
        if len(self.bones):
            pinned[np.diag_indices_from(pinned)] += NEARBY_BONE_WEIGHT * scale / len(A)
        try:
            factor = scipy.linalg.cho_factor(A + stiffness * rows.T @ rows + held.normal + pinned)
        except np.linalg.LinAlgError as error:
            raise MeshError(
                mesh.name,
                found=f"a surface whose deformation is not unique ({error})",
                expected="a surface whose triangles are not all needles or crossed",
                fix="Remesh it, or use fewer fields.",
            ) from error
        from_turns = scipy.linalg.cho_solve(factor, B)
        anchor = nearby_motions(model, mesh) if len(self.bones) else np.zeros((len(A), 0))
        from_inputs = scipy.linalg.cho_solve(factor, np.hstack([stiffness * rows.T, held.pull + pinned @ anchor]))
        constant = np.zeros_like(rest) if len(self.bones) else scipy.linalg.cho_solve(factor, pinned @ rest)
        self._place_of_turns = blocks.matrix_row_places(B.shape[1] // 3)
        place_of_inputs = blocks.row_places(from_inputs.shape[1])

        def laid_out(
            reader: NDArray[np.float64], row: NDArray[np.int64], prior: NDArray[np.float64] | float
        ) -> _Affine:
            from_all = reader @ from_inputs
            from_all[:, len(rows) :] += prior
            return _Affine(
                blocks.pack_matrix(reader @ from_turns, row, self._place_of_turns),
                blocks.pack_matrix(from_all, row, place_of_inputs),
                blocks.pack_rows(reader @ constant, row),
            )

        together = rotation_weights(model, self._mode)
        area, count = mesh.vertex_areas, len(self.bones)
        held_shares = bone_shares(together, area, np.where(regions.held, regions.owner, -1), count)
        near = nearby_rotations(bone_shares(together, area, regions.owner, count))
        self._near_bones = blocks.pack_matrix(
            np.hstack([np.zeros((len(near), len(rows))), near]), self._place_of_turns, place_of_inputs
        )
        size = np.einsum("rxx->r", (reader @ rest).reshape(-1, 3, 3)) / 3
        self._surface = laid_out(reader, self._place_of_turns, prior(held_shares, size))
        self._controls = laid_out(np.eye(len(rest)), blocks.row_places(len(rest)), 0.0)
        self._inputs = blocks.pack_rows(np.zeros((from_inputs.shape[1], 3)), place_of_inputs)
        self._at_rest = np.tile(np.eye(4, 3), (len(self.bones), 1, 1))
        spread = (
            np.linalg.svd(self.handles - self.handles.mean(axis=0), compute_uv=False) if len(handles) else np.zeros(3)
        )
        on_a_line = len(handles) < 3 or spread[1] < MIN_HANDLE_SPREAD_DIAGONALS * float(model.diagonal)
        self._rolls = on_a_line and not len(self.bones)
        self._unturned = blocks.pack_rows(np.tile(np.eye(3), (B.shape[1] // 3, 1)), self._place_of_turns)
        self._turns, self._near, self._carried, self._now_carried = (self._unturned.copy() for _ in range(4))
        self._started = False
        self._fixed, self._now = np.empty_like(self._surface.constant), np.empty_like(self._surface.constant)
        self._result = np.empty_like(self._controls.constant)

    @property
    def turns(self) -> NDArray[np.float64]:
        """(3r, 3) float64: the rotations of clusters or isolines in the last frame, for row vectors."""
        return blocks.unpack_rows(self._turns, self._place_of_turns)

    def another(self, iterations: int) -> "Deformer":
        """Return a deformer of the same character, handles and bones with its own state."""
        other = copy(self)
        other.iterations = iterations
        for buffer in ("_inputs", "_turns", "_near", "_carried", "_now_carried", "_fixed", "_now", "_result"):
            setattr(other, buffer, getattr(self, buffer).copy())
        other.reset()
        return other

    @property
    def state(self) -> DeformerState:
        """What the next frame starts from."""
        return DeformerState(self._turns.copy(), self._carried.copy(), self._started)

    def resume(self, state: DeformerState) -> None:
        """Continue after the frame of a `state` of a deformer of the same character, handles and bones."""
        self._turns[:], self._carried[:], self._started = state

    def reset(self) -> None:
        """Forget the last frame: the next one starts from the bones, or from the rigid motion that fits the handles."""
        self._started = False
        self._turns[:], self._carried[:] = self._unturned, self._unturned

    def solve(
        self,
        targets: NDArray[np.float64],
        motions: NDArray[np.float64] | None = None,
        out: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]:
        """Return the control variables R that move the handles to their targets, and held surface with its bones.

        Parameters
        ----------
        targets : (h, 3) float64
            In the mesh file's coordinates.
        motions : (b, 4, 3) float64, optional
            T_b of x' = [x 1] T_b, in the mesh file's coordinates; by default the rest pose.
        out : (4m, 3) float64, optional
            Written to, and returned.

        Returns
        -------
        (4m, 3) float64
            Model units.

        Raises
        ------
        ValueError
            An array has another shape, or a number is not finite.
        """
        out = np.empty_like(self.model.rest_controls) if out is None else out
        targets = np.ascontiguousarray(targets, dtype=np.float64)
        motions = self._at_rest if motions is None else np.ascontiguousarray(motions, dtype=np.float64)
        if targets.shape != self.handles.shape or out.shape != (len(self.model.A), 3):
            raise ValueError(
                f"found {targets.shape} targets into {out.shape}; expected targets for {self.handles.shape} handles"
            )
        if motions.shape != self._at_rest.shape:
            raise ValueError(f"found {motions.shape} motions; expected {self._at_rest.shape}")
        if not _pack_inputs(targets, motions, self.model.center, float(self.model.diagonal), self._inputs):
            raise ValueError("found a target or a motion that is not finite; expected finite numbers")
        if len(self.bones):
            _carry(self._near_bones, self._inputs, self._near, self._carried, self._now_carried, self._turns)
        elif not self._started:
            start = twist.rigid_fit(self.handles, targets)
            self._turns[:] = blocks.pack_rows(np.tile(start, (len(self._place_of_turns) // 3, 1)), self._place_of_turns)
        self._started = True
        _turn(*self._surface, self._inputs, self.iterations, self._turns, self._fixed, self._now)
        if self._rolls:
            start = twist.rigid_fit(self.handles, targets)
            twist.remove_roll(self._turns, len(self._place_of_turns) // 3, start, _line_through(targets))
        _settle(*self._controls, self._inputs, self._turns, self._result, out)
        return out

    def step(self, targets: NDArray[np.float64], motions: NDArray[np.float64] | None = None) -> Controls:
        """Solve for the next frame, starting from the previous one.

        Parameters
        ----------
        targets : (h, 3) float64
            In the mesh file's coordinates.
        motions : (b, 4, 3) float64, optional
            As for `solve`.

        Returns
        -------
        Controls
            (m, 3, 4) float32.
        """
        return to_file_units(self.solve(targets, motions), self.model)


def _line_through(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the direction (3,) in which points spread most; zero if all coincide."""
    _, spread, directions = np.linalg.svd(points - points.mean(axis=0))
    return directions[0] if spread[0] > 1e-12 * np.abs(points).max() else np.zeros(3)


@compiled
def _pack_inputs(targets, motions, center, diagonal, packed):
    """Write (h, 3) targets and (b, 4, 3) motions in blocks, in model units; return whether all are finite."""
    finite = True
    for h in range(len(targets)):
        place = place_of_row(h)
        for axis in range(3):
            packed[place + axis * ROWS] = (targets[h, axis] - center[axis]) / diagonal
            finite = finite and np.isfinite(targets[h, axis])
    for b in range(len(motions)):
        for axis in range(3):
            moved = motions[b, 3, axis] - center[axis]
            for row in range(3):
                packed[place_of_row(len(targets) + 4 * b + row) + axis * ROWS] = motions[b, row, axis]
                moved += center[row] * motions[b, row, axis]
            packed[place_of_row(len(targets) + 4 * b + 3) + axis * ROWS] = moved / diagonal
            finite = finite and np.isfinite(moved)
    return finite


@compiled(inner=True)
def _copy(source, target):
    """Copy an array. An assignment to all of it would compile more slowly."""
    for k in range(len(target)):
        target[k] = source[k]


@compiled(inner=True)
def _fix(of_inputs, constant, inputs, out):
    """Write the part that does not depend on the rotations."""
    _copy(constant, out)
    add_product(of_inputs, inputs, out)


@compiled
def _carry(near_bones, inputs, near, carried, now, turns):
    """Multiply all rotations by the change of nearby bones since the last frame."""
    for k in range(len(near)):
        near[k] = 0.0
    add_product(near_bones, inputs, near)
    nearest_rotations(near, now)  # not in place, so that the compiler can vectorise
    apply_change(turns, carried, now)
    _copy(now, carried)


@compiled
def _turn(of_turns, of_inputs, constant, inputs, iterations, turns, fixed, now):
    """Update the rotations from the surface, several times."""
    _fix(of_inputs, constant, inputs, fixed)
    for _ in range(iterations):
        _copy(fixed, now)
        add_product(of_turns, turns, now)
        nearest_rotations(now, turns)


@compiled
def _settle(of_turns, of_inputs, constant, inputs, turns, packed, out):
    """Write the (4m, 3) control variables for these rotations."""
    _fix(of_inputs, constant, inputs, packed)
    add_product(of_turns, turns, packed)
    for row in range(len(out)):
        place = place_of_row(row)
        for axis in range(3):
            out[row, axis] = packed[place + axis * ROWS]


def to_file_units(R: NDArray[np.floating], model: ReducedModel, out: Controls | None = None) -> Controls:
    """Convert control variables in model units to affine transforms of the mesh file's coordinates.

    Parameters
    ----------
    R : (..., 4m, 3)
    model : ReducedModel
    out : (..., m, 3, 4) float32, optional
        Written to, and returned.

    Returns
    -------
    (..., m, 3, 4) float32

    Raises
    ------
    ValueError
        The output array has another shape.
    """
    shape = (*R.shape[:-2], R.shape[-2] // 4, 3, 4)
    out = np.empty(shape, dtype=np.float32) if out is None else out
    if out.shape != shape:
        raise ValueError(f"found transforms {out.shape} for control variables {R.shape}; expected {shape}")
    stack = np.ascontiguousarray(R).reshape(-1, 4, 3)
    _transforms(stack, model.center, float(model.diagonal), out.reshape(-1, 3, 4))
    return out


@compiled
def _transforms(R, center, diagonal, out):
    """Write (k, 4, 3) control variables, for rows in model units, as (k, 3, 4) maps of columns in file units."""
    for k in range(len(R)):
        for row in range(3):
            offset = R[k, 3, row] * diagonal + center[row]
            for column in range(3):
                out[k, row, column] = R[k, column, row]
                offset -= R[k, column, row] * center[column]
            out[k, row, 3] = offset
