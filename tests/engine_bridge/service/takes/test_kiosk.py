"""Visitors record themselves by a gesture; nothing of it is kept."""

import tomllib
from dataclasses import replace

from capture.skeleton import JOINT_INDEX
from engine_bridge.film.scene import Scene
from engine_bridge.service.stages.stage import StageSettings
from engine_bridge.service.takes.kiosk import FOLDER, Kiosk
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


def test_hands_up_begin_and_end_a_recording_and_the_clip_is_offered_and_deleted(
    make_theatre, record_events, kung_fu, tmp_path, monkeypatch
):
    """A visitor raises both hands from second 2 to 5 and from 8 to 11."""
    still = [replace(kung_fu[0], time=kung_fu[0].time + k / 30) for k in range(14 * 30)]
    record_events(tmp_path / "performer.log", list(signalling(still, (2, 5), (8, 11))))
    made = []
    monkeypatch.setattr(Kiosk, "_make", lambda _, *paths: made.append(paths) or paths[1].write_bytes(b"video") * 0)
    visitors = tmp_path / "takes" / FOLDER
    visitors.mkdir(parents=True)
    (visitors / "ABCDE.mp4").touch()  # left by a crash
    theatre = make_theatre(("dog",), "replay:performer.log", tables="[kiosk]\ncount_in = 1\nminutes = 1.0")
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
    [(scene, video)] = made
    assert (scene, video) == tuple((visitors / code).with_suffix(ending) for ending in (".toml", ".mp4"))
    filmed = toml_schema.check(Scene, tomllib.loads(scene.read_text()), "", ServiceError)
    assert [(each.character, each.file, each.user) for each in filmed.take] == [("dog", f"{code}.log", 1)]
    [clip] = kiosk.clips
    assert (clip["code"], 50 < clip["seconds_left"] <= 60) == (code, True)
    assert theatre.of("dog")[-1].state == "performing"  # in the take
    assert video.exists()
    theatre.run(60.0)
    assert kiosk.clips == []
    assert list(visitors.iterdir()) == []


def test_who_steps_back_ends_the_turn_and_comes_nearer_to_begin_another(make_stage, kung_fu, moved):
    stage = make_stage(settings=StageSettings(beyond=float(kung_fu[0].positions[0, 2]) + 1.0))
    driving = []
    for k, back in enumerate([0.0] * 20 + [1.1] * 30 + [0.8] * 20 + [0.6] * 20):
        stage.step(moved(kung_fu[0], time=k / 30, by=(0.0, 0.0, back)), clock.now_ns())
        driving.append(stage.players[0].user)
    assert (driving[19], driving[49], driving[69], driving[89]) == (1, None, None, 1)
