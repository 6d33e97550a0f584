import json
import socket
import time
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from puppetline.examples.performances import PERFORMANCES

from capture.events import Cue, Lost, Tick
from capture.network.osc import encode
from capture.network.source import open_osc
from capture.reconnecting import ReopeningSource
from capture.sensor_tilt import SensorTilt
from capture.sensors import sight as sights
from capture.sensors.sight import FROZEN, Performer, Reason, Sight, Watch, reasons, status_line, summary, told
from capture.sensors.source import SensorSource
from capture.skeleton import JOINT_INDEX, JOINTS, SkeletonFrame
from capture.source import Counts
from capture.sources.replay import RecordingSource
from capture.trackers.picture import Lens, Picture
from puppetline.errors import SourceError

LENS = Lens(640, 480, 525.0)
WALK = PERFORMANCES["walk"]()
COLOR = np.full((480, 640, 3), 120, np.uint8)
DEPTH = np.full((480, 640), 3000, np.uint16)


def frame(number, user=1, confidence=1.0, moved=(0, 0, 0)):
    """Return a frame of somebody who walks about 3 m away."""
    sure = np.full(20, confidence, np.float32)
    return SkeletonFrame(number / 30, user, WALK.positions[number] + moved, sure)


def seen(frames=(), picture=None, **more):
    """Return what was seen of a source that has given frames."""
    sight = Sight("test:", more.pop("listens", False), 3.0, more.pop("received", 90), picture=picture, **more)
    for each in frames:
        sight.take(each)
    return sight


def why(*arguments, **more):
    return why_of(seen(*arguments, **more))


def why_of(sight):
    return [reason.what for reason in reasons(sight)]


def picture(color=COLOR, depth=DEPTH):
    return Picture(0.0, LENS, color, depth)


@pytest.fixture
def osc():
    with closing(open_osc("127.0.0.1:0")) as source:
        yield source


def send(source, *datagrams):
    with socket.socket(type=socket.SOCK_DGRAM) as sender:
        for datagram in datagrams:
            sender.sendto(datagram, ("127.0.0.1", source.port))


