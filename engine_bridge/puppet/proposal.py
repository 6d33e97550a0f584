"""Proposal of a puppet for any mesh: its limbs, or handles if it has none, and the joints that move them."""

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.bodies import bodies_of, with_body
from engine_bridge.character.character import CharacterMesh, load_character
from engine_bridge.character.face_targets import morph_tables
from engine_bridge.character.own_targets import names_of
from engine_bridge.character.surface_document import SURFACE_FILES
from engine_bridge.puppet.axes_proposal import MIN_OTHER_PROBABILITY, propose_axes
from engine_bridge.puppet.body_plans import BodyPlan, check_plan, plan_of
from engine_bridge.puppet.body_summary import body_summary
from engine_bridge.puppet.limb_nodes import limb_nodes
from engine_bridge.puppet.limb_proposal import PERFORMER_JOINTS, end_handles, limb_tables
from engine_bridge.puppet.placement import check_handles, check_limbs, check_on_surface
from engine_bridge.puppet.puppet import CharacterTable, Direction, Puppet
from engine_bridge.puppet.puppet_file import check
from engine_bridge.puppet.rig_limbs import RigBody
from engine_bridge.puppet.size import propose_scale
from puppetline.errors import PuppetError, at
from solver.anatomy.bodies import STILL
from solver.anatomy.limb_chain import Limbs
from solver.anatomy.limb_finding import find_limbs
from solver.surface.mesh import SolverMesh

ENDS = ("head", "tail", "jaw", *(f"{side} {limb}" for limb in (*PERFORMER_JOINTS, "ear") for side in ("left", "right")))
"""Limbs whose ends the user may give."""

IMPORTANCE = ("trunk", "neck", "head", "leg", "arm", "wing", "tail")
"""Kinds of limbs in the order in which they are kept, if they cannot all be as they were found; others are last."""

PLACEHOLDER_HANDLES = ({"name": "any", "position": (0.0, 0.0, 0.0)},)
"""Handles with which the rest of a puppet is checked before its own are known."""


@dataclass(frozen=True, eq=False)
class Proposal:
    """A proposed puppet and its character.

    Attributes
    ----------
    puppet : Puppet
    character : CharacterMesh
    assumed : tuple of str
        Assumptions about the orientation and scale of the mesh, as sentences.
    notes : tuple of str
        Sentences about what is unclear.
    plan : BodyPlan or None
        None for a puppet without limbs.
    """

    puppet: Puppet
    character: CharacterMesh
    assumed: tuple[str, ...]
    notes: tuple[str, ...] = ()
    plan: BodyPlan | None = None

    @property
    def summary(self) -> str:
        """What was found, in words: "a person: one head, two arms, two legs"."""
        return body_summary(self.plan, (limb.name for limb in self.puppet.limb))


