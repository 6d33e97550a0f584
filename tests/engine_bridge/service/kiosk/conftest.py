"""Kiosks with a small character, on the clock that a test is given."""

import math
from concurrent.futures import Future
from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from capture.skeleton import JOINT_INDEX
from engine_bridge.service.background_jobs import Jobs
from engine_bridge.service.kiosk.clip import FOLDER
from engine_bridge.service.kiosk.kiosk import Kiosk
from engine_bridge.service.kiosk.kiosk_table import KioskTable
from puppetline import clock

from ..in_process import AtOnce
from ..takes.conftest import make_theatre

__all__ = ["make_theatre"]


def signalling(frames, *raised):
    """Return frames of a performer whose hands are up between pairs of seconds."""
    for frame in frames:
        positions = frame.positions.copy()
        if any(begin <= frame.time < end for begin, end in raised):
            for joint in ("wrist_left", "hand_left", "wrist_right", "hand_right"):
                positions[JOINT_INDEX[joint]] = positions[JOINT_INDEX["head"]] + [0.2, 0.3, 0]
        yield replace(frame, positions=positions)


@pytest.fixture
def visitors(tmp_path):
    """Return the folder of visitors' files."""
    folder = tmp_path / "takes" / FOLDER
    folder.mkdir(parents=True)
    return folder


@pytest.fixture
def films(monkeypatch):
    """Make films at once; return the scene files, and the ends of the next processes: exit codes or errors."""
    made, ends = [], []

    def make(_, clip):
        made.append(clip.scene)
        end = ends.pop(0) if ends else 0
        if isinstance(end, OSError):
            raise end
        if not end:
            for path in (clip.film, clip.path.with_suffix(".gif")):
                path.write_bytes(b"film" * 250)
        return end, ""

    monkeypatch.setattr(Kiosk, "_run", make)
    return made, ends


def follow(jobs):
    """Call what follows the jobs that have finished."""
    while finished := jobs.take_finished():
        for future, then in finished:
            then(future)


class Slowly:
    """An executor on the given clock: one job at a time, each of which takes some seconds."""

    def __init__(self, seconds):
        self.seconds, self.waiting, self._free_at = seconds, [], -math.inf

    def submit(self, work):
        """Begin a job when all before it have ended."""
        future = Future()
        self._free_at = max(self._free_at, clock.now()) + self.seconds
        self.waiting.append((self._free_at, work, future))
        return future

    def finish(self, jobs):
        """End the jobs whose time has come, and what follows them."""
        while self.waiting and self.waiting[0][0] <= clock.now():
            _, work, future = self.waiting.pop(0)
            future.set_result(work())
            follow(jobs)

    def shutdown(self, wait=True, cancel_futures=False):
        """Forget what waits."""
        self.waiting.clear()


class Runner:
    """A stage with a performer who drives a character, and whose hands are up when a visitor begins and ends."""

    def __init__(self, puppet):
        player = SimpleNamespace(user=1, character=SimpleNamespace(name="dog"), document=SimpleNamespace(path=puppet))
        self.stage = SimpleNamespace(name="stage", players=[player])
        self.recording, self.recorded = None, []

    def start(self, _, path, seconds):
        """Begin a take, as the count-in does."""
        path.write_bytes(b"take")
        self.recording = path.stem
        self.recorded.append(path.stem)

    def left(self, _):
        """Return the seconds of the count-in."""
        return 0

    def stop_recording(self):
        """End the take."""
        self.recording = None
        return Mock()


@pytest.fixture
def visit(visitors, films, given_clock, tmp_path):
    """Have visitors come to a kiosk, each of whom records ten seconds, and films take some seconds."""
    jobs, runner = Jobs(lambda *_: AtOnce()), Runner(tmp_path / "dog.toml")

    def come(count, every=60.0, film_seconds=0.0):
        jobs.filming = Slowly(film_seconds)
        kiosk = Kiosk(KioskTable(count_in=0), tmp_path / "takes", runner, lambda *_: None, jobs)
        for _ in range(count):
            for seconds in (10.0, every):
                kiosk._asked.add(runner)
                kiosk.advance([runner])
                follow(jobs)
                jobs.filming.finish(jobs)
                given_clock.advance(seconds)
        return kiosk

    def wait(kiosk, seconds):
        """Let a second pass after another; nobody comes."""
        for _ in range(seconds):
            given_clock.advance(1.0)
            jobs.filming.finish(jobs)
            kiosk.advance([])

    come.wait, come.recorded = wait, runner.recorded
    yield come
    jobs.close()


@pytest.fixture
def open_kiosk(make_theatre, record_events, kung_fu, tmp_path):
    """Open a kiosk whose visitor raises both hands from second 2 to 5 and from 8 to 11."""
    still = [replace(kung_fu[0], time=kung_fu[0].time + k / 30) for k in range(14 * 30)]
    record_events(tmp_path / "performer.log", signalling(still, (2, 5), (8, 11)))
    return lambda: make_theatre(("dog",), "replay:performer.log", tables="[kiosk]\ncount_in = 1\nminutes = 1.0")
