"""Up and front of a character by its outline (`solver.anatomy.orientation`) and by the points inside it together."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from solver.anatomy import orientation
from solver.anatomy.axes import basis_of
from solver.anatomy.orientation import Orientation
from solver.anatomy.solid import solid_of
from solver.anatomy.voted_limbs import votes_of
from solver.surface.mesh import SolverMesh

MAX_WAYS, MIN_WAY_PROBABILITY = 12, 0.001
"""Number of ups and fronts that are compared, and minimum probability of the others by the outline."""

INSIDE_WEIGHT, OUTLINE_WEIGHT = 0.5, 0.5
"""Weights of the logits by the points inside and by the outline."""

CONVENTION_BONUS, OTHER_UP = 2.0, -4.0
"""What is added for the way that the outline and the convention of the file say, and for an up that is no file's."""


def propose_standing(
    mesh: SolverMesh, up: str | None = None, front: str | None = None, *, specified: bool = False
) -> Orientation:
    """Propose a character's axes; the parameters are those of `solver.anatomy.orientation.propose`."""
    outline = orientation.propose(mesh, up, front, specified=specified)
    ways = [(outline.up, outline.front, outline.confidence), *outline.others]
    ways = [way for way in ways if way is ways[0] or way[2] >= MIN_WAY_PROBABILITY][:MAX_WAYS]
    if len(ways) == 1:
        return outline
    inside = np.array(standing_logits(mesh, [basis_of(*way[:2]) for way in ways]))
    total = INSIDE_WEIGHT * inside + OUTLINE_WEIGHT * np.log([max(way[2], MIN_WAY_PROBABILITY) for way in ways])
    total += [OTHER_UP * (up not in orientation.FILE_UPS) for up, _, _ in ways]
    total[0] += CONVENTION_BONUS
    chances = scipy.special.softmax(total)
    best, *others = ((*ways[way][:2], float(chances[way])) for way in chances.argsort()[::-1].tolist())
    chosen = outline if best[:2] == ways[0][:2] else orientation.propose(mesh, *best[:2])
    return replace(chosen, confidence=best[2], others=tuple(others))


def standing_logits(mesh: SolverMesh, bases: Sequence[NDArray[np.float64]]) -> list[float]:
    """Return how likely a character stands in each of several ways, by the points inside.

    Parameters
    ----------
    mesh : SolverMesh
    bases : sequence of (3, 3) float64
        Rows are the mesh's directions of left, up and front, along its axes.
    """
    return [votes_of(solid_of(mesh).along(basis), sets=1).stands for basis in bases]
