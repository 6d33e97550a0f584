"""Damaged clips; `tests/engine_bridge/service/test_clip_export.py` has what a whole one holds."""

import numpy as np
import pytest

from engine_bridge.service.protocol.clip_file import ClipFacts, beginning, frame_message, read_clip
from engine_bridge.service.protocol.header import PAYLOAD_OFFSET, Header, Kind, WireError, join, split, topic
from engine_bridge.service.protocol.scene import StreamedCharacter

from ....oracles import assert_is_clause


@pytest.fixture(scope="module")
def messages(blob_rig):
    """The description, the scene and three frames of a clip file."""
    character = StreamedCharacter.of("blob", blob_rig)
    R, weights = blob_rig.model.rest_controls.astype(np.float32), np.zeros(2, np.float32)
    content = beginning(character, ClipFacts("blob", character.revision, 3, 30.0, "walk"))
    size = PAYLOAD_OFFSET + split(content).header.length
    frames = [frame_message(character, number, number / 30, R, weights[[0] * 3], weights) for number in range(3)]
    return [content[:size], content[size:], *frames]


def other_scene(message):
    head = split(message).header
    return message[:64] + head._replace(revision=head.revision ^ 1).pack() + message[PAYLOAD_OFFSET:]


NO_FACTS = join(topic("blob", Kind.CLIP), Header(kind=Kind.CLIP, length=2), b"{}")
DAMAGES = {
    "a frame too few": lambda messages: messages[:-1],
    "a frame too many": lambda messages: [*messages, messages[-1]],
    "the description only": lambda messages: messages[:1],
    "nothing": lambda messages: [],
    "the scene first": lambda messages: [messages[1], messages[0]],
    "no scene": lambda messages: [messages[0], *messages[2:]],
    "a frame of another scene": lambda messages: [*messages[:4], other_scene(messages[4])],
    "a weight cut short": lambda messages: [*messages[:4], messages[4][:-1]],
    "a header cut short": lambda messages: [*messages[:4], messages[4][:100]],
    "no number of frames": lambda messages: [NO_FACTS, *messages[1:]],
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_clip_is_refused(messages, damage):
    assert len(list(read_clip(b"".join(messages)))) == 5
    with pytest.raises(WireError) as told:
        list(read_clip(b"".join(damage(messages))))
    assert_is_clause(told.value)
