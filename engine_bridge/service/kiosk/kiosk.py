"""What visitors of a service record, and the films that are made of it."""

import logging
import math
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from capture.gestures import HandsUp
from capture.skeleton import SkeletonFrame
from engine_bridge.service.background_jobs import Jobs
from engine_bridge.service.kiosk.clip import Clip, clips_in, visitors_folder
from engine_bridge.service.kiosk.kiosk_table import KioskTable
from engine_bridge.service.monitoring.logs import fields
from engine_bridge.service.monitoring.status import ClipStatus
from engine_bridge.service.stages.stage_runner import StageRunner
from engine_bridge.service.takes.count_in import CountIn
from puppetline import clock
from puppetline.child_process import bound_to_parent, lower_priority
from puppetline.errors import PuppetlineError

LOW_PRIORITY = 10
"""Niceness of the process that makes a film."""

MAX_ATTEMPTS = 3
"""How often a film is begun whose process is killed, for example because the memory is full."""

NOT_STARTED = -1
"""Exit code of a process that the system refuses to start; like a killed one, it is started again."""

LEAST_FREE_BYTES = 200_000_000
"""Free space on the disk below which the oldest films are deleted: a minute's take, sound and film need less."""

log = logging.getLogger(__name__)


class Kiosk:
    """The visitors of a service.

    Clips that a crashed service has left are continued: films are offered for the rest of their time, and takes become
    films.

    Parameters
    ----------
    table : KioskTable
    takes : Path
        Folder of takes.
    count_in : CountIn
    play : callable
        Shows a take on a character again; called with the name of the character and the take.
    jobs : Jobs
    """

    def __init__(
        self, table: KioskTable, takes: Path, count_in: CountIn, play: Callable[[str, Path], object], jobs: Jobs
    ) -> None:
        self._table, self._folder, self._count_in = table, visitors_folder(takes), count_in
        self._play, self._jobs = play, jobs
        self._hands: dict[StageRunner, HandsUp] = {}
        self._asked: set[StageRunner] = set()
        self._recorded: dict[StageRunner, Clip] = {}
        self._process: subprocess.Popen[bytes] | None = None
        self._closed = False
        self._clips = clips_in(self._folder)
        for clip in self._clips:
            if clip.offered is None:
                self._film(clip)

    @property
    def clips(self) -> list[ClipStatus]:
        """What is offered and made, the oldest first."""
        now = clock.now()
        return [
            ClipStatus(each.code, None if each.offered is None else round(self._end(each) - now))
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
        removed = self._recorded.keys() - set(runners)  # by a reload, which has ended their takes
        self._hands = {runner: self._hands[runner] for runner in runners if runner in self._hands}
        for runner in [*runners, *removed]:
            if self._count_in.left(runner):
                continue
            clip = self._recorded.get(runner)
            asked = runner in self._asked
            if clip is None and asked and runner.recording is None:
                self._begin(runner)
            elif clip is not None and self._over(runner, clip, asked, now):
                del self._recorded[runner]
                self._stop(runner, clip)
        self._asked.clear()
        for clip in [each for each in self._clips if now >= self._end(each)]:
            self._delete(clip)

    def close(self) -> None:
        """End the film that is being made, and delete everything."""
        self._closed = True
        if self._process is not None:
            self._process.kill()
        for clip in [*self._clips, *self._recorded.values()]:
            clip.delete()

    def _end(self, clip: Clip) -> float:
        return math.inf if clip.offered is None else clip.offered + 60 * self._table.minutes

    def _begin(self, runner: StageRunner) -> None:
        seconds = self._table.count_in
        try:
            self._make_room()
            clip = Clip.begin(self._folder, runner.stage, self._table, clock.now() + seconds)
            try:
                self._count_in.start(runner, clip.path, seconds)
            except PuppetlineError:
                clip.delete()
                raise
        except (OSError, PuppetlineError) as error:
            log.error("the visitor's recording cannot begin: %s", error, extra=fields(stage=runner.stage.name))
        else:
            self._recorded[runner] = clip

    def _over(self, runner: StageRunner, clip: Clip, asked: bool, now: float) -> bool:
        """Return whether a recording ends: by the gesture, by time, without performers, or as a reload ended it."""
        left = all(player.user is None for player in runner.stage.players)
        return runner.recording != clip.code or asked or left or now >= clip.began + self._table.longest

    def _stop(self, runner: StageRunner, clip: Clip) -> None:
        """End a recording, show it again, and make a film of it."""
        recorder = runner.stop_recording() if runner.recording == clip.code else None
        self._clips.append(clip)

        def closed(_: object) -> None:
            if not clip.recorded:
                self._delete(clip)
                return
            for name in clip.characters:
                self._play(name, clip.path)
            self._film(clip)

        close = (lambda: None) if recorder is None else recorder.close  # what was ended elsewhere is written before
        self._jobs.start(self._jobs.writing, close, closed)

    def _film(self, clip: Clip) -> None:
        """Make the film of a clip whose take is on the disk, and offer it."""
        clip.attempts += 1
        self._make_room()
        self._jobs.start(self._jobs.filming, lambda: self._make(clip), lambda made: self._made(clip, made.result()))

    def _make(self, clip: Clip) -> int:
        """Make a film; return the exit code of the process."""
        try:
            code, errors = self._run(clip)
        except OSError as error:
            code, errors = NOT_STARTED, str(error)
        if code and not self._closed:
            log.error("the visitor's film cannot be made: %s", errors.strip()[-500:] or code)
        return code

    def _run(self, clip: Clip) -> tuple[int, str]:
        """Run the process that makes a film; return its exit code and its errors."""
        command = [sys.executable, "-P", "-m", "puppetline", "film", str(clip.scene), "-o", str(clip.film), "--share"]
        outputs: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
        process = self._process = subprocess.Popen([*command, "--force"], **outputs, **bound_to_parent())  # noqa: S603
        if self._closed:  # meanwhile
            process.kill()
        lower_priority(process.pid, LOW_PRIORITY)
        assert process.stderr is not None  # noqa: S101 - a pipe was asked for
        errors = process.stderr.read()  # `communicate` would close the standard input
        return process.wait(), errors.decode(errors="replace")

    def _made(self, clip: Clip, code: int) -> None:
        if code < 0 and clip.attempts < MAX_ATTEMPTS:  # killed, or not started
            self._film(clip)
        elif code:
            self._delete(clip)
        else:
            clip.offered = clock.now()
            log.info("a visitor's film", extra=fields(code=clip.code))

    def _make_room(self) -> None:
        """Delete the oldest films while the disk is full."""
        offered = [each for each in self._clips if each.offered is not None]
        while offered and shutil.disk_usage(self._folder).free < LEAST_FREE_BYTES:
            oldest = offered.pop(0)
            log.warning("the disk is full: the oldest visitor's film is deleted", extra=fields(code=oldest.code))
            self._delete(oldest)

    def _delete(self, clip: Clip) -> None:
        clip.delete()
        self._clips.remove(clip)
