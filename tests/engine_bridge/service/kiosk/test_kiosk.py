"""Visitors record themselves by a gesture; nothing of it is kept, and nothing of it is lost before its time."""

import errno
import gc
import math
import os
import shutil
import tomllib
from pathlib import Path
from types import SimpleNamespace

import psutil
import pytest

from engine_bridge.film.scene import Scene
from engine_bridge.service.kiosk.clip import Clip, clips_in
from engine_bridge.service.kiosk.kiosk import LEAST_FREE_BYTES, MAX_ATTEMPTS, Kiosk
from engine_bridge.service.stages.stage import StageSettings
from puppetline import clock, toml_schema
from puppetline.errors import OutputError, ServiceError


def crash(theatre):
    """End a service without the cleaning up of its kiosk."""
    service = theatre.service
    service.kiosk._clips, service.kiosk._recorded = [], {}
    service.count_in.cancel = lambda _: None
    service.close()


def test_hands_up_begin_and_end_a_recording_and_the_film_is_offered_and_deleted(open_kiosk, visitors, films):
    (visitors / "ABCDEF.gif").touch()  # of no clip
    made, _ = films
    theatre = open_kiosk()
    kiosk = theatre.service.kiosk
    assert list(visitors.iterdir()) == []
    theatre.run(3.9)
    assert theatre.runner.recording is None
    theatre.run(1.5)
    code = theatre.runner.recording
    assert len(code) == 6
    assert kiosk.clips == []
    theatre.run(5.0)
    assert theatre.runner.recording is None
    [scene] = made
    assert scene == visitors / f"{code}.toml"
    filmed = toml_schema.check(Scene, tomllib.loads(scene.read_text()), "", ServiceError)
    assert [(each.character, each.file, each.user) for each in filmed.take] == [("dog", f"{code}.log", 1)]
    assert filmed.background.set == "stage"
    [clip] = kiosk.clips
    assert (clip.code, 50 < clip.seconds_left <= 60) == (code, True)
    assert theatre.ask("describe")["status"]["clips"] == [{"code": code, "seconds_left": clip.seconds_left}]
    assert theatre.of("dog")[-1].state == "performing"  # in the take
    assert (visitors / f"{code}.mp4").exists()
    theatre.run(60.0)
    assert kiosk.clips == []
    assert list(visitors.iterdir()) == []


def test_the_next_service_offers_a_crashed_one_s_film_for_the_rest_of_its_time(
    open_kiosk, visitors, films, given_clock
):
    theatre = open_kiosk()
    theatre.run(10.5)
    [clip] = theatre.service.kiosk.clips
    film = visitors / f"{clip.code}.mp4"
    os.utime(film, (clock.wall(), clock.wall()))
    theatre.run(20.0)
    crash(theatre)
    kiosk = open_kiosk().service.kiosk
    assert [(each.code, each.seconds_left) for each in kiosk.clips] == [(clip.code, 40)]
    assert len(films[0]) == 1


@pytest.mark.parametrize("seconds", [4.6, 7.0])
def test_the_next_service_makes_the_film_of_a_recording_that_a_crash_ended(open_kiosk, visitors, films, seconds):
    """The service crashes during the count, in which case nothing is left, or during the recording."""
    theatre = open_kiosk()
    theatre.run(seconds)
    code = theatre.runner.recording
    crash(theatre)
    kiosk = open_kiosk().service.kiosk
    assert films[0] == ([] if code is None else [visitors / f"{code}.toml"])
    assert [each.code for each in kiosk.clips] == ([] if code is None else [code])
    assert {path.stem for path in visitors.iterdir()} == ({code} - {None})


@pytest.mark.parametrize(("codes", "offered"), [([-9, -9], True), ([-9] * MAX_ATTEMPTS, False), ([1], False)])
def test_a_film_whose_process_is_killed_is_begun_again(visit, films, visitors, codes, offered):
    made, ends = films
    ends.extend(codes)
    kiosk = visit(1)
    assert len(made) == len(codes) + offered
    assert len(kiosk.clips) == offered
    assert bool(list(visitors.iterdir())) == offered


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


def test_a_long_queue_of_films_keeps_its_order_and_every_film_its_time(visit, visitors, films, tmp_path):
    """A visitor comes every 20 s, but a film takes 45 s: in the end, 34 of 60 takes wait, up to 25 minutes."""
    visit.slow_films(45.0)
    kiosk = visit(60, every=10.0)
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
    assert not [each for each in gc.get_objects() if type(each) is Clip and each.path.is_relative_to(tmp_path)]


