import itertools

import numpy as np
import pytest

from capture.events import TICK_SECONDS
from engine_bridge.service.takes.take_track import TakeTrack
from puppetline import clock
from puppetline.errors import ServiceError

from ...refusals import refused

EASE = 0.2


@pytest.fixture
def paths(record_take):
    """Takes of the characters dog and cat, whose performer is calibrated after a moment and then walks."""
    return record_take("take1", names=("dog",))[0], record_take("take2", names=("cat",), seconds=1.5)[0]


@pytest.fixture
def begin(make_theatre, paths):
    """Play the take on the character dog; return the service, the track, and the cat's track."""

    def start(source="osc:0", **more):
        theatre = make_theatre(source=source, **more)
        dog, cat = (TakeTrack(theatre.player(name), path) for name, path in zip(("dog", "cat"), paths, strict=True))
        theatre.playback.add(dog)
        return theatre, dog, cat

    return start


@pytest.fixture
def with_performer(begin):
    """The same with a performer."""
    return begin("replay:performer.log?loop")


def follows(track, frames, zero, speed=1.0):
    """Whether each frame has the controls of the track's frame that is due then; `zero` is the moment of its start."""
    numbers = [track.index(speed * (frame.received / 1e9 - zero) + 1e-6) for frame in frames]
    return [
        np.array_equal(track.frame(k)[1][1].R, frame.pose.R) for k, frame in zip(numbers, frames, strict=True)
    ], numbers


def assert_eases_in(equal, frames, zero, seconds=EASE):
    """Only frames of the easing differ from those of the track."""
    assert any(equal)
    first = equal.index(True)
    assert all(equal[first:])
    assert frames[first].received / 1e9 - zero <= seconds + 3 * TICK_SECONDS


@pytest.mark.parametrize(("speed", "second"), [(1.0, 0.0), (1.0, 1.234), (2.5, 0.1), (0.5, 2.5), (1.0, 2.1333)])
def test_from_any_moment_a_take_moves_its_character_as_it_was_recorded(begin, speed, second):
    theatre, track, _ = begin()
    theatre.run(0.5)
    theatre.playback.timeline.set_speed(speed, clock.now())
    theatre.playback.seek(second)
    now, zero = clock.now(), clock.now() - second / speed
    theatre.run((track.seconds - second) / speed - 0.01)
    frames = theatre.of("dog")
    equal, numbers = follows(track, frames, zero, speed)
    assert_eases_in(equal, frames, now, EASE * max(1.0, 1 / speed))
    assert numbers == list(range(track.index(second), len(track.times) - 1))
    due = [speed * (frame.received / 1e9 - zero) for frame in frames[1:]]
    assert due == pytest.approx([track.times[number] for number in numbers[1:]], abs=speed * 2e-6)


def test_a_pause_holds_the_pose_goes_on_with_the_next_frame_and_can_jump(begin):
    theatre, track, _ = begin()
    zero = clock.now()
    theatre.run(1.0)
    before = theatre.of("dog")[-1]
    theatre.playback.timeline.pause(True, clock.now())
    theatre.run(1.0)
    assert len(theatre.of("dog")) >= 25
    assert all(np.array_equal(frame.pose.R, before.pose.R) for frame in theatre.of("dog"))
    theatre.playback.timeline.pause(False, clock.now())
    theatre.run(0.2)
    equal, numbers = follows(track, theatre.of("dog"), zero + 1.0)
    assert all(equal)
    assert numbers[0] == track.index(before.received / 1e9 - zero + 1e-6) + 1
    theatre.playback.timeline.pause(True, clock.now())
    theatre.playback.seek(2.5)
    theatre.run(1.0)
    frames = theatre.of("dog")
    assert np.array_equal(frames[-1].pose.R, track.frame(track.index(2.5))[1][1].R)
    assert not np.array_equal(frames[0].pose.R, frames[-1].pose.R)


def test_a_loop_begins_again_and_a_take_ends_at_its_end(begin):
    theatre, track, _ = begin()
    zero = clock.now()
    theatre.playback.timeline.loop = True
    theatre.run(2.5 * track.seconds)
    frames = theatre.of("dog")
    assert {frame.state for frame in frames} == {"performing"}
    third = [frame for frame in frames if frame.received / 1e9 > zero + 2 * track.seconds + 2 * EASE]
    assert all(follows(track, third, zero + 2 * track.seconds)[0])
    theatre.playback.timeline.loop = False
    theatre.run(track.seconds)
    assert not theatre.playback.takes
    assert theatre.of("dog")[-1].state == "waiting"


def test_nothing_jumps_when_a_take_begins_jumps_loops_and_stops(begin):
    theatre, track, _ = begin("replay:performer.log?loop", ease=0.8)
    shown = [*theatre.run(2.0)]
    theatre.playback.seek(0.3)
    shown += theatre.run(1.0)
    theatre.playback.seek(2.7)
    theatre.playback.timeline.loop = True
    shown += theatre.run(1.0)
    theatre.playback.add(track, 0.5)
    shown += theatre.run(1.0)
    theatre.playback.stop("dog")
    shown += theatre.run(2.0)
    frames = [frame for frame in shown if frame.character.name == "dog"]
    vertices = np.array([frame.vertices_and_normals[0] for frame in frames])
    diagonal = theatre.player("dog").character.prepared.mesh.diagonal
    assert np.linalg.norm(np.diff(vertices, axis=0), axis=-1).max() / diagonal < 0.04
    assert all(a.time <= b.time for a, b in itertools.pairwise(frames))
    assert [b.sequence - a.sequence for a, b in itertools.pairwise(frames)] == [1] * (len(frames) - 1)


