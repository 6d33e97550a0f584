import gc
import logging
import math
import re
import socket
import sys
import time
import warnings
from contextlib import closing
from itertools import pairwise
from select import select

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from capture.events import TICK_SECONDS, Lost, Tick
from capture.network.assembly import PART_TIMEOUT_SECONDS
from capture.network.osc import REASONS, encode
from capture.network.source import MAX_DATAGRAMS, MAX_MESSAGES, MAX_PERFORMERS, open_osc, open_vmc
from capture.skeleton import JOINT_INDEX, SkeletonFrame
from puppetline.errors import SourceError

from ...effort import EFFORT
from ..conftest import Watched

REFUSALS = {
    *REASONS,
    *("unknown message", "unknown joint", "unknown channel", "channel outside 0 to 1", "wrong arguments"),
    *("position too far away", "another sender", "socket error"),
}
SDK = "siiffffd"


@pytest.fixture
def body(osc_message, osc_bundle):
    """A function that returns OSCeleton's bundle for a frame, with the head at a height in screen coordinates."""

    def made(user, height=0.5):
        joints = (("head", height), ("neck", 0.4), ("torso", 0.5))
        return osc_bundle(*(osc_message("/joint", "sifff", name, user, 0.5, y, 1.0) for name, y in joints))

    return made


def _head(frame):
    return round(0.5 - (frame.positions[JOINT_INDEX["head"], 1] / 1.92), 6)


def _port(opened):
    """Return the default port of a source, even if another program on this machine uses it."""
    try:
        source = opened("")
    except SourceError as error:
        return int(re.search(r"UDP port (\d+)", error.found)[1])
    source.close()
    return source.port


def test_the_default_ports_are_those_of_the_programs():
    assert _port(open_osc) == 7110
    assert _port(open_vmc) == 39539


def test_a_port_in_use_is_refused_with_a_fix(listen):
    port = listen().source.port
    with pytest.raises(
        SourceError, match=f"^osc:{port}: found another program that listens on UDP port {port}"
    ) as caught:
        open_osc(str(port))
    assert "choose another port" in caught.value.fix


@pytest.mark.parametrize("host", ["192.0.2.1", "no.such.host.invalid", "a" * 70, "..."])
def test_the_host_of_another_machine_is_refused_with_a_fix(host):
    with pytest.raises(SourceError, match="which is not an address of this machine") as caught:
        open_osc(f"{host}:0")
    assert "0.0.0.0" in caught.value.fix


def test_localhost_is_the_address_that_senders_use(body):
    source = open_osc("localhost:0")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.sendto(body(1), ("127.0.0.1", source.port))
        assert select([source.fileno()], [], [], 10)[0]
    [frame] = source.receive()
    assert frame.user == 1
    source.close()


def test_closing_twice_frees_the_port():
    with warnings.catch_warnings():
        warnings.simplefilter("error", ResourceWarning)
        source = open_osc("127.0.0.1:0?units=mm")
        assert (source.name, source.receive()) == ("osc:127.0.0.1:0?units=mm", [])
        source.close()
        source.close()
        open_osc(f"{source.port}").close()
        del source
        gc.collect()


def test_frames_have_increasing_arrival_times(listen, body):
    wire = listen()
    events = []
    for user in (1, 2, 1, 2, 1, 1):
        before = time.monotonic()
        events += wire.events(body(user))
        assert before <= events[-1].time <= time.monotonic()
    assert all(one.time < other.time for one, other in pairwise(events))
    assert wire.source.now() == pytest.approx(time.monotonic(), abs=1.0)


def test_frames_that_wait_are_returned_in_order_with_the_times_at_which_they_arrived(listen, body):
    wire = listen()
    heights = [(1, 0.1), (2, 0.2), (1, 0.3), (3, 0.4), (1, 0.5), (2, 0.6)]
    before = time.monotonic()
    wire.send(*(body(*each) for each in heights[:3]))
    between = time.monotonic()
    wire.send(*(body(*each) for each in heights[3:]))
    after = time.monotonic()
    frames = wire.events(count=6)
    assert [(frame.user, _head(frame)) for frame in frames] == heights
    times = [frame.time for frame in frames]
    assert all(one < other for one, other in pairwise([before, *times, time.monotonic()]))
    if sys.platform == "linux":
        assert times[2] <= between < times[3] <= times[5] <= after


def test_the_last_frames_of_a_performer_are_returned_if_too_many_wait(listen, body, monkeypatch):
    monkeypatch.setattr("capture.network.source.MAX_WAITING_FRAMES", 4)
    wire = listen()
    wire.send(*(body(1, 0.1 * number) for number in range(7)))
    assert [_head(frame) for frame in wire.events(count=4)] == pytest.approx([0.3, 0.4, 0.5, 0.6])
    assert wire.source.counts.dropped == 3


