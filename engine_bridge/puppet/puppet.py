"""Contents of a puppet file: a character, its limbs and handles, and the joints that move them."""

import difflib
import re
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, FiniteFloat, StrictBool, model_validator

from capture.channels import ALL_CHANNELS
from capture.skeleton import JOINT_INDEX, JOINTS
from capture.smoothing import Smoothing
from puppetline.toml_schema import Kind, Table, check_distinct, mistake
from solver.anatomy.axes import basis_of, unit_vector
from solver.model.reduced_model import ModelParameters
from solver.model.rotations import RotationMode
from solver.motion.limbs import TRUNK, Follow, Limb
from solver.motion.retarget import Mapping

Direction = Literal["x", "-x", "y", "-y", "z", "-z"]
AxisSet = Literal["", "x", "y", "z", "xy", "xz", "yz", "xyz"]
DEFAULT_SMOOTHING = Smoothing()
MAX_ISOLINES = 640
"""Maximum number of isolines of all fields. Memory grows with its square; this number takes half a gigabyte."""

OVERLAP_SHARE = 0.05
"""Distance of a bone's middle from another limb's bone, as a share of its length, below which the two overlap."""


def _known_joint(name: str) -> str:
    if name not in JOINT_INDEX:
        close = difflib.get_close_matches(name, JOINTS, 1)
        fix = f"Did you mean {close[0]!r}?" if close else f"Choose one of these: {', '.join(JOINTS)}."
        raise mistake(found=repr(name), expected="the name of a Kinect joint", fix=fix)
    return name


def _web_address(text: str) -> str:
    if not re.fullmatch(r"https?://[^\s/]+\S*", text):
        raise mistake(
            found=repr(text),
            expected="the web address of a licence's text",
            fix="Write it like https://creativecommons.org/licenses/by/4.0/",
        )
    return text


JointName = Annotated[str, AfterValidator(_known_joint)]
Text = Annotated[str, Field(min_length=1)]
# strict, because TOML has types: true is not 1.0
Number = Annotated[FiniteFloat, Field(strict=True, ge=-1e9, le=1e9)]
Count = Annotated[int, Field(strict=True)]
Scale = Literal["auto"] | Annotated[Number, Field(gt=0)]


class CharacterTable(Table):
    """[character]: the mesh's path relative to the puppet file, its orientation, and metres per mesh unit.

    `turn` is the angle, in degrees, by which the character is turned from `front` to its left. `body` is the number of
    the body that moves, if the mesh shows several, or something that stays still.
    """

    mesh: Text
    up: Direction = "y"
    front: Direction = "z"
    turn: Annotated[Number, Field(ge=-180, le=180)] = 0.0
    scale: Annotated[Number, Field(gt=0)] = 1.0
    body: Annotated[Count, Field(ge=1)] | None = None

    @model_validator(mode="after")
    def _axes_differ(self) -> Self:
        if self.up[-1] == self.front[-1]:
            raise mistake(
                "front",
                found=f"front {self.front!r} with up {self.up!r}",
                expected="up and front along different axes",
                fix="Choose another axis for front.",
            )
        return self

    @property
    def basis(self) -> NDArray[np.float64]:
        """(3, 3): rows are the mesh's directions of the character's left, up and front."""
        return basis_of(self.up, self.front, self.turn)


Point = tuple[Number, Number, Number]
Channel = Literal[ALL_CHANNELS]  # type: ignore[valid-type]

MIN_RANGE = 0.01
"""Smallest difference of the two values of a channel that become 0 and 1."""


