import math
import struct
import time
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pythonosc.osc_bundle import OscBundle
from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
from pythonosc.osc_message import OscMessage
from pythonosc.osc_message_builder import OscMessageBuilder
from pythonosc.parsing.osc_types import BuildError

from capture.network.osc import (
    MAX_DATAGRAM_BYTES,
    MAX_DEPTH,
    MAX_MESSAGES,
    REASONS,
    Message,
    OscError,
    bundle,
    decode,
    encode,
)

from ...effort import EFFORT
from .conftest import message

ADDRESSES = st.text("/aZ9_äø ", min_size=1, max_size=40)
TEXTS = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=50)
FLOATS = st.floats(width=32, allow_nan=False, allow_infinity=False)
ARGUMENTS = st.lists(  # python-osc cannot write an empty blob
    st.one_of(st.integers(-(2**31), 2**31 - 1), FLOATS, TEXTS, st.binary(min_size=1, max_size=50)), max_size=20
).map(tuple)
TAGS = {int: "i", float: "f", str: "s", bytes: "b"}


def _refused(datagram):
    with pytest.raises(OscError) as caught:
        decode(datagram)
    assert caught.value.reason in REASONS
    return caught.value.reason


@given(ADDRESSES, ARGUMENTS)
def test_encoded_messages_are_decoded_and_those_that_python_osc_reads_and_writes(address, arguments):
    tags = "".join(TAGS[type(argument)] for argument in arguments)
    encoded = encode(address, *arguments)
    [decoded] = decode(encoded)
    assert decoded == Message(address, tags, arguments)
    assert [type(argument) for argument in decoded.arguments] == [type(argument) for argument in arguments]
    if address.startswith("/"):
        theirs = OscMessage(encoded)
        assert (theirs.address, tuple(theirs.params)) == (address, arguments)
        assert message(address, tags, *arguments) == encoded


def test_messages_of_python_osc_are_decoded():
    values = (1, 2**40, 0.5, 0.1, "ü", b"abcde", True, False, None)
    builder = OscMessageBuilder("/all")
    for value, tag in zip(values, "ihfdsbTFN", strict=True):
        builder.add_arg(value, tag)
    everything = builder.build()
    [decoded] = decode(everything.dgram)
    assert decoded == Message("/all", "ihfdsbTFN", values)
    inner, outer = OscBundleBuilder(IMMEDIATELY), OscBundleBuilder(time.time() + 3600)
    inner.add_content(everything)
    outer.add_content(inner.build())
    outer.add_content(everything)
    assert decode(outer.build().dgram) == [decoded, decoded]


def test_python_osc_reads_our_bundles():
    one, other = encode("/one", 1), encode("/other", "x")
    theirs = OscBundle(bundle(one, bundle(other)))
    assert theirs.content(0).dgram == one
    assert theirs.content(1).content(0).dgram == other
    assert decode(bundle(bundle(one), other, bundle())) == decode(one) + decode(other)


@given(st.lists(FLOATS, min_size=6, max_size=6))
def test_an_array_of_any_layout_is_written_in_c_order(numbers):
    array = np.array(numbers, dtype=np.float32).reshape(2, 3)
    assert encode("/a", np.asfortranarray(array)) == encode("/a", array) == encode("/a", *numbers)


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ((2**31,), BuildError),
        ((1e39,), OverflowError),
        (("a\0b",), ValueError),
        ((np.zeros(3),), TypeError),
        ((None,), TypeError),
    ],
)
def test_unsupported_arguments_are_not_encoded(arguments, error):
    with pytest.raises(error):
        encode("/a", *arguments)


def _bundles(depth):
    nested = encode("/deep", 1)
    for _ in range(depth):
        nested = bundle(nested)
    return nested


def _element(size):
    """A bundle that announces an element of a size in bytes."""
    return b"#bundle\0" + bytes(8) + struct.pack(">i", size)


