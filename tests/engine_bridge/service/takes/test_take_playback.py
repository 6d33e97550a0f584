import numpy as np
import pytest

from capture.events import TICK_SECONDS
from puppetline import clock
from puppetline.errors import ServiceError

from ...refusals import refused
from ..stage_steps import states

EASE = 0.2
TAKES = {"dog": 3.0, "cat": 1.5}


@pytest.fixture
def begin(make_theatre, record_take):
    """Play a take on the character dog; return the service, the track, and a shorter one for the cat.

    Their performer is calibrated after a moment and then walks.
    """
    first, second = (record_take(f"{name}'s", names=(name,), seconds=long)[0] for name, long in TAKES.items())

    def start(source="osc:0", **more):
        theatre = make_theatre(source=source, **more)
        dog, cat = theatre.load("dog", first), theatre.load("cat", second)
        theatre.playback.add(dog)
        return theatre, dog, cat

    return start


@pytest.fixture
def with_performer(begin):
    """The same with a performer."""
    return begin("replay:performer.log?loop")


def controls(track, number):
    return track.frame(number)[1][1].R


def follows(track, frames, zero, speed=1.0):
    """Whether each frame has the controls of the track's frame that is due then; `zero` is the moment of its start."""
    numbers = [track.index(speed * (frame.received / 1e9 - zero) + 1e-6) for frame in frames]
    shown = zip(numbers, frames, strict=True)
    return [np.array_equal(controls(track, number), frame.pose.R) for number, frame in shown], numbers


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
    now, zero = clock.now(), clock.now() - second / speed
    theatre.playback.timeline.set_speed(speed, now)
    theatre.playback.seek(second)
    theatre.run((track.seconds - second) / speed - 0.01)
    frames = theatre.of("dog")
    equal, numbers = follows(track, frames, zero, speed)
    assert_eases_in(equal, frames, now, EASE * max(1.0, 1 / speed))
    assert numbers == list(range(track.index(second), len(track.times) - 1))
    due = [speed * (frame.received / 1e9 - zero) for frame in frames[1:]]
    assert due == pytest.approx([track.times[number] for number in numbers[1:]], abs=speed * 2e-6)


def test_a_pause_holds_the_pose_goes_on_with_the_next_frame_and_can_jump(begin):
    (theatre, track, _), zero = begin(), clock.now()
    timeline = theatre.playback.timeline
    theatre.run(1.0)
    before = theatre.of("dog")[-1]
    timeline.pause(True, clock.now())
    theatre.run(1.0)
    held = theatre.of("dog")
    assert len(held) >= 25
    assert all(np.array_equal(frame.pose.R, before.pose.R) for frame in held)
    timeline.pause(False, clock.now())
    theatre.run(0.2)
    equal, numbers = follows(track, theatre.of("dog"), zero + 1.0)
    assert all(equal)
    assert numbers[0] == track.index(before.received / 1e9 - zero + 1e-6) + 1
    timeline.pause(True, clock.now())
    theatre.playback.seek(2.5)
    theatre.run(1.0)
    first, *_, last = (frame.pose.R for frame in theatre.of("dog"))
    assert np.array_equal(last, controls(track, track.index(2.5)))
    assert not np.array_equal(first, last)


def test_a_loop_begins_again_and_a_take_ends_at_its_end(begin):
    (theatre, track, _), zero = begin(), clock.now()
    theatre.playback.timeline.loop = True
    theatre.run(2.5 * track.seconds)
    frames, third = theatre.of("dog"), zero + 2 * track.seconds
    assert states(frames) == {"performing"}
    assert all(follows(track, [frame for frame in frames if frame.received / 1e9 > third + 2 * EASE], third)[0])
    theatre.playback.timeline.loop = False
    theatre.run(track.seconds)
    assert not theatre.playback.takes
    assert theatre.of("dog")[-1].state == "waiting"


def test_nothing_jumps_when_a_take_begins_jumps_loops_and_stops(begin):
    theatre, track, _ = begin("replay:performer.log?loop", ease=0.8)
    playback = theatre.playback

    def loop():
        playback.seek(2.7)
        playback.timeline.loop = True

    theatre.run(2.0)
    for change in (lambda: playback.seek(0.3), loop, lambda: playback.add(track, 0.5), lambda: playback.stop("dog")):
        change()
        theatre.run(1.0)
    theatre.run(1.0)
    frames = [frame for frame in theatre.frames if frame.character.name == "dog"]
    vertices = np.array([frame.vertices_and_normals[0] for frame in frames])
    diagonal = theatre.player("dog").character.prepared.mesh.diagonal
    assert np.linalg.norm(np.diff(vertices, axis=0), axis=-1).max() / diagonal < 0.04
    assert (np.diff([frame.time for frame in frames]) >= 0).all()
    assert set(np.diff([frame.sequence for frame in frames])) == {1}


