"""A first puppet for any mesh: handles at its extremities, and joints that suit where they are."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine_bridge.gltf.character import load_character
from engine_bridge.performance import check_handles
from engine_bridge.puppet import CharacterTable, HandleTable, Puppet, check
from puppetline.errors import PuppetError, at
from solver.extremities import extremities
from solver.mesh import SolverMesh

FEET_BELOW = 0.25
"""Tips in the lowest quarter of the height stand on the ground."""

TAIL_GAIN = -0.7
"""A tail swings against the head, and less."""

MIDDLE = 0.25
"""Tips this close to the middle plane, as a share of half the larger of width and length, belong to neither side."""


@dataclass(frozen=True, eq=False)
class _Tip:
    """A limb's end; left, up and front lie between −1 and 1 over the character, position is the mesh file's."""

    position: NDArray[np.float64]
    left: float
    up: float
    front: float


def propose(mesh: SolverMesh, character: CharacterTable) -> list[HandleTable]:
    """Choose handles and joints that play at once.

    The front-most of the high tips in the middle is the head; tips on the ground are feet, or front and hind feet
    where there are more than two; the outermost of the others are arms or wings; what is left in the middle and at the
    back is a tail, a counterweight to the head.

    Parameters
    ----------
    mesh : SolverMesh
    character : CharacterTable
        Which way it stands and faces.

    Raises
    ------
    PuppetError
        A shape without limbs.
    """
    tips = [_place(mesh, vertex, character.basis) for vertex in extremities(mesh)]
    handles = [_handle(name, joint, tip.position) for name, joint, tip in _assign(tips)]
    if not handles:
        raise PuppetError(
            character.mesh,
            found="no extremities to put handles at",
            expected="a shape with limbs",
            fix="Place handles yourself: --handle NAME=X,Y,Z --map NAME=JOINT",
        )
    return handles


def new_puppet(
    mesh: Path,
    output: Path,
    *,
    handles: Mapping[str, str],
    maps: Mapping[str, str],
    up: str = "y",
    front: str = "z",
    mirror: bool = False,
) -> Puppet:
    """Make a puppet for a mesh file, with the user's own handles and joints where they are given.

    Parameters
    ----------
    mesh : Path
    output : Path
        Where the puppet will be written: its path to the mesh is relative to that.
    handles : mapping of str
        Name to "X,Y,Z"; instead of those that would be proposed.
    maps : mapping of str
        Handle name to "JOINT" or "JOINT,JOINT".
    up, front : str
        As in the puppet file.
    mirror : bool

    Raises
    ------
    PuppetlineError
    """
    surface = load_character(mesh).solver_mesh()
    where = "the command line"
    values: dict[str, Any] = {
        "character": {"mesh": Path(os.path.relpath(mesh, output.parent)).as_posix(), "up": up, "front": front},
        "handle": [{"name": name, "position": _numbers(name, text)} for name, text in handles.items()],
        "root": {},
        "retarget": {"mirror": mirror},
    }
    if not handles:
        values["handle"] = [{"name": "unknown", "position": [0, 0, 0]}]
        character = check(values, where).character
        values["handle"] = [handle.model_dump(exclude_none=True) for handle in propose(surface, character)]
    names = [handle["name"] for handle in values["handle"]]
    for name, joints in maps.items():
        if name not in names:
            raise PuppetError(
                at(where, field=f"--map {name}={joints}"),
                found=f"no handle {name!r}",
                expected=f"one of {', '.join(names)}",
                fix="Name one of these handles, or add it with --handle.",
            )
        handle = values["handle"][names.index(name)]
        handle.pop("joint", None)
        several = joints.split(",")
        handle.update({"joints": several} if len(several) > 1 else {"joint": joints})
    puppet = check(values, where)
    check_handles(puppet.handle, surface, where)
    return puppet


def _numbers(name: str, text: str) -> list[float]:
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError as error:
        raise PuppetError(
            at("the command line", field=f"--handle {name}={text}"),
            found=repr(text),
            expected="three numbers with commas between them",
            fix=f"Write it like --handle {name}=0.1,1.5,0.2",
        ) from error
    return [x, y, z]


def _place(mesh: SolverMesh, vertex: int, basis: NDArray[np.float64]) -> _Tip:
    # one scale for both horizontal directions, so that a curled tail of a slender animal is still in the middle
    placed = mesh.vertices @ basis.T
    low, high = placed.min(axis=0), placed.max(axis=0)
    wide = float(max(high[0] - low[0], high[2] - low[2]))
    extent = np.array([wide, max(float(high[1] - low[1]), 1e-12 * mesh.diagonal), wide])
    left, up, front = (2 * placed[vertex] - low - high) / extent
    position = mesh.vertices[vertex]
    return _Tip(position, float(left), float(up), float(front))


def _assign(tips: list[_Tip]) -> list[tuple[str, str, _Tip]]:
    """Give each tip a name and a joint; a tip for which no joint is left over is passed by."""
    low = sorted((tip for tip in tips if tip.up < 2 * FEET_BELOW - 1), key=lambda tip: tip.front)
    high = [tip for tip in tips if tip not in low]
    found: list[tuple[str, str, _Tip]] = []
    if high:
        head = max(high, key=lambda tip: tip.up + 0.7 * tip.front - abs(tip.left))
        high.remove(head)
        found.append(("head", "head", head))
    # feet come in pairs: an odd one is a tail that touches the ground
    tails = [low.pop(0)] if len(low) % 2 and len(low) > 1 else []
    tails += sorted((tip for tip in high if abs(tip.left) < MIDDLE and tip.front < 0), key=lambda tip: tip.front)
    high = [tip for tip in high if tip not in tails]
    hind, fore = low[:2], low[-2:] if len(low) > 2 else []
    found += _pair(hind, "hind foot" if fore else "foot", "foot")
    found += _pair(fore, "forefoot", "hand")
    found += _pair(high, "wing" if fore else "arm", "elbow" if fore else "hand")
    return found + [("tail", "head", tip) for tip in tails[:1]]


def _pair(tips: list[_Tip], name: str, joint: str) -> list[tuple[str, str, _Tip]]:
    """Take the tip farthest to the left and the one farthest to the right."""
    left = max(tips, key=lambda tip: tip.left, default=None)
    right = min((tip for tip in tips if tip is not left), key=lambda tip: tip.left, default=None)
    sides = (("left", left), ("right", right))
    return [(f"{side} {name}", f"{joint}_{side}", tip) for side, tip in sides if tip is not None]


def _handle(name: str, joint: str, position: NDArray[np.float64]) -> HandleTable:
    x, y, z = (float(f"{value:.6g}") for value in position)
    return HandleTable(name=name, position=(x, y, z), joint=joint, gain=TAIL_GAIN if name == "tail" else 1.0)