def new_puppet(
    mesh: Path,
    output: Path,
    *,
    handles: Mapping[str, str] = MappingProxyType({}),
    maps: Mapping[str, str] = MappingProxyType({}),
    ends: Mapping[str, str] = MappingProxyType({}),
    up: Direction | None = None,
    front: Direction | None = None,
    turn: float | None = None,
    scale: float | None = None,
    mirror: bool = False,
    limbs: bool = True,
    plan: BodyPlan | None = None,
    body: int | None = None,
) -> Proposal:
    """Propose a puppet for a mesh file, with the user's handles and joints where they are given.

    Parameters
    ----------
    mesh : Path
    output : Path
        Where the puppet will be written; its path to the mesh is relative to this file.
    handles : mapping of str
        Name to "X,Y,Z". They replace the proposed limbs, unless ends of limbs are given too.
    maps : mapping of str
        Name of a handle or limb to "JOINT" or "JOINT,JOINT"; a limb needs one joint per point.
    ends : mapping of str
        Name of a limb to "X,Y,Z", its end. With any of them, the skeleton in the file is ignored.
    up, front, turn, scale
        As in the puppet file; None to find it from the file's skeleton, the shape or the body plan.
    mirror : bool
    plan : BodyPlan or None
        How limbs follow the performer, and which limbs are taken where the shape may have several; None to choose both.
    limbs : bool
        False for handles at the ends of limbs instead of limbs.
    body : int or None
        Number of the body that moves; None for the first, 0 for everything that the file shows.

    Raises
    ------
    PuppetlineError
    """
    where = "the command line"
    character, bodies = _with_chosen(load_character(mesh), body, at(where, field=f"--body {body}"))
    surface = character.solver_mesh()
    places = _places(ends, surface, where)
    table: dict[str, Any] = {"mesh": Path(os.path.relpath(mesh, output.parent)).as_posix()}
    if character.still:
        table["body"] = body or 1
    given = {"up": up, "front": front, "turn": turn, "scale": scale}
    values: dict[str, Any] = {
        "character": table | {key: value for key, value in given.items() if value is not None},
        "handle": [{"name": name, "position": _numbers("--handle", name, text)} for name, text in handles.items()],
        "root": {},
        "retarget": {"mirror": mirror},
    }
    if up is not None and front is not None:
        check(values | {"handle": PLACEHOLDER_HANDLES}, where)  # refuses parallel axes first
    specified = mesh.suffix.lower() not in SURFACE_FILES
    axes = propose_axes(character, surface, up, front, turn, skeleton=not ends, specified=specified)
    values["character"] = axes.values | values["character"]
    standing = check(values | {"handle": PLACEHOLDER_HANDLES}, where).character
    notes = [*_others(bodies, body or 1), *axes.others()]
    if places or not handles:
        found = with_plan_of(limbs_of(axes.rig, surface, standing, places), plan, standing.basis[1])
        notes += [*found.notes, *_other_plan(found, standing.basis[1])]
        proposed = limb_tables(found, standing, _checked(plan, found)) if limbs else []
        tables = [limb.model_dump(exclude_none=True) for limb in proposed]
        if tables and not places:
            tables, omissions = fitting(values, tables, surface)
            notes += omissions
        values["limb"] = tables
        if not tables and not handles:
            at_ends = end_handles(found, surface, standing)
            values["handle"] = [handle.model_dump(exclude_none=True) for handle in at_ends]
    values["morph"] = morph_tables(names_of(character))
    _map(values, maps, where)
    puppet = _with_near_nodes(check(values, where), character)
    check_handles(puppet.handle, surface, where)
    plan = _plan(puppet, plan)
    size, reason = propose_scale(float(np.ptp(surface.vertices @ standing.basis[1])), plan)
    if scale is None:
        puppet = puppet.model_copy(update={"character": puppet.character.model_copy(update={"scale": size})})
    reasons = dict(zip(("up", "front", "scale"), (*axes.orientation.reasons, reason), strict=True))
    assumed = [reason for name, reason in reasons.items() if given[name] is None]
    if (bodies == STILL).any():
        assumed.append("what it stands on, or what stands beside it, stays still; to move everything: --body 0")
    return Proposal(puppet, character, tuple(assumed), tuple(notes), plan)


def _with_chosen(character: CharacterMesh, body: int | None, where: str) -> tuple[CharacterMesh, NDArray[np.int64]]:
    """Return the character with the body that moves, and the bodies (N,); all of it and none with 0."""
    if body == 0:
        return character, np.ones(0, dtype=np.int64)
    bodies = bodies_of(character)
    return with_body(character, bodies, body or 1, where), bodies


def _others(bodies: NDArray[np.int64], chosen: int) -> Iterator[str]:
    """Yield a note if there are several bodies (N,)."""
    count = int(bodies.max(initial=1))
    if count > 1:
        others = ", ".join(f"--body {number}" for number in range(1, count + 1) if number != chosen)
        yield f"The file shows {count} bodies. Body {chosen} moves, and the others stay still. For another: {others}"


def _plan(puppet: Puppet, plan: BodyPlan | None) -> BodyPlan | None:
    """Return the plan of a puppet's limbs; None for handles."""
    if not puppet.limb:
        return None
    return plan or plan_of({limb.name: np.array(limb.points) for limb in puppet.limb}, puppet.character.basis[1])


def _with_near_nodes(puppet: Puppet, character: CharacterMesh) -> Puppet:
    """Return a puppet without nodes if a joint of its file's skeleton is far from the limb that was read from it."""
    try:
        limb_nodes(puppet, character)
    except PuppetError:
        limbs = tuple(limb.model_copy(update={"nodes": None}) for limb in puppet.limb)
        return puppet.model_copy(update={"limb": limbs})
    return puppet


def fitting(
    values: dict[str, Any], tables: list[dict[str, Any]], surface: SolverMesh
) -> tuple[list[dict[str, Any]], list[str]]:
    """Return limbs that do not overlap and are inside the mesh, and a note if others were left out.

    Parameters
    ----------
    values : dict
        The other tables of the puppet; its handles do not count.
    tables : list of dict
        The limbs.
    surface : SolverMesh
    """
    if _is_valid(values | {"handle": [], "limb": tables}, surface):
        return tables, []
    kept: list[dict[str, Any]] = []
    for kind in sorted(dict.fromkeys(map(_kind, tables)), key=_importance):
        tried = [table for table in tables if table in kept or _kind(table) == kind]
        if _is_valid(values | {"handle": [], "limb": tried}, surface):
            kept = tried
    names = [table["name"] for table in tables if table not in kept]
    if {table["name"] for table in kept} - {"trunk", "neck", "head"}:
        is_or_are = "is" if len(names) == 1 else "are"
        return kept, [f"{' and '.join(names)} would overlap another limb or leave the mesh, and {is_or_are} left out."]
    return [], [
        "The limbs that were found overlap or leave the mesh, so handles are proposed instead. If the "
        "character has limbs, give their ends: --limb 'left leg=X,Y,Z' --limb 'right leg=X,Y,Z'"
    ]


