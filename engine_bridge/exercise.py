"""Motion made up for a puppet, which takes every handle everywhere it can go: alone, and all at once."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from capture import body
from engine_bridge.performance import make_deformer
from engine_bridge.retargeting import fit_sizes
from engine_bridge.rig import Rig
from solver.retarget import soft_limit

ALONE = 15
"""Frames of a handle's way along one axis and back."""

TOGETHER = 900
"""Frames in which all handles move at once."""

WAVES = 3
"""Sine waves that are added up for each coordinate of a handle then."""

FAR = 1.2
"""How far handles are drawn, as a share of their reach; the limit that holds for performers brings them back within."""

SEED = 1


def exercise(rig: Rig, rest: NDArray[np.float64], at_a_time: int) -> Iterator[NDArray[np.float32]]:
    """Move the handles that joints move, always in the same way.

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
    moved = FAR * (_shares(free) @ rig.puppet.character.basis)
    moved *= np.where(moved < 0, reach[..., 0], reach[..., 1])
    targets = deformer.handles + mapping.gain[:, None] * soft_limit(moved, reach)
    for start in range(0, len(targets), at_a_time):
        solved = [deformer.solve(frame) for frame in targets[start : start + at_a_time]]
        yield np.array(solved, dtype=np.float32)


def _shares(free: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return how far handles go in each frame (F, h, 3), from −1 to 1 along the axes in which they are free (h, 3)."""
    there_and_back = np.sin(np.linspace(0, np.pi, ALONE)) ** 2
    alone = np.zeros((np.count_nonzero(free), 2, ALONE, *free.shape))
    for way, (handle, axis) in zip(alone, np.argwhere(free), strict=True):
        way[:, :, handle, axis] = np.array([[1.0], [-1.0]]) * there_and_back
    random, seconds = np.random.default_rng(SEED), np.arange(TOGETHER) / 30
    hertz, phase = random.uniform(0.2, 0.8, (WAVES, *free.shape)), random.uniform(0, 2 * np.pi, (WAVES, *free.shape))
    waves = np.sin(2 * np.pi * hertz * seconds[:, None, None, None] + phase).sum(axis=1) / np.sqrt(WAVES)
    return np.concatenate([alone.reshape(-1, *free.shape), waves * free])
