"""Synthetic motion that moves each handle and bone of a puppet through its range, one by one and then all together."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from capture import body
from engine_bridge.performance.performance import make_deformer
from engine_bridge.performance.retargeting import fit_sizes
from engine_bridge.performance.rig import Rig
from solver.model.bones import Bones
from solver.model.vectors import perpendicular
from solver.motion.limbs import TRUNK, Limb, parents_first
from solver.motion.motion_blend import moved_by
from solver.motion.retarget import soft_limit

SINGLE_FRAMES = 15
"""Number of frames for one handle along one axis and back, and for one bone about one axis and back."""

COMBINED_FRAMES = 900
"""Number of frames in which all handles and bones move together."""

WAVE_COUNT = 3
"""Number of sine waves in the combined motion of each coordinate of a handle, and of each axis of a bone."""

LIMB_TURN_RADIANS, TRUNK_TURN_RADIANS = 1.8, 0.7
"""Rotation of a bone relative to its parent, in a limb and in the trunk, in radians."""

TARGET_SHARE = 1.2
"""Largest displacement of handles before the limit of motion applies, as a share of their reach."""

SEED = 1
"""Seed of the random frequencies and phases."""


def exercise(rig: Rig, rest: NDArray[np.float64], chunk_size: int) -> Iterator[NDArray[np.float32]]:
    """Yield the controls of a deterministic motion of all bones, and of the handles that joints move.

    Parameters
    ----------
    rig : Rig
    rest : (20, 3) float64
        A performer's calibration pose, sensor coordinates, which sets the size of the motion if the puppet's scale is a
        number.
    chunk_size : int

    Yields
    ------
    (f, 4m, 3) float32
        Control variables of the next frames, at most `chunk_size`; model units.
    """
    deformer = make_deformer(rig.puppet, rig.mesh, rig.model)
    mapping, fit = rig.puppet.mapping, fit_sizes(rig.puppet, deformer, rig.mesh, rest)
    without_limit = np.abs(fit.scale * (mapping.matrix @ body.reach(rest)))[:, None, None]
    reach = np.where(np.isfinite(fit.reach), fit.reach, np.maximum(without_limit, 1e-9 * rig.mesh.diagonal))
    free = mapping.axes & (mapping.matrix != 0).any(axis=1, keepdims=True)
    axes = _axes(rig.puppet.limbs, deformer.bones)
    shares = _shares(np.concatenate([free, axes.any(axis=2)]))
    moved = TARGET_SHARE * (shares[:, : len(free)] @ rig.puppet.character.basis)
    moved *= np.where(moved < 0, reach[..., 0], reach[..., 1])
    targets = deformer.handles + mapping.gain[:, None] * soft_limit(moved, reach)
    turned = np.einsum("fba,bax->fbx", shares[:, len(free) :], axes)
    apart = np.concatenate([turned, np.zeros_like(turned)], axis=2)
    rest = np.tile(np.eye(4, 3), (len(deformer.bones), 1, 1))
    trunk = _names(rig.puppet.limbs).index(TRUNK) if TRUNK in _names(rig.puppet.limbs) else None
    for start in range(0, len(targets), chunk_size):
        solved = []
        for frame, turns in zip(targets[start : start + chunk_size], apart[start : start + chunk_size], strict=True):
            motions = moved_by(deformer.bones, rest, turns, 1.0)
            carried = frame if trunk is None else frame @ motions[trunk, :3] + motions[trunk, 3]
            solved.append(deformer.solve(carried, motions))
        yield np.array(solved, dtype=np.float32)


def _names(limbs: Sequence[Limb]) -> list[str]:
    """Return the names of the bones' limbs."""
    return [limb.name for limb in parents_first(limbs) for _ in limb.points[1:]]


def _axes(limbs: Sequence[Limb], bones: Bones) -> NDArray[np.float64]:
    """Return the rotation vectors (b, 3, 3) of each bone: two across it, and one along a bone of the trunk."""
    out = np.zeros((len(bones), 3, 3))
    for axes, name, along in zip(out, _names(limbs), (bones.tails - bones.heads) / bones.lengths[:, None], strict=True):
        axes[0] = perpendicular(tuple(along))
        axes[1] = np.cross(along, axes[0])
        axes[2] = along if name == TRUNK else 0.0
        axes *= TRUNK_TURN_RADIANS if name == TRUNK else LIMB_TURN_RADIANS
    return out


def _shares(free: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the displacements (F, k, 3), from −1 to 1, along the free axes (k, 3) in each frame."""
    there_and_back = np.sin(np.linspace(0, np.pi, SINGLE_FRAMES)) ** 2
    alone = np.zeros((np.count_nonzero(free), 2, SINGLE_FRAMES, *free.shape))
    for way, (handle, axis) in zip(alone, np.argwhere(free), strict=True):
        way[:, :, handle, axis] = np.array([[1.0], [-1.0]]) * there_and_back
    random, seconds = np.random.default_rng(SEED), np.arange(COMBINED_FRAMES) / 30
    hertz, phase = (
        random.uniform(0.2, 0.8, (WAVE_COUNT, *free.shape)),
        random.uniform(0, 2 * np.pi, (WAVE_COUNT, *free.shape)),
    )
    waves = np.sin(2 * np.pi * hertz * seconds[:, None, None, None] + phase).sum(axis=1) / np.sqrt(WAVE_COUNT)
    return np.concatenate([alone.reshape(-1, *free.shape), waves * free])