class HandleTable(Table):
    """[[handle]]: a point on the surface, the joints whose mean motion it follows, and a channel that moves it."""

    name: Text
    position: Point
    joint: JointName | None = None
    joints: Annotated[tuple[JointName, ...], Field(min_length=1)] | None = None
    axes: AxisSet = "xyz"
    gain: Number = 1.0
    channel: Channel | None = None
    moves: Point = (0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _check_joints(self) -> Self:
        if self.joint is not None and self.joints is not None:
            raise mistake(
                "joints",
                found="both joint and joints",
                expected="either joint or joints",
                fix="Remove one of the keys.",
            )
        if (self.channel is not None) != any(self.moves):
            raise mistake(
                "moves",
                found="channel without moves" if self.channel else "moves without channel",
                expected="a channel, and how far it moves the handle along x, y and z",
                fix='Write both, such as channel = "voice" and moves = [0, -0.05, 0], or neither.',
            )
        return self

    @property
    def driven_by(self) -> tuple[str, ...]:
        """Names of its joints; empty for a handle that does not move."""
        return self.joints or (() if self.joint is None else (self.joint,))


class BendTable(Table):
    """bend of [[limb]]: how far a channel turns it about its first point, and the mesh file's axis."""

    channel: Channel
    degrees: Annotated[Number, Field(ge=-180, le=180)]
    axis: Direction = "x"

    @property
    def turn(self) -> NDArray[np.float64]:
        """(3,): axis times angle in radians, when the channel is 1."""
        return np.radians(self.degrees) * unit_vector(self.axis)


class MorphTable(Table):
    """[[morph]]: a morph target that the mesh has, and the channel that moves it."""

    target: Text
    channel: Channel
    gain: Number = 1.0


class ChannelTable(Table):
    """[[channel]]: the values of a channel that count as 0 and as 1, such as those of a closed and an open mouth."""

    name: Channel
    neutral: Number = 0.0
    full: Number = 1.0

    @model_validator(mode="after")
    def _check_range(self) -> Self:
        if abs(self.full - self.neutral) < MIN_RANGE:
            raise mistake(
                "full",
                found=f"full {self.full:g} with neutral {self.neutral:g}",
                expected=f"values that differ by at least {MIN_RANGE:g}",
                fix="Write the channel's value when nothing moves as neutral, and the largest one as full.",
            )
        return self


class LimbTable(Table):
    """[[limb]]: a chain of points inside the character, and the chain of joints that it follows.

    `nodes` are the joints of the file's skeleton that it was read from, root to tip (`limb_nodes.node_labels`).
    """

    name: Text
    nodes: Annotated[tuple[Text, ...], Field(min_length=1)] | None = None
    points: tuple[Point, ...]
    joints: tuple[JointName | Annotated[tuple[JointName, ...], Field(min_length=1)], ...]
    follow: Follow = "direction"
    gain: Number = 1.0
    parent: Text | None = None
    stands: StrictBool = False
    delay: Annotated[Number, Field(ge=0, le=2)] = 0.0
    bend: BendTable | None = None

    @model_validator(mode="after")
    def _check_chain(self) -> Self:
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
                fix="Give both lists the same length. To average several joints, put them in brackets.",
            )
        for number, (head, tail) in enumerate(pairwise(self.points), 2):
            if head == tail:
                raise mistake(
                    "points",
                    number - 1,
                    found=f"[{', '.join(f'{x:g}' for x in tail)}], which equals the point before it",
                    expected="a point that differs from the one before it",
                    fix="Remove one of the two points and its joint.",
                )
        return self

    @property
    def driven_by(self) -> tuple[tuple[str, ...], ...]:
        """Names of each point's joints."""
        return tuple((joint,) if isinstance(joint, str) else joint for joint in self.joints)


class RootTable(Table):
    """[root]: the joint that moves the whole character, and whether the character turns and stands on its feet."""

    joint: JointName = "hip_center"
    axes: AxisSet = "xz"
    turns: StrictBool = True
    feet: Literal["lock", "free"] = "lock"
    walk: Literal["in place", "forward"] = "in place"


class RetargetTable(Table):
    """[retarget]: mirroring, metres of the character per metre of the performer, and adjustments of the arms."""

    mirror: StrictBool = False
    scale: Scale = "auto"
    arm_space: Annotated[Number, Field(ge=-90, le=90)] = 0.0
    hands_meet: StrictBool = True


class SmoothingTable(Table):
    """[smoothing]: parameters of `capture.smoothing.Smoothing` (docs/smoothing.md)."""

    alpha: Annotated[Number, Field(gt=0, le=1)] = DEFAULT_SMOOTHING.alpha
    gamma: Annotated[Number, Field(ge=0, le=1)] = DEFAULT_SMOOTHING.gamma
    jitter_radius: Annotated[Number, Field(ge=0)] = DEFAULT_SMOOTHING.jitter_radius
    max_deviation: Annotated[float, Field(gt=0, strict=True)] = DEFAULT_SMOOTHING.max_deviation
    prediction: Annotated[Number, Field(ge=0)] = DEFAULT_SMOOTHING.prediction

    @property
    def parameters(self) -> Smoothing:
        """Parameters of the filter."""
        return Smoothing(**self.model_dump())


