import math
import socket
import sys
import time
import warnings
from contextlib import closing, suppress
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from capture.events import TICK_SECONDS, Lost, Tick
from capture.network import source
from capture.network.assembly import PART_TIMEOUT_SECONDS
from capture.network.osc import REASONS, bundle, encode
from capture.network.source import MAX_DATAGRAMS, MAX_MESSAGES, MAX_PERFORMERS, OSC_PORT, VMC_PORT, open_osc, open_vmc
from capture.skeleton import JOINT_INDEX, SkeletonFrame
from puppetline.clock import use

from ...clock import GivenClock
from ...effort import EFFORT
from ..conftest import refused
from .conftest import Wire, kinect_sdk, known, message, osceleton

REFUSALS = {
    *REASONS,
    *("unknown message", "unknown joint", "unknown channel", "channel outside 0 to 1", "wrong arguments"),
    *("position too far away", "another sender", "socket error"),
}


def body(user, height=0.5):
    """Return OSCeleton's bundle for a frame, with the head at a height in screen coordinates, at the user's place."""
    joints = (("head", height), ("neck", 0.4), ("torso", 0.5))
    return bundle(*(osceleton(name, user, 0.5 + 0.3 * (user % 50), y, 1.0) for name, y in joints))


def sdk_joint(name, z=1500.0, confidence=1.0):
    return kinect_sdk(name, (0.0, 0.0, z), confidence, user=1)


GONE = message("/lost_user", "i", 1)


def _head(frame):
    return round(0.5 - (frame.positions[JOINT_INDEX["head"], 1] / 1.92), 6)


@pytest.mark.parametrize(("opened", "scheme", "port"), [(open_osc, "osc", OSC_PORT), (open_vmc, "vmc", VMC_PORT)])
def test_the_default_ports_are_those_of_the_programs_and_one_in_use_is_refused_with_a_fix(opened, scheme, port):
    assert (OSC_PORT, VMC_PORT) == (7110, 39539)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        with suppress(OSError):  # a program on this machine uses it
            other.bind(("127.0.0.1", port))
        error = refused(opened, "")
    assert error.where == f"{scheme}:"
    assert f"UDP port {port}" in error.found


@pytest.mark.parametrize(
    ("place", "fix"),
    [
        *((place, "0.0.0.0") for place in ("192.0.2.1:0", "no.such.host.invalid:0", "a" * 70 + ":0")),
        ("0.0.0.0:0", "?from="),
    ],
)
def test_the_host_of_another_machine_or_any_sender_from_one_is_refused_with_a_fix(place, fix):
    assert fix in refused(open_osc, place).fix


@pytest.mark.parametrize(
    "options", ["localhost:0", "127.0.0.1:0?from=127.0.0.1", *("0.0.0.0:0?from=any", "0.0.0.0:0?from=127.0.0.1")]
)
@pytest.mark.usefixtures("given_clock")
def test_senders_on_this_machine_are_received(options, until_end):
    assert until_end(Wire(open_osc(options))).frame(body(1)).user == 1


def test_senders_that_are_not_allowed_are_refused(listen):
    assert listen("?from=127.0.0.2").refused(body(1)) == {"another sender": 1}


@pytest.mark.usefixtures("given_clock")
def test_closing_twice_closes_the_port():
    source = open_osc("127.0.0.1:0?units=mm")
    assert (source.name, source.receive()) == ("osc:127.0.0.1:0?units=mm", [])
    for _ in range(2):
        source.close()
        assert source.fileno() == -1


@pytest.mark.skipif(sys.platform != "linux", reason="another system does not date what arrives")
def test_frames_that_wait_are_returned_in_order_with_the_times_at_which_they_arrived(until_end, monkeypatch):
    """Dates are compared with dates, since no program reads the date and the time at once on a busy machine."""
    later = time.time_ns() + 1_000_000_000_000
    monkeypatch.setattr(source, "_moment", lambda: (later, 1e6))
    monkeypatch.setattr(source, "MAX_AGE_NS", 2_000_000_000_000)
    wire = until_end(Wire(open_osc("127.0.0.1:0")))
    heights = [(1, 0.1), (2, 0.2), (1, 0.3), (3, 0.4), (1, 0.5), (2, 0.6)]
    dates = [time.time_ns()]
    for sent in (heights[:3], heights[3:]):
        wire.send(*(body(*each) for each in sent))
        dates.append(time.time_ns())
    frames = wire.events(count=6)
    assert [(frame.user, _head(frame)) for frame in frames] == heights
    before, between, after = (1e6 - (later - date) / 1e9 for date in dates)
    times = [frame.time for frame in frames]
    assert all(one < other for one, other in pairwise(times))
    assert before <= times[0] < times[2] <= between <= times[3] < times[5] <= after


