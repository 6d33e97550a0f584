"""A first puppet for any mesh: its limbs, or handles where it has none, and joints that suit where they are."""

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from engine_bridge.character.character import Character, load_character
from engine_bridge.puppet.placement import check_handles
from engine_bridge.puppet.puppet import CharacterTable, Direction, HandleTable, LimbTable, Puppet, check
from engine_bridge.puppet.rig_limbs import axes_of, rig_limbs
from puppetline.errors import PuppetError, at
from solver.anatomy import orientation
from solver.anatomy.extremities import distances, extremities, surface_graph
from solver.anatomy.limb_chain import LimbChain, Limbs
from solver.anatomy.limb_finding import find_limbs
from solver.surface.mesh import SolverMesh

ARM, LEG = ("shoulder", "elbow", "wrist", "hand"), ("hip", "knee", "ankle", "foot")
LIMB_JOINTS: dict[str, tuple[str, ...]] = {
    "arm": ARM,
    "leg": LEG,
    "front leg": ARM,
    "hind leg": LEG,
    "wing": ARM,
}
"""What drives a limb of either side: front legs and wings are arms."""

MIDDLE_JOINTS: dict[str, tuple[str | tuple[str, ...], ...]] = {
    "trunk": ("hip_center", "spine", "shoulder_center"),
    "neck": ("shoulder_center", ("shoulder_center", "head"), "head"),
    "head": ("shoulder_center", "head"),
    "tail": ("hip_center", "shoulder_center", ("shoulder_center", "head"), "head"),
}
"""What drives a limb of the middle. A tail swings with the head from its second bone on."""

LIMB_GAINS = {"neck": 0.5, "tail": -0.7, "left wing": 0.5, "right wing": 0.5}
"""A neck does half of what the head does; a tail swings against the head, and less. Wings that are spread at rest
would go through the body where a hanging arm is raised."""

ENDS = ("head", "tail", *(f"{side} {limb}" for limb in LIMB_JOINTS for side in ("left", "right")))
"""Limbs whose ends a user may give."""

UPRIGHT_COSINE = np.cos(np.radians(40))
"""A body is a person's where its trunk is within 40° of up; the same for its head."""

AXES = "up", "front"

GROUND_HEIGHT = -0.6
"""Tips below this, from −1 at the soles to 1 at the crown, stand on the ground."""

MIN_FEET_DISTANCE = 0.5
"""Feet this far behind others, in halves of the larger of width and length, are hind feet."""

MAX_TAIL_OFFSET = 0.3
"""How far aside of the middle plane, in the same unit, a tail may be."""

MIN_LIMB_PROMINENCE = 0.08
"""Prominence of an arm or a leg, and more than that of a finger."""
MIN_WING_PROMINENCE = 0.3
"""Prominence of a wing, and more than that of the plates on a dinosaur's back."""

MAX_TAIL_FRONT = -0.4
"""Where a tail ends: this far behind the middle or farther."""
TAIL_GAIN = -0.7
"""A tail swings against the head, and less."""

HEAD_REGION_SHARE = 0.2
"""Ears, horns and antennas branch off nearer to the head than this, as a share of the way to the farthest point."""


PLACEHOLDER_HANDLES = ({"name": "any", "position": (0.0, 0.0, 0.0)},)
"""Stands for the handles while the rest of a puppet is checked."""


@dataclass(frozen=True, eq=False)
class _Tip:
    """A limb's end: left, up and front lie between −1 and 1 over the character."""

    vertex: int
    left: float
    up: float
    front: float
    prominence: float


def limb_tables(limbs: Limbs, character: CharacterTable) -> list[LimbTable]:
    """Choose the joints that drive each limb, and how.

    People's limbs point where the performer's do. Those of a body that is built otherwise turn as the performer's have
    turned: four legs, tails, necks and wings, and whatever does not stand upright.

    Parameters
    ----------
    limbs : Limbs
    character : CharacterTable
        Which way it stands and faces.

    Returns
    -------
    list of LimbTable
        Empty for what has a trunk and a head only.
    """
    points = limbs.points
    if not set(points) - {"trunk", "neck", "head"}:
        return []
    return [_limb(chain, _follow(chain.name, points, character.basis[1]), points) for chain in limbs.chains]