def test_a_performer_gets_another_character_and_the_first_one_back(with_performer):
    theatre, _, _ = with_performer
    theatre.run(1.0)
    assert (theatre.player("dog").user, theatre.player("cat").user) == (None, 1)
    assert "performing" in {frame.state for frame in theatre.of("cat")}
    refused(ServiceError, theatre.runner.cue, "choose_user", character="dog", user=1)
    theatre.playback.stop()
    theatre.runner.cue("choose_user", character="dog", user=1)
    theatre.run(1.0)
    assert (theatre.player("dog").user, theatre.player("cat").user) == (1, None)


def test_two_takes_have_one_clock_and_their_characters_idle_before_and_after(begin):
    theatre, dog, cat = begin()
    zero = clock.now()
    theatre.playback.add(cat, 1.0)
    theatre.run(0.9)
    assert {frame.state for frame in theatre.of("cat")} == {"waiting"}
    theatre.run(0.9)
    assert all(follows(dog, theatre.of("dog"), zero)[0])
    shown = [frame for frame in theatre.of("cat") if frame.state == "performing"]
    assert_eases_in(follows(cat, shown, zero + 1.0)[0], shown, zero + 1.0)
    assert theatre.playback.timeline.end == max(dog.seconds, 1.0 + cat.seconds)
    theatre.run(1.1)
    assert theatre.of("cat")[-1].state == "waiting"
    assert theatre.of("dog")[-1].state == "performing"


def test_a_changed_mapping_moves_the_take_too(begin):
    theatre, track, _ = begin()
    zero = clock.now()
    theatre.run(0.5)
    player = theatre.player("dog")
    retarget = player.character.prepared.puppet.retarget.model_copy(update={"scale": 0.4})
    theatre.runner.remap(player, player.character.prepared.puppet.model_copy(update={"retarget": retarget}))
    assert theatre.playback.stale() == [(player, track)]
    theatre.run(0.2)
    changed = TakeTrack(player, track.path)
    theatre.playback.replace(changed)
    assert not theatre.playback.stale()
    theatre.run(1.0)
    assert follows(changed, theatre.of("dog")[-5:], zero)[0] == [True] * 5
    assert follows(track, theatre.of("dog")[-5:], zero)[0] == [False] * 5


def test_characters_that_are_loaded_again_stay_with_their_takes(with_performer):
    theatre, _, _ = with_performer
    theatre.run(0.5)
    assert theatre.ask("reload") == {"characters": ["dog", "cat"]}
    theatre.run(0.5)
    assert theatre.of("dog")[-1].state == "performing"
    numbers = [frame.sequence for frame in theatre.frames if frame.character.name == "dog"]
    assert numbers == list(range(1, len(numbers) + 1))
    assert (theatre.player("dog").user, theatre.player("cat").user) == (None, 1)
    theatre.runner.replace_players([theatre.player("cat")])
    theatre.run(0.2)
    assert not theatre.playback.takes


def test_a_take_that_fails_ends_and_the_others_go_on(begin, monkeypatch):
    theatre, dog, cat = begin()
    theatre.playback.add(cat)
    theatre.run(0.5)
    monkeypatch.setattr(dog, "frame", lambda number: 1 / 0)
    theatre.run(0.5)
    assert [each["character"] for each in theatre.playback.takes] == ["cat"]
    assert theatre.of("cat")[-1].state == "performing"


def test_the_first_take_may_wait_for_the_others_at_its_beginning(begin):
    theatre, dog, cat = begin()
    theatre.playback.stop()
    theatre.playback.add(dog, 1.0, 0.5, 0.7, pause=True)
    theatre.run(5.0)
    theatre.playback.add(cat, 1.0, 0.5, 1.5)
    assert theatre.playback.timeline.paused
    assert theatre.playback.timeline.position(clock.now()) == 1.0
    assert [each["character"] for each in theatre.playback.takes] == ["dog", "cat"]
    theatre.playback.timeline.pause(False, clock.now())
    theatre.run(0.5)
    assert theatre.playback.timeline.position(clock.now()) == pytest.approx(1.5)


def test_parts_of_takes_follow_one_another_on_one_character(begin, paths):
    theatre, track, _ = begin()
    again = TakeTrack(theatre.player("dog"), paths[0])
    theatre.playback.stop()
    theatre.playback.add(track, 0.0, 0.5, 1.0)
    added = theatre.playback.add(again, 2.0, 0.2, 0.6, beside=True)
    assert added == pytest.approx({"character": "dog", "take": "take1", "at": 2.0, "seconds": 0.4, "sound": None})
    assert (theatre.playback.timeline.start, theatre.playback.timeline.end) == pytest.approx((0.0, 2.4), abs=1 / 30)
    for at, seconds, part, shown in ((0.0, 0.48, track, 0.98), (2.0, 0.38, again, 0.58)):
        theatre.playback.seek(at)
        theatre.run(seconds)
        assert np.array_equal(theatre.of("dog")[-1].pose.R, part.frame(part.index(shown))[1][1].R)
    assert refused(ServiceError, theatre.playback.add, track, 0.0, 90.0).where == "take 'take1'"
