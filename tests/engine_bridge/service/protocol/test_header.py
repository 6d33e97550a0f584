import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

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
)


def test_a_header_lies_byte_by_byte_where_the_documentation_says():
    content = HEADER.pack()
    assert len(content) == 64
    assert content[:4] == bytes([1, 0, 2, 2])
    assert struct.unpack_from("<i", content, 4) == (-3,)
    assert struct.unpack_from("<I", content, 8) == (7,)
    assert struct.unpack_from("<I", content, 12) == (5,)
    assert struct.unpack_from("<Q", content, 16) == (2**40 + 1,)
    assert struct.unpack_from("<d", content, 24) == (1.5,)
    assert struct.unpack_from("<QQ", content, 32) == (2**62, 2**62 + 1)
    assert struct.unpack_from("<3f", content, 48) == (0.5, -1.25, 4.0)
    assert content[60:] == bytes(4)


def test_a_message_is_topic_header_and_payload_again():
    assert split(join(topic("dog", Kind.CONTROLS), HEADER, b"abcde")) == ("dog/controls", HEADER, b"abcde")


def test_what_follows_the_payload_or_fills_the_header_is_ignored():
    message = bytearray(join(topic("dog", Kind.CONTROLS), HEADER, b"abcde more"))
    message[124:128] = b"\xff" * 4
    assert split(bytes(message)) == ("dog/controls", HEADER, b"abcde")


def test_a_later_minor_version_and_an_unknown_kind_are_taken():
    header = HEADER._replace(minor=9, kind=200)
    assert split(join(topic_field("dog/new"), header, b"abcde")).header == header


@pytest.mark.parametrize(
    "message",
    [
        b"",
        bytes(PAYLOAD_OFFSET - 1),
        bytes(PAYLOAD_OFFSET),
        join(b"\xc3\xa9/controls".ljust(64, b"\0"), HEADER, b"abcde"),
        join(b"x" * 64, HEADER, b"abcde"),
        join(b"dog/controls\0x".ljust(64, b"\0"), HEADER, b"abcde"),
        join(topic("dog", Kind.CONTROLS), HEADER, b"abcd"),
        join(topic("dog", Kind.CONTROLS), HEADER._replace(major=2), b"abcde"),
        join(topic("dog", Kind.CONTROLS), HEADER._replace(state=len(STATES)), b"abcde"),
    ],
)
def test_what_is_no_message_is_refused(message):
    with pytest.raises(WireError):
        split(message)


@settings(deadline=None)
@given(st.binary(max_size=300))
def test_any_bytes_are_a_message_or_refused(content):
    try:
        message = split(content)
    except WireError:
        return
    assert len(message.payload) == message.header.length <= len(content) - PAYLOAD_OFFSET


def test_a_subscription_ends_with_a_zero_so_that_it_matches_nothing_longer():
    assert subscription("dog/controls") == b"dog/controls\0"
    assert topic("dog", Kind.CONTROLS).startswith(subscription("dog/controls"))
    assert not topic("dog", Kind.VERTICES16).startswith(subscription("dog/vertices"))


@pytest.mark.parametrize("text", ["", "x" * 64, "é", "a\0b", "a\nb"])
def test_what_is_no_topic_cannot_be_published(text):
    with pytest.raises(ValueError, match="no topic"):
        topic_field(text)


def test_json_comes_back_and_holds_no_numbers_that_are_none():
    assert read_json(write_json({"a": [1, 2.5, None, "é"]})) == {"a": [1, 2.5, None, "é"]}
    with pytest.raises(ValueError, match="JSON"):
        write_json(float("nan"))


@pytest.mark.parametrize("content", [b"", b"{", b"NaN", b"\xff", b"[" * 100_000, b"9" * 10_000])
def test_what_is_no_json_is_refused(content):
    with pytest.raises(WireError):
        read_json(content)
