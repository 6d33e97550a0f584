"""Maps a performer's joints to the motions of a character's bones.

A limb is a chain of bones that follows a chain of the performer's joints. Its bones have the directions of the
performer's (`follow = "direction"`), or turn from their rest as the performer's have turned from theirs (`"turn"`). The
bones keep their lengths.

Few sensors measure the roll of a limb. A bone moves with its parent, and turns by the least rotation to its direction.
Its roll is then eased to the best known reference: for the trunk the two sides of the body; the orientation of the
performer's bone if a recording has it; the plane of the elbow or knee of a bent arm or leg; otherwise the roll of the
least rotation from rest. The weight of each reference vanishes where it is undefined, so that no roll flips.
"""

import math
from collections.abc import Sequence
from copy import copy
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled
from solver.model.vectors import blend, in_axes, row_of, scaled, unit, write_row
from solver.motion import quaternions as quat
from solver.motion.limb_directions import HEADING, TIME, observed
from solver.motion.limb_plan import plan_of
from solver.motion.limb_turns import turn_bone
from solver.motion.limbs import Limb, Performer, bones_of, parents_first


class _State(NamedTuple):
    """The state between frames."""

    local: NDArray[np.float64]  # (b + 1, 4): each bone's rotation from rest relative to its base
    gap: NDArray[np.float64]  # (b + 1, 3): remaining rotation from where a lost bone was held
    roll_gap: NDArray[np.float64]  # (b + 1,): remaining roll
    known: NDArray[np.float64]  # (b + 1,): 1 for bones known in the last frame
    roll_known: NDArray[np.float64]  # (b + 1,)
    vector: NDArray[np.float64]  # (b + 1, 3): `local` as axis times angle, for the gain
    mount: NDArray[np.float64]  # (b + 1, 4): from the axes of the performer's bone to the bone's rest; NaN before
    side: NDArray[np.float64]  # (3,): the mean direction from the body's right to its left
    clock: NDArray[np.float64]  # (5,): time; time of `side`; 1 while exchanged; since when; heading


class LimbMotion:
    """Maps a performer's joints to the motions of a character's bones.

    Parameters
    ----------
    limbs : sequence of Limb
    performer : Performer
    rest : (j, 3) float64
        The performer in the calibration pose, which maps to the character's rest pose; metres, character axes (left +x,
        up +y, forward +z), NaN for unknown joints. It affects limbs that follow by "turn", and the pitch of feet:
        sensors place the joint of a foot at other heights than meshes, so feet are level if the performer's are.
    basis : (3, 3) float64
        Rows: the mesh file's directions of the character's left, up and forward.
    turns : bool
        Whether the character turns with the performer. A character without a trunk does not.
    """

    def __init__(
        self,
        limbs: Sequence[Limb],
        performer: Performer,
        rest: NDArray[np.float64],
        basis: NDArray[np.float64] | None = None,
        *,
        turns: bool = True,
    ) -> None:
        self.limbs = parents_first(limbs)
        self.bones = bones_of(limbs)
        basis = np.eye(3) if basis is None else np.ascontiguousarray(basis, dtype=np.float64)
        self._plan = plan_of(self.limbs, self.bones, performer, rest, basis, turns)
        self._unknown = np.full((len(performer.opposite), 4), np.nan)
        self._state = _first_state(np.full((len(self._plan.roll), 4), np.nan))

    def restarted(self) -> "LimbMotion":
        """Return one that has had no frame yet, but knows the axes of the performer's bones."""
        other = copy(self)
        other._state = _first_state(self._state.mount.copy())
        return other

    def step(
        self,
        time: float,
        positions: NDArray[np.float64],
        confidence: NDArray[np.float32],
        out: NDArray[np.float64] | None = None,
        *,
        orientations: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]:
        """Return the motions of the bones in one frame.

        A bone whose joints are lost keeps its direction relative to its parent; when they are tracked again, it eases
        to its new direction. The first frame is not eased.

        Parameters
        ----------
        time : float
            Seconds, increasing from call to call.
        positions : (j, 3) float64
            Metres, character axes. A joint without a valid position (`is_position`) is lost.
        confidence : (j,) float32
            0 for a lost joint.
        out : (b, 4, 3) float64, optional
            Written to, and returned.
        orientations : (j, 4) float64, optional
            Unit quaternions (w, x, y, z) of the bones that begin at the joints, from their own axes to character axes;
            NaN if unknown. A bone's roll follows their rotation since they were first known.

        Returns
        -------
        (b, 4, 3) float64
            Motions for row vectors, x' = [x 1] T, mesh file's coordinates, without the root's translation.
        """
        out = np.empty((len(self.bones.parents), 4, 3)) if out is None else out
        turns = self._unknown if orientations is None else np.ascontiguousarray(orientations)
        _step(self._plan, self._state, float(time), np.ascontiguousarray(positions), confidence, turns, out)
        return out

    @property
    def heading(self) -> float:
        """Angle about the upright axis, in radians, by which the performer is turned and the character is not."""
        return 0.0 if self._plan.turns else float(self._state.clock[HEADING])

    @property
    def trunk(self) -> int | None:
        """The first bone of the trunk, if there is one."""
        return int(self._plan.trunk_rows[0]) - 1 if len(self._plan.trunk_rows) else None