def test_the_next_service_continues_a_long_queue_in_its_order(visit, visitors, films):
    visit.slow_films(45.0)
    kiosk = visit(12, every=10.0)
    recorded = [each.code for each in kiosk.clips]
    made = len(films[0])
    assert 0 < made < 12
    visit.slow_films(45.0)  # the first service is killed
    again = visit(0)
    assert [each.code for each in again.clips] == recorded
    visit.wait(again, 12 * 45)
    assert [path.stem for path in films[0]] == recorded


def test_a_service_that_cannot_start_keeps_the_clips_of_a_crashed_one(open_kiosk, visitors, films, monkeypatch):
    theatre = open_kiosk()
    theatre.run(10.5)
    crash(theatre)
    before = {path.name for path in visitors.iterdir()}

    def fail():
        raise ServiceError("here", found="a fault", expected="none", fix="Mend it.")

    monkeypatch.setattr("engine_bridge.service.service.Notifier", fail)
    with pytest.raises(ServiceError):
        open_kiosk()
    assert {path.name for path in visitors.iterdir()} == before


def test_a_reload_that_removes_the_stage_ends_the_recording_and_its_film_is_made(open_kiosk, visitors, films):
    theatre = open_kiosk()
    theatre.run(5.4)
    code, service = theatre.runner.recording, theatre.service
    service._replace_runners([])
    for _ in range(3):
        service.kiosk.advance(service.runners)
        service._finish_jobs()
    assert [path.stem for path in films[0]] == [code]
    assert [each.code for each in service.kiosk.clips] == [code]
    assert clock.now() < service.kiosk.due() < math.inf
    assert not service.kiosk._hands


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

    def refuse(*_):
        raise ServiceError("here", found="a fault", expected="none", fix="Mend it.")

    theatre.service.count_in.start = refuse
    theatre.run(4.6)
    assert "the visitor's recording cannot begin" in caplog.text
    assert list(visitors.iterdir()) == []


def test_a_film_whose_process_cannot_start_is_given_up(visit, visitors, monkeypatch, caplog):
    started = []

    def refuse(_, clip):
        started.append(clip)
        raise OSError(errno.ENOMEM, "no memory")

    monkeypatch.setattr(Kiosk, "_run", refuse)
    assert visit(1).clips == []
    assert len(started) == caplog.text.count("no memory") == MAX_ATTEMPTS
    assert list(visitors.iterdir()) == []


def test_recovery_deletes_only_files_of_visitors(visitors):
    kept = ["AAAAAA.toml", "AAAAAA.log", "BBBBBB.toml", "BBBBBB.log", "BBBBBB.mp4", "BBBBBB.gif"]
    deleted = ["CCCCCC.toml", "DDDDDD.log", ".AAAAAA.12.mp4", "EEEEEE.mp4"]
    others = ["notes.txt", "a film.mp4", "scene.toml"]
    for name in (*kept, *deleted, *others):
        (visitors / name).write_bytes(b"content")
    (visitors / "FFFFFF.d").mkdir()
    clips = clips_in(visitors)
    assert {clip.code: clip.offered is not None for clip in clips} == {"AAAAAA": False, "BBBBBB": True}
    assert {path.name for path in visitors.iterdir()} == {*kept, *others, "FFFFFF.d"}


def test_recovery_reports_a_file_that_cannot_be_deleted(visitors, monkeypatch):
    (visitors / "CCCCCC.log").touch()
    monkeypatch.setattr(Path, "unlink", lambda _: (_ for _ in ()).throw(PermissionError(errno.EPERM, "not yours")))
    with pytest.raises(OutputError, match="not yours"):
        clips_in(visitors)


def test_who_steps_back_ends_the_turn_and_comes_nearer_to_begin_another(make_stage, kung_fu, moved):
    stage = make_stage(settings=StageSettings(beyond=float(kung_fu[0].positions[0, 2]) + 1.0))
    driving = []
    for k, back in enumerate([0.0] * 20 + [1.1] * 30 + [0.8] * 20 + [0.6] * 20):
        stage.step(moved(kung_fu[0], time=k / 30, by=(0.0, 0.0, back)), clock.now_ns())
        driving.append(stage.players[0].user)
    assert (driving[19], driving[49], driving[69], driving[89]) == (1, None, None, 1)
