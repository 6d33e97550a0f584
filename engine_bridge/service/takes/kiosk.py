"""A kiosk: visitors record themselves by a gesture, see what they did, and get it as a video for some minutes."""

import logging
import math
import os
import secrets
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tomlkit
from pydantic import Field, FiniteFloat

from capture.gestures import HandsUp
from capture.skeleton import SkeletonFrame
from engine_bridge.service.background_jobs import Jobs
from engine_bridge.service.monitoring.logs import fields
from engine_bridge.service.stages.stage_runner import StageRunner
from engine_bridge.service.takes.count_in import CountIn
from puppetline import clock
from puppetline.child_process import bound_to_parent
from puppetline.errors import PuppetlineError
from puppetline.toml_schema import Table

FOLDER = "visitors"
"""Name of the folder in the folder of takes, in which nothing is kept."""

CODE_LETTERS, CODE_LENGTH = "ABCDEFGHJKMNPQRSTUVWXYZ23456789", 6
"""Letters and digits that cannot be mistaken for each other, and their number in a code: 900 million codes."""

CODE = f"[{CODE_LETTERS}]{{{CODE_LENGTH}}}"
"""Pattern of a code."""

SPACING_METRES = 1.6
"""Distance between characters in a video, in metres."""

LOW_PRIORITY = 10
"""Niceness of the process that makes a video."""

log = logging.getLogger(__name__)


class KioskTable(Table):
    """[kiosk]: visitors record themselves by holding both hands above their heads, see `Kiosk`.

    Attributes
    ----------
    hands_up : float
        Seconds for which they hold them.
    count_in : int
        Seconds from the gesture to the recording.
    longest : float
        Seconds after which a recording ends by itself.
    minutes : float
        Minutes after which a visitor's take, sound and video are deleted.
    size : (int, int)
        Width and height of the videos, in pixels.
    """

    hands_up: Annotated[FiniteFloat, Field(strict=True, ge=0.5, le=10)] = 2.0
    count_in: Annotated[int, Field(strict=True, ge=0, le=10)] = 3
    longest: Annotated[FiniteFloat, Field(strict=True, ge=1, le=600)] = 60.0
    minutes: Annotated[FiniteFloat, Field(strict=True, gt=0, le=1440)] = 10.0
    size: tuple[int, int] = (1280, 720)


@dataclass
class Clip:
    """What a visitor recorded.

    Attributes
    ----------
    path : Path
        The take; the sound, the scene and the video have the same name.
    characters : list of (str, Path, int)
        Name, puppet file and performer of each character.
    began : float
        Time at which the recording began, of `puppetline.clock`.
    offered : float or None
        Time from which on the video is offered; None while it is made.
    """

    path: Path
    characters: list[tuple[str, Path, int]]
    began: float
    offered: float | None = None

    @property
    def video(self) -> Path:
        """The video, which appears when it is complete."""
        return self.path.with_suffix(".mp4")

    def delete(self) -> None:
        """Delete everything, also a video that is not complete."""
        for path in self.path.parent.glob(f"*{self.path.stem}.*"):
            with suppress(OSError):
                path.unlink()