def _first_state(mount: NDArray[np.float64]) -> _State:
    """Return the state before the first frame, with the axes (rows, 4) of the performer's bones; NaN if unknown."""
    rows = len(mount)
    return _State(
        local=np.tile([1.0, 0.0, 0.0, 0.0], (rows, 1)),
        gap=np.zeros((rows, 3)),
        roll_gap=np.zeros(rows),
        known=np.zeros(rows),
        roll_known=np.zeros(rows),
        vector=np.zeros((rows, 3)),
        mount=mount,
        side=np.zeros(3),
        clock=np.array([-np.inf, -np.inf, 0.0, 0.0, 0.0]),
    )


@compiled(waits=False)
def _step(plan, state, time, positions, confidence, orientations, out):
    """Update the state, and write the motions of the bones in a frame."""
    began = math.isfinite(state.clock[TIME])
    elapsed = max(0.0, time - state.clock[TIME]) if began else math.inf  # 0 if the clock is set back
    state.clock[TIME] = time
    directions, weight, across, turned = observed(plan, state, time, positions, confidence, orientations)
    aims, world = plan.aims.copy(), np.empty((len(plan.roll), 4))
    for row in plan.trunk_rows:
        write_row(aims, row, unit(blend(row_of(plan.chords, row), row_of(plan.aims, row), weight)))
    for row in range(len(world)):
        base = (1.0, 0.0, 0.0, 0.0)
        if plan.base[row] >= 0:
            base = quat.row_of(world, plan.base[row])
        local = turn_bone(plan, state, row, quat.inverse(base), aims, directions, across, turned, elapsed, began)
        quat.write_row(world, row, quat.product(base, local))
    _mount(state, turned, world)
    _write_motions(plan, state, out)


@compiled(inner=True)
def _mount(state, turned, world):
    """Store the bones' rotations in the axes of the performer's bones when these are first known."""
    for row in range(len(world)):
        if math.isfinite(turned[row, 0]) and state.known[row] > 0 and not math.isfinite(state.mount[row, 0]):
            mount = quat.product(quat.inverse(quat.row_of(turned, row)), quat.row_of(world, row))
            quat.write_row(state.mount, row, mount)


@compiled(inner=True)
def _write_motions(plan, state, out):
    """Write the motions of the bones, from the root to the tips."""
    rows = len(plan.roll)
    shown = np.empty((rows, 4))
    quat.write_row(shown, 0, (1.0, 0.0, 0.0, 0.0))
    for row in range(1, rows):
        local = quat.row_of(state.local, row)
        if plan.gain[row] != 1:
            vector = quat.near_vector(local, row_of(state.vector, row))
            write_row(state.vector, row, vector)
            local = quat.from_vector(scaled(vector, plan.gain[row]))
        base = plan.shown_base[row]
        turn = quat.product(quat.row_of(shown, base), local) if base >= 0 else local
        quat.write_row(shown, row, turn)
        bone = row - 1
        turn = _in_file_axes(turn, plan.basis)
        _write_motion(turn, plan.heads, plan.parents[bone], bone, out)


@compiled(inner=True)
def _in_file_axes(q, basis):
    """Convert a rotation from character axes to those of the mesh file."""
    x, y, z = in_axes((q[1], q[2], q[3]), basis)
    return (q[0], x, y, z)


@compiled(inner=True)
def _write_motion(turn, heads, parent, bone, out):
    """Write the motion that turns a bone about its head, which moves with the bone's parent."""
    quat.write_rows(turn, out[bone])
    for axis in range(3):
        place, kept = heads[bone, axis], 0.0
        if parent >= 0:
            place = out[parent, 3, axis]
        for i in range(3):
            if parent >= 0:
                place += heads[bone, i] * out[parent, i, axis]
            kept += heads[bone, i] * out[bone, i, axis]
        out[bone, 3, axis] = place - kept
