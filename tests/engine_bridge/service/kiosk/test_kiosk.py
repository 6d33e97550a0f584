"""Visitors record themselves by a gesture; nothing of it is kept, and nothing of it is lost before its time."""

import errno
import gc
import math
import os
import shutil
import tomllib
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import psutil
import pytest

from engine_bridge.film.scene import Scene
from engine_bridge.service.kiosk.clip import Clip, clips_in
from engine_bridge.service.kiosk.kiosk import LEAST_FREE_BYTES, MAX_ATTEMPTS
from engine_bridge.service.stages.stage import StageSettings
from puppetline import clock, toml_schema
from puppetline.errors import OutputError, ServiceError

from ..stage_steps import play


def crash(theatre):
    """End a service without the cleaning up of its kiosk."""
    service = theatre.service
    service.kiosk._clips, service.kiosk._recorded = [], {}
    service.count_in.cancel = lambda _: None
    service.close()


def test_hands_up_begin_and_end_a_recording_and_the_film_is_offered_and_deleted(open_kiosk, visitors, films):
    (visitors / "ABCDEF.gif").touch()  # of no clip
    theatre = open_kiosk()
    kiosk, runner = theatre.service.kiosk, theatre.runner
    assert list(visitors.iterdir()) == []
    theatre.run(3.9)
    assert runner.recording is None
    theatre.run(1.5)
    code = runner.recording
    assert len(code) == 6
    assert kiosk.clips == []
    theatre.run(5.0)
    assert runner.recording is None
    [scene] = films[0]
    assert scene == visitors / f"{code}.toml"
    filmed = toml_schema.check(Scene, tomllib.loads(scene.read_text()), "", ServiceError)
    assert [(each.character, each.file, each.user) for each in filmed.take] == [("dog", f"{code}.log", 1)]
    assert filmed.background.set == "stage"
    [clip] = kiosk.clips
    assert clip.code == code
    assert 50 < clip.seconds_left <= 60
    assert theatre.ask("describe")["status"]["clips"] == [asdict(clip)]
    assert theatre.of("dog")[-1].state == "performing"  # in the take
    assert (visitors / f"{code}.mp4").exists()
    theatre.run(60.0)
    assert kiosk.clips == list(visitors.iterdir()) == []


@pytest.mark.parametrize("seconds", [4.6, 7.0])
def test_the_next_service_makes_the_film_of_a_recording_that_a_crash_ended(open_kiosk, visitors, films, seconds):
    """The service crashes during the count, in which case nothing is left, or during the recording."""
    theatre = open_kiosk()
    theatre.run(seconds)
    codes = [code] if (code := theatre.runner.recording) else []
    crash(theatre)
    kiosk = open_kiosk().service.kiosk
    assert films[0] == [visitors / f"{code}.toml" for code in codes]
    assert [each.code for each in kiosk.clips] == codes
    assert {path.stem for path in visitors.iterdir()} == {*codes}


KILLED, NO_MEMORY = -9, OSError(errno.ENOMEM, "no memory")


@pytest.mark.parametrize(
    ("ends", "offered"),
    [([KILLED, KILLED], True), ([KILLED] * MAX_ATTEMPTS, False), ([NO_MEMORY] * MAX_ATTEMPTS, False), ([1], False)],
)
def test_a_film_whose_process_is_killed_or_cannot_start_is_begun_again(visit, films, visitors, caplog, ends, offered):
    films[1].extend(ends)
    kiosk = visit(1)
    assert len(films[0]) == len(ends) + offered
    assert len(kiosk.clips) == offered
    assert bool(list(visitors.iterdir())) == offered
    assert caplog.text.count("no memory") == ends.count(NO_MEMORY)


def test_the_oldest_film_goes_first_if_the_disk_is_full(visit, visitors, films, monkeypatch, caplog):
    """Room is for three films; the fourth is made as well, and makes room for itself."""

    def usage(folder):
        return SimpleNamespace(free=LEAST_FREE_BYTES - (len(list(folder.glob("*.mp4"))) >= 3))

    monkeypatch.setattr(shutil, "disk_usage", usage)
    kiosk = visit(8, every=1.0)
    made = [path.stem for path in films[0]]
    kept = [each.code for each in kiosk.clips]
    assert kept == made[-3:]
    assert {path.stem for path in visitors.iterdir()} == set(kept)
    gone = [record.fields["code"] for record in caplog.records if "the disk is full" in record.message]
    assert gone == made[:-3]


def test_a_week_of_visitors_leaves_nothing_behind(visit, visitors, films, given_clock, tmp_path):
    """Of 500 visitors, one every twenty minutes, the last one's film is there; an hour later it is not."""
    process = psutil.Process()
    kiosk = visit(500, every=1200.0)
    assert len(films[0]) == 500
    assert [each.code for each in kiosk.clips] == [films[0][-1].stem]
    assert {path.stem for path in visitors.iterdir()} == {films[0][-1].stem}
    given_clock.advance(3600.0)
    kiosk.advance([])
    assert list(visitors.iterdir()) == []
    assert kiosk.due() == math.inf
    assert not [each for each in gc.get_objects() if type(each) is Clip and each.path.is_relative_to(tmp_path)]
    assert not [each for each in process.open_files() if Path(each.path).parent == visitors]


