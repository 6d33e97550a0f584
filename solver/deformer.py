"""A reduced model bound to handles: handle targets in, 80 affine transforms out (Section 3.4, Eq. 8-9)."""

from copy import copy
from typing import NamedTuple

import numba
import numpy as np
import scipy
from numpy.typing import NDArray

from puppetline.errors import MeshError
from solver import lanes, roll, rotations
from solver.lanes import ROWS, add_product, place_of_row
from solver.mesh import SolverMesh
from solver.polar import nearest_rotations
from solver.reduced_model import ReducedModel
from solver.rotations import RotationMode

HANDLE_STIFFNESS = 1.0
"""λ in units of trace(A) / trace((ΦW)ᵀ(ΦW)): at 1 the Armadillo's handles are met to 3e-5 of its diagonal."""

ON_A_LINE = 0.02
"""Handles that leave a line by less than this share of the diagonal do not hold the character against rolling."""

Controls = NDArray[np.float32]
"""(n_e · n_iso, 3, 4) float32: an affine transform [linear | translation] for each isoline, acting on rest positions in
the mesh file's coordinates. Field i's isolines are rows i · n_iso … (i + 1) · n_iso − 1."""


class _Affine(NamedTuple):
    """Something that depends on the isolines' turns and the handles' targets, in the layout of `lanes`."""

    turns: NDArray[np.float64]
    handles: NDArray[np.float64]
    constant: NDArray[np.float64]


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
            factor = scipy.linalg.cho_factor(model.A + stiffness * rows.T @ rows + pin * model.null_space)
        except np.linalg.LinAlgError as error:
            raise MeshError(
                mesh.name,
                found=f"a surface whose deformation has no single answer ({error})",
                expected="one whose triangles are not all needles or crossed",
                fix="Remesh it, or ask for fewer fields in the puppet file's [solver] table.",
            ) from error
        from_turns = scipy.linalg.cho_solve(factor, model.B)
        from_handles = scipy.linalg.cho_solve(factor, stiffness * rows.T)
        constant = scipy.linalg.cho_solve(factor, pin * model.null_space @ rest)
        self._mode: RotationMode = mode
        reader = model.covariance if mode == "covariance" else model.edges
        self._place_of_turns = lanes.of_matrices(model.B.shape[1] // 3)
        self._place_of_seen = self._place_of_turns if mode == "covariance" else lanes.of_rows(len(reader))

        def laid_out(reader: NDArray[np.float64], row: NDArray[np.int64]) -> _Affine:
            return _Affine(
                lanes.matrix(reader @ from_turns, row, self._place_of_turns),
                lanes.matrix(reader @ from_handles, row, lanes.of_rows(len(rows))),
                lanes.pack(reader @ constant, row),
            )

        self._surface = laid_out(reader, self._place_of_seen)
        self._controls = laid_out(np.eye(len(rest)), lanes.of_rows(len(rest)))
        self._wanted = lanes.pack(self.handles, lanes.of_rows(len(rows)))
        self._rest_frames = rotations.triangle_frames(model.edges @ rest)
        spread = np.linalg.svd(self.handles - self.handles.mean(axis=0), compute_uv=False)
        self._on_a_line = len(handles) < 3 or spread[1] < ON_A_LINE * float(model.diagonal)
        self._turns = lanes.pack(np.zeros((len(self._place_of_turns), 3)), self._place_of_turns)
        self._started = False
        self._fixed, self._now = np.empty_like(self._surface.constant), np.empty_like(self._surface.constant)
        self._result = np.empty_like(self._controls.constant)

    @property
    def turns(self) -> NDArray[np.float64]:
        """(3m, 3) float64: the isolines' rotations in the last frame, for row vectors."""
        return lanes.unpack(self._turns, self._place_of_turns)

    @property
    def memory(self) -> dict[str, NDArray[np.float64]]:
        """What is carried from frame to frame; setting it goes on where another of the same handles was."""
        return {"turns": self._turns.copy(), "started": np.array(float(self._started))}

    @memory.setter
    def memory(self, memory: dict[str, NDArray[np.float64]]) -> None:
        self._turns[:] = memory["turns"]
        self._started = bool(memory["started"])

    def another(self, iterations: int) -> "Deformer":
        """Return one of the same character and handles, with a state of its own."""
        other = copy(self)
        other.iterations = iterations
        other._started = False
        for buffer in ("_wanted", "_turns", "_fixed", "_now", "_result"):
            setattr(other, buffer, getattr(self, buffer).copy())
        return other

    def reset(self) -> None:
        """Forget the last frame: the next one starts from the rigid motion that fits the handles best."""
        self._started = False

    def solve(self, targets: NDArray[np.float64], out: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
        """Return the control variables R that bring the handles to their targets.

        Parameters
        ----------
        targets : (h, 3) float64
            In the mesh file's coordinates.
        out : (4m, 3) float64, optional
            Written to, and returned.

        Returns
        -------
        (4m, 3) float64
            Model units.

        Raises
        ------
        ValueError
            Arrays of other shapes, or targets that are not finite.
        """
        out = np.empty_like(self.model.rest_controls) if out is None else out
        targets = np.ascontiguousarray(targets, dtype=np.float64)
        if targets.shape != self.handles.shape or out.shape != (4 * len(self._place_of_turns) // 3, 3):
            raise ValueError(f"{targets.shape} targets into {out.shape}: there are {self.handles.shape} handles")
        if not _pack_targets(targets, self.model.center, float(self.model.diagonal), self._wanted):
            raise ValueError("a handle's target is not a finite number")
        if not self._started:
            self._started = True
            start = roll.rigid_fit(self.handles, targets)
            self._turns[:] = lanes.pack(np.tile(start, (len(self._place_of_turns) // 3, 1)), self._place_of_turns)
        if self._mode == "covariance":
            _turn_isolines(*self._surface, self._wanted, self.iterations, self._turns, self._fixed, self._now)
        else:
            self._compare_triangles()
        if self._on_a_line:
            start = roll.rigid_fit(self.handles, targets)
            roll.take_back(self._turns, len(self._place_of_turns) // 3, start, _line_through(targets))
        _settle(*self._controls, self._wanted, self._turns, self._result, out)
        return out

    def _compare_triangles(self) -> None:
        """Update the turns as the paper does, from sampled triangles."""
        _fix(self._surface.handles, self._surface.constant, self._wanted, self._fixed)
        for _ in range(self.iterations):
            self._now[:] = self._fixed
            add_product(self._surface.turns, self._turns, self._now)
            found = rotations.from_edges(lanes.unpack(self._now, self._place_of_seen), self._rest_frames)
            self._turns[:] = lanes.pack(found.reshape(-1, 3), self._place_of_turns)

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


def _line_through(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the direction (3,) in which points spread most; zero where all are at one place."""
    _, spread, directions = np.linalg.svd(points - points.mean(axis=0))
    return directions[0] if spread[0] > 1e-12 * np.abs(points).max() else np.zeros(3)


@numba.njit(cache=True, nogil=True)
def _pack_targets(targets, center, diagonal, wanted):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Lay (h, 3) targets out in blocks, in model units; say whether all are finite."""
    finite = True
    for h in range(len(targets)):
        place = place_of_row(h)
        for axis in range(3):
            wanted[place + axis * ROWS] = (targets[h, axis] - center[axis]) / diagonal
            finite = finite and np.isfinite(targets[h, axis])
    return finite


@numba.njit(cache=True, nogil=True)
def _fix(of_handles, constant, wanted, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Write what does not depend on the turns."""
    out[:] = constant
    add_product(of_handles, wanted, out)


@numba.njit(cache=True, nogil=True)
def _turn_isolines(of_turns, of_handles, constant, wanted, iterations, turns, fixed, now):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Look at the surface and turn the isolines with it, again and again."""
    _fix(of_handles, constant, wanted, fixed)
    for _ in range(iterations):
        now[:] = fixed
        add_product(of_turns, turns, now)
        nearest_rotations(now, turns)


@numba.njit(cache=True, nogil=True)
def _settle(of_turns, of_handles, constant, wanted, turns, packed, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Write the (4m, 3) control variables for these turns."""
    _fix(of_handles, constant, wanted, packed)
    add_product(of_turns, turns, packed)
    for row in range(len(out)):
        place = place_of_row(row)
        for axis in range(3):
            out[row, axis] = packed[place + axis * ROWS]


def to_file_units(R: NDArray[np.floating], model: ReducedModel, out: Controls | None = None) -> Controls:
    """Turn control variables in model units into affine transforms of the mesh file's coordinates.

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
        An array of another shape to write to.
    """
    shape = (*R.shape[:-2], R.shape[-2] // 4, 3, 4)
    out = np.empty(shape, dtype=np.float32) if out is None else out
    if out.shape != shape:
        raise ValueError(f"control variables {R.shape} into transforms {out.shape}, expected {shape}")
    stack = np.ascontiguousarray(R).reshape(-1, 4, 3)
    _transforms(stack, model.center, float(model.diagonal), out.reshape(-1, 3, 4))
    return out


@numba.njit(cache=True, nogil=True)
def _transforms(R, center, diagonal, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Write (k, 4, 3) control variables, which act on rows of model units, as (k, 3, 4) maps of the file's columns."""
    for k in range(len(R)):
        for row in range(3):
            offset = R[k, 3, row] * diagonal + center[row]
            for column in range(3):
                out[k, row, column] = R[k, column, row]
                offset -= R[k, column, row] * center[column]
            out[k, row, 3] = offset