def users(theatre):
    return [theatre.player(name).user for name in ("dog", "cat")]


def test_a_performer_gets_another_character_and_the_first_one_back(with_performer):
    theatre, _, _ = with_performer
    theatre.run(1.0)
    assert users(theatre) == [None, 1]
    assert "performing" in states(theatre.of("cat"))
    refused(ServiceError, theatre.runner.cue, "choose_user", character="dog", user=1)
    theatre.playback.stop()
    theatre.runner.cue("choose_user", character="dog", user=1)
    theatre.run(1.0)
    assert users(theatre) == [1, None]


def test_two_takes_have_one_clock_and_their_characters_idle_before_and_after(begin):
    (theatre, dog, cat), zero = begin(), clock.now()
    theatre.playback.add(cat, 1.0)
    theatre.run(0.9)
    assert states(theatre.of("cat")) == {"waiting"}
    theatre.run(0.9)
    assert all(follows(dog, theatre.of("dog"), zero)[0])
    shown = [frame for frame in theatre.of("cat") if frame.state == "performing"]
    assert_eases_in(follows(cat, shown, zero + 1.0)[0], shown, zero + 1.0)
    assert theatre.playback.timeline.end == max(dog.seconds, 1.0 + cat.seconds)
    theatre.run(1.1)
    assert theatre.of("cat")[-1].state == "waiting"
    assert theatre.of("dog")[-1].state == "performing"


def test_a_changed_mapping_moves_the_take_too(begin):
    (theatre, track, _), zero = begin(), clock.now()
    theatre.run(0.5)
    player = theatre.player("dog")
    puppet = player.character.prepared.puppet
    scaled = puppet.retarget.model_copy(update={"scale": 0.4})
    theatre.runner.remap(player, puppet.model_copy(update={"retarget": scaled}))
    assert theatre.playback.stale() == [(player, track)]
    theatre.run(0.2)
    changed = theatre.load("dog", track.path)
    theatre.playback.replace(changed)
    assert not theatre.playback.stale()
    theatre.run(1.0)
    last = theatre.of("dog")[-5:]
    assert follows(changed, last, zero)[0] == [True] * 5
    assert follows(track, last, zero)[0] == [False] * 5


def test_characters_that_are_loaded_again_stay_with_their_takes(with_performer):
    theatre, _, _ = with_performer
    theatre.run(0.5)
    assert theatre.ask("reload") == {"characters": ["dog", "cat"]}
    theatre.run(0.5)
    assert theatre.of("dog")[-1].state == "performing"
    numbers = [frame.sequence for frame in theatre.frames if frame.character.name == "dog"]
    assert numbers == list(range(1, len(numbers) + 1))
    assert users(theatre) == [None, 1]
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
    playback = theatre.playback
    playback.stop()
    playback.add(dog, 1.0, 0.5, 0.7, pause=True)
    theatre.run(5.0)
    playback.add(cat, 1.0, 0.5, 1.5)
    assert playback.timeline.paused
    assert playback.timeline.position(clock.now()) == 1.0
    assert [each["character"] for each in playback.takes] == ["dog", "cat"]
    playback.timeline.pause(False, clock.now())
    theatre.run(0.5)
    assert playback.timeline.position(clock.now()) == pytest.approx(1.5)


def test_parts_of_takes_follow_one_another_on_one_character(begin):
    theatre, track, _ = begin()
    playback, again = theatre.playback, theatre.load("dog", track.path)
    playback.stop()
    playback.add(track, 0.0, 0.5, 1.0)
    added = playback.add(again, 2.0, 0.2, 0.6, beside=True)
    entry = {"character": "dog", "take": track.take, "at": 2.0, "seconds": 0.4, "sound": None}
    assert added == pytest.approx(entry)
    assert (playback.timeline.start, playback.timeline.end) == pytest.approx((0.0, 2.4), abs=1 / 30)
    for at, seconds, part, shown in ((0.0, 0.48, track, 0.98), (2.0, 0.38, again, 0.58)):
        playback.seek(at)
        theatre.run(seconds)
        assert np.array_equal(theatre.of("dog")[-1].pose.R, controls(part, part.index(shown)))
    assert refused(ServiceError, playback.add, track, 0.0, 90.0).where == f"take {track.take!r}"
