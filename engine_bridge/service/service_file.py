"""The service file: which sources, which characters, and who may listen.

TOML; `load` checks all of it and says what to mend. What the command line gives makes the same settings.
"""

import re
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, FiniteFloat, StrictBool, model_validator

from engine_bridge.service.character_player import Calibrate, Manner
from engine_bridge.service.security.endpoints import NetworkSettings
from engine_bridge.service.stage import Direction
from engine_bridge.service.user_assignment import People
from puppetline import toml_schema
from puppetline.errors import ServiceError
from puppetline.toml_schema import Table, mistake

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,32}$")]
"""What a character or stage is called on the wire."""

Text = Annotated[str, Field(strict=True, min_length=1)]
Port = Annotated[int, Field(strict=True, ge=1, le=65535)]
Seconds = Annotated[FiniteFloat, Field(strict=True, ge=0, le=86400)]
OscKind = Literal["controls", "morphs", "joints", "handles", "vertices", "performer", "vmc"]

RESERVED = "service"
"""No character's name: what the service says of itself is published under it."""


class CharacterTable(Table):
    """[[stage.character]]: a puppet, and what goes with it; files are relative to the service file."""

    puppet: Text
    name: Name | None = None
    morphs: Text | None = None
    idle: Text | None = None


class StageTable(Table):
    """[[stage]]: a source and the characters that its performers play; see `Direction` and `Manner`."""

    source: Text
    character: Annotated[tuple[CharacterTable, ...], Field(min_length=1, max_length=64)]
    name: Name | None = None
    people: People = "each"
    turn: Annotated[Seconds, Field(gt=0)] = 60.0
    calibrate: Calibrate = "still"
    lost_after: Annotated[Seconds, Field(gt=0)] = 0.5
    remember: Seconds = 30.0
    ease: Seconds = 0.8
    least_confidence: Annotated[FiniteFloat, Field(strict=True, ge=0, le=1)] = 0.25
    tilt: Literal["auto"] | Annotated[FiniteFloat, Field(strict=True, ge=-60, le=60)] = "auto"
    height: Literal["auto"] | Annotated[FiniteFloat, Field(strict=True, ge=-10, le=10)] = "auto"

    @property
    def direction(self) -> Direction:
        """How the stage treats people."""
        return Direction(self.people, self.turn, self.lost_after, self.least_confidence)

    @property
    def manner(self) -> Manner:
        """How its characters treat their performers."""
        return Manner(
            calibrate=self.calibrate,
            ease=self.ease,
            remember=self.remember,
            tilt=None if self.tilt == "auto" else self.tilt,
            height=None if self.height == "auto" else self.height,
        )


class OscTable(Table):
    """[[osc]]: a receiver of OSC over UDP."""

    port: Port
    host: Text = "127.0.0.1"
    rate: Annotated[FiniteFloat, Field(strict=True, gt=0, le=1000)] = 30.0
    send: Annotated[tuple[OscKind, ...], Field(min_length=1)] = ("morphs", "joints", "handles", "performer")
    characters: tuple[Name, ...] = ()


class MetricsTable(Table):
    """[metrics]: numbers for Prometheus, on loopback: they have no password."""

    port: Port = 9464


