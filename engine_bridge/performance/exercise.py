"""Synthetic motion that moves each handle and bone of a puppet through its range, one by one and then all together."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from capture import body
from capture.skeleton import JOINTS
from engine_bridge.performance.character_motion import make_deformer
from engine_bridge.performance.prepared_character import PreparedCharacter
from engine_bridge.performance.retargeting import fit_sizes
from solver.model.bones import Bones
from solver.model.vectors import perpendicular
from solver.motion.limbs import TRUNK, Limb, bone_ranges
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

RANDOM_SHARE = 0.7
"""Largest displacement in a random pose, as a share of that of the exercise."""

RANDOM_ITERATIONS = 12
"""Iterations per random pose, with which the pose before it does not matter."""

SEED = 1
"""Seed of the random frequencies and phases."""


def exercise(prepared: PreparedCharacter, rest: NDArray[np.float64], chunk_size: int) -> Iterator[NDArray[np.float32]]:
    """Yield the controls of a deterministic motion of all bones, and of the handles that joints move.

    Parameters
    ----------
    prepared : PreparedCharacter
    rest : (20, 3) float64
        A performer's calibration pose, sensor coordinates, which sets the size of the motion if the puppet's scale is a
        number.
    chunk_size : int

    Yields
    ------
    (f, 4m, 3) float32
        Control variables of the next frames, at most `chunk_size`; model units.
    """
    course = _Course(prepared, rest)
    shares = _shares(course.free)
    for start in range(0, len(shares), chunk_size):
        yield course.solve(shares[start : start + chunk_size])[0]


def random_poses(
    prepared: PreparedCharacter, count: int, seed: int = SEED, *, handles: bool = True
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Return poses in which all bones and handles have random displacements, each pose independent of the others.

    Parameters
    ----------
    prepared : PreparedCharacter
    count : int
    seed : int, optional
    handles : bool, optional
        Whether handles are moved; without them, only bones are.

    Returns
    -------
    R : (count, 4m, 3) float32
        Control variables, model units.
    motions : (count, b, 4, 3) float64
        Motions of the bones for row vectors, mesh file's coordinates.
    """
    course = _Course(prepared, np.full((len(JOINTS), 3), np.nan), RANDOM_ITERATIONS)
    shares = np.random.default_rng(seed).uniform(-RANDOM_SHARE, RANDOM_SHARE, (count, *course.free.shape))
    if not handles:
        shares[:, : len(prepared.puppet.handle)] = 0.0
    return course.solve(shares * course.free)


class _Course:
    """Displacements of a puppet's handles along their axes, and of its bones about theirs.

    Attributes
    ----------
    free : (k, 3) bool
        Axes along which handles, and then bones, can move.
    """

    def __init__(self, prepared: PreparedCharacter, rest: NDArray[np.float64], iterations: int | None = None) -> None:
        puppet = prepared.puppet
        deformer = make_deformer(prepared)
        self._deformer = deformer if iterations is None else deformer.another(iterations)
        self._basis, self._mapping = puppet.character.basis, puppet.mapping
        fit = fit_sizes(puppet, deformer, prepared.mesh, rest)
        without_limit = np.abs(fit.scale * (self._mapping.matrix @ body.reach(rest)))[:, None, None]
        self._reach = np.where(
            np.isfinite(fit.reach), fit.reach, np.maximum(without_limit, 1e-9 * prepared.mesh.diagonal)
        )
        self._axes = _axes(puppet.limbs, deformer.bones)
        handles = self._mapping.axes & (self._mapping.matrix != 0).any(axis=1, keepdims=True)
        self.free = np.concatenate([handles, self._axes.any(axis=2)])
        ranges = bone_ranges(puppet.limbs)
        self._trunk = ranges[TRUNK].start if TRUNK in ranges else None

    def solve(self, shares: NDArray[np.float64]) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Return the controls (F, 4m, 3) and the motions of the bones (F, b, 4, 3) for displacements (F, k, 3)."""
        bones, handles = self._deformer.bones, len(self._reach)
        moved = TARGET_SHARE * (shares[:, :handles] @ self._basis)
        moved *= np.where(moved < 0, self._reach[..., 0], self._reach[..., 1])
        targets = self._deformer.handles + self._mapping.gain[:, None] * soft_limit(moved, self._reach)
        turned = np.einsum("fba,bax->fbx", shares[:, handles:], self._axes)
        apart = np.concatenate([turned, np.zeros_like(turned)], axis=2)
        rest = np.tile(np.eye(4, 3), (len(bones), 1, 1))
        motions = np.empty((len(shares), len(bones), 4, 3))
        solved = np.empty((len(shares), *self._deformer.model.rest_controls.shape), dtype=np.float32)
        for frame, aims in enumerate(targets):
            motions[frame] = moved_by(bones, rest, apart[frame], 1.0)
            if self._trunk is not None:
                aims = aims @ motions[frame, self._trunk, :3] + motions[frame, self._trunk, 3]
            solved[frame] = self._deformer.solve(aims, motions[frame])
        return solved, motions


def _axes(limbs: Sequence[Limb], bones: Bones) -> NDArray[np.float64]:
    """Return the rotation vectors (b, 3, 3) of each bone: two across it, and one along a bone of the trunk."""
    out, trunk = np.zeros((len(bones), 3, 3)), bone_ranges(limbs).get(TRUNK, ())
    for bone, (axes, along) in enumerate(zip(out, (bones.tails - bones.heads) / bones.lengths[:, None], strict=True)):
        axes[0] = perpendicular(tuple(along))
        axes[1] = np.cross(along, axes[0])
        axes[2] = along if bone in trunk else 0.0
        axes *= TRUNK_TURN_RADIANS if bone in trunk else LIMB_TURN_RADIANS
    return out


def _shares(free: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the displacements (F, k, 3), from −1 to 1, along the free axes (k, 3) in each frame."""
    there_and_back = np.sin(np.linspace(0, np.pi, SINGLE_FRAMES)) ** 2
    alone = np.zeros((np.count_nonzero(free), 2, SINGLE_FRAMES, *free.shape))
    for way, (handle, axis) in zip(alone, np.argwhere(free), strict=True):
        way[:, :, handle, axis] = np.array([[1.0], [-1.0]]) * there_and_back
    random, seconds = np.random.default_rng(SEED), np.arange(COMBINED_FRAMES) / 30
    hertz = random.uniform(0.2, 0.8, (WAVE_COUNT, *free.shape))
    phase = random.uniform(0, 2 * np.pi, (WAVE_COUNT, *free.shape))
    waves = np.sin(2 * np.pi * hertz * seconds[:, None, None, None] + phase).sum(axis=1) / np.sqrt(WAVE_COUNT)
    return np.concatenate([alone.reshape(-1, *free.shape), waves * free])