def test_leaving_and_returning_between_two_calls_is_reported_in_order(listen, body, osc_message):
    wire = listen()
    wire.frame(body(1))
    gone = osc_message("/lost_user", "i", 1)
    wire.send(body(1, 0.1), gone, body(1, 0.2))
    frame, lost, back = wire.events(count=3)
    assert (_head(frame), type(lost), type(back), _head(back)) == (0.1, Lost, SkeletonFrame, 0.2)
    wire.send(body(1, 0.3), gone)
    frame, lost = wire.events(count=2)
    assert (_head(frame), type(lost)) == (0.3, Lost)
    assert frame.time < lost.time


def test_a_silent_source_ticks(listen, clock):
    source = listen().source
    ticks = []
    while len(ticks) < 5:
        due = source.due()
        assert due <= source.now() + TICK_SECONDS
        events = source.receive()
        if not events:
            clock.advance_to(due)
        assert all(isinstance(event, Tick) and event.time >= due for event in events)
        ticks += events
    assert all(later.time - earlier.time >= TICK_SECONDS for earlier, later in pairwise(ticks))


def test_refused_packets_do_not_stop_the_ticks(listen):
    wire = listen()
    ticks = []
    give_up = time.monotonic() + 10
    while len(ticks) < 3 and time.monotonic() < give_up:
        wire.send(b"garbage!")
        select([wire.source.fileno()], [], [], 1)
        ticks += wire.source.receive()
    assert [type(tick) for tick in ticks] == [Tick] * 3


def test_an_incomplete_frame_is_due_after_the_timeout(listen, osc_message):
    wire = listen()

    def joints(*names):
        return [osc_message("/joint", SDK, name, 0, 1, 0.0, 0.0, 1500.0, 1.0, 1.0) for name in names]

    wire.frame(*joints("head", "neck", "torso"))
    sent = time.monotonic()
    frame = wire.frame(*joints("head", "neck"))
    assert np.flatnonzero(frame.confidence).tolist() == [JOINT_INDEX["shoulder_center"], JOINT_INDEX["head"]]
    assert sent < frame.time <= time.monotonic() - PART_TIMEOUT_SECONDS
    assert wire.source.due() == frame.time + TICK_SECONDS


def test_several_dialects_are_understood_at_once(listen, body, osc_message):
    wire = listen()
    frames = wire.events(
        body(1),
        osc_message("/joint", "isfff", 2, "head", 0.5, 0.5, 2000.0),
        osc_message("/joint", SDK, "head", 0, 3, 0.0, 0.0, 1500.0, 1.0, 1.0),
        osc_message("Head_4", "fff", 0.0, 1.0, -2.0),
        osc_message("/VMC/Ext/Bone/Pos", "sfffffff", "Hips", 0, 1, 0, 0, 0, 0, 1),
        count=5,
    )
    assert sorted(frame.user for frame in frames) == [0, 1, 2, 3, 4]


def test_the_number_of_performers_is_limited(listen, body):
    wire = listen()
    for user in range(MAX_PERFORMERS):
        wire.frame(body(user))
    wire.frame(body(0))
    lost, new = wire.events(body(1000), count=2)
    assert (type(lost), lost.user, new.user) == (Lost, 1, 1000)
    for user in range(2000, 6000):
        wire.send(body(user))
        if user % 20 == 0:
            wire.source.receive()
            assert wire.source.due() <= wire.source.now() + TICK_SECONDS
    assert len(wire.source._assemblies) == MAX_PERFORMERS
    assert len(wire.source._present) <= MAX_PERFORMERS


def test_only_the_configured_sender_is_accepted(listen, body):
    stranger, friend = listen("?from=127.0.0.2"), listen("?from=127.0.0.1")
    assert stranger.settle(body(1)) == []
    assert stranger.source.counts.refused == {"another sender": 1}
    assert friend.frame(body(1)).user == 1


def test_a_flood_is_received_in_portions(listen, body, osc_message, osc_bundle):
    wire = listen()
    full = osc_bundle(*[osc_message("/x", "")] * 1000)
    wire.send(*[full] * 8)
    wire.source.receive()
    assert wire.source.counts.received == math.ceil(MAX_MESSAGES / 1000)
    wire.settle()
    wire.send(*[osc_message("/x", "")] * (MAX_DATAGRAMS + 20))
    before = wire.source.counts.received
    wire.source.receive()
    assert wire.source.counts.received <= before + MAX_DATAGRAMS
    wire.source.receive()
    wire.frame(body(1))


def test_garbage_is_counted_by_its_reason_and_logged_without_its_bytes(listen, body, osc_message, caplog):
    wire = listen()
    with caplog.at_level(logging.WARNING):
        wire.settle(b"secret", b"", b"\xff" * 8, osc_message("/secret", "s", "secret"))
        wire.frame(body(1))
    assert wire.source.counts.refused == {"no multiple of 4 bytes": 1, "cut short": 2, "unknown message": 1}
    assert len(caplog.messages) <= 2
    assert "secret" not in caplog.text
    assert caplog.messages[0].startswith("osc:127.0.0.1:0: refused ")


