"""Visitors record themselves by a gesture; nothing of it is kept."""

import tomllib
from dataclasses import replace
from types import SimpleNamespace

import pytest

from capture.skeleton import JOINT_INDEX
from engine_bridge.film.scene import Scene
from engine_bridge.service.background_jobs import Jobs
from engine_bridge.service.stages.stage import StageSettings
from engine_bridge.service.takes.kiosk import FOLDER, Kiosk, KioskTable
from puppetline import clock, toml_schema
from puppetline.errors import ServiceError


def signalling(frames, *raised):
    """Return frames of a performer whose hands are up between pairs of seconds."""
    for frame in frames:
        positions = frame.positions.copy()
        if any(begin <= frame.time < end for begin, end in raised):
            for joint in ("wrist_left", "hand_left", "wrist_right", "hand_right"):
                positions[JOINT_INDEX[joint]] = positions[JOINT_INDEX["head"]] + [0.2, 0.3, 0]
        yield replace(frame, positions=positions)


@pytest.fixture
def visitors(make_theatre, record_events, kung_fu, tmp_path):
    """A stage with a performer who raises both hands from second 2 to 5 and from 8 to 11, and the kiosk."""
    still = [replace(kung_fu[0], time=kung_fu[0].time + k / 30) for k in range(14 * 30)]
    record_events(tmp_path / "performer.log", list(signalling(still, (2, 5), (8, 11))))
    theatre = make_theatre(("dog",), uri="replay:performer.log")
    jobs, ended = Jobs(), []

    def stop(runner, clip):
        runner.stop_recording().close()
        ended.append(clip)

    table = KioskTable(count_in=1, minutes=1.0)

    for player in theatre.runner.stage.players:
        player.document = SimpleNamespace(path=tmp_path / f"{player.character.name}.toml")
    kiosk = Kiosk(table, tmp_path, theatre.count_in, stop, jobs)
    theatre.runner.watch = lambda frame: kiosk.see(theatre.runner, frame)

    def run(seconds):
        for _ in range(round(10 * seconds)):
            theatre.run(0.1)
            kiosk.advance([theatre.runner])

    yield theatre, kiosk, ended, run
    kiosk.close()
    jobs.close()


def test_hands_up_begin_and_end_a_recording_and_the_clip_is_offered_and_deleted(visitors, tmp_path, monkeypatch):
    theatre, kiosk, ended, run = visitors
    run(3.9)
    assert theatre.runner.recording is None
    run(1.5)
    code = theatre.runner.recording
    assert len(code) == 6
    assert not ended
    run(5.0)
    assert theatre.runner.recording is None
    (clip,) = ended
    assert (clip.path, clip.characters) == (tmp_path / FOLDER / f"{code}.log", [("dog", tmp_path / "dog.toml", 1)])
    monkeypatch.setattr(kiosk, "_make", lambda _, video: video.write_bytes(b"video") * 0)
    kiosk.film(clip)
    scene = toml_schema.check(Scene, tomllib.loads(clip.path.with_suffix(".toml").read_text()), "", ServiceError)
    assert [(each.character, each.file, each.user) for each in scene.take] == [("dog", f"{code}.log", 1)]
    assert kiosk.clips == [{"code": code, "seconds_left": None}]
    kiosk._jobs.filming.shutdown()
    for future, then in kiosk._jobs.take_finished():
        then(future)
    assert kiosk.clips == [{"code": code, "seconds_left": 60}]
    run(1)
    assert clip.video.exists()
    theatre.clock.advance(60)
    kiosk.advance([theatre.runner])
    assert kiosk.clips == []
    assert list((tmp_path / FOLDER).iterdir()) == []


def test_what_a_crash_left_is_deleted_at_the_next_start(tmp_path):
    (tmp_path / FOLDER).mkdir()
    (tmp_path / FOLDER / "ABCDE.mp4").touch()
    Kiosk(KioskTable(), tmp_path, None, None, None)
    assert list((tmp_path / FOLDER).iterdir()) == []


def test_who_steps_back_ends_the_turn_and_comes_nearer_to_begin_another(make_stage, kung_fu, moved):
    stage = make_stage(settings=StageSettings(beyond=float(kung_fu[0].positions[0, 2]) + 1.0))
    driving = []
    for k, back in enumerate([0.0] * 20 + [1.1] * 30 + [0.8] * 20 + [0.6] * 20):
        stage.step(moved(kung_fu[0], time=k / 30, by=(0.0, 0.0, back)), clock.now_ns())
        driving.append(stage.players[0].user)
    assert (driving[19], driving[49], driving[69], driving[89]) == (1, None, None, 1)
