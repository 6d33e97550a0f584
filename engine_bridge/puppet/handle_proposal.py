"""Proposal of handles, and of joints that move them, for a character without limbs."""

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from engine_bridge.puppet.puppet import CharacterTable, HandleTable
from solver.anatomy.extremities import distances, extremities, surface_graph
from solver.surface.mesh import SolverMesh

GROUND_HEIGHT = -0.6
"""Height below which tips stand on the ground, from −1 at the soles to 1 at the crown."""

MIN_FEET_DISTANCE = 0.5
"""Minimum distance of hind feet from front feet, in halves of the larger of width and length."""

MAX_TAIL_OFFSET = 0.3
"""Maximum distance of a tail from the middle plane, in the same unit."""

MAX_TAIL_FRONT = -0.4
"""Maximum position of a tail's end along the front direction, in the same unit: behind the middle."""

MIN_LIMB_PROMINENCE = 0.08
"""Minimum prominence of an arm or a leg, which is more than that of a finger."""

MIN_WING_PROMINENCE = 0.3
"""Minimum prominence of a wing, which is more than that of the plates on a dinosaur's back."""

TAIL_GAIN = -0.7
"""Gain of a tail's handle: it moves opposite to the head, and less."""

HEAD_REGION_SHARE = 0.2
"""Size of the region in which ears, horns and antennas branch off, as a share of the distance from the head to the
farthest point."""


@dataclass(frozen=True, eq=False)
class _Tip:
    """End of a limb; left, up and front range from −1 to 1 over the character."""

    vertex: int
    left: float
    up: float
    front: float
    prominence: float


def propose_handles(mesh: SolverMesh, character: CharacterTable) -> list[HandleTable]:
    """Choose handles and joints for a character without limbs.

    Ends of limbs on the ground are feet; if some are far behind the others, they are hind feet. The head is the
    front-most and upper-most point of the middle. A limb that ends in the middle far behind is a tail, which moves
    opposite to the head. Of the other pairs, those near the head are ears or horns and get no handle. The lower and
    outer ones are arms; long ones on a body with arms or four feet are wings. A character without a tail, or without
    feet, gets a handle that stays in place.

    Parameters
    ----------
    mesh : SolverMesh
    character : CharacterTable
        Gives the character's up and front.
    """
    graph = surface_graph(mesh)
    found = extremities(mesh, graph)
    placed = _placed(mesh, character.basis)
    rows = np.column_stack([found.vertices, placed[found.vertices], found.prominence]).tolist()
    tips = [_Tip(int(vertex), left, up, front, prominence) for vertex, left, up, front, prominence in rows]
    feet = _feet(tips)
    four_legged = len(feet) > 1
    head = _head(placed, four_legged)
    from_head = distances(graph, head)
    from_end = distances(graph, int(from_head.argmax()))
    tail = _tail([tip for tip in tips if not any(tip in pair for pair in feet)], four_legged)
    branch = (from_head + from_head.max() - from_end) / 2  # where the paths from a tip to head and end part
    trunk = [tip for tip in tips if branch[tip.vertex] > HEAD_REGION_SHARE * from_head.max() and tip is not tail]
    arms, wings = _arms_and_wings(trunk, four_legged)

    named: dict[str, tuple[str | None, int]] = {"head": ("head", head)}
    for pair, name, joint in (
        (arms, "hand", "hand"),
        (wings, "wing", "elbow"),
        (feet[-1] if four_legged else None, "front foot", "hand"),
        (feet[0] if feet else None, "hind foot" if four_legged else "foot", "foot"),
    ):
        for side, tip in zip(("left", "right"), pair or (), strict=False):
            named[f"{side} {name}"] = (f"{joint}_{side}", tip.vertex)
    left, up, front = placed.T
    if tail is not None:
        named["tail"] = ("head", tail.vertex)
    elif four_legged:  # the hind quarters of a frog have no other handle
        named["rump"] = (None, int(np.argmax(-front - np.abs(left))))
    if not feet:
        named["base"] = (None, int(np.argmax(-up - np.abs(left))))
    return [_handle(name, joint, mesh, vertex) for name, (joint, vertex) in named.items()]


