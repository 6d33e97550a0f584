"""Motion made up for a puppet, which takes every handle and bone everywhere it can go: alone, and all at once."""

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

ALONE = 15
"""Frames of a handle's way along one axis and back, and of a bone's turn about one."""

TOGETHER = 900
"""Frames in which all handles and bones move at once."""

WAVES = 3
"""Sine waves that are added up for each coordinate of a handle then, and for each axis of a bone."""

TURN, TRUNK_TURN = 1.8, 0.7
"""Radians by which a bone of a limb, and one of the trunk, is turned against the bone that it hangs on."""

FAR = 1.2
"""How far handles are drawn, as a share of their reach; the limit that holds for performers brings them back within."""

SEED = 1


def exercise(rig: Rig, rest: NDArray[np.float64], at_a_time: int) -> Iterator[NDArray[np.float32]]:
    """Turn the bones, and move the handles that joints move, always in the same way.

    Parameters
    ----------
    rig : Rig
    rest : (20, 3) float64
        A performer at rest, sensor frame: sets the size of the motion where the puppet's scale is a number.
    at_a_time : int

    Yields
    ------
    (f, 4m, 3) float32
        Control variables of the next frames, at most `at_a_time`; model units.
    """
    deformer = make_deformer(rig.puppet, rig.mesh, rig.model)
    mapping, fit = rig.puppet.mapping, fit_sizes(rig.puppet, deformer, rig.mesh, rest)
    without_limit = np.abs(fit.scale * (mapping.matrix @ body.reach(rest)))[:, None, None]
    reach = np.where(np.isfinite(fit.reach), fit.reach, np.maximum(without_limit, 1e-9 * rig.mesh.diagonal))
    free = mapping.axes & (mapping.matrix != 0).any(axis=1, keepdims=True)
    axes = _axes(rig.puppet.limbs, deformer.bones)
    shares = _shares(np.concatenate([free, axes.any(axis=2)]))
    moved = FAR * (shares[:, : len(free)] @ rig.puppet.character.basis)
    moved *= np.where(moved < 0, reach[..., 0], reach[..., 1])
    targets = deformer.handles + mapping.gain[:, None] * soft_limit(moved, reach)
    turned = np.einsum("fba,bax->fbx", shares[:, len(free) :], axes)
    apart = np.concatenate([turned, np.zeros_like(turned)], axis=2)
    rest = np.tile(np.eye(4, 3), (len(deformer.bones), 1, 1))
    trunk = _names(rig.puppet.limbs).index(TRUNK) if TRUNK in _names(rig.puppet.limbs) else None
    for start in range(0, len(targets), at_a_time):
        solved = []
        for frame, turns in zip(targets[start : start + at_a_time], apart[start : start + at_a_time], strict=True):
            motions = moved_by(deformer.bones, rest, turns, 1.0)
            carried = frame if trunk is None else frame @ motions[trunk, :3] + motions[trunk, 3]
            solved.append(deformer.solve(carried, motions))
        yield np.array(solved, dtype=np.float32)


def _names(limbs: Sequence[Limb]) -> list[str]:
    """Return the name of each bone's limb."""
    return [limb.name for limb in parents_first(limbs) for _ in limb.points[1:]]


def _axes(limbs: Sequence[Limb], bones: Bones) -> NDArray[np.float64]:
    """Return the axes about which each bone is turned, times how far (b, 3, 3): two across it, and a trunk's own."""
    out = np.zeros((len(bones), 3, 3))
    for axes, name, along in zip(out, _names(limbs), (bones.tails - bones.heads) / bones.lengths[:, None], strict=True):
        axes[0] = perpendicular(tuple(along))
        axes[1] = np.cross(along, axes[0])
        axes[2] = along if name == TRUNK else 0.0
        axes *= TRUNK_TURN if name == TRUNK else TURN
    return out


def _shares(free: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return how far things go in each frame (F, k, 3), from −1 to 1 along the axes in which they are free (k, 3)."""
    there_and_back = np.sin(np.linspace(0, np.pi, ALONE)) ** 2
    alone = np.zeros((np.count_nonzero(free), 2, ALONE, *free.shape))
    for way, (handle, axis) in zip(alone, np.argwhere(free), strict=True):
        way[:, :, handle, axis] = np.array([[1.0], [-1.0]]) * there_and_back
    random, seconds = np.random.default_rng(SEED), np.arange(TOGETHER) / 30
    hertz, phase = random.uniform(0.2, 0.8, (WAVES, *free.shape)), random.uniform(0, 2 * np.pi, (WAVES, *free.shape))
    waves = np.sin(2 * np.pi * hertz * seconds[:, None, None, None] + phase).sum(axis=1) / np.sqrt(WAVES)
    return np.concatenate([alone.reshape(-1, *free.shape), waves * free])