class Kiosk:
    """The visitors of a service.

    Parameters
    ----------
    table : KioskTable
    folder : Path
        Folder of takes.
    count_in : CountIn
    stop : callable
        Ends the take of a stage and shows it again; called with the stage and the clip.
    jobs : Jobs
    """

    def __init__(
        self, table: KioskTable, folder: Path, count_in: CountIn, stop: Callable[[StageRunner, Clip], None], jobs: Jobs
    ) -> None:
        self._table, self._folder, self._count_in = table, visitors_folder(folder), count_in
        self._stop, self._jobs = stop, jobs
        self._hands: dict[StageRunner, HandsUp] = {}
        self._asked: set[StageRunner] = set()
        self._recorded: dict[StageRunner, Clip] = {}
        self._clips: list[Clip] = []
        self._process: subprocess.Popen[bytes] | None = None
        for left in self._folder.glob("*") if self._folder.is_dir() else ():  # of a service that crashed
            left.unlink()

    @property
    def clips(self) -> list[dict[str, Any]]:
        """Each clip: its code, and the seconds until it is deleted, or None while its video is made."""
        now = clock.now()
        return [
            {"code": each.path.stem, "seconds_left": None if each.offered is None else round(self._end(each) - now)}
            for each in self._clips
        ]

    def see(self, runner: StageRunner, frame: SkeletonFrame) -> None:
        """Watch the hands of a performer who drives a character, or who has just finished a recording."""
        hands = self._hands.setdefault(runner, HandsUp(self._table.hands_up))
        if hands.step(frame) and any(player.user == frame.user for player in runner.stage.players):
            self._asked.add(runner)

    def due(self) -> float:
        """Return the moment at which to call `advance`, of `puppetline.clock`."""
        if self._asked:
            return 0.0
        ends = [each.began + self._table.longest for each in self._recorded.values()]
        return min([*ends, *map(self._end, self._clips)], default=math.inf)

    def advance(self, runners: list[StageRunner]) -> None:
        """Begin and end recordings, and delete what is over."""
        now = clock.now()
        for runner in runners:
            clip = self._recorded.get(runner)
            asked = runner in self._asked
            if clip is None and asked and not self._count_in.left(runner) and runner.recording is None:
                self._begin(runner)
            elif clip is not None and now >= clip.began and self._over(runner, clip, asked, now):
                del self._recorded[runner]
                self._stop(runner, clip)
        self._asked.clear()
        for clip in [each for each in self._clips if now >= self._end(each)]:
            clip.delete()
            self._clips.remove(clip)

    def film(self, clip: Clip) -> None:
        """Make the video of a clip whose take is on the disk, and offer it."""
        self._clips.append(clip)
        scene = clip.path.with_suffix(".toml")
        scene.write_text(_scene(clip, self._table.size), encoding="utf-8")
        self._jobs.start(
            self._jobs.filming, lambda: self._make(scene, clip.video), lambda made: self._made(clip, made.result())
        )

    def close(self) -> None:
        """End the video that is being made, and delete everything."""
        if self._process is not None:
            self._process.kill()
        for clip in [*self._clips, *self._recorded.values()]:
            clip.delete()

    def _end(self, clip: Clip) -> float:
        return math.inf if clip.offered is None else clip.offered + 60 * self._table.minutes

    def _begin(self, runner: StageRunner) -> None:
        self._folder.mkdir(parents=True, exist_ok=True)
        path = self._folder / ("".join(secrets.choice(CODE_LETTERS) for _ in range(CODE_LENGTH)) + ".log")
        driven = [(each, each.user) for each in runner.stage.players if each.user is not None]
        characters = [(each.character.name, each.document.path, user) for each, user in driven]
        clip = Clip(path, characters, clock.now() + self._table.count_in)
        try:
            self._count_in.start(runner, path, self._table.count_in)
        except PuppetlineError as error:
            log.error("the visitor's recording cannot begin: %s", error, extra=fields(stage=runner.stage.name))
        else:
            self._recorded[runner] = clip

    def _over(self, runner: StageRunner, clip: Clip, asked: bool, now: float) -> bool:
        """Return whether a recording ends: by the gesture, after the longest time, or because the performers left."""
        left = all(player.user is None for player in runner.stage.players)
        return asked or left or now >= clip.began + self._table.longest

    def _make(self, scene: Path, video: Path) -> int:
        command = [sys.executable, "-P", "-m", "puppetline", "film", str(scene), "-o", str(video)]
        outputs: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
        self._process = subprocess.Popen(command, **outputs, **bound_to_parent())  # noqa: S603
        if sys.platform != "win32":
            os.setpriority(os.PRIO_PROCESS, self._process.pid, LOW_PRIORITY)
        assert self._process.stderr is not None  # noqa: S101 - a pipe was asked for
        told = self._process.stderr.read()  # `communicate` would close the standard input
        code = self._process.wait()
        if code > 0:
            log.error("the visitor's video cannot be made: %s", told.decode(errors="replace").strip()[-500:])
        return code

    def _made(self, clip: Clip, code: int) -> None:
        if code:
            clip.delete()
            self._clips.remove(clip)
            return
        clip.offered = clock.now()
        log.info("a visitor's video", extra=fields(code=clip.path.stem))


def visitors_folder(takes: Path) -> Path:
    """Return the folder of visitors' files in a folder of takes."""
    return takes / FOLDER


def _scene(clip: Clip, size: tuple[int, int]) -> str:
    """Return the scene file of a clip: its characters side by side."""
    count = len(clip.characters)
    names = [name for name, _, _ in clip.characters]
    characters = [
        {"name": name, "puppet": str(puppet.resolve()), "position": [(number - (count - 1) / 2) * SPACING_METRES, 0.0]}
        for number, (name, puppet, _) in enumerate(clip.characters)
    ]
    takes = [
        {"character": name, "file": clip.path.name, "user": user, "sound": name == names[0]}
        for name, _, user in clip.characters
    ]
    return tomlkit.dumps({"film": {"size": list(size)}, "character": characters, "take": takes})