def test_the_moment_of_a_date_is_that_of_the_attempt_that_was_interrupted_least(monkeypatch):
    times = iter([0.0, 0.5, 1.0, 1.2, *np.arange(2.0, 50.0)])
    dates = iter(range(100))
    monkeypatch.setattr(source.clock, "now", lambda: next(times))
    monkeypatch.setattr(source.time, "time_ns", lambda: next(dates))
    assert source._moment() == (1, 1.2)


def test_the_last_frames_of_a_performer_are_returned_if_too_many_wait(listen, monkeypatch):
    monkeypatch.setattr("capture.network.source.MAX_WAITING_FRAMES", 4)
    wire = listen()
    wire.send(*(body(1, 0.1 * number) for number in range(7)))
    assert [_head(frame) for frame in wire.events(count=4)] == pytest.approx([0.3, 0.4, 0.5, 0.6])
    assert wire.source.counts.dropped == 3


def test_leaving_and_returning_between_two_calls_is_reported_in_order(listen):
    wire = listen()
    wire.frame(body(1))
    wire.send(body(1, 0.1), GONE, body(1, 0.2), body(1, 0.3), GONE)
    events = wire.events(count=5)
    assert [_head(each) if isinstance(each, SkeletonFrame) else type(each) for each in events] == [
        *(0.1, Lost, 0.2, 0.3, Lost)
    ]
    assert all(one.time < other.time for one, other in pairwise(events))


@pytest.mark.parametrize("datagrams", [[], [b"garbage!"]])
def test_a_silent_source_ticks_also_while_packets_are_refused(listen, given_clock, datagrams):
    wire, start, ticks = listen(), given_clock.now(), []
    for _ in range(5):
        given_clock.advance_to(wire.source.due())
        wire.send(*datagrams)
        ticks += wire.source.receive()
    assert {type(tick) for tick in ticks} == {Tick}
    assert [tick.time for tick in ticks] == pytest.approx([start + TICK_SECONDS * k for k in range(1, 6)], abs=1e-6)


def test_an_incomplete_frame_is_due_after_the_timeout(listen, given_clock):
    wire = listen()
    wire.frame(*map(sdk_joint, ("head", "neck", "torso")))
    wire.settle(sdk_joint("head"))
    given_clock.advance(PART_TIMEOUT_SECONDS / 2)
    frame = wire.frame(sdk_joint("neck"))
    assert known(frame).keys() == {"shoulder_center", "head"}
    assert given_clock.now() == pytest.approx(frame.time + PART_TIMEOUT_SECONDS, abs=1e-5)
    assert wire.source.due() == frame.time + TICK_SECONDS


def test_the_number_of_performers_is_limited(listen):
    wire = listen()
    for user in (*range(MAX_PERFORMERS), 0):
        wire.frame(body(user))
    lost, new = wire.events(body(1000), count=2)
    assert (type(lost), lost.user, new.user) == (Lost, 1, 1000)
    for user in range(2000, 2000 + 3 * MAX_PERFORMERS):
        wire.settle(body(user))
        assert wire.source.due() - wire.source.now() <= TICK_SECONDS + 1e-9
    assert len(wire.source._assemblies) == MAX_PERFORMERS
    assert len(wire.source._present) <= MAX_PERFORMERS


def test_a_flood_is_received_in_portions(listen):
    wire, nothing = listen(), message("/x", "")
    wire.send(*[bundle(*[nothing] * 1000)] * 8)
    wire.source.receive()
    assert wire.source.counts.received == math.ceil(MAX_MESSAGES / 1000)
    wire.source.receive()
    wire.send(*[nothing] * (MAX_DATAGRAMS + 20))
    wire.source.receive()
    assert wire.source.counts.received == 8 + MAX_DATAGRAMS
    wire.frame(body(1))