def _follow(name: str, points: Mapping[str, NDArray[np.float64]], up: NDArray[np.float64]) -> str:
    def stands(way: NDArray[np.float64]) -> bool:
        return bool(way @ up > UPRIGHT_COSINE * np.linalg.norm(way))

    if not points.keys() >= {"trunk", "head", "left arm", "right arm", "left leg", "right leg"}:
        return "turn"
    trunk, head = (points[limb][-1] - points[limb][0] for limb in ("trunk", "head"))
    body = trunk if np.linalg.norm(trunk) > np.linalg.norm(head) else points["head"][-1] - points["trunk"][0]
    if not stands(body) or name in ("tail", "neck", "left wing", "right wing"):
        return "turn"
    return "turn" if name == "head" and not stands(head) else "direction"


def _limb(chain: LimbChain, follow: str, points: Mapping[str, NDArray[np.float64]]) -> LimbTable:
    side, _, limb = chain.name.partition(" ")
    joints = MIDDLE_JOINTS.get(chain.name) or tuple(f"{joint}_{side}" for joint in LIMB_JOINTS[limb])
    size = max(float(np.ptp(np.concatenate(list(points.values())), axis=0).max()), 1e-12)
    table = {
        "name": chain.name,
        "points": [_rounded(point, size) for point in chain.points],
        "joints": joints,
        "follow": follow,
        "gain": LIMB_GAINS.get(chain.name, 1.0),
        "parent": "neck" if chain.name == "head" and "neck" in points else None,
    }
    return LimbTable.model_validate(table)


def _rounded(point: NDArray[np.float64], size: float) -> tuple[float, ...]:
    decimals = 5 - math.floor(math.log10(size))
    return tuple(round(float(value), decimals) for value in point)


def propose_handles(mesh: SolverMesh, character: CharacterTable) -> list[HandleTable]:
    """Choose handles and joints for a character without limbs.

    Ends of limbs on the ground are feet, and where some are far behind the others there are front and hind feet. The
    head is the front-most and upper-most of the middle; a limb that ends in the middle far behind is a tail, a
    counterweight to the head. Of the pairs that are left, those near the head are ears or horns and get nothing; the
    lower and outer ones are arms, and what is long and upon a body with arms or four feet are wings. Where there is no
    tail to hold the hind quarters, or there are no feet, a point that stays steadies the character.

    Parameters
    ----------
    mesh : SolverMesh
    character : CharacterTable
        Which way it stands and faces.
    """
    graph = surface_graph(mesh)
    found = extremities(mesh, graph)
    placed = _placed(mesh, character.basis)
    tips = [
        _Tip(int(vertex), float(left), float(up), float(front), float(prominence))
        for vertex, (left, up, front), prominence in zip(
            found.vertices, placed[found.vertices], found.prominence, strict=True
        )
    ]
    feet = _feet(tips)
    four_legged = len(feet) > 1
    head = _head(placed, four_legged)
    from_head = distances(graph, head)
    from_end = distances(graph, int(from_head.argmax()))
    tail = _tail([tip for tip in tips if not any(tip in pair for pair in feet)], four_legged)
    branch = (from_head + from_head.max() - from_end) / 2  # where the ways from a tip to head and end part
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
    elif four_legged:  # nothing else holds the hind quarters of a frog
        named["rump"] = (None, int(np.argmax(-front - np.abs(left))))
    if not feet:  # something to stand on
        named["base"] = (None, int(np.argmax(-up - np.abs(left))))
    return [_handle(name, joint, mesh, vertex) for name, (joint, vertex) in named.items()]


@dataclass(frozen=True, eq=False)
class Proposal:
    """A first puppet, the character that it is for, what was assumed about how that stands, and what is unclear."""

    puppet: Puppet
    character: Character
    assumed: tuple[str, ...]
    notes: tuple[str, ...] = ()


