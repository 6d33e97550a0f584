"""From a performer's frames to a character's controls: one pipeline for live and recorded skeletons.

A frame is smoothed (`capture.smoothing`), mirrored if the puppet says so, turned into character axes, freed of the
root's own motion, retargeted to handles and solved for.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from capture import body
from capture.skeleton import JOINT_INDEX, LOST, OPPOSITE, SkeletonFrame, mirrored, to_character_axes
from capture.smoothing import JointFilter
from engine_bridge.puppet import HandleTable, Puppet, axis_mask
from puppetline.errors import PuppetError, at
from solver.deformer import Deformer
from solver.mesh import SolverMesh, snap
from solver.reach import limb_reach
from solver.reduced_model import ReducedModel
from solver.retarget import Fit, Retargeter, SmoothReturn

OFF_THE_MESH = 0.1
"""A handle farther than this from the surface, as a fraction of the diagonal, is taken for a mistake."""


@dataclass(frozen=True)
class Pose:
    """One frame of a character.

    Attributes
    ----------
    R : (4m, 3) float64
        Control variables, model units.
    root : (3,) float64
        Translation of the whole character, mesh file's coordinates; zero where the puppet has no root.
    """

    R: NDArray[np.float64]
    root: NDArray[np.float64]


class Performance:
    """A puppet on stage with one performer.

    Parameters
    ----------
    puppet : Puppet
    mesh : SolverMesh
        Of the puppet's character.
    model : ReducedModel
        Of that mesh.
    rest : (20, 3) float64
        The performer's joints in the pose that stands for the character's rest pose; sensor frame, NaN where unknown.
    """

    def __init__(self, puppet: Puppet, mesh: SolverMesh, model: ReducedModel, rest: NDArray[np.float64]) -> None:
        self._puppet = puppet
        self._basis = puppet.character.basis
        self.deformer = Deformer(
            model,
            mesh,
            puppet.handle_positions,
            iterations=puppet.solver.iterations,
            mode=puppet.solver.rotations,
        )
        self._filter = JointFilter(puppet.smoothing.parameters)
        self._rest = self._to_character(rest)
        self.fit = fit_sizes(puppet, self.deformer, mesh, rest)
        self.root_scale = _root_scale(puppet, mesh, rest)
        self._retargeter = Retargeter(self.deformer.handles, puppet.mapping, self.fit, self._rest, self._basis)
        self._root = JOINT_INDEX[puppet.root.joint] if puppet.root else 0
        self._root_return = SmoothReturn(1)
        self._with_root = np.full_like(self._rest, np.nan)  # all joints when the root was last known

    def step(self, frame: SkeletonFrame, out: NDArray[np.float64] | None = None) -> Pose:
        """Take the next frame.

        Parameters
        ----------
        frame : SkeletonFrame
            Later than the one before.
        out : (4m, 3) float64, optional
            Where the pose's R is written.
        """
        positions = self._to_character(self._filter.step(frame.time, frame.positions, frame.confidence))
        confidence = frame.confidence[OPPOSITE] if self._puppet.retarget.mirror else frame.confidence
        moved = np.zeros(3)
        if self._puppet.root is not None:
            displacement = self._root_displacement(positions - self._rest, confidence > LOST)
            moved = self._root_return.step(frame.time, displacement[None], np.ones(1, dtype=bool))[0]
            moved = moved * axis_mask(self._puppet.root.axes)
        R = self.deformer.solve(self._retargeter.step(frame.time, positions - moved, confidence), out)
        return Pose(R, self.root_scale * moved @ self._basis)

    def _root_displacement(self, displacement: NDArray[np.float64], known: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return where the root has moved to (3,); while its joint is lost it goes on with the median of the others.

        NaN where nothing is known.
        """
        known = known & np.isfinite(displacement).all(axis=1)
        if known[self._root]:
            self._with_root = np.where(known[:, None], displacement, np.nan)
            return displacement[self._root]
        since = (displacement - self._with_root)[known]
        since = since[np.isfinite(since).all(axis=1)]
        return self._with_root[self._root] + (np.median(since, axis=0) if len(since) else np.nan)

    def _to_character(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        return to_character_axes(mirrored(positions) if self._puppet.retarget.mirror else positions)


def check_handles(handles: Sequence[HandleTable], mesh: SolverMesh, where: str | Path) -> None:
    """Refuse handles that are too far from the surface to have been meant.

    Raises
    ------
    PuppetError
    """
    allowed = OFF_THE_MESH * mesh.diagonal
    for number, handle in enumerate(handles, 1):
        away = mesh.vertices - handle.position
        if np.einsum("vx,vx->v", away, away).min() <= allowed**2:
            continue  # the surface is no farther away than its nearest vertex
        corners, blend = snap(mesh, np.array(handle.position))
        nearest = blend[0] @ mesh.vertices[corners[0]]
        distance = np.linalg.norm(nearest - handle.position)
        if distance > allowed:
            low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
            raise PuppetError(
                at(where, field=f"[[handle]] {number} {handle.name!r}, position"),
                found=f"{_numbers(np.array(handle.position))}, which is {distance:.4g} away from the surface",
                expected=f"a point on the mesh, which spans {_numbers(low)} to {_numbers(high)}",
                fix=f"The nearest surface point is {_numbers(nearest)}.",
            )


def _numbers(point: NDArray[np.float64]) -> str:
    return "[" + ", ".join(f"{value:.4g}" for value in point) + "]"


def fit_sizes(puppet: Puppet, deformer: Deformer, mesh: SolverMesh, rest: NDArray[np.float64]) -> Fit:
    """Set the performer's size against the character's (the paper's Eq. 5, for want of a window).

    With ``scale = "auto"`` a limb of the performer that is stretched out fully takes its handles to the end of their
    reach, found by trying the deformation; a number is used as it stands, without limits.

    Parameters
    ----------
    puppet : Puppet
    deformer : Deformer
        Of the puppet's character and handles.
    mesh : SolverMesh
        The character.
    rest : (20, 3) float64
        The performer, sensor frame.
    """
    mapping = puppet.mapping
    if puppet.units_a_metre is not None:
        count = len(puppet.handle)
        return Fit(np.full(count, puppet.units_a_metre), np.full((count, 3, 2), np.inf))
    arm = mapping.matrix @ body.reach(mirrored(rest) if puppet.retarget.mirror else rest)
    limbs, of_handle = _limbs(puppet, arm)
    reach = limb_reach(deformer, mesh, limbs)[of_handle]
    # the directions of the mesh in which the handle's joints may move it at all
    used = mapping.axes @ np.abs(puppet.character.basis)
    typical = np.einsum("has,ha->h", reach, used) / np.maximum(2 * used.sum(axis=1), 1)
    share = np.abs(limbs[of_handle, np.arange(len(arm))])
    longest = np.where(share > 0, arm / np.maximum(share, 1e-9), 1.0)
    return Fit(typical / longest, np.maximum(share, 1e-9)[:, None, None] * reach)


def _limbs(puppet: Puppet, arm: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Sort handles by the limb of the performer that moves them.

    A handle moved by several limbs, or by none, is one by itself. Where the trunk goes, the arms go too.

    Returns
    -------
    limbs : (l, h) float64
        Each handle's share of a limb's motion, as `limb_reach` wants it.
    of_handle : (h,) int64
        The limb of each handle.
    """
    names = []
    for number, handle in enumerate(puppet.handle):
        moved_by = {limb for limb, joints in body.LIMBS.items() if not set(handle.driven_by).isdisjoint(joints)}
        names.append(moved_by.pop() if len(moved_by) == 1 else f"handle {number}")
    distinct = list(dict.fromkeys(names))
    of_handle = np.array([distinct.index(name) for name in names])
    limbs = (of_handle == np.arange(len(distinct))[:, None]) * arm
    limbs /= np.maximum(limbs.max(axis=1, keepdims=True), 1e-9)
    if "trunk" in distinct:
        limbs[distinct.index("trunk")] += [name.endswith("arm") for name in names]
    return limbs * np.sign(puppet.mapping.gain), of_handle


def _root_scale(puppet: Puppet, mesh: SolverMesh, rest: NDArray[np.float64]) -> float:
    """Return mesh units a metre of the root: the character's height to the performer's, or the number given."""
    if puppet.units_a_metre is not None:
        return puppet.units_a_metre
    up = puppet.character.basis[1]
    return float(np.ptp(mesh.vertices @ up) / body.height(rest))
