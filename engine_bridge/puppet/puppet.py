"""The puppet file: which character, which limbs and handles, which joints move them.

TOML; the unit that users edit, share and load. `load` checks all of it and says what to mend; `dump` writes one.
"""

import difflib
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
import tomlkit
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, FiniteFloat, StrictBool, model_validator

from capture.skeleton import JOINT_INDEX, JOINTS
from capture.smoothing import Smoothing
from puppetline import toml_schema
from puppetline.errors import PuppetError
from puppetline.files import written_whole
from puppetline.toml_schema import Table, mistake
from solver.model.reduced_model import ModelParameters
from solver.model.rotations import RotationMode
from solver.motion.limbs import TRUNK, Follow, Limb
from solver.motion.retarget import Mapping

Direction = Literal["x", "-x", "y", "-y", "z", "-z"]
AxisSet = Literal["", "x", "y", "z", "xy", "xz", "yz", "xyz"]
DEFAULT_SMOOTHING = Smoothing()
MAX_ISOLINES = 640
"""Memory grows with the square of this; eight times the default take half a gigabyte."""


OVERLAP_SHARE = 0.05
"""Distance of a bone's middle from another limb's bone, as a share of its length, below which both hold one region."""


def _known_joint(name: str) -> str:
    if name not in JOINT_INDEX:
        close = difflib.get_close_matches(name, JOINTS, 1)
        fix = f"Did you mean {close[0]!r}?" if close else f"Choose one of them: {', '.join(JOINTS)}."
        raise mistake(found=repr(name), expected="the name of a Kinect joint", fix=fix)
    return name


JointName = Annotated[str, AfterValidator(_known_joint)]
# strict: TOML has types, and true is not 1.0
Number = Annotated[FiniteFloat, Field(strict=True, ge=-1e9, le=1e9)]
Count = Annotated[int, Field(strict=True)]
Scale = Literal["auto"] | Annotated[Number, Field(gt=0)]


class CharacterTable(Table):
    """[character]: the mesh, relative to the puppet file, how it stands in its own coordinates, and metres a unit."""

    mesh: Annotated[str, Field(min_length=1)]
    up: Direction = "y"
    front: Direction = "z"
    scale: Annotated[Number, Field(gt=0)] = 1.0

    @model_validator(mode="after")
    def _axes_differ(self) -> Self:
        if self.up[-1] == self.front[-1]:
            raise mistake(
                "front",
                found=f"{self.front!r}, and up is {self.up!r}",
                expected="up and front along different axes",
                fix="Give front another axis.",
            )
        return self

    @property
    def basis(self) -> NDArray[np.float64]:
        """(3, 3): rows are the mesh's directions of the character's left, up and front."""
        up, front = (_unit_vector(direction) for direction in (self.up, self.front))
        return np.array([np.cross(up, front), up, front])


Point = tuple[Number, Number, Number]


class HandleTable(Table):
    """[[handle]]: a point on the surface, and the joints whose mean motion it follows."""

    name: Annotated[str, Field(min_length=1)]
    position: Point
    joint: JointName | None = None
    joints: Annotated[tuple[JointName, ...], Field(min_length=1)] | None = None
    axes: AxisSet = "xyz"
    gain: Number = 1.0

    @model_validator(mode="after")
    def _one_of_the_two(self) -> Self:
        if self.joint is not None and self.joints is not None:
            raise mistake(
                "joints", found="both joint and joints", expected="one of the two", fix="Leave one of them out."
            )
        return self

    @property
    def driven_by(self) -> tuple[str, ...]:
        """Its joints; none for a handle that stays where it is."""
        return self.joints or (() if self.joint is None else (self.joint,))