def test_garbage_is_counted_by_its_reason_and_logged_once_a_second_without_its_bytes(listen, caplog, given_clock):
    wire, garbage = listen(), [b"secret", b"", b"\xff" * 8, message("/secret", "s", "secret")]
    for _ in range(5):
        given_clock.advance(0.4)
        refused = wire.refused(*garbage)
    assert refused == {"no multiple of 4 bytes": 5, "cut short": 10, "unknown message": 5}
    assert caplog.messages == [
        f"osc:127.0.0.1:0: refused {2 * count} × cut short, {count} × no multiple of 4 bytes, {count} × unknown message"
        for count in (1, 3)
    ]


@pytest.mark.parametrize("far", [2e6, 3e38, 1e308])
def test_positions_out_of_range_are_refused(listen, far):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert listen().refused(
            bundle(message("/joint", "siddd", "head", 1, far, 0.0, 1500.0)),
            bundle(message("/joint", "isddd", 2, "head", far, 0.5, far)),
        ) == {"position too far away": 2}


def test_a_frame_of_lost_joints_is_not_reported(listen, given_clock):
    wire = listen()
    wire.settle(sdk_joint("head", z=0.0, confidence=0.1))
    given_clock.advance(PART_TIMEOUT_SECONDS)
    assert all(isinstance(event, Tick) for event in wire.source.receive())
    assert not wire.source.counts.refused


NAMES = ["head", "l_hand", "r_foot", "Hips", "LeftHand", "root", "tail", "head3", "smile", "Joy"]
FLOATS = st.floats(width=32, allow_nan=False, allow_infinity=False)
ADDRESSES = """
/joint /orient /new_user /lost_user /joint/head/1 /joint/tail/1 /user/2 /osceleton2/joint
/osceleton2/hand /face Head /Head_3 2/Left_Hand NI_mate_sync skeleton /VMC/Ext/OK /VMC/Ext/Bone/Pos
/VMC/Ext/Root/Pos /VMC/Ext/T /other /VMC/Ext/Blend/Val /VMC/Ext/Blend/Apply /puppetline/channel
"""
SHAPES = "sifff sff sf isfff siifffff sfffffff i iiii f ff fff ffff fffffff ffffffffffff sb b"
TYPED = {
    "s": st.sampled_from([*NAMES, ""]),
    "i": st.one_of(st.integers(-2, 40), st.integers(-(2**31), 2**31 - 1)),
    "f": st.one_of(st.floats(-3, 3, width=32), FLOATS, st.sampled_from([0.0, 1e3])),
    "b": st.binary(max_size=8),
}
FITTING = st.sampled_from(SHAPES.split()).flatmap(lambda shape: st.tuples(*(TYPED[tag] for tag in shape)))
MESSAGES = st.builds(
    lambda address, arguments: encode(address, *arguments), st.sampled_from(ADDRESSES.split()), FITTING
)

DATAGRAMS = st.lists(st.one_of(MESSAGES, st.lists(MESSAGES, max_size=6), st.binary(max_size=60)), max_size=8)


@pytest.fixture(scope="module")
def long_lived():
    with use(GivenClock()), closing(Wire(open_osc("127.0.0.1:0"))) as wire:
        yield wire


@settings(max_examples=round(1000 * EFFORT))
@given(DATAGRAMS)
def test_any_messages_become_sound_frames_or_counted_refusals(long_lived, datagrams):
    """One source serves all examples, so that each begins in the state that the last one left."""
    counts = long_lived.source.counts
    refused = sum(counts.refused.values())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        events = long_lived.settle(*(bundle(*each) if isinstance(each, list) else each for each in datagrams))
        events += long_lived.source.receive()
    assert set(counts.refused) <= REFUSALS
    assert sum(counts.refused.values()) - refused <= 6 * len(datagrams) + 2 * MAX_PERFORMERS
    assert all(one.time < other.time for one, other in pairwise(events))
    for frame in events:
        if isinstance(frame, SkeletonFrame):
            known = frame.confidence > 0
            assert known.any()
            assert ((frame.confidence >= 0) & (frame.confidence <= 1)).all()
            assert (np.abs(frame.positions[known]) <= 1000).all()
            assert np.isnan(frame.positions[~known]).all()
            assert frame.positions.shape == (20, 3)
            assert (frame.positions.dtype, frame.confidence.dtype) == (np.float64, np.float32)
            assert -(2**31) <= frame.user < 2**31
            assert all(0 <= value <= 1 for value in (frame.channels or {}).values())


def test_a_valid_sender_is_received_afterwards(long_lived):
    events = long_lived.events(body(77, 0.25), until=lambda found: any(event.user == 77 for event in found))
    assert _head(events[-1]) == 0.25
