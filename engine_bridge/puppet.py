"""The puppet file: which character, which handles, which joints move them.

TOML; the unit that users edit, share and load. `load` checks all of it and says what to mend; `dump` writes one.
"""

import difflib
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
import tomlkit
from numpy.typing import NDArray
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, FiniteFloat, ValidationError, model_validator
from pydantic_core import ErrorDetails, PydanticCustomError

from capture.skeleton import JOINT_INDEX, JOINTS
from capture.smoothing import Smoothing
from engine_bridge.files import written_whole
from puppetline.errors import PuppetError, at
from solver.reduced_model import ModelParameters
from solver.retarget import Mapping
from solver.rotations import RotationMode

Direction = Literal["x", "-x", "y", "-y", "z", "-z"]
AxisSet = Literal["", "x", "y", "z", "xy", "xz", "yz", "xyz"]
DEFAULT_SMOOTHING = Smoothing()


def _known_joint(name: str) -> str:
    if name not in JOINT_INDEX:
        close = difflib.get_close_matches(name, JOINTS, 1)
        hint = f"Did you mean {close[0]!r}?" if close else f"Choose one of them: {', '.join(JOINTS)}."
        raise PydanticCustomError("joint", "{hint}", {"hint": hint, "expected": "the name of a Kinect joint"})
    return name