class LimbTable(Table):
    """[[limb]]: a chain of points inside the character, and the chain of joints that it follows."""

    name: Annotated[str, Field(min_length=1)]
    points: tuple[Point, ...]
    joints: tuple[JointName | Annotated[tuple[JointName, ...], Field(min_length=1)], ...]
    follow: Follow = "direction"
    gain: Number = 1.0
    parent: Annotated[str, Field(min_length=1)] | None = None

    @model_validator(mode="after")
    def _is_a_chain(self) -> Self:
        if len(self.points) < 2:
            raise mistake(
                "points",
                found=["no point", "one point"][len(self.points)],
                expected="at least two points, from root to tip",
                fix="Add the point at the other end of the limb.",
            )
        if len(self.points) != len(self.joints):
            raise mistake(
                "joints",
                found=f"{_counted(len(self.joints), 'joint')} for {_counted(len(self.points), 'point')}",
                expected="one joint for each point",
                fix="Give both lists the same length; several joints in brackets of their own are averaged.",
            )
        for number, (head, tail) in enumerate(pairwise(self.points), 2):
            if head == tail:
                raise mistake(
                    "points",
                    number - 1,
                    found=f"[{', '.join(f'{x:g}' for x in tail)}], as the point before",
                    expected="points apart from each other",
                    fix="Remove one of the two, and its joint.",
                )
        return self

    @property
    def driven_by(self) -> tuple[tuple[str, ...], ...]:
        """The joints of each point."""
        return tuple((joint,) if isinstance(joint, str) else joint for joint in self.joints)


class RootTable(Table):
    """[root]: the joint that carries the whole character, and whether the character turns and stands on its feet."""

    joint: JointName = "hip_center"
    axes: AxisSet = "xz"
    turns: StrictBool = True
    feet: Literal["lock", "free"] = "lock"


class RetargetTable(Table):
    """[retarget]: mirror, the character's metres for one of the performer's, and what its arms do otherwise."""

    mirror: StrictBool = False
    scale: Scale = "auto"
    arm_space: Annotated[Number, Field(ge=-90, le=90)] = 0.0
    hands_meet: StrictBool = True


class SmoothingTable(Table):
    """[smoothing]: see docs/smoothing.md; the defaults are those of `capture.smoothing.Smoothing`."""

    alpha: Annotated[Number, Field(gt=0, le=1)] = DEFAULT_SMOOTHING.alpha
    gamma: Annotated[Number, Field(ge=0, le=1)] = DEFAULT_SMOOTHING.gamma
    jitter_radius: Annotated[Number, Field(ge=0)] = DEFAULT_SMOOTHING.jitter_radius
    max_deviation: Annotated[float, Field(gt=0, strict=True)] = DEFAULT_SMOOTHING.max_deviation
    prediction: Annotated[Number, Field(ge=0)] = DEFAULT_SMOOTHING.prediction

    @property
    def parameters(self) -> Smoothing:
        """The filter's own parameters."""
        return Smoothing(**self.model_dump())


class SolverTable(Table):
    """[solver]: size of the reduced model, and work a frame."""

    fields: Annotated[Count, Field(ge=1, le=64)] = 8
    isolines: Annotated[Count, Field(ge=2, le=64)] = 10
    iterations: Annotated[Count, Field(ge=1, le=1000)] = 4
    rotations: RotationMode | None = None

    @model_validator(mode="after")
    def _fits_in_memory(self) -> Self:
        if self.fields * self.isolines > MAX_ISOLINES:
            raise mistake(
                "isolines",
                found=f"{self.fields} fields with {self.isolines} isolines each",
                expected=f"no more than {MAX_ISOLINES} isolines together",
                fix="Lower one of the two; 8 and 10 are a sound choice.",
            )
        return self

    @property
    def parameters(self) -> ModelParameters:
        """What the reduced model depends on."""
        return ModelParameters(fields=self.fields, isolines=self.isolines)