HOSTILE = {
    "cut short": [
        *(b"", b"/abcdefg"),  # nothing, and an address without an end
        _element(-4),  # on which python-osc hangs
        *(_element(0x7FFFFFFC), _element(0), b"#bundle\0\0\0\0\0"),  # 2 GiB, nothing, and a bundle without a time
        b"/a\0\0,b\0\0" + struct.pack(">i", -1),  # a blob of -1 bytes
        *(b"/a\0\0,ff\0\0\0\0\0", b"/a\0\0,d\0\0\0\0\0\0"),  # fewer numbers than tags, and half a double
    ],
    "bundles too deep": [_bundles(MAX_DEPTH + 1), _bundles(400)],  # on the second one python-osc dies
    "text not in UTF-8": [b"/\xff\xfe\0,\0\0\0"],
    "no multiple of 4 bytes": [_element(0x7FFFFFFF), b"/abc\0"],
    "number not finite": [b"/a\0\0,f\0\0" + struct.pack(">f", math.nan)],
    "bad address": [b"\0\0\0\0,\0\0\0", b",f\0\0,f\0\0", encode("/" + 255 * "a"), encode("/\a")],
    "no type tags": [b"/a\0\0", b"/a\0\0f\0\0\0\0\0\0\0"],
    "unknown type tag": [b"/a\0\0,[f]\0\0\0\0\0\0\0\0"],
    "bytes left over": [b"/a\0\0,\0\0\0\0\0\0\0"],
    "too many messages": [bundle(*[encode("/")] * MAX_MESSAGES), bundle(*[bundle(*[encode("/")] * 600)] * 2)],
    "larger than a datagram": [encode("/a", bytes(MAX_DATAGRAM_BYTES))],
}


@pytest.mark.parametrize("reason", REASONS)
def test_hostile_datagrams_are_refused_with_the_reason_and_false_lengths_allocate_no_memory(reason):
    for datagram in HOSTILE[reason]:
        tracemalloc.start()
        try:
            assert _refused(datagram) == reason
            assert tracemalloc.get_traced_memory()[1] < 200_000 + 20 * len(datagram)
        finally:
            tracemalloc.stop()


def test_the_hostile_datagrams_that_mean_something_are_read_at_once():
    tomorrow = b"#bundle\0" + struct.pack(">II", 0xFFFFFFFF, 0)  # python-osc's dispatcher sleeps until then
    message = encode("/a", 1)
    assert decode(tomorrow + struct.pack(">i", len(message)) + message) == [Message("/a", "i", (1,))]
    pattern = "/" + 25 * "*" + "b"  # python-osc matches it against its handlers for 10 s
    assert decode(encode(pattern)) == [Message(pattern, "", ())]
    assert decode(_bundles(MAX_DEPTH)) == [Message("/deep", "i", (1,))]


CORPUS = [
    encode("/joint", "l_shoulder", 3, 0.5, 0.25, 1.5),
    encode("Left_Hand", 0.1, 0.2, 0.3, 1.0, 0.0, 0.0, 0.0),
    encode("/VMC/Ext/Bone/Pos", "Hips", 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0),
    bundle(encode("/joint", "head", 1, 0.5, 0.5, 1.0), bundle(encode("/a", b"12345", "text")), encode("/lost_user", 1)),
    b"/all\0\0\0\0,ihfdtsSbTFN\0\0\0\0"
    + bytes(4 + 8 + 4 + 8 + 8)
    + b"a\0\0\0b\0\0\0"
    + struct.pack(">i", 3)
    + b"abc\0",
]


def _check(datagram):
    """Assert that bytes are either messages within bounds or one documented error."""
    try:
        messages = decode(datagram)
    except OscError:
        _refused(datagram)
        return
    assert len(messages) <= MAX_MESSAGES
    for each in messages:
        assert len(each.tags) == len(each.arguments)
        assert all(math.isfinite(number) for number in each.arguments if isinstance(number, float))
    assert sum(len(each.address) + len(each.tags) for each in messages) <= len(datagram)


WORDS = st.sampled_from([1, 4, 0xFF, 0x80000000, 0xFFFFFFFC]) | st.integers(0, 2**32 - 1)


@settings(max_examples=round(1000 * EFFORT))
@given(st.sampled_from(CORPUS), st.lists(st.tuples(st.integers(0, 50), WORDS), max_size=4), st.integers(0, 50))
def test_changed_datagrams_are_read_or_refused(datagram, changes, kept):
    words = np.frombuffer(datagram, ">u4").copy()
    for place, change in changes:
        words[place % len(words)] ^= change
    _check(words.tobytes())
    _check(words[:kept].tobytes() + datagram)


@settings(max_examples=round(1000 * EFFORT))
@given(st.binary(max_size=200).map(lambda data: data + bytes(-len(data) % 4)))
def test_any_bytes_are_read_or_refused(data):
    _check(data)
    _check(b"#bundle\0" + bytes(8) + struct.pack(">I", len(data)) + data)
    _check(b"/a\0\0," + data)