def test_a_long_queue_of_films_keeps_its_order_and_every_film_its_time(visit, visitors, films):
    """A visitor comes every 20 s, but a film takes 45 s: in the end, 34 of 60 takes wait, up to 25 minutes."""
    kiosk = visit(60, every=10.0, film_seconds=45.0)
    made = [path.stem for path in films[0]]
    assert len(visit.recorded) == 60
    assert made == visit.recorded[:26]  # in 1190 s from the end of the first take on
    waiting = [each.code for each in kiosk.clips if each.seconds_left is None]
    assert waiting == visit.recorded[26:]
    assert {path.stem for path in visitors.glob("*.log")} == {each.code for each in kiosk.clips}
    for _ in waiting:
        visit.wait(kiosk, 45)
        offered = [each.code for each in kiosk.clips if each.seconds_left is not None]
        assert offered == visit.recorded[: len(films[0])][-len(offered) :]
        assert len(offered) in (13, 14)  # each for ten minutes
    assert [path.stem for path in films[0]] == visit.recorded
    assert {path.stem for path in visitors.iterdir()} == {*offered}
    visit.wait(kiosk, 600)
    assert list(visitors.iterdir()) == []


def refuse(*_):
    raise ServiceError("here", found="a fault", expected="none", fix="Mend it.")


def test_a_service_that_cannot_start_keeps_the_clips_of_a_crashed_one(open_kiosk, visitors, films, monkeypatch):
    theatre = open_kiosk()
    theatre.run(10.5)
    crash(theatre)
    before = sorted(visitors.iterdir())
    monkeypatch.setattr("engine_bridge.service.service.Notifier", refuse)
    with pytest.raises(ServiceError):
        open_kiosk()
    assert sorted(visitors.iterdir()) == before


def test_a_reload_that_removes_the_stage_ends_the_recording_and_its_film_is_made(open_kiosk, visitors, films):
    theatre = open_kiosk()
    theatre.run(5.4)
    code, service = theatre.runner.recording, theatre.service
    kiosk = service.kiosk
    service._replace_runners([])
    for _ in range(3):
        kiosk.advance(service.runners)
        service._finish_jobs()
    assert [path.stem for path in films[0]] == [each.code for each in kiosk.clips] == [code]
    assert clock.now() < kiosk.due() < math.inf
    assert not kiosk._hands


def test_a_recording_that_a_reload_ended_is_filmed_and_another_take_goes_on(open_kiosk, visitors, films, tmp_path):
    theatre = open_kiosk()
    theatre.run(5.4)
    code = theatre.runner.recording
    theatre.service._end_take(theatre.runner)
    theatre.runner.start_recording(tmp_path / "other.log")
    theatre.run(0.3)
    assert [path.stem for path in films[0]] == [code]
    assert theatre.runner.recording == "other"


def test_a_recording_begins_after_a_reload_that_would_end_it(open_kiosk, visitors, films):
    theatre = open_kiosk()
    theatre.run(3.9)
    theatre.service.reloading = True
    theatre.run(1.5)
    assert theatre.left() == 0
    assert theatre.runner.recording is None
    theatre.service.reloading = False
    theatre.run(1.3)
    assert theatre.runner.recording in {path.stem for path in visitors.iterdir()}


def test_a_cancelled_count_in_leaves_nothing(open_kiosk, visitors, films):
    theatre = open_kiosk()
    theatre.run(4.6)
    assert theatre.service.count_in.cancel(theatre.runner)
    theatre.run(0.3)
    assert theatre.service.kiosk.clips == films[0] == list(visitors.iterdir()) == []


def test_a_recording_that_is_refused_leaves_nothing(open_kiosk, visitors, films, caplog):
    theatre = open_kiosk()
    theatre.service.count_in.start = refuse
    theatre.run(4.6)
    assert "the visitor's recording cannot begin" in caplog.text
    assert list(visitors.iterdir()) == []


def test_recovery_deletes_only_files_of_visitors_and_keeps_the_order_and_the_time_of_clips(visitors, given_clock):
    kept = ["BBBBBB.toml", "BBBBBB.log", "BBBBBB.mp4", "BBBBBB.gif", "AAAAAA.toml", "AAAAAA.log"]
    deleted = ["CCCCCC.toml", "DDDDDD.log", ".AAAAAA.12.mp4", "EEEEEE.mp4"]
    others = ["notes.txt", "a film.mp4", "scene.toml"]
    for number, name in enumerate((*kept, *deleted, *others)):
        (visitors / name).write_bytes(b"content")
        os.utime(visitors / name, (0, clock.wall() - 30 + number))
    (visitors / "FFFFFF.d").mkdir()
    offered = [(clip.code, clip.offered) for clip in clips_in(visitors)]
    assert offered == [("BBBBBB", pytest.approx(clock.now() - 28)), ("AAAAAA", None)]
    assert {path.name for path in visitors.iterdir()} == {*kept, *others, "FFFFFF.d"}


def test_recovery_reports_a_file_that_cannot_be_deleted(visitors, monkeypatch):
    (visitors / "CCCCCC.log").touch()
    monkeypatch.setattr(Path, "unlink", Mock(side_effect=PermissionError(errno.EPERM, "not yours")))
    with pytest.raises(OutputError, match="not yours"):
        clips_in(visitors)


def test_who_steps_back_ends_the_turn_and_comes_nearer_to_begin_another(make_stage, kung_fu, moved):
    stage = make_stage(settings=StageSettings(beyond=float(kung_fu[0].positions[0, 2]) + 1.0))
    driving = []
    for second, back in enumerate((0.0, 1.1, 0.8, 0.6)):
        frames = [moved(kung_fu[0], time=second + k / 30, by=(0.0, 0.0, back)) for k in range(30)]
        driving.append(play(stage, frames)["dog"][-1].user)
    assert driving == [1, None, None, 1]