class SolverTable(Table):
    """[solver]: size of the reduced model, and iterations per frame."""

    fields: Annotated[Count, Field(ge=1, le=64)] = 8
    isolines: Annotated[Count, Field(ge=2, le=64)] = 10
    iterations: Annotated[Count, Field(ge=1, le=1000)] = 4
    rotations: RotationMode | None = None

    @model_validator(mode="after")
    def _check_size(self) -> Self:
        if self.fields * self.isolines > MAX_ISOLINES:
            raise mistake(
                "isolines",
                found=f"{self.fields} fields with {self.isolines} isolines each",
                expected=f"at most {MAX_ISOLINES} isolines in total",
                fix="Lower one of the two numbers; 8 fields of 10 isolines suit most characters.",
            )
        return self

    @property
    def parameters(self) -> ModelParameters:
        """Parameters of the reduced model."""
        return ModelParameters(fields=self.fields, isolines=self.isolines)


class VrmTable(Table):
    """[vrm]: what an avatar in VRM states about itself."""

    name: Text
    authors: Annotated[tuple[Text, ...], Field(min_length=1)]
    licence: Annotated[str, AfterValidator(_web_address)]
    version: Text | None = None


class Puppet(Table):
    """All tables of a puppet file."""

    file_kind: ClassVar[Kind | None] = "puppet"

    character: CharacterTable
    limb: tuple[LimbTable, ...] = ()
    handle: tuple[HandleTable, ...] = ()
    morph: tuple[MorphTable, ...] = ()
    channel: tuple[ChannelTable, ...] = ()
    root: RootTable | None = None
    retarget: RetargetTable = RetargetTable()
    smoothing: SmoothingTable = SmoothingTable()
    solver: SolverTable = SolverTable()
    vrm: VrmTable | None = None

    @model_validator(mode="after")
    def _check_not_empty(self) -> Self:
        if not self.limb and not self.handle:
            raise mistake(
                found="neither a limb nor a handle",
                expected="at least one limb or handle",
                fix="Add a table [[limb]] or [[handle]].",
            )
        return self

    @model_validator(mode="after")
    def _check_names(self) -> Self:
        for kind, tables_ in (("limb", self.limb), ("handle", self.handle), ("channel", self.channel)):
            check_distinct([table.name for table in tables_], kind)
        return self

    @model_validator(mode="after")
    def _check_parents(self) -> Self:
        names = [limb.name for limb in self.limb]
        for index, limb in enumerate(self.limb):
            if limb.parent is not None and limb.parent not in names:
                others = [name for name in names if name != limb.name]
                raise mistake(
                    "limb",
                    index,
                    "parent",
                    found=f"{limb.parent!r}, which is not the name of a limb",
                    expected="the name of another limb" + (f": {', '.join(others)}" if others else ""),
                    fix="Correct the name, or remove the key parent.",
                )
        for index, limb in enumerate(self.limb):
            cycle = self._with_ancestors(limb.name)
            if cycle[-1] == limb.name and len(cycle) > 1:
                raise mistake(
                    "limb",
                    index,
                    "parent",
                    found=f"a cycle of parents: {', '.join(map(repr, cycle))}",
                    expected="parents that lead to a limb without a parent",
                    fix="Change or remove the parent of one of these limbs.",
                )
        return self

    @model_validator(mode="after")
    def _check_overlaps(self) -> Self:
        for index, limb in enumerate(self.limb):
            for other in self.limb[:index]:
                if _overlap(limb, other):
                    raise mistake(
                        "limb",
                        index,
                        "points",
                        found=f"a bone that overlaps a bone of the limb {other.name!r}",
                        expected="limbs that touch only where one joins the other",
                        fix="Remove one of the two limbs, or move its points.",
                    )
        return self

    def _with_ancestors(self, name: str) -> list[str]:
        """Return the names of a limb and its ancestors, up to the root or the first name that repeats."""
        parents, names = self.limb_parents, [name]
        while (parent := parents[names[-1]]) is not None:
            names.append(parent)
            if parent in names[:-1]:
                break
        return names

    @property
    def limb_parents(self) -> dict[str, str | None]:
        """Each limb's parent: the one in the file, else the trunk if there is one."""
        has_trunk = any(limb.name == TRUNK for limb in self.limb)
        return {limb.name: limb.parent or (TRUNK if has_trunk and limb.name != TRUNK else None) for limb in self.limb}

    @property
    def limbs(self) -> tuple[Limb, ...]:
        """The limbs, with joints as indices into `JOINTS`."""
        parents = self.limb_parents
        return tuple(
            Limb(
                limb.name,
                np.array(limb.points, dtype=np.float64),
                tuple(tuple(JOINT_INDEX[joint] for joint in joints) for joints in limb.driven_by),
                limb.follow,
                limb.gain,
                parents[limb.name],
                limb.stands,
                limb.delay,
            )
            for limb in self.limb
        )

    @property
    def turns(self) -> bool:
        """Whether the character turns with the performer."""
        return self.root is None or self.root.turns

    @property
    def targets(self) -> tuple[str, ...]:
        """Names of the mesh's morph targets that channels move, each once."""
        return tuple(dict.fromkeys(morph.target for morph in self.morph))

    @property
    def driven_by(self) -> tuple[str, ...]:
        """Names of all joints that move the character, in the order of `JOINTS`."""
        used = {joint for handle in self.handle for joint in handle.driven_by}
        used |= {joint for limb in self.limb for joints in limb.driven_by for joint in joints}
        if self.root is not None:
            used.add(self.root.joint)
        return tuple(joint for joint in JOINTS if joint in used)

    @property
    def units_per_metre(self) -> float | None:
        """Mesh units that the character moves per metre of the performer; None for an automatic scale."""
        return None if self.retarget.scale == "auto" else self.retarget.scale / self.character.scale

    @property
    def handle_positions(self) -> NDArray[np.float64]:
        """Positions of the handles (h, 3) float64, file coordinates."""
        return np.array([handle.position for handle in self.handle], dtype=np.float64).reshape(-1, 3)

    @property
    def mapping(self) -> Mapping:
        """Matrix M, axis masks and gains of the handles (Section 3.3)."""
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
    """Return a copy of a puppet in which one handle has other joints, axes and gain."""
    handles = list(puppet.handle)
    changed: dict[str, Any] = {"axes": axes, "gain": gain}
    if joints != handles[index].driven_by:
        changed |= {"joint": None, "joints": None} | ({"joint": joints[0]} if len(joints) == 1 else {})
        changed |= {"joints": joints} if len(joints) > 1 else {}
    handles[index] = handles[index].model_copy(update=changed)
    return puppet.model_copy(update={"handle": tuple(handles)})