def new_puppet(
    mesh: Path,
    output: Path,
    *,
    handles: Mapping[str, str] = MappingProxyType({}),
    maps: Mapping[str, str] = MappingProxyType({}),
    ends: Mapping[str, str] = MappingProxyType({}),
    up: Direction | None = None,
    front: Direction | None = None,
    scale: float | None = None,
    mirror: bool = False,
    limbs: bool = True,
) -> Proposal:
    """Make a puppet for a mesh file, with the user's own handles and joints where they are given.

    Parameters
    ----------
    mesh : Path
    output : Path
        Where the puppet will be written: its path to the mesh is relative to that.
    handles : mapping of str
        Name to "X,Y,Z"; instead of limbs that would be proposed, or beside them where ends of limbs are given as well.
    maps : mapping of str
        Name of a handle or limb to "JOINT" or "JOINT,JOINT"; a limb has as many as points.
    ends : mapping of str
        Name of a limb to "X,Y,Z", where it ends; the file's skeleton then counts for nothing.
    up, front, scale
        As in the puppet file; what is None is proposed from the file's skeleton or the shape.
    mirror : bool
    limbs : bool
        False for handles at the ends of limbs instead of the limbs.

    Raises
    ------
    PuppetlineError
    """
    character = load_character(mesh)
    surface = character.solver_mesh()
    where = "the command line"
    places = {name: np.array(_numbers("--limb", name, text)) for name, text in ends.items()}
    _check_ends(ends, where)
    rig = None if ends else rig_limbs(character)
    skeleton = _axes(rig, up, front)
    table: dict[str, Any] = {"mesh": Path(os.path.relpath(mesh, output.parent)).as_posix()}
    given = {"up": up, "front": front, "scale": scale}
    values: dict[str, Any] = {
        "character": table | {key: value for key, value in given.items() if value is not None},
        "handle": [{"name": name, "position": _numbers("--handle", name, text)} for name, text in handles.items()],
        "root": {},
        "retarget": {"mirror": mirror},
    }
    if up is not None and front is not None:
        check(values | {"handle": PLACEHOLDER_HANDLES}, where)  # axes that do not go together leave nothing to propose
    stands = orientation.propose(surface, *(skeleton if skeleton else (up, front)))
    values["character"] = {"up": stands.up, "front": stands.front, "scale": stands.scale} | values["character"]
    standing = check(values | {"handle": PLACEHOLDER_HANDLES}, where).character
    notes: list[str] = []
    if places or not handles:
        found = _limbs(rig, surface, standing, places, notes) if limbs else []
        values["limb"] = [limb.model_dump(exclude_none=True) for limb in found]
        if not found and not handles:
            proposed = propose_handles(surface, standing)
            values["handle"] = [handle.model_dump(exclude_none=True) for handle in proposed]
    _map(values, maps, where)
    puppet = check(values, where)
    check_handles(puppet.handle, surface, where)
    reasons = list(stands.reasons)
    if skeleton:
        reasons[:2] = (f"{name} is {axis}, by the file's skeleton" for name, axis in zip(AXES, skeleton, strict=True))
    assumed = tuple(reason for value, reason in zip(given.values(), reasons, strict=True) if value is None)
    return Proposal(puppet, character, assumed, tuple(notes))


def _axes(rig: Limbs | None, up: Direction | None, front: Direction | None) -> tuple[Direction, Direction] | None:
    """Return the axes of the file's skeleton, those that the user gives first; None where they do not go together."""
    axes = None if rig is None else axes_of(rig)
    if axes is None:
        return None
    chosen = up or axes[0], front or axes[1]
    return chosen if chosen[0][-1] != chosen[1][-1] else None


def _limbs(
    rig: Limbs | None,
    surface: SolverMesh,
    standing: CharacterTable,
    ends: Mapping[str, NDArray[np.float64]],
    notes: list[str],
) -> list[LimbTable]:
    """Return the limbs of the file's skeleton if it says where they are, or those of the shape; add what is unclear."""
    if rig is not None:
        notes += rig.notes
        tables = limb_tables(rig, standing)
        if tables:
            return tables
    shape = find_limbs(surface, standing.basis, ends)
    notes += shape.notes
    return limb_tables(shape, standing)


