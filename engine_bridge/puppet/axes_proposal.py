"""Proposal of how a character stands: its up, its front, and how far it is turned between the axes of its mesh."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from engine_bridge.character.character import CharacterMesh
from engine_bridge.puppet.puppet import Direction
from engine_bridge.puppet.rig_limbs import RigBody, rig_limbs
from engine_bridge.puppet.skin_joints import STRAIGHT
from solver.anatomy.axes import unit_vector
from solver.anatomy.orientation import FILE_UPS, Orientation
from solver.anatomy.standing import propose_standing
from solver.anatomy.turn import turn_of
from solver.surface.mesh import SolverMesh

AXES = "up", "front"

MIN_OTHER_PROBABILITY = 0.05
"""Minimum probability of another up or front, or of other limbs, for which there is a note."""


@dataclass(frozen=True, eq=False)
class ProposedAxes:
    """How a character stands.

    Attributes
    ----------
    orientation : Orientation
        Axes of the mesh when it is turned back.
    turn : float
        Degrees by which the character is turned from its front to its left; as in the puppet file.
    rig : RigBody or None
        Limbs of the file's skeleton.
    """

    orientation: Orientation
    turn: float
    rig: RigBody | None

    @property
    def values(self) -> dict[str, str | float]:
        """Keys of a puppet file's character."""
        turn = {"turn": self.turn} if self.turn else {}
        return {"up": self.orientation.up, "front": self.orientation.front, **turn}

    def others(self) -> Iterator[str]:
        """Yield a note on another up or front, if it is likely, with the options that take it."""
        chosen = self.orientation.up, self.orientation.front
        for *other, chance in self.orientation.others[:1]:
            changed = [(name, axis) for name, axis, own in zip(AXES, other, chosen, strict=True) if axis != own]
            what = " and ".join(f"{name} is {axis}" for name, axis in changed)
            fix = [f"--{name} {axis}" for name, axis in changed]
            fix += [f"--turn {self.turn:g}"] if self.turn and other[0] == chosen[0] else []
            if chance >= MIN_OTHER_PROBABILITY:
                yield f"With a probability of {chance:.0%}, {what}. If so: {' '.join(fix)}"


def propose_axes(
    character: CharacterMesh,
    surface: SolverMesh,
    up: Direction | None = None,
    front: Direction | None = None,
    turn: float | None = None,
    *,
    skeleton: bool = True,
    specified: bool,
) -> ProposedAxes:
    """Propose how a character stands.

    Parameters
    ----------
    character : CharacterMesh
    surface : SolverMesh
        Its surface.
    up, front : str, optional
        What the user gives.
    turn : float, optional
        As in the puppet file. By default, a character whose front is not given is turned if its left and right mirror
        each other across a plane between the axes.
    skeleton : bool
        False to ignore the file's skeleton.
    specified : bool
        See `solver.anatomy.orientation.propose`.
    """
    if turn is None and front is None:
        axis, angle = turn_of(surface, [up] if up else ["y"] if specified else FILE_UPS)
        found = _turned_back(character, surface, (up, front), (axis, angle), skeleton, specified)
        if angle == 0 or found.orientation.up[-1] == axis[-1]:
            return _with_reason(found)
    straight = _turned_back(character, surface, (up, front), ("y", 0.0), skeleton, specified)
    if not turn:
        return straight
    own = up or straight.orientation.up
    return _turned_back(character, surface, (own, front), (own, turn), skeleton, specified)


def _turned_back(
    character: CharacterMesh,
    surface: SolverMesh,
    known: tuple[str | None, str | None],
    turn: tuple[str, float],
    skeleton: bool,
    specified: bool,
) -> ProposedAxes:
    """Return how a character stands that is turned about an axis by some degrees."""
    axis, angle = turn
    back = STRAIGHT
    if angle:
        back = Rotation.from_rotvec(-angle * unit_vector(axis), degrees=True).as_matrix()
        surface = replace(surface, vertices=surface.vertices @ back.T)
    up, front = (None if name is None else unit_vector(name) for name in known)
    rig = rig_limbs(character, up, front, back, surface) if skeleton else None
    orientation = stands_of(rig, surface, *known, specified=specified)
    return ProposedAxes(orientation, angle if orientation.up == axis else -angle, rig)


def _with_reason(found: ProposedAxes) -> ProposedAxes:
    """Return axes of which the reason for the front says that the character was found to be turned, if it was."""
    if not found.turn:
        return found
    up, front = found.orientation.reasons
    side = "left" if found.turn > 0 else "right"
    front += f", and it is turned by {abs(found.turn):g}° to its {side}, where its sides mirror each other"
    return replace(found, orientation=replace(found.orientation, reasons=(up, front)))


def stands_of(
    rig: RigBody | None, surface: SolverMesh, up: str | None = None, front: str | None = None, *, specified: bool
) -> Orientation:
    """Return up and front by the file's skeleton, or by the shape if there are no limbs in it.

    Parameters
    ----------
    rig : RigBody or None
    surface : SolverMesh
    up, front, specified
        See `solver.anatomy.orientation.propose`; the skeleton was read with the same axes.
    """
    if rig is None or not rig.limbs.chains:
        return propose_standing(surface, up, front, specified=specified)
    ways = [(_direction(body.up), _direction(body.front), chance) for chance, body in rig.bodies]
    reasons = (f"{name} is {axis}, by the file's skeleton" for name, axis in zip(AXES, ways[0], strict=False))
    return Orientation(*ways[0], tuple(reasons), tuple(ways[1:]))


def _direction(vector: NDArray[np.float64]) -> Direction:
    names: tuple[tuple[Direction, Direction], ...] = (("x", "-x"), ("y", "-y"), ("z", "-z"))
    axis = int(np.abs(vector).argmax())
    return names[axis][int(vector[axis] < 0)]