def has_same_model(one: Puppet, other: Puppet) -> bool:
    """Return whether two puppets differ in their mapping only: root motion, retargeting, and what moves each handle."""
    mapping = {"joint": None, "joints": None, "axes": "xyz", "gain": 1.0}

    def without_mapping(puppet: Puppet) -> Puppet:
        handles = tuple(handle.model_copy(update=mapping) for handle in puppet.handle)
        return puppet.model_copy(update={"handle": handles, "root": None, "retarget": other.retarget})

    return without_mapping(one) == without_mapping(other)


def axis_mask(axes: str) -> NDArray[np.bool_]:
    """Turn ``"xz"`` into (True, False, True)."""
    return np.array([axis in axes for axis in "xyz"])


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def _overlap(one: LimbTable, other: LimbTable) -> bool:
    """Return whether a bone of one limb lies along a bone of another: the middle of the shorter is on the longer."""
    for a in pairwise(np.array(one.points)):
        for b in pairwise(np.array(other.points)):
            (start, end), (from_, to) = sorted((a, b), key=lambda bone: float(np.linalg.norm(bone[1] - bone[0])))
            middle, along = (start + end) / 2, to - from_
            share = np.clip((middle - from_) @ along / (along @ along), 0, 1)
            if np.linalg.norm(middle - from_ - share * along) < OVERLAP_SHARE * np.linalg.norm(end - start):
                return True
    return False
