import struct

import pytest

from engine_bridge.service.protocol.header import (
    PAYLOAD_OFFSET,
    Header,
    Kind,
    WireError,
    join,
    read_json,
    split,
    subscription,
    topic,
    topic_field,
    write_json,
)
from engine_bridge.service.states import STATES

HEADER = Header(
    kind=Kind.CONTROLS,
    length=5,
    revision=7,
    sequence=2**40 + 1,
    state=2,
    user=-3,
    time=1.5,
    received=2**62,
    published=2**62 + 1,
    root=(0.5, -1.25, 4.0),
    targets=2,
)


def test_the_number_of_targets_is_the_last_field_and_they_follow_the_payload():
    """All other fields are those of recorded messages."""
    assert struct.unpack_from("<iI", HEADER.pack(), 4) == (-3, 7)
    assert struct.unpack_from("<I", HEADER.pack(), 60) == (2,)
    assert split(join(topic("dog", Kind.CONTROLS), HEADER, b"abcde01234567 and more")).targets == b"01234567"


DOG = topic("dog", Kind.CONTROLS)


@pytest.mark.parametrize(
    "message",
    [
        b"",
        bytes(PAYLOAD_OFFSET - 1),
        bytes(PAYLOAD_OFFSET),
        *(join(name.ljust(64, b"\0"), HEADER, b"abcde01234567") for name in (b"\xc3\xa9/controls", b"x" * 64)),
        join(b"dog/controls\0x".ljust(64, b"\0"), HEADER, b"abcde01234567"),
        join(DOG, HEADER, b"abcde0123456"),
        join(DOG, HEADER._replace(targets=0), b"abcd"),
        join(DOG, HEADER._replace(major=2, targets=0), b"abcde"),
        join(DOG, HEADER._replace(state=len(STATES), targets=0), b"abcde"),
    ],
)
def test_an_invalid_message_is_refused(message):
    with pytest.raises(WireError):
        split(message)


def test_a_subscription_ends_with_a_zero_so_that_it_matches_nothing_longer():
    assert topic("dog", Kind.VERTICES).startswith(subscription("dog/vertices"))
    assert not topic("dog", Kind.VERTICES16).startswith(subscription("dog/vertices"))


@pytest.mark.parametrize("text", ["", "x" * 64, "é", "a\nb"])
def test_an_invalid_topic_cannot_be_published(text):
    with pytest.raises(ValueError):  # noqa: PT011 - its own
        topic_field(text)


def test_json_comes_back_and_holds_no_numbers_that_are_none():
    assert read_json(write_json({"a": [1, 2.5, None, "é"]})) == {"a": [1, 2.5, None, "é"]}
    with pytest.raises(ValueError):  # noqa: PT011 - the library's
        write_json(float("nan"))


@pytest.mark.parametrize("content", [b"{", b"NaN", b"\xff", b"[" * 100_000, b"9" * 10_000])
def test_invalid_json_is_refused(content):
    with pytest.raises(WireError):
        read_json(content)
