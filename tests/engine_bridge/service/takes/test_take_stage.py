from functools import partial

import numpy as np
import pytest

from capture.events import Lost
from engine_bridge.service.players.player_settings import PlayerSettings
from engine_bridge.service.takes.take_track import TakeTrack
from puppetline.errors import ServiceError, SkeletonLogError, SourceError

from ...refusals import refused
from ..stage_steps import beginning, with_beginnings_of


def states(track):
    return [track.frame(number)[0].state for number in range(len(track.times))]


@pytest.fixture
def dog(make_player):
    """Load a take for the character dog."""
    return partial(TakeTrack, make_player("dog"))


def test_a_performer_of_another_character_never_drives_this_one(make_stage, record_events, kung_fu, moved, tmp_path):
    """On a stage of the dog alone, the cat's performer would take over when the dog's leaves."""
    stage = make_stage(("dog", "cat"), PlayerSettings(calibrate="at_once"))
    both = [each for frame in kung_fu[:120] for each in (frame, moved(frame, user=2, by=(1.0, 0.0, 0.0)))]
    begin = beginning(stage)
    events = with_beginnings_of(stage, [*both, Lost(both[-1].time, 1)])
    later = [moved(frame, time=frame.time + 4.0, user=2) for frame in kung_fu[:60]]
    track = TakeTrack(stage.players[0], record_events(tmp_path / "both.log", [begin, *events, *later]))
    assert states(track)[-1] in ("leaving", "waiting")
    assert {track.frame(number)[0].user for number in range(len(track.times))} == {1, None}


def test_a_take_of_two_characters_can_drive_each_and_others_with_the_performer_of_one(record_take, make_player, dog):
    path, _ = record_take(names=("dog", "cat"), seconds=1.5)  # the only performer drives the dog
    cat, horse, own = make_player("cat"), make_player("horse"), states(dog(path))
    assert "performing" in own
    assert set(states(TakeTrack(cat, path))) == set(states(dog(path, "cat"))) == {"waiting"}
    assert refused(ServiceError, TakeTrack, horse, path).where == "take 'take1'"
    assert states(TakeTrack(cat, path, "dog")) == states(TakeTrack(horse, path, "dog")) == own


def test_a_take_plays_up_to_its_damage_and_says_so(record_take, dog):
    path, frames = record_take(names=("dog",))
    lines = path.read_bytes().splitlines(keepends=True)
    lines[60] = b'{"t": "soon"}\n'
    path.write_bytes(b"".join(lines))
    track = dog(path)
    assert "line 61" in track.note
    assert 50 < len(track.times) < 60
    assert np.array_equal(track.frame(50)[1][1].R, frames[50].pose.R)


def test_a_take_with_a_damaged_beginning_plays_like_any_other_recording(record_take, dog):
    path, _ = record_take(names=("dog",), seconds=2.0)
    text = path.read_text()
    path.write_text(text.replace('"time"', '"times"', 1))
    track = dog(path)
    assert track.note
    assert states(track)[-1] == "performing"


def test_any_recording_plays_and_calibrates_after_a_moment(record_events, kung_fu, dog, tmp_path):
    track = dog(record_events(tmp_path / "plain.log", [*kung_fu[:60], Lost(kung_fu[60].time, 1), *kung_fu[90:120]]))
    assert set(states(track)[:60]) == {"performing"}
    assert not np.array_equal(track.frame(0)[1][1], track.frame(59)[1][1])
    assert "leaving" in states(track)
    assert np.diff(track.times).max() < 0.11  # ticks fill the gap
    assert track.times[0] == 0.0


def test_a_take_that_is_missing_without_motion_or_too_long_is_refused(record_take, dog, monkeypatch, tmp_path):
    path, _ = record_take(names=("dog",), seconds=1.0)
    refused(SkeletonLogError, dog, tmp_path / "gone.log")
    monkeypatch.setattr("engine_bridge.service.takes.take_track.MAX_FRAMES", 20)
    refused(ServiceError, dog, path)
    for keep, family in ((2, ServiceError), (1, SourceError)):  # no motion, not even a beginning
        path.write_bytes(b"".join(path.read_bytes().splitlines(keepends=True)[:keep]))
        refused(family, dog, path)