class ServiceFile(Table):
    """A whole service file."""

    stage: Annotated[tuple[StageTable, ...], Field(min_length=1, max_length=16)]
    network: NetworkSettings = NetworkSettings()
    osc: tuple[OscTable, ...] = ()
    metrics: MetricsTable | None = None
    takes: Text = "takes"
    announce: StrictBool = True

    @model_validator(mode="after")
    def _names_differ(self) -> Self:
        seen: set[str] = set()
        for s, stage in enumerate(self.stage):
            for c, name in enumerate(character_names(stage)):
                if name in seen or name == RESERVED:
                    raise mistake(
                        "stage",
                        s,
                        "character",
                        c,
                        "name",
                        found=f"the name {name!r}" + (" again" if name in seen else ""),
                        expected=f"a name of its own for each character, other than {RESERVED!r}",
                        fix='Give it another one: name = "…".',
                    )
                seen.add(name)
        names = stage_names(self)
        for s, name in enumerate(names):
            if name in names[:s]:
                raise mistake(
                    "stage",
                    s,
                    "name",
                    found=f"{name!r} again",
                    expected="a name of its own for each stage",
                    fix="Rename one of the two.",
                )
        return self

    @model_validator(mode="after")
    def _targets_get_something(self) -> Self:
        morphs = {
            name: each.morphs is not None
            for stage in self.stage
            for each, name in zip(stage.character, character_names(stage), strict=True)
        }
        for t, target in enumerate(self.osc):
            for c, name in enumerate(target.characters):
                if name not in morphs:
                    raise mistake(
                        "osc",
                        t,
                        "characters",
                        c,
                        found=f"no character {name!r}",
                        expected=f"one of {', '.join(morphs)}",
                        fix="Name one of these, or leave out characters for all of them.",
                    )
            if target.send == ("morphs",) and not any(morphs[name] for name in target.characters or morphs):
                raise mistake(
                    "osc",
                    t,
                    "send",
                    found="morph weights, and no character that has morph targets",
                    expected="a character with morphs = FILE.glb",
                    fix="Make the file with puppetline bake, or send something else.",
                )
        return self

    @model_validator(mode="after")
    def _vmc_is_of_one_character(self) -> Self:
        for t, target in enumerate(self.osc):
            if "vmc" in target.send and len(receives := self.receives(target)) > 1:
                raise mistake(
                    "osc",
                    t,
                    "characters",
                    found=f"VMC of {len(receives)} characters ({', '.join(receives)})",
                    expected="one character: VMC has no names for several",
                    fix="Name one of them, and make an [[osc]] of another port for each of the others.",
                )
        return self

    def receives(self, target: OscTable) -> list[str]:
        """Return the names of the characters that a receiver is sent."""
        names = [name for stage in self.stage for name in character_names(stage)]
        return [name for name in names if not target.characters or name in target.characters]


def stage_names(service: ServiceFile) -> list[str]:
    """Return what the stages are called; without a name, by their number."""
    alone = len(service.stage) == 1
    return [stage.name or ("stage" if alone else f"stage{number}") for number, stage in enumerate(service.stage, 1)]


def character_names(stage: StageTable) -> list[str]:
    """Return what a stage's characters are called; without a name, as their puppet files."""
    return [each.name or _as_name(Path(each.puppet).stem) for each in stage.character]


def _as_name(stem: str) -> str:
    return re.sub(r"[^A-Za-z0-9_-]+", "_", stem).strip("_")[:32] or "character"


def load(path: Path) -> ServiceFile:
    """Read and check a service file.

    Raises
    ------
    ServiceError
        With the line of a syntax error, or the table and key of anything else.
    """
    fix = "Check the path, or give --puppet and --source instead."
    values = toml_schema.parse(toml_schema.read_text(path, "a service file", fix, ServiceError), path, ServiceError)
    return toml_schema.check(ServiceFile, values, path, ServiceError)


def from_flags(
    sources: tuple[str, ...],
    puppets: tuple[Path, ...],
    stage: dict[str, Any],
    character: dict[str, Any],
    rest: dict[str, Any],
) -> ServiceFile:
    """Make the settings that command line options stand for.

    Parameters
    ----------
    sources, puppets
        One source with all the puppets, or as many sources as puppets, which belong together in their order.
    stage, character, rest : dict
        Further keys of each [[stage]], of each [[stage.character]], and of the file.

    Raises
    ------
    ServiceError
    """
    if len(sources) > 1 and len(sources) != len(puppets):
        raise ServiceError(
            "puppetline serve",
            found=f"{len(sources)} times --source and {len(puppets)} times --puppet",
            expected="one source for all puppets, or one for each",
            fix="Write a service file for anything else: puppetline serve --config SERVICE.toml",
        )
    groups = [puppets] if len(sources) == 1 else [(puppet,) for puppet in puppets]
    stages = [
        {"source": source, "character": [{"puppet": str(puppet), **character} for puppet in group], **stage}
        for source, group in zip(sources, groups, strict=True)
    ]
    return toml_schema.check(ServiceFile, {"stage": stages, **rest}, "puppetline serve", ServiceError)