@pytest.mark.parametrize("shown", [None, picture(), picture(depth=None), picture(color=None)])
def test_of_somebody_who_is_seen_well_there_is_nothing_to_say(shown):
    sight = seen(map(frame, range(60)), shown)
    assert reasons(sight) == []
    assert told(sight.performers[1]) == "user 1: 20 of 20 joints seen, 2.78 m away, 30 frames a second"


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"listens": True, "received": 0, "silent": 3.2}, ["Nothing has come in 3 s."]),
        ({"listens": False, "received": 0, "silent": 3.2}, ["No picture has come in 3 s."]),
        ({"listens": True, "received": 7}, ["Packets come, with nobody in them."]),
        (
            {"listens": True, "received": 1007, "refused": {"unknown message": 1000, "not OSC": 7}},
            ["What came were no performers: not OSC (7 ×), unknown message (1000 ×)."],
        ),
        ({"failure": "freenect: found no Kinect"}, ["freenect: found no Kinect"]),
        ({"picture": picture()}, ["Nobody is in view."]),
        ({"picture": picture(COLOR * 0)}, ["The picture is black.", "Nobody is in view."]),
        ({"picture": picture(COLOR // 5)}, ["The picture is dark.", "Nobody is in view."]),
        ({"picture": picture(depth=DEPTH * 0)}, ["The sensor measures no depth.", "Nobody is in view."]),
        (
            {"picture": picture(COLOR * 0, DEPTH * (np.arange(640) < 64).astype(np.uint16))},
            ["The picture is black.", "The sensor measures depth in 10% of the picture.", "Nobody is in view."],
        ),
        (
            {"picture": picture(), "gone": {4, 2}},
            ["Nobody is in view.", "User 2 was there and is gone.", "User 4 was there and is gone."],
        ),
    ],
)
def test_why_nobody_is_there_is_said_in_order_of_causes(more, said):
    assert why(**more) == said


def test_each_reason_but_an_error_that_has_its_own_says_what_to_do():
    for more in ({"listens": True, "received": 0}, {"received": 0}, {"picture": picture(COLOR * 0, DEPTH * 0)}):
        assert all(reason.fix for reason in reasons(seen(**more)))


def test_a_pose_that_never_changes_is_nobodys():
    same = [replace(frame(0), time=number / 30) for number in range(FROZEN)]
    assert why(same) == [f"User 1 does not move at all: {FROZEN} times the very same pose came."]
    assert why(same[1:]) == []
    assert why([*same, frame(FROZEN)]) == []


def test_joints_that_are_guessed_or_unknown_are_named_as_people_do():
    sure = np.ones(20, np.float32)
    sure[JOINT_INDEX["foot_left"]] = 0
    assert why([replace(frame(0), confidence=sure)]) == ["User 1: nothing is known of left foot."]
    sure[:] = 1
    sure[:8] = 0.5  # what senders of 15 joints leave to guess is nothing to complain of
    assert why([replace(frame(0), confidence=sure)]) == []
    sure[8] = 0.3
    (guessed,) = why([replace(frame(0), confidence=sure)])
    sure[19] = 0  # is not known, and so not guessed
    assert why([replace(frame(0), confidence=sure)])[1] == guessed
    assert guessed == (
        "User 1: 9 of 20 joints are guessed: hip center, spine, shoulder center, head, left shoulder, left elbow, "
        "left wrist, left hand, right shoulder."
    )


def test_who_reaches_out_of_the_picture_is_told_with_which_joints():
    head = WALK.positions[0, JOINT_INDEX["head"]]
    high = (0, 240 / 525 * head[2] - head[1] + 0.01, 0)  # its head is a centimetre above the upper edge
    assert why([frame(0, moved=high)], picture()) == ["User 1: head outside the picture."]
    assert why([frame(0, moved=high)]) == []


@pytest.mark.parametrize("away", [0.6, 5.0])
def test_who_is_too_near_or_too_far_for_depth_is_told(away):
    near = frame(0, moved=(0, 0, away - np.median(WALK.positions[0, :, 2])))
    assert f"User 1 is {away:.1f} m away." in why([near], picture())
    assert f"User 1 is {away:.1f} m away." not in why([near], picture(depth=None))


def test_a_slow_source_is_told():
    slow = [replace(frame(number), time=number / 8) for number in range(20)]
    assert why(slow) == ["User 1: only 8 frames a second come."]


def test_each_performer_is_told_of_and_who_comes_back_is_there():
    sight = seen([frame(0, 2), frame(0, 1, 0.4), Lost(0.1, 2), frame(5, 2), Lost(0.2, 9), Tick(0.3)])
    assert (set(sight.performers), sight.gone) == ({1, 2}, set())
    assert [reason.what[:10] for reason in reasons(sight)] == ["User 1: 20"]


def test_a_frame_in_which_nothing_is_known_is_nobody():
    lost = replace(frame(0), positions=np.full((20, 3), np.nan))
    assert seen([lost]).performers == {}


def test_the_summary_is_json():
    sight = seen(map(frame, range(60)), picture(depth=DEPTH * (np.arange(640) < 320).astype(np.uint16)))
    plain = json.loads(json.dumps(summary(sight, [Reason("a", "b")]), allow_nan=False))
    assert plain["picture"] == {"width": 640, "height": 480, "brightness": 120.0, "depth_known": 0.5}
    assert plain["reasons"] == [{"what": "a", "fix": "b"}]
    (performer,) = plain["performers"]
    assert performer["confidence"] == dict.fromkeys(JOINTS, 1.0)
    assert (performer["user"], performer["joints_seen"]) == (1, 20)
    assert performer["rate"] == pytest.approx(30)


def test_the_rate_is_that_of_the_frames_times():
    performer = Performer(frame(0), 0.0)
    assert performer.rate is None
    for number in range(1, 31):
        performer.take(frame(number))
    assert performer.rate == pytest.approx(30)


def test_a_recording_that_ends_leaves_who_was_in_it_and_says_so():
    short = replace(
        WALK, times=WALK.times[:3], positions=WALK.positions[:3], confidence=np.ones((3, 20), np.float32), user=1
    )
    with closing(RecordingSource.of_clips("replay:short.log", [short])) as source:
        sight = sights.watch(source, 60)
    assert {user: performer.frames for user, performer in sight.performers.items()} == {1: 3}
    assert [reason.what for reason in reasons(sight)] == [sight.failure]
    assert "found the end of the recording" in sight.failure


def test_a_silent_port_is_given_up_and_packets_that_are_none_are_told_of(osc):
    assert why_of(sights.watch(osc, 1, patience=0.1)) == ["Nothing has come in 0 s."]
    send(osc, b"nonsense")
    sight = sights.watch(osc, 0.1)
    assert (sight.received, sum(sight.refused.values()), sight.listens) == (1, 1, True)
    assert why_of(sight)[0].startswith("What came were no performers: ")


def test_a_performer_of_whom_nothing_comes_any_more_has_gone(osc, monkeypatch):
    monkeypatch.setattr(sights, "SILENT", 0.05)
    send(osc, *(encode("/joint", name, 7, 0.5, 0.5, 1.0) for name in ("head", "neck", "torso")))
    sight = sights.watch(osc, 0.5)
    assert (set(sight.performers), sight.gone) == (set(), {7})


def test_the_last_picture_of_a_sensor_is_kept_with_who_was_in_it(watch, scripted_device, scripted_tracker):
    scripted_device.show(0.0)
    scripted_device.show(0.1, color=np.full((3, 4, 3), 5, np.uint8))
    sight = sights.watch(watch(scripted_device, scripted_tracker).source, 0.3)
    assert (sight.picture.time, set(sight.performers), sight.listens) == (0.1, {1}, False)
    assert "The picture is black." in why_of(sight)


def test_a_sensor_that_fails_is_told_with_its_own_error(watch, scripted_tracker):
    def absent():
        raise SourceError("freenect:", found="no Kinect v1 on USB", expected="one", fix="Plug it in.")

    sight = sights.watch(watch(absent, scripted_tracker).source, 1)
    assert why_of(sight) == ["freenect: found no Kinect v1 on USB; expected one. Plug it in."]


PATIENCE = 30.0
"""Seconds after which a test gives up."""


def until(looking, condition):
    """Look until what is seen satisfies a condition, and return it."""
    give_up = time.monotonic() + PATIENCE
    while not condition(sight := looking.sight()):
        assert time.monotonic() < give_up, sight
        looking.take_in(time.monotonic() + 0.05)
    return sight


class Played:
    """A source of events at times that the test tells; a stand-in, for no other one comes as fast as a test wants."""

    name = "played:"
    recorded = False

    def __init__(self):
        self.counts, self.time, self.events = Counts(), 0.0, []

    def play(self, looking, *events, refused=()):
        self.events += events
        self.time = max([self.time, *(event.time for event in events)])
        self.counts.received += len(events) + len(refused)
        self.counts.refused.update(refused)
        looking.take_in(0)

    def fileno(self):
        return None

    def due(self):
        return 0.0

    def now(self):
        return self.time

    def receive(self):
        events, self.events = self.events, []
        return events

    def close(self):
        pass


def test_who_looks_on_sees_what_came_of_late():
    source = Played()
    looking = Watch(source, memory=2.0)
    fast = [frame(number) for number in range(60)]
    for each in fast:
        source.play(looking, each)
    assert told(looking.sight().performers[1]).endswith("30 frames a second")
    slow = [replace(frame(0), time=fast[-1].time + (number + 1) / 8) for number in range(20)]
    for each in slow:
        source.play(looking, each)
    assert [reason.what for reason in reasons(looking.sight())] == [
        "User 1 does not move at all: 17 times the very same pose came.",
        "User 1: only 8 frames a second come.",
    ]
    source.play(looking, replace(frame(5), time=source.time + 1 / 8))
    assert why_of(looking.sight()) == ["User 1: only 8 frames a second come."]


def test_who_looks_on_forgets_who_has_gone_and_what_was_refused():
    source = Played()
    looking = Watch(source, memory=2.0)
    source.play(looking, frame(0), Lost(0.1, 1), refused=["not OSC"])
    assert looking.sight().gone == {1}
    assert looking.sight().refused == {"not OSC": 1}
    source.play(looking, Tick(3.0))
    sight = looking.sight()
    assert (sight.gone, sight.refused, sight.received) == (set(), {}, 1)


def test_how_the_sensor_stands_is_said_once_and_holds():
    source = Played()
    looking = Watch(source, memory=2.0)
    assert looking.sight().level is None
    source.play(looking, Cue(0.0, "level", {"tilt": 12.2, "roll": -2.6, "height": 1.304}))
    source.play(looking, Cue(1.0, "level", {"tilt": "steep"}), Tick(9.0))
    sight = looking.sight()
    assert sight.level == SensorTilt(12.2, 1.304, -2.6)
    assert summary(sight, [])["sensor"] == {"tilt": 12.2, "height": 1.304, "roll": -2.6}


def test_a_source_that_is_silent_is_told_of_with_the_seconds_since_something_came(osc):
    looking = Watch(osc, memory=0.1)
    send(osc, b"nonsense")
    until(looking, lambda sight: sight.received)
    sight = until(looking, lambda sight: not sight.received)
    assert 0.1 < sight.silent < sight.seconds
    assert why_of(sight) == ["Nothing has come in 0 s."]


def test_a_sensor_that_fails_is_opened_again_until_a_picture_comes(watch, scripted_device, scripted_tracker):
    absent = SourceError("freenect:", found="no Kinect v1 on USB", expected="one", fix="Plug it in.")
    answers = iter([scripted_device, absent, scripted_device])

    def opened():
        answer = next(answers)
        if answer is absent:
            raise absent
        return watch(answer, scripted_tracker).source

    looking = Watch(source := ReopeningSource("freenect:", opened), sights.RECENT)
    scripted_device.show(0.0)
    assert until(looking, lambda sight: sight.performers).picture is not None
    gone = SourceError("freenect:", found="it gone", expected="one", fix="Plug it in.")
    scripted_device.pictures.put(gone)
    sight = until(looking, lambda sight: sight.failure)
    assert (sight.performers, sight.picture, looking.over) == ({}, None, False)
    assert reasons(sight)[0] == Reason(str(gone), "It is opened again twice a second.")
    until(looking, lambda sight: sight.failure == str(absent))
    until(looking, lambda _: isinstance(source.inner, SensorSource))
    assert looking.sight().failure == str(absent)  # it is open, and nothing has come
    scripted_tracker.users = ()
    scripted_device.show(1.0)
    sight = until(looking, lambda sight: sight.picture)
    assert (sight.failure, sight.performers, sight.picture.time) == ("", {}, 1.0)


def test_a_port_that_was_taken_is_waited_for_and_then_listened_to(osc):
    def fail():
        raise failure

    failure = SourceError("osc:7110", found="a port in use", expected="a free one", fix="Wait.")
    played = Played()
    played.receive = fail
    sources = iter([played, osc])
    looking = Watch(source := ReopeningSource("osc:7110", lambda: next(sources)))
    assert until(looking, lambda sight: sight.failure).failure == str(failure)
    assert until(looking, lambda sight: not sight.failure).retried is False
    assert source.inner is osc


@pytest.mark.parametrize("bare", [True, False])
def test_a_recording_that_has_ended_is_over(bare):
    short = replace(
        WALK, times=WALK.times[:3], positions=WALK.positions[:3], confidence=np.ones((3, 20), np.float32), user=1
    )
    again = RecordingSource.of_clips("replay:short.log", [short])
    with closing(again if bare else ReopeningSource("replay:short.log", lambda: again)) as source:
        looking = Watch(source)
        assert (looking.begun, looking.over) == (False, False)
        sight = until(looking, lambda _: looking.over)
        assert (looking.begun, sight.retried, set(sight.performers)) == (True, False, {1})


def test_a_status_line_says_first_what_is_wrong_then_what_to_do_then_who_is_seen_how_well():
    still = seen([replace(frame(0), time=number / 30) for number in range(FROZEN + 10)])
    assert status_line(still) == (
        f"User 1 does not move at all: {FROZEN + 10} times the very same pose came. · "
        "See whether the sender tracks somebody, or only shows a character at rest. · "
        f"user 1: 20 of 20 joints seen, {still.performers[1].distance:.2f} m away, 30 frames a second"
    )
    well = seen([frame(number, user) for number in range(20) for user in (2, 1)])
    assert status_line(well) == " · ".join(["All is well.", told(well.performers[1]), told(well.performers[2])])
    assert status_line(seen(listens=True, received=0, silent=12.3)) == (
        "Nothing has come in 12 s. · "
        "Start the sender, have it send to this machine and port, and let UDP through the firewall."
    )


def test_a_status_line_has_nothing_that_a_terminal_would_obey():
    assert status_line(seen(failure="driver\x1b[2Jfail\red\n[bold]x[/]")) == "driver [2Jfail ed [bold]x[/]"
