"""The file of ``fused:FILE.toml``: several sensors and their poses, in TOML with one table per sensor."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Self

import numpy as np
from pydantic import Field, FiniteFloat, model_validator

from capture.fusion.source import FusedSource, Member
from capture.sensor_pose import SensorPose
from capture.source import SkeletonSource
from puppetline import toml_schema
from puppetline.errors import SourceError
from puppetline.files import written_whole
from puppetline.toml_schema import Table, mistake

SCHEME = "fused:"

MAX_POSITION_METRES = 100.0
"""Maximum absolute coordinate of a sensor in the first sensor's coordinates, in metres."""
MAX_CLOCK_DIFFERENCE_SECONDS = 0.5
"""Maximum time by which a live sensor may be later than another."""

_Metres = Annotated[FiniteFloat, Field(ge=-MAX_POSITION_METRES, le=MAX_POSITION_METRES)]
_Degrees = Annotated[FiniteFloat, Field(ge=-360, le=360)]


class SensorTable(Table):
    """[[sensor]]: a source and its pose; see `capture.sensor_pose.SensorPose.of_degrees`."""

    source: Annotated[str, Field(strict=True, min_length=1)]
    position: tuple[_Metres, _Metres, _Metres] | None = None
    rotation: tuple[_Degrees, _Degrees, _Degrees] = (0.0, 0.0, 0.0)
    clock: FiniteFloat = 0.0

    @property
    def member(self) -> Member:
        """The member that the table describes."""
        return Member(
            self.source, SensorPose.of_degrees(*self.rotation, np.array(self.position or (0, 0, 0))), self.clock
        )


class FusedFile(Table):
    """A whole file."""

    sensor: Annotated[tuple[SensorTable, ...], Field(min_length=2, max_length=16)]

    @model_validator(mode="after")
    def _check_sensors(self) -> Self:
        for k, sensor in enumerate(self.sensor):
            if sensor.source.startswith(SCHEME) or sensor.source.endswith(("?loop", "&loop")):
                raise mistake(
                    "sensor",
                    k,
                    "source",
                    found=repr(sensor.source),
                    expected="a single sensor, or a recording that plays once",
                    fix="Name the sensor itself, without loop; the service repeats recordings automatically.",
                )
            if k and sensor.position is None:
                raise mistake(
                    "sensor",
                    k,
                    "position",
                    found="nothing",
                    expected="the sensor's position in the first sensor's coordinates, in metres",
                    fix="Measure it, or use puppetline align: position = [x, y, z].",
                )
        return self


def open_fused(
    name: str, path: Path, recorded: Callable[[str], bool], opener: Callable[[str, Path], SkeletonSource]
) -> FusedSource:
    """Open the sensors of a file as one source.

    Parameters
    ----------
    name : str
        The URI.
    path : Path
    recorded : callable
        Whether a URI is that of a recording.
    opener : callable
        Function that opens a source, given its URI and the folder that files are relative to.

    Raises
    ------
    PuppetlineError
        The file is invalid, or one of its sources cannot be opened.
    """
    members = [sensor.member for sensor in load(path).sensor]
    replayed = [recorded(member.uri) for member in members]
    clocks = [member.clock for member in members]
    if any(replayed) and not all(replayed):
        raise SourceError(
            path,
            found="recordings and live sensors together",
            expected="only recordings or only live sensors",
            fix="Write one file for the recordings and another for the live sensors.",
        )
    if not any(replayed) and max(clocks) - min(clocks) > MAX_CLOCK_DIFFERENCE_SECONDS:
        raise SourceError(
            path,
            found=f"clocks {max(clocks) - min(clocks):g} s apart",
            expected=f"at most {MAX_CLOCK_DIFFERENCE_SECONDS:g} s between live sensors",
            fix="Remove the key clock, which is only for sensors whose images arrive later than others'.",
        )
    return FusedSource(name, members, lambda uri: opener(uri, path.parent), all(replayed))


def load(path: Path) -> FusedFile:
    """Read and check a file.

    Raises
    ------
    SourceError
        The file is invalid; the error names the line of a syntax error, or the table and key.
    """
    text = toml_schema.read_text(path, "a file of several sensors", "Make one with puppetline align.", SourceError)
    return toml_schema.check(FusedFile, toml_schema.parse(text, path, SourceError), path, SourceError)


def write(path: Path, members: Sequence[Member]) -> None:
    """Write a file that `load` reads, with lengths rounded to 0.1 mm and angles to 0.001°.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    blocks = []
    for member in members:
        position = [round(float(x), 4) + 0.0 for x in member.pose.position]
        rotation = [round(x, 3) + 0.0 for x in member.pose.degrees]
        blocks.append(
            f"[[sensor]]\nsource = {json.dumps(member.uri)}\n"
            f"position = {position}   # metres, in the first sensor's coordinates\n"
            f"rotation = {rotation}   # degrees: tilted down, turned to its left, rolled\n"
            f"clock = {round(member.clock, 4)}   # seconds by which it is later than the first\n"
        )
    with written_whole(path) as partial:
        partial.write_text("\n".join(blocks), encoding="utf-8")