def _check_ends(ends: Mapping[str, str], where: str) -> None:
    """Refuse names that no limb has, and one limb of a pair without the other."""
    for name, text in ends.items():
        if name not in ENDS:
            raise PuppetError(
                at(where, field=f"--limb {name}={text}"),
                found=repr(name),
                expected=f"one of {', '.join(ENDS)}",
                fix="Correct the name of the limb.",
            )
        side, _, limb = name.partition(" ")
        other = f"{'right' if side == 'left' else 'left'} {limb}"
        if limb and other not in ends:
            raise PuppetError(
                at(where, field=f"--limb {name}={text}"),
                found=f"no --limb for the {other}",
                expected="the ends of both",
                fix=f"Add --limb '{other}=X,Y,Z'.",
            )


def _map(values: dict[str, Any], maps: Mapping[str, str], where: str) -> None:
    """Give handles and limbs the joints that the user wants."""
    tables = {table["name"]: table for kind in ("handle", "limb") for table in values.get(kind, [])}
    handles = {handle["name"] for handle in values["handle"]}
    for name, joints in maps.items():
        if name not in tables:
            what = "handle" if handles else "limb"
            raise PuppetError(
                at(where, field=f"--map {name}={joints}"),
                found=f"no {what} {name!r}",
                expected=f"one of {', '.join(tables)}",
                fix=f"Name one of these {what}s, or add it with --handle.",
            )
        table, several = tables[name], joints.split(",")
        table.pop("joint", None)
        table.update({"joints": several} if len(several) > 1 or name not in handles else {"joint": joints})


def _numbers(option: str, name: str, text: str) -> list[float]:
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError as error:
        raise PuppetError(
            at("the command line", field=f"{option} {name}={text}"),
            found=repr(text),
            expected="three numbers with commas between them",
            fix=f"Write it like {option} {name}=0.1,1.5,0.2",
        ) from error
    return [x, y, z]


def _placed(mesh: SolverMesh, basis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (n, 3) how far left, up and to the front each vertex is, −1 to 1 over the character."""
    # one scale for both horizontal directions, so that a curled tail of a slender animal is still in the middle
    placed = mesh.vertices @ basis.T
    low, high = placed.min(axis=0), placed.max(axis=0)
    wide = float(max(high[0] - low[0], high[2] - low[2]))
    extent = np.array([wide, max(float(high[1] - low[1]), 1e-12 * mesh.diagonal), wide])
    relative: NDArray[np.float64] = (2 * placed - low - high) / extent
    return relative


_Pair = tuple[_Tip, _Tip]


def _pairs(tips: list[_Tip]) -> list[_Pair]:
    """Match tips on the left with those on the right that mirror them best."""
    left, right = [tip for tip in tips if tip.left > 0], [tip for tip in tips if tip.left <= 0]
    unlike = [[abs(a.left + b.left) + abs(a.up - b.up) + abs(a.front - b.front) for b in right] for a in left]
    rows, columns = linear_sum_assignment(np.array(unlike).reshape(len(left), len(right)))
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
    """Return the vertex farthest to the front and up, near the middle."""
    left, up, front = placed.T
    forwards = front + 0.25 * up if four_legged else up + 0.7 * front
    return int(np.argmax(forwards - np.abs(left)))


def _tail(tips: list[_Tip], four_legged: bool) -> _Tip | None:
    """Return the most prominent end in the middle behind; what two-legged creatures carry up there is no tail."""
    behind = [tip for tip in tips if abs(tip.left) < MAX_TAIL_OFFSET and tip.front < MAX_TAIL_FRONT]
    if not four_legged:
        behind = [tip for tip in behind if tip.up < 0.5 and tip.prominence > MIN_LIMB_PROMINENCE]
    return max(behind, key=lambda tip: tip.prominence, default=None)


def _arms_and_wings(tips: list[_Tip], four_legged: bool) -> tuple[_Pair | None, _Pair | None]:
    """Return the arms, a pair that is low and reaches out sideways, and the wings, a pair behind them."""

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