class Puppet(Table):
    """A whole puppet file."""

    character: CharacterTable
    limb: tuple[LimbTable, ...] = ()
    handle: tuple[HandleTable, ...] = ()
    root: RootTable | None = None
    retarget: RetargetTable = RetargetTable()
    smoothing: SmoothingTable = SmoothingTable()
    solver: SolverTable = SolverTable()

    @model_validator(mode="after")
    def _something_moves(self) -> Self:
        if not self.limb and not self.handle:
            raise mistake(
                found="neither a limb nor a handle",
                expected="at least one of them",
                fix="Add a table [[limb]] or [[handle]].",
            )
        return self

    @model_validator(mode="after")
    def _names_differ(self) -> Self:
        for kind, tables_ in (("limb", self.limb), ("handle", self.handle)):
            names = [table.name for table in tables_]
            for index, name in enumerate(names):
                if name in names[:index]:
                    raise mistake(
                        kind,
                        index,
                        "name",
                        found=f"{name!r} again",
                        expected=f"a name of its own for each {kind}",
                        fix=f"Rename one of the two {kind}s {name!r}.",
                    )
        return self

    @model_validator(mode="after")
    def _limbs_hang_together(self) -> Self:
        names = [limb.name for limb in self.limb]
        for index, limb in enumerate(self.limb):
            if limb.parent is not None and limb.parent not in names:
                others = [name for name in names if name != limb.name]
                raise mistake(
                    "limb",
                    index,
                    "parent",
                    found=f"{limb.parent!r}, and there is no limb of that name",
                    expected="the name of another limb" + (f": {', '.join(others)}" if others else ""),
                    fix="Correct the name, or leave parent out.",
                )
        for index, limb in enumerate(self.limb):
            circle = self._way_to_the_root(limb.name)
            if circle[-1] == limb.name and len(circle) > 1:
                raise mistake(
                    "limb",
                    index,
                    "parent",
                    found=f"a circle: {' on '.join(map(repr, circle))}",
                    expected="limbs that hang on each other up to one that hangs on none",
                    fix="Give one of them another parent, or none.",
                )
        return self

    @model_validator(mode="after")
    def _limbs_lie_apart(self) -> Self:
        for index, limb in enumerate(self.limb):
            for other in self.limb[:index]:
                if _overlap(limb, other):
                    raise mistake(
                        "limb",
                        index,
                        "points",
                        found=f"bones in the same place as those of the limb {other.name!r}",
                        expected="limbs that lie apart and touch at most where one hangs on the other",
                        fix="Remove one of the two limbs, or move its points.",
                    )
        return self

    def _way_to_the_root(self, name: str) -> list[str]:
        """Return the names of a limb and those that it hangs on, up to the root or the first that comes again."""
        parents, way = self.limb_parents, [name]
        while (parent := parents[way[-1]]) is not None:
            way.append(parent)
            if parent in way[:-1]:
                break
        return way

    @property
    def limb_parents(self) -> dict[str, str | None]:
        """What each limb hangs on: what it says, or the trunk."""
        there = any(limb.name == TRUNK for limb in self.limb)
        return {limb.name: limb.parent or (TRUNK if there and limb.name != TRUNK else None) for limb in self.limb}

    @property
    def limbs(self) -> tuple[Limb, ...]:
        """The limbs, their joints by number."""
        parents = self.limb_parents
        return tuple(
            Limb(
                limb.name,
                np.array(limb.points, dtype=np.float64),
                tuple(tuple(JOINT_INDEX[joint] for joint in joints) for joints in limb.driven_by),
                limb.follow,
                limb.gain,
                parents[limb.name],
            )
            for limb in self.limb
        )

    @property
    def turns(self) -> bool:
        """Whether the character turns with the performer."""
        return self.root is None or self.root.turns

    @property
    def driven_by(self) -> tuple[str, ...]:
        """All joints that move anything, in the order of `JOINTS`."""
        used = {joint for handle in self.handle for joint in handle.driven_by}
        used |= {joint for limb in self.limb for joints in limb.driven_by for joint in joints}
        if self.root is not None:
            used.add(self.root.joint)
        return tuple(joint for joint in JOINTS if joint in used)

    @property
    def units_per_metre(self) -> float | None:
        """Mesh units that the character moves for a metre of the performer; None where that is to be found out."""
        return None if self.retarget.scale == "auto" else self.retarget.scale / self.character.scale

    @property
    def handle_positions(self) -> NDArray[np.float64]:
        """(h, 3) float64, mesh file's coordinates."""
        return np.array([handle.position for handle in self.handle], dtype=np.float64).reshape(-1, 3)

    @property
    def mapping(self) -> Mapping:
        """M, the axis masks and the gains (Section 3.3)."""
        matrix = np.zeros((len(self.handle), len(JOINTS)))
        for row, handle in zip(matrix, self.handle, strict=True):
            for joint in handle.driven_by:
                row[JOINT_INDEX[joint]] += 1 / len(handle.driven_by)
        return Mapping(
            matrix=matrix,
            axes=np.array([axis_mask(handle.axes) for handle in self.handle], dtype=bool).reshape(-1, 3),
            gain=np.array([handle.gain for handle in self.handle], dtype=np.float64),
        )