def _placed(mesh: SolverMesh, basis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return each vertex's position (n, 3) along left, up and front, from −1 to 1 over the character."""
    # both horizontal directions have one scale, so that the curled tail of a slender animal is still in the middle
    placed = mesh.vertices @ basis.T
    low, high = placed.min(axis=0), placed.max(axis=0)
    wide = float(max(high[0] - low[0], high[2] - low[2]))
    extent = np.array([wide, max(float(high[1] - low[1]), 1e-12 * mesh.diagonal), wide])
    relative: NDArray[np.float64] = (2 * placed - low - high) / extent
    return relative


_Pair = tuple[_Tip, _Tip]


def _pairs(tips: list[_Tip]) -> list[_Pair]:
    """Match tips on the left with their best mirror images on the right."""
    left, right = [tip for tip in tips if tip.left > 0], [tip for tip in tips if tip.left <= 0]
    unlike = [[abs(a.left + b.left) + abs(a.up - b.up) + abs(a.front - b.front) for b in right] for a in left]
    rows, columns = scipy.optimize.linear_sum_assignment(np.array(unlike).reshape(len(left), len(right)))
    return [(left[i], right[j]) for i, j in zip(rows, columns, strict=True)]


def _front(pair: _Pair) -> float:
    return (pair[0].front + pair[1].front) / 2


def _least(pair: _Pair) -> float:
    return min(tip.prominence for tip in pair)


def _feet(tips: list[_Tip]) -> list[_Pair]:
    """Return no feet, a pair of feet, or hind feet and front feet."""
    pairs = sorted(
        _pairs([tip for tip in tips if tip.up < GROUND_HEIGHT and tip.prominence > MIN_LIMB_PROMINENCE]), key=_front
    )
    if len(pairs) > 1 and _front(pairs[-1]) - _front(pairs[0]) > MIN_FEET_DISTANCE:
        return [pairs[0], pairs[-1]]
    return sorted(pairs, key=_least)[-1:]


def _head(placed: NDArray[np.float64], four_legged: bool) -> int:
    """Return the front-most and upper-most vertex near the middle."""
    left, up, front = placed.T
    forwards = front + 0.25 * up if four_legged else up + 0.7 * front
    return int(np.argmax(forwards - np.abs(left)))


def _tail(tips: list[_Tip], four_legged: bool) -> _Tip | None:
    """Return the most prominent end in the middle behind; a high one of a two-legged character is not a tail."""
    behind = [tip for tip in tips if abs(tip.left) < MAX_TAIL_OFFSET and tip.front < MAX_TAIL_FRONT]
    if not four_legged:
        behind = [tip for tip in behind if tip.up < 0.5 and tip.prominence > MIN_LIMB_PROMINENCE]
    return max(behind, key=lambda tip: tip.prominence, default=None)


def _arms_and_wings(tips: list[_Tip], four_legged: bool) -> tuple[_Pair | None, _Pair | None]:
    """Return the arms, a low pair that reaches sideways, and the wings, a pair behind them."""

    def like_arms(pair: _Pair) -> float:
        left, right = pair
        return min(_least(pair), 0.3) + (left.left - right.left - left.up - right.up) / 4 - abs(_front(pair)) / 4

    pairs = _pairs([tip for tip in tips if tip.up >= GROUND_HEIGHT and tip.prominence > MIN_LIMB_PROMINENCE])
    arms = None if four_legged else max(pairs, key=like_arms, default=None)
    wings = [
        pair
        for pair in pairs
        if _least(pair) > MIN_WING_PROMINENCE and (arms is None or _front(pair) < _front(arms) - 0.1)
    ]
    return arms, max(wings, key=_least, default=None)


def _handle(name: str, joint: str | None, mesh: SolverMesh, vertex: int) -> HandleTable:
    decimals = 5 - math.floor(math.log10(mesh.diagonal))
    x, y, z = (round(float(value), decimals) for value in mesh.vertices[vertex])
    return HandleTable(name=name, position=(x, y, z), joint=joint, gain=TAIL_GAIN if name == "tail" else 1.0)
