import json

import pytest

from capture.events import TICK_SECONDS
from puppetline import clock
from puppetline.errors import OutputError, ServiceError

from ...refusals import refused


@pytest.fixture
def overdub(make_theatre, record_take, tmp_path):
    """Play a take on the dog, and record the performer, who drives the cat, over it; return everything."""
    first, _ = record_take("take1", names=("dog",))

    def record(count_in, seconds=2.0):
        theatre, second = make_theatre(), tmp_path / "take2.log"
        dog = theatre.load("dog", first)
        theatre.playback.add(dog)
        theatre.run(1.0)
        theatre.count(second, count_in)
        theatre.run(count_in + seconds)
        theatre.end_take()
        return theatre, dog, second

    return record


def opening(path):
    """Return the arguments of the cue with which a take begins."""
    return json.loads(path.read_text().splitlines()[1])["arguments"]


def test_the_service_counts_down_and_takes_begin_at_zero(overdub):
    theatre, _, path = overdub(count_in=0, seconds=0.1)
    playback, zero, counts = theatre.playback, clock.now() + 3, []
    theatre.count(path.with_name("take3.log"), 3)
    assert playback.status().moment == pytest.approx(zero, abs=1e-4)
    for _ in range(7):
        counts.append(theatre.left())
        position = playback.timeline.position(clock.now())
        theatre.run(0.41)
    assert counts == [3, 3, 3, 2, 2, 1, 1]
    assert position == 0.0
    assert theatre.runner.recording is None
    assert theatre.count_in.take(theatre.runner) == "take3"
    theatre.run(0.23)
    assert theatre.runner.recording == "take3"
    assert theatre.left() == 0
    assert playback.timeline.position(clock.now()) == pytest.approx(0.1, abs=1e-4)
    assert playback.status().moment == pytest.approx(clock.now(), abs=1e-4)


def test_both_takes_line_up_as_they_were_seen_when_the_second_was_recorded(overdub, make_theatre):
    theatre, dog, path = overdub(count_in=2)
    said = opening(path)
    assert said["reserved"] == ["dog"]
    place = {"character": "dog", "take": "take1", "at": 0.0, "seconds": dog.seconds, "sound": None}
    assert said["timeline"]["takes"] == [place]
    assert -TICK_SECONDS - 1e-4 <= said["timeline"]["at"] <= 0.0

    def apart(theatre):
        """The time from the dog's frame nearest to its first second to the cat's next 20 frames."""
        zero = theatre.playback.timeline.moment(0.0)
        first = min((frame.received for frame in theatre.of("dog")), key=lambda at: abs(at / 1e9 - zero - 1.0))
        return [(frame.received - first) / 1e9 for frame in theatre.of("cat") if frame.received > first][:20]

    other = make_theatre(source="osc:0")
    cat = other.load("cat", path)
    for track in (other.load("dog", dog.path), cat):
        other.playback.add(track)
    other.run(2.0)
    assert cat.offset == said["timeline"]["at"]
    assert apart(other) == pytest.approx(apart(theatre), abs=1e-5)


def test_a_take_from_the_middle_stores_that_second_and_replays_without_the_other_take(overdub, make_theatre):
    _, _, path = overdub(count_in=0)
    assert opening(path)["timeline"]["at"] == pytest.approx(1.0, abs=TICK_SECONDS + 1e-4)
    replayed = make_theatre(source="replay:take2.log")
    replayed.run(1.5)
    assert {frame.user for frame in replayed.of("dog")} == {None}
    assert {frame.user for frame in replayed.of("cat")} == {1}


def test_without_other_takes_none_are_stored_and_a_count_in_can_be_cancelled(make_theatre, tmp_path):
    theatre = make_theatre()
    theatre.count(tmp_path / "alone.log", 1)
    theatre.run(1.5)
    theatre.end_take()
    assert opening(tmp_path / "alone.log")["timeline"] is None
    theatre.count(tmp_path / "never.log", 2)
    theatre.run(1.0)
    assert theatre.count_in.cancel(theatre.runner) == "never"
    theatre.run(2.0)
    assert theatre.runner.recording is None
    assert not (tmp_path / "never.log").exists()


def test_a_take_that_cannot_begin_after_the_count_is_logged(make_theatre, tmp_path, caplog):
    theatre = make_theatre()
    path = tmp_path / "take.log"
    theatre.count(path, 1)
    path.write_text("something else")
    theatre.run(1.5)
    assert "the take cannot begin" in caplog.text
    for taken, seconds in ((path, 1), (path, 0), (tmp_path / "no folder" / "take.log", 1)):
        refused(OutputError, theatre.count, taken, seconds)
    assert theatre.count_in.take(theatre.runner) is None


def test_nothing_is_recorded_over_takes_that_play_at_another_speed(overdub, tmp_path):
    theatre, _, _ = overdub(count_in=0, seconds=0.5)
    theatre.playback.timeline.set_speed(0.5, clock.now())
    refused(ServiceError, theatre.count, tmp_path / "slow.log", 3)