@pytest.mark.parametrize("far", [2e6, 3e38, 1e308])
def test_positions_out_of_range_are_refused(listen, osc_message, osc_bundle, far):
    wire = listen()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        wire.settle(
            osc_bundle(osc_message("/joint", "siddd", "head", 1, far, 0.0, 1500.0)),
            osc_bundle(osc_message("/joint", "isddd", 2, "head", far, 0.5, far)),
        )
    assert wire.source.counts.refused == {"position too far away": 2}


def test_a_frame_of_lost_joints_is_not_reported(listen, osc_message, clock):
    wire = listen()
    wire.settle(osc_message("/joint", SDK, "head", 0, 1, 0.0, 0.0, 0.0, 0.1, 1.0))
    clock.advance(PART_TIMEOUT_SECONDS)
    assert all(isinstance(event, Tick) for event in wire.source.receive())
    assert not wire.source.counts.refused


VALUES = st.one_of(
    st.integers(-(2**31), 2**31 - 1),
    st.floats(width=32, allow_nan=False, allow_infinity=False),
    st.floats(-3, 3, width=32),
    st.sampled_from(["head", "l_hand", "Hips", "LeftHand", "root", "tail", "head3", ""]),
    st.binary(max_size=8),
)
ADDRESSES = st.sampled_from(
    [
        *("/joint", "/orient", "/new_user", "/lost_user", "/joint/head/1", "/joint/tail/1", "/user/2"),
        *("/osceleton2/joint", "/osceleton2/hand", "/face", "Head", "/Head_3", "2/Left_Hand"),
        *("NI_mate_sync", "skeleton"),
        *("/VMC/Ext/OK", "/VMC/Ext/Bone/Pos", "/VMC/Ext/Root/Pos", "/VMC/Ext/T", "/other"),
        *("/VMC/Ext/Blend/Val", "/VMC/Ext/Blend/Apply", "/puppetline/channel"),
    ]
)
SHAPES = st.sampled_from(
    [
        *("sifff", "sff", "sf", "isfff", "siifffff", "sfffffff", "i", "iiii", ""),
        *("f" * count for count in (1, 2, 3, 4, 7, 12)),
    ]
)
TYPED = {
    "s": st.sampled_from(["head", "l_hand", "r_foot", "Hips", "LeftHand", "root", "tail", "head3", "smile", "Joy", ""]),
    "i": st.one_of(st.integers(-2, 40), st.integers(-(2**31), 2**31 - 1)),
    "f": st.one_of(
        st.floats(-3, 3, width=32),
        st.floats(width=32, allow_nan=False, allow_infinity=False),
        st.sampled_from([0.0, 1e3]),
    ),
}
FITTING = SHAPES.flatmap(lambda shape: st.tuples(*(TYPED[tag] for tag in shape)))
MESSAGES = st.builds(
    lambda address, arguments: encode(address, *arguments), ADDRESSES, st.one_of(FITTING, st.lists(VALUES, max_size=10))
)


@pytest.fixture(scope="module")
def long_lived():
    source = open_osc("127.0.0.1:0")
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    yield source, sender
    sender.close()
    source.close()


DATAGRAMS = st.lists(st.one_of(MESSAGES, st.lists(MESSAGES, max_size=6), st.binary(max_size=60)), max_size=8)
ANY = {"suppress_health_check": [HealthCheck.function_scoped_fixture]}


@settings(max_examples=round(1000 * EFFORT), **ANY)
@given(DATAGRAMS)
def test_any_messages_become_sound_frames_or_counted_refusals(long_lived, osc_bundle, datagrams):
    """One source serves all examples, so that each begins in the state that the last one left."""
    source, sender = long_lived
    received, refused = source.counts.received, sum(source.counts.refused.values())
    for datagram in datagrams:
        whole = osc_bundle(*datagram) if isinstance(datagram, list) else datagram
        sender.sendto(whole, ("127.0.0.1", source.port))
    events = []
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        while source.counts.received < received + len(datagrams):
            events += source.receive()
        events += source.receive()
    assert set(source.counts.refused) <= REFUSALS
    assert sum(source.counts.refused.values()) - refused <= 6 * len(datagrams) + 2 * MAX_PERFORMERS
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


def test_a_valid_sender_is_received_afterwards(long_lived, body):
    source, sender = long_lived
    sender.sendto(body(77, 0.25), ("127.0.0.1", source.port))
    events = Watched(source).events(until=lambda found: any(getattr(event, "user", 0) == 77 for event in found))
    assert _head(events[-1]) == 0.25


def test_other_machines_require_an_allowed_sender(body):
    with pytest.raises(SourceError, match="without an allowed sender"):
        open_osc("0.0.0.0:0")
    for allowed in ("any", "127.0.0.1"):
        with closing(open_osc(f"0.0.0.0:0?from={allowed}")) as source:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
                sender.sendto(body(1), ("127.0.0.1", source.port))
            while not source.counts.received:
                source.receive()
            assert not source.counts.refused