def _kind(table: Mapping[str, Any]) -> str:
    """Return the name of a limb without its side."""
    name: str = table["name"]
    return name.removeprefix("left ").removeprefix("right ")


def _importance(kind: str) -> int:
    words = kind.split()
    return next((place for place, own in enumerate(IMPORTANCE) if own in words), len(IMPORTANCE))


def _is_valid(values: dict[str, Any], surface: SolverMesh) -> bool:
    try:
        check_limbs(check(values, "the proposal").limb, surface, "the proposal")
    except PuppetError:
        return False
    return True


def limbs_of(
    rig: RigBody | None,
    surface: SolverMesh,
    standing: CharacterTable,
    ends: Mapping[str, NDArray[np.float64]] = MappingProxyType({}),
) -> Limbs:
    """Return the limbs of the file's skeleton if it has any, else those of the shape; with the notes on both.

    Parameters
    ----------
    rig : RigBody or None
    surface : SolverMesh
    standing : CharacterTable
        Up and front.
    ends : mapping of str to (3,) float64
        See `solver.anatomy.limb_finding.find_limbs`.
    """
    if rig is not None and limb_tables(rig.limbs, standing):
        return rig.limbs
    shape = find_limbs(surface, standing.basis, ends)
    return replace(shape, notes=(*(rig.limbs.notes if rig is not None else ()), *shape.notes))


def with_plan_of(limbs: Limbs, plan: BodyPlan | None, up: NDArray[np.float64]) -> Limbs:
    """Return the likeliest limbs for which a body plan would be chosen; if there are none, the likeliest of all.

    Parameters
    ----------
    limbs : Limbs
    plan : BodyPlan or None
        None for limbs with any plan, with what else they may be.
    up : (3,) float64
    """
    if plan is None:
        return limbs
    for chains in (limbs.chains, *(other for _, other in limbs.others)):
        if plan_of(Limbs(chains).points, up) == plan:
            return Limbs(chains, limbs.notes)
    own = body_summary(plan_of(limbs.points, up), limbs.points)
    note = f"No limbs of the plan '{plan}' were found. These follow the performer by that plan: {own}."
    return replace(limbs, others=(), notes=(*limbs.notes, note) if limbs.chains else limbs.notes)


def _other_plan(limbs: Limbs, up: NDArray[np.float64]) -> Iterator[str]:
    """Yield a note on other limbs, if they are likely, with the option that takes them."""
    own = plan_of(limbs.points, up)
    for chance, chains in limbs.others:
        other = Limbs(chains).points
        plan = plan_of(other, up)
        if plan != own and chance >= MIN_OTHER_PROBABILITY:
            yield f"With a probability of {chance:.0%}, it is {body_summary(plan, other)}. If so: --plan '{plan}'"
            return


def _checked(plan: BodyPlan | None, limbs: Limbs) -> BodyPlan | None:
    """Return a plan that the user chose, or refuse it for a body without the limbs that it needs."""
    if plan is not None:
        fix = "Choose another plan, or give the ends of the missing limbs with --limb."
        check_plan(plan, limbs.points, at("the command line", field=f"--plan {plan}"), fix)
    return plan


def _places(ends: Mapping[str, str], surface: SolverMesh, where: str) -> dict[str, NDArray[np.float64]]:
    """Return the ends (3,) that the user gives; refuse those that are not on the surface."""
    places = {name: np.array(_numbers("--limb", name, text)) for name, text in ends.items()}
    _check_ends(ends, where)
    for name, point in places.items():
        check_on_surface(point, surface, at(where, field=f"--limb {name}={ends[name]}"))
    return places


def _check_ends(ends: Mapping[str, str], where: str) -> None:
    """Refuse unknown names, and one limb of a pair without the other."""
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
                expected="the ends of both limbs of a pair",
                fix=f"Add --limb '{other}=X,Y,Z'.",
            )


def _map(values: dict[str, Any], maps: Mapping[str, str], where: str) -> None:
    """Set the joints that the user gives for handles and limbs."""
    tables = {table["name"]: table for kind in ("handle", "limb") for table in values.get(kind, [])}
    handles = {handle["name"] for handle in values["handle"]}
    for name, joints in maps.items():
        if name not in tables:
            what = "handle" if handles else "limb"
            raise PuppetError(
                at(where, field=f"--map {name}={joints}"),
                found=f"no {what} {name!r}",
                expected=f"one of {', '.join(tables)}",
                fix=f"Use the name of one of these {what}s, or add a handle with --handle.",
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
            fix=f"Write it like {option} '{name}=0.1,1.5,0.2'.",
        ) from error
    return [x, y, z]
