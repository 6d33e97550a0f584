"""Export of a recording and a puppet as a clip file, which engines play without a service (docs/clips.md)."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from engine_bridge.performance.channels import morph_weights
from engine_bridge.performance.clip import Progress, load_timeline, solve
from engine_bridge.performance.prepared_character import load_prepared
from engine_bridge.performance.settings import Settings
from engine_bridge.service.loading.service_file import name_from_stem
from engine_bridge.service.protocol.clip_file import ClipFacts, beginning, frame_message
from engine_bridge.service.protocol.header import NAME
from engine_bridge.service.protocol.scene import StreamedCharacter
from puppetline.errors import OutputError
from puppetline.files import check_writable, written_whole


@dataclass(frozen=True)
class ClipSummary:
    """Result of `write_clip`; `revision` identifies the scene."""

    output: str
    character: str
    revision: int
    frames: int
    fps: float
    seconds: float
    vertices: int
    bytes: int
    notes: tuple[str, ...]


def write_clip(
    log: Path,
    puppet: Path,
    output: Path,
    name: str | None,
    settings: Settings,
    progress: Progress = lambda _stage, _share: None,
) -> ClipSummary:
    """Write the motion of a puppet's character, driven by a recording, as a clip file.

    Parameters
    ----------
    log, puppet, output : Path
    name : str or None
        Name of the character in the file: 1 to 32 letters, digits, _ and -. By default that of the puppet file.
    settings : Settings
    progress : callable, optional

    Raises
    ------
    PuppetlineError
    """
    name = name_from_stem(puppet.stem) if name is None else _checked(name)
    check_writable(output, ".clip", inputs=(log, puppet))
    timeline, notes = load_timeline(log, settings, animals=True)
    progress("Preparing the character", 0.0)
    prepared = load_prepared(puppet)
    character = StreamedCharacter.of(name, prepared)
    progress("Preparing the character", 1.0)
    motion = solve(prepared, timeline, settings, partial(progress, "Performing"))
    count, moved = len(motion), morph_weights(prepared.puppet, motion.channels)
    still = np.zeros(count, np.float32)
    weights = (
        np.array([moved.get(target, still) for target in prepared.puppet.targets], np.float32).reshape(-1, count).T
    )
    facts = ClipFacts(name, character.revision, count, motion.fps, log.stem)
    with written_whole(output) as path, path.open("wb") as file:
        file.write(beginning(character, facts))
        for number, time in enumerate(motion.times.tolist()):
            file.write(frame_message(character, number, time, motion[number], weights[number]))
    return ClipSummary(
        output=str(output),
        character=name,
        revision=character.revision,
        frames=count,
        fps=motion.fps,
        seconds=float(motion.times[-1]),
        vertices=len(character.rest),
        bytes=output.stat().st_size,
        notes=(*prepared.character.document.notes, *notes),
    )


def _checked(name: str) -> str:
    if not NAME.fullmatch(name) or name == "service":
        raise OutputError(
            "--name",
            found=repr(name),
            expected="1 to 32 letters (a to z), digits, _ and -, and not 'service'",
            fix="Choose such a name.",
        )
    return name
