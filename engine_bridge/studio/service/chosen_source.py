"""Sources that can be chosen, and the stages of the service file for a source and the open characters."""

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from capture.sources.registry import LOOP_SUFFIX, is_recorded
from engine_bridge.studio.messages.state import SourceState
from puppetline.errors import ServiceError

if TYPE_CHECKING:
    from engine_bridge.studio.project.open_characters import OpenCharacter  # importing it takes a while

LIVE_SCHEMES = "osc", "vmc", "freenect", "openni", "realsense", "orbbec", "camera"
"""Schemes of URIs that the page may give. The others name files, which the page does not."""


NAMES = {"camera": "the webcam", "freenect": "the Kinect"}
"""Names of sources for people, by scheme."""


@dataclass(frozen=True)
class ChosenSource:
    """The chosen source: the URI that the service opens, and its state on pages, which contains no path."""

    uri: str
    state: SourceState


NOTHING = ChosenSource("demo:walk", SourceState())
"""The source before one was chosen. A stage requires a source, so the example plays once."""


def stages(
    characters: "Iterable[OpenCharacter]", playing: ChosenSource, folder: Path, sound: str | None = None
) -> list[dict[str, Any]]:
    """Return the tables [[stage]] of the service file.

    Each character has a stage of its own if a recording plays, so that its performers move all of them. A sensor or a
    port can be opened once only, and a video is tracked once: their performers are distributed among the characters of
    one stage.

    Parameters
    ----------
    characters : iterable of OpenCharacter
    playing : ChosenSource
    folder : Path
        Folder of the service file.
    sound : str, optional
        What the stages hear, see `capture.sound_input.open_sound`.
    """
    heard = {} if sound is None else {"sound": sound}
    tables = [{"puppet": os.path.relpath(each.live_file, folder), "name": each.name} for each in characters]
    is_video = playing.uri.startswith("video:")
    if is_video or not is_recorded(playing.uri):
        calibrated = {"calibrate": "at_once"} if is_video else {}
        return [{"source": playing.uri, "name": "stage", **calibrated, **heard, "character": tables}] if tables else []
    return [
        {"source": playing.uri, "name": table["name"], "calibrate": "at_once", **heard, "character": [table]}
        for table in tables
    ]


def example(name: str, loop: bool = True) -> ChosenSource:
    """Return the source of an example motion."""
    uri = f"demo:{name}{LOOP_SUFFIX if loop else ''}"
    text = f"Example: {name.replace('_', ' ')}"
    return ChosenSource(uri, SourceState(uri=uri, kind="example", name=name, text=text, loop=loop))


def live(uri: str) -> ChosenSource:
    """Return a live source.

    Raises
    ------
    ServiceError
        The URI has another scheme, or names a file.
    """
    scheme, colon, rest = uri.partition(":")
    if not colon or scheme not in LIVE_SCHEMES or is_recorded(uri) or "file=" in rest:
        raise ServiceError(
            "the request, uri",
            found=f"{uri!r:.80}",
            expected=f"a live source: {', '.join(f'{each}:' for each in LIVE_SCHEMES)}",
            fix="Choose a source from the list. To play a file, upload it.",
        )
    return ChosenSource(uri, SourceState(uri=uri, kind="live", name=uri, text=NAMES.get(scheme, uri)))


def recording(
    path: Path, name: str, kind: Literal["upload", "take"], loop: bool, start: float | None, stop: float | None
) -> ChosenSource:
    """Return the source of a recording that is already trimmed; `name` is for people."""
    state = SourceState(uri=f"replay:{name}", kind=kind, name=name, text=name, loop=loop, start=start, stop=stop)
    return ChosenSource(f"replay:{path}{LOOP_SUFFIX if loop else ''}", state)


def video(path: Path, name: str, loop: bool) -> ChosenSource:
    """Return the source of a video of a performer; `name` is for people."""
    state = SourceState(uri=f"video:{name}", kind="upload", name=name, text=name, loop=loop)
    return ChosenSource(f"video:{path}{LOOP_SUFFIX if loop else ''}", state)
