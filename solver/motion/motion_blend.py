"""Interpolation between motions of bones: each bone takes the shortest rotation relative to its parent."""

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled
from solver.model.bones import Bones
from solver.model.vectors import scaled
from solver.motion import quaternions as quat
from solver.motion.two_bones import moved


def difference(bones: Bones, start: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the difference between the motions `start` and `end`.

    Parameters
    ----------
    bones : Bones
    start, end : (b, 4, 3) float64
        Motions for row vectors, rotations and translations.

    Returns
    -------
    (b, 6) float64
        For each bone, the rotation relative to its parent as axis times angle, and the translation of its head.
    """
    out = np.empty((len(bones.parents), 6))
    _difference(bones.parents, bones.heads, start, end, out)
    return out


def moved_by(
    bones: Bones, motions: NDArray[np.float64], apart: NDArray[np.float64], share: float
) -> NDArray[np.float64]:
    """Return motions plus a share of a difference.

    With share 0 the result is `motions`; with share 1 and `difference(bones, motions, end)` it is `end`.

    Parameters
    ----------
    bones : Bones
    motions : (b, 4, 3) float64
    apart : (b, 6) float64
        From `difference`.
    share : float

    Returns
    -------
    (b, 4, 3) float64
    """
    out = np.empty_like(motions)
    _move(bones.parents, bones.heads, motions, apart, float(share), out)
    return out


@compiled(inner=True)
def _place(motions, bone, point):
    """Return the image of a point under a bone's motion; the point itself for bone −1."""
    return moved(motions[bone], point) if bone >= 0 else (point[0], point[1], point[2])


@compiled(inner=True)
def _against_parent(motions, parents, bone):
    """Return a bone's rotation relative to that of its parent."""
    own = quat.of_rows(motions[bone])
    if parents[bone] < 0:
        return own
    return quat.product(quat.inverse(quat.of_rows(motions[parents[bone]])), own)


@compiled(waits=False)
def _difference(parents, heads, start, end, out):
    for bone in range(len(parents)):
        before, after = _against_parent(start, parents, bone), _against_parent(end, parents, bone)
        turn = quat.to_vector(quat.product(after, quat.inverse(before)))
        carried = _place(start, parents[bone], heads[bone]), _place(end, parents[bone], heads[bone])
        was, becomes = _place(start, bone, heads[bone]), _place(end, bone, heads[bone])
        for axis in range(3):
            out[bone, axis] = turn[axis]
            out[bone, 3 + axis] = (becomes[axis] - carried[1][axis]) - (was[axis] - carried[0][axis])


@compiled(waits=False)
def _move(parents, heads, motions, apart, share, out):
    turns = np.empty((len(parents), 4))
    for bone in range(len(parents)):
        parent = parents[bone]
        turn = quat.from_vector(scaled(apart[bone], share))
        turn = quat.product(turn, _against_parent(motions, parents, bone))
        if parent >= 0:
            turn = quat.product(quat.row_of(turns, parent), turn)
        quat.write_row(turns, bone, turn)
        quat.write_rows(turn, out[bone])
        carried, place = _place(motions, parent, heads[bone]), _place(motions, bone, heads[bone])
        now = _place(out, parent, heads[bone])
        for axis in range(3):
            there = now[axis] + place[axis] - carried[axis] + share * apart[bone, 3 + axis]
            for i in range(3):
                there -= heads[bone, i] * out[bone, i, axis]
            out[bone, 3, axis] = there
