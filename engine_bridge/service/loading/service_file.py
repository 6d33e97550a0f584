"""The service file: sources, characters and outputs, in TOML.

`load` reads and checks a file; `from_flags` builds the same settings from the options of the command line.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, FiniteFloat, StrictBool, model_validator

from engine_bridge.service.kiosk.kiosk_table import KioskTable
from engine_bridge.service.outputs.osc import OscTable
from engine_bridge.service.outputs.output import OutputTable
from engine_bridge.service.outputs.websocket import WebSocketTable
from engine_bridge.service.outputs.zeromq import NetworkTable
from engine_bridge.service.players.automatic_calibration import Calibrate
from engine_bridge.service.players.player_settings import PlayerSettings
from engine_bridge.service.security.endpoints import Text
from engine_bridge.service.stages.stage import StageSettings
from engine_bridge.service.stages.user_assignment import People
from puppetline import toml_schema
from puppetline.errors import ServiceError
from puppetline.toml_schema import Kind, Table, check_distinct, mistake

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,32}$")]
"""Name of a character or stage in topics and addresses."""

Port = Annotated[int, Field(strict=True, ge=1, le=65535)]
Seconds = Annotated[FiniteFloat, Field(strict=True, ge=0, le=86400)]

RESERVED = "service"
"""Name that no character can have, because the service publishes its own status under it."""


class CharacterTable(Table):
    """[[stage.character]]: a character's files, relative to the service file."""

    puppet: Text
    name: Name | None = None
    morphs: Text | None = None
    idle: Text | None = None


class StageTable(Table):
    """[[stage]]: a source and the characters that its performers drive; see `StageSettings` and `PlayerSettings`."""

    source: Text
    sound: Text | None = None
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
    beyond: Annotated[FiniteFloat, Field(strict=True, gt=0, le=100)] | None = None

    @property
    def settings(self) -> StageSettings:
        """Settings of how performers are assigned to characters."""
        return StageSettings(self.people, self.turn, self.lost_after, self.least_confidence, self.beyond)

    @property
    def player_settings(self) -> PlayerSettings:
        """Settings of how the characters are calibrated and eased."""
        tilt, height = (None if value == "auto" else value for value in (self.tilt, self.height))
        return PlayerSettings(self.calibrate, self.ease, self.remember, tilt, height)


class MetricsTable(Table):
    """[metrics]: metrics for Prometheus, on loopback because they require no credentials."""

    port: Port = 9464


class OutputTables(Table):
    """One row per wire: a key of the service file and its table, or a tuple of tables.

    To add a wire, add a module with an `Output` and its `OutputTable`, and a row.
    """

    network: NetworkTable = NetworkTable()
    osc: tuple[OscTable, ...] = ()
    websocket: WebSocketTable | None = None

    def output_tables(self) -> Iterator[tuple[tuple[str | int, ...], OutputTable]]:
        """Yield the keys and indices of each table in the file, and the table, in the order of the rows."""
        for key in OutputTables.model_fields:
            value = getattr(self, key)
            if isinstance(value, tuple):
                yield from (((key, index), table) for index, table in enumerate(value))
            elif value is not None:
                yield (key,), value


class ServiceFile(OutputTables):
    """A whole service file."""

    file_kind: ClassVar[Kind | None] = "service"

    stage: Annotated[tuple[StageTable, ...], Field(min_length=1, max_length=16)]
    metrics: MetricsTable | None = None
    kiosk: KioskTable | None = None
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
                        expected=f"a different name for each character, other than {RESERVED!r}",
                        fix='Choose another name: name = "…".',
                    )
                seen.add(name)
        check_distinct(stage_names(self), "stage")
        return self

    @model_validator(mode="after")
    def _outputs_fit(self) -> Self:
        morphs = {
            name: each.morphs is not None
            for stage in self.stage
            for each, name in zip(stage.character, character_names(stage), strict=True)
        }
        for place, output in self.output_tables():
            output.check(place, morphs)
        return self


def stage_names(service: ServiceFile) -> list[str]:
    """Return the names of the stages; one without a name is called ``stage``, with its number if there are several."""
    alone = len(service.stage) == 1
    return [stage.name or ("stage" if alone else f"stage{number}") for number, stage in enumerate(service.stage, 1)]


def character_names(stage: StageTable) -> list[str]:
    """Return the names of a stage's characters; a character without one is named after its puppet file."""
    return [each.name or name_from_stem(Path(each.puppet).stem) for each in stage.character]


def name_from_stem(stem: str) -> str:
    """Return the default name of a character from its puppet file's name without the ending."""
    return re.sub(r"[^A-Za-z0-9_-]+", "_", stem).strip("_")[:32] or "character"


def load(path: Path) -> ServiceFile:
    """Read and check a service file.

    Raises
    ------
    ServiceError
        The file cannot be read, or has an error; the message has the line of a syntax error, else the table and key.
    """
    fix = "Check the path, or use --puppet and --source instead."
    values = toml_schema.parse(toml_schema.read_text(path, "a service file", fix, ServiceError), path, ServiceError)
    return toml_schema.check(ServiceFile, values, path, ServiceError)


def from_flags(
    sources: tuple[str, ...],
    puppets: tuple[Path, ...],
    stage: dict[str, Any],
    character: dict[str, Any],
    rest: dict[str, Any],
) -> ServiceFile:
    """Return the settings of command line options.

    Parameters
    ----------
    sources, puppets
        One source for all puppets, or one source per puppet, in the same order.
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