JointName = Annotated[str, AfterValidator(_known_joint)]
Positive = Annotated[FiniteFloat, Field(gt=0)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class CharacterTable(_Table):
    """[character]: the mesh, relative to the puppet file, and how it stands in its own coordinates."""

    mesh: Annotated[str, Field(min_length=1)]
    up: Direction = "y"
    front: Direction = "z"

    @model_validator(mode="after")
    def _axes_differ(self) -> Self:
        if self.up[-1] == self.front[-1]:
            raise PydanticCustomError(
                "axes", "{hint}", {"hint": "Give front another axis.", "expected": "up and front along different axes"}
            )
        return self

    @property
    def basis(self) -> NDArray[np.float64]:
        """(3, 3): rows are the mesh's directions of the character's left, up and front."""
        up, front = (_unit_vector(direction) for direction in (self.up, self.front))
        return np.array([np.cross(up, front), up, front])


class HandleTable(_Table):
    """[[handle]]: a point on the surface, and the joints whose mean motion it follows."""

    name: Annotated[str, Field(min_length=1)]
    position: tuple[FiniteFloat, FiniteFloat, FiniteFloat]
    joint: JointName | None = None
    joints: Annotated[tuple[JointName, ...], Field(min_length=1)] | None = None
    axes: AxisSet = "xyz"
    gain: FiniteFloat = 1.0

    @model_validator(mode="after")
    def _one_of_the_two(self) -> Self:
        if self.joint is not None and self.joints is not None:
            raise PydanticCustomError(
                "joints", "{hint}", {"hint": "Leave one of them out.", "expected": "either joint or joints"}
            )
        return self

    @property
    def driven_by(self) -> tuple[str, ...]:
        """Its joints; none for a handle that stays where it is."""
        return self.joints or (() if self.joint is None else (self.joint,))


class RootTable(_Table):
    """[root]: the joint that carries the whole character."""

    joint: JointName = "hip_center"
    axes: AxisSet = "xz"


class RetargetTable(_Table):
    """[retarget]: mirror, and mesh units a metre."""

    mirror: bool = False
    scale: Literal["auto"] | Positive = "auto"


class SmoothingTable(_Table):
    """[smoothing]: see docs/smoothing.md; the defaults are those of `capture.smoothing.Smoothing`."""

    alpha: Annotated[FiniteFloat, Field(gt=0, le=1)] = DEFAULT_SMOOTHING.alpha
    gamma: Annotated[FiniteFloat, Field(ge=0, le=1)] = DEFAULT_SMOOTHING.gamma
    jitter_radius: Annotated[FiniteFloat, Field(ge=0)] = DEFAULT_SMOOTHING.jitter_radius
    max_deviation: Annotated[float, Field(gt=0)] = DEFAULT_SMOOTHING.max_deviation
    prediction: Annotated[FiniteFloat, Field(ge=0)] = DEFAULT_SMOOTHING.prediction

    @property
    def parameters(self) -> Smoothing:
        """The filter's own parameters."""
        return Smoothing(**self.model_dump())


class SolverTable(_Table):
    """[solver]: size of the reduced model, and work a frame."""

    fields: Annotated[int, Field(ge=1, le=64)] = 8
    isolines: Annotated[int, Field(ge=2, le=64)] = 10
    iterations: Annotated[int, Field(ge=1, le=1000)] = 4
    rotations: RotationMode = "covariance"

    @property
    def parameters(self) -> ModelParameters:
        """What the reduced model depends on."""
        return ModelParameters(fields=self.fields, isolines=self.isolines)


class Puppet(_Table):
    """A whole puppet file."""

    character: CharacterTable
    handle: Annotated[tuple[HandleTable, ...], Field(min_length=1)]
    root: RootTable | None = None
    retarget: RetargetTable = RetargetTable()
    smoothing: SmoothingTable = SmoothingTable()
    solver: SolverTable = SolverTable()

    @model_validator(mode="after")
    def _names_differ(self) -> Self:
        names = [handle.name for handle in self.handle]
        double = next((name for name in names if names.count(name) > 1), None)
        if double is not None:
            raise PydanticCustomError(
                "names",
                "{hint}",
                {"hint": f"Rename one of the two handles {double!r}.", "expected": "a name of its own for each handle"},
            )
        return self

    @property
    def handle_positions(self) -> NDArray[np.float64]:
        """(h, 3) float64, mesh file's coordinates."""
        return np.array([handle.position for handle in self.handle], dtype=np.float64)

    @property
    def mapping(self) -> Mapping:
        """M, the axis masks and the gains (Section 3.3)."""
        matrix = np.zeros((len(self.handle), len(JOINTS)))
        for row, handle in zip(matrix, self.handle, strict=True):
            for joint in handle.driven_by:
                row[JOINT_INDEX[joint]] += 1 / len(handle.driven_by)
        return Mapping(
            matrix=matrix,
            axes=np.array([axis_mask(handle.axes) for handle in self.handle]),
            gain=np.array([handle.gain for handle in self.handle]),
        )


def axis_mask(axes: str) -> NDArray[np.bool_]:
    """Turn ``"xz"`` into (True, False, True)."""
    return np.array([axis in axes for axis in "xyz"])


def _unit_vector(direction: str) -> NDArray[np.float64]:
    return np.eye(3)["xyz".index(direction[-1])] * (-1.0 if direction.startswith("-") else 1.0)


def load(path: Path) -> Puppet:
    """Read and check a puppet file.

    Raises
    ------
    PuppetError
        With the line of a syntax error, or the table and key of anything else.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise PuppetError(
            path,
            found=f"that it cannot be read ({error.strerror})",
            expected="a puppet file",
            fix="Check the path, or make one: puppetline new MESH -o PUPPET.toml",
        ) from error
    except UnicodeDecodeError as error:
        raise PuppetError(
            path, found="bytes that are not text", expected="a TOML file in UTF-8", fix="Check which file was given."
        ) from error
    try:
        values = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise PuppetError(
            path, found=f"a syntax error: {error}", expected="TOML", fix="Mend that line; text needs quotes."
        ) from error
    return check(values, path)


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
    try:
        return Puppet.model_validate(values)
    except ValidationError as error:
        raise _puppet_error(error.errors()[0], values, where) from error


def _puppet_error(error: ErrorDetails, values: dict[str, Any], where: str | Path) -> PuppetError:
    """Say a pydantic error in the words of the puppet file."""
    location = [part for part in error["loc"] if not (isinstance(part, str) and "[" in part) and part != "auto"]
    context = error.get("ctx", {})
    field = _field_name(location, values)
    if error["type"] == "extra_forbidden":
        known = _keys_beside(location)
        close = difflib.get_close_matches(str(location[-1]), known, 1)
        fix = f"Did you mean {close[0]!r}?" if close else "Remove it."
        found = f"the unknown key {location[-1]!r}"
        return PuppetError(at(where, field=field), found=found, expected=f"one of {', '.join(known)}", fix=fix)
    if error["type"] == "missing":
        return PuppetError(
            at(where, field=field), found="nothing", expected="a value", fix=f"Add the key {location[-1]!r} there."
        )
    if "hint" in context:
        found = repr(error["input"]) if isinstance(error["input"], str) else "what does not go together"
        return PuppetError(at(where, field=field), found=found, expected=context["expected"], fix=context["hint"])
    expected = error["msg"].removeprefix("Input should be ").replace("valid ", "")
    return PuppetError(
        at(where, field=field), found=repr(error["input"]), expected=expected, fix="Change the value of that key."
    )


def _field_name(location: list[Any], values: dict[str, Any]) -> str:
    """Write a place as a user sees it: ``[[handle]] 2 'tail', joint``."""
    if not location:
        return "the whole file"
    if location[0] != "handle" or len(location) < 2:
        table = f"[{location[0]}]" if len(location) > 1 else str(location[0])
        return ", ".join([table, *map(str, location[1:])])
    handle = values["handle"][location[1]] if isinstance(location[1], int) else {}
    name = f" {handle['name']!r}" if isinstance(handle, dict) and isinstance(handle.get("name"), str) else ""
    return ", ".join([f"[[handle]] {location[1] + 1}{name}", *map(str, location[2:])])


def _keys_beside(location: list[Any]) -> list[str]:
    """List the keys that may stand where an unknown one stands."""
    tables: dict[str, type[_Table]] = {
        "character": CharacterTable,
        "handle": HandleTable,
        "root": RootTable,
        "retarget": RetargetTable,
        "smoothing": SmoothingTable,
        "solver": SolverTable,
    }
    return list((tables[location[0]] if len(location) > 1 else Puppet).model_fields)


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
    handles = tomlkit.aot()
    for handle in values["handle"]:
        table = tomlkit.table()
        table.update({key: list(value) if isinstance(value, tuple) else value for key, value in handle.items()})
        handles.append(table)
    document["handle"] = handles
    for name in ("root", "retarget", "smoothing", "solver"):
        table = getattr(puppet, name)
        if table is not None and (name in values or name == "root"):
            document[name] = table.model_dump() if name == "root" else values[name]
    return tomlkit.dumps(document)