def with_handle(puppet: Puppet, index: int, joints: tuple[str, ...], axes: AxisSet, gain: float) -> Puppet:
    """Return a puppet one of whose handles is moved otherwise."""
    handles = list(puppet.handle)
    changed: dict[str, Any] = {"axes": axes, "gain": gain}
    if joints != handles[index].driven_by:
        changed |= {"joint": None, "joints": None} | ({"joint": joints[0]} if len(joints) == 1 else {})
        changed |= {"joints": joints} if len(joints) > 1 else {}
    handles[index] = handles[index].model_copy(update=changed)
    return puppet.model_copy(update={"handle": tuple(handles)})


def axis_mask(axes: str) -> NDArray[np.bool_]:
    """Turn ``"xz"`` into (True, False, True)."""
    return np.array([axis in axes for axis in "xyz"])


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def _overlap(one: LimbTable, other: LimbTable) -> bool:
    """Tell whether a bone of one limb lies along a bone of another: the middle of the shorter is on the longer."""
    for a in pairwise(np.array(one.points)):
        for b in pairwise(np.array(other.points)):
            (start, end), (from_, to) = sorted((a, b), key=lambda bone: float(np.linalg.norm(bone[1] - bone[0])))
            middle, along = (start + end) / 2, to - from_
            share = np.clip((middle - from_) @ along / (along @ along), 0, 1)
            if np.linalg.norm(middle - from_ - share * along) < OVERLAP_SHARE * np.linalg.norm(end - start):
                return True
    return False


def _unit_vector(direction: str) -> NDArray[np.float64]:
    return np.eye(3)["xyz".index(direction[-1])] * (-1.0 if direction.startswith("-") else 1.0)


def load(path: Path) -> Puppet:
    """Read and check a puppet file.

    Raises
    ------
    PuppetError
        With the line of a syntax error, or the table and key of anything else.
    """
    return loads(read(path), path)


def read(path: Path) -> str:
    """Read a puppet file without looking at what it says.

    Raises
    ------
    PuppetError
    """
    fix = "Check the path, or make one: puppetline new MESH -o PUPPET.toml"
    return toml_schema.read_text(path, "a puppet file", fix, PuppetError)


def loads(text: str, where: str | Path) -> Puppet:
    """Parse and check the text of a puppet file.

    Parameters
    ----------
    text : str
    where : str or Path
        What error messages call it.

    Raises
    ------
    PuppetError
        As `load` does.
    """
    return check(toml_schema.parse(text, where, PuppetError), where)


def check(values: dict[str, Any], where: str | Path) -> Puppet:
    """Check a puppet's values.

    Parameters
    ----------
    values : dict
        As parsed from TOML.
    where : str or Path
        What error messages call it.

    Raises
    ------
    PuppetError
        For the first thing that is wrong.
    """
    return toml_schema.check(Puppet, values, where, PuppetError)


def dump(puppet: Puppet, path: Path) -> None:
    """Write a puppet file, whole or not at all; `load` gives an equal puppet back.

    Raises
    ------
    OutputError
    """
    with written_whole(path) as beside:
        beside.write_text(dumps(puppet), encoding="utf-8")


def dumps(puppet: Puppet) -> str:
    """Return a puppet as TOML, without the values that are defaults."""
    values = puppet.model_dump(exclude_none=True, exclude_defaults=True)
    document = tomlkit.document()
    document["character"] = values["character"]
    for name in ("limb", "handle"):
        if name in values:
            document[name] = tomlkit.aot()
            for each in values[name]:
                table = tomlkit.table()
                table.update({key: _as_list(value) for key, value in each.items()})
                document[name].append(table)
    if puppet.root is not None:
        document["root"] = root_values(puppet.root)
    for name in ("retarget", "smoothing", "solver"):
        if name in values:
            document[name] = values[name]
    return tomlkit.dumps(document)


def root_values(root: RootTable) -> dict[str, Any]:
    """Return what a file says of a root: joint and axes always, since the table stands for itself."""
    return {"joint": root.joint, "axes": root.axes} | root.model_dump(exclude_defaults=True)


def _as_list(value: Any) -> Any:
    """Return tuples of tuples as lists of lists: what TOML has."""
    return [_as_list(item) for item in value] if isinstance(value, tuple) else value
