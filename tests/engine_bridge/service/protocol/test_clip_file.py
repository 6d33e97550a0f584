"""Damaged clips; `tests/engine_bridge/service/test_clip_export.py` has what a whole one holds."""

import numpy as np
import pytest

from engine_bridge.service.protocol.clip_file import ClipFacts, beginning, frame_message, read_clip
from engine_bridge.service.protocol.header import PAYLOAD_OFFSET, Header, Kind, WireError, join, split, topic
from engine_bridge.service.protocol.scene import StreamedCharacter

from ....oracles import assert_is_clause
from ..outputs.frames import pose_of


@pytest.fixture(scope="module")
def messages(prepared_blob):
    """The description, the scene and three frames of a clip file."""
    character = StreamedCharacter.of("blob", prepared_blob)
    pose = pose_of(prepared_blob)
    content = beginning(character, ClipFacts("blob", character.revision, 3, 30.0, "walk"))
    size = PAYLOAD_OFFSET + split(content).header.length
    frames = [frame_message(character, number, number / 30, pose, np.zeros(2, np.float32)) for number in range(3)]
    return [content[:size], content[size:], *frames]


def other_scene(message):
    head = split(message).header
    return message[:64] + head._replace(revision=head.revision ^ 1).pack() + message[PAYLOAD_OFFSET:]


NO_FACTS = join(topic("blob", Kind.CLIP), Header(kind=Kind.CLIP, length=2), b"{}")
DAMAGES = {
    "a frame too few": "dsab",
    "a frame too many": "dsabcc",
    "the description only": "d",
    "nothing": "",
    "the scene first": "sdabc",
    "no scene": "dabc",
    "a frame of another scene": "dsabo",
    "a weight cut short": "dsabw",
    "a header cut short": "dsabh",
    "no number of frames": "nsabc",
}
"""Orders of parts: a description, a scene, frames a, b and c, and others instead of one of them."""


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_clip_is_refused(messages, damage):
    last = messages[4]
    parts = dict(zip("dsabcowhn", [*messages, other_scene(last), last[:-1], last[:100], NO_FACTS], strict=True))
    assert len(list(read_clip(b"".join(messages)))) == 5
    with pytest.raises(WireError) as told:
        list(read_clip(b"".join(parts[each] for each in damage)))
    assert_is_clause(told.value)
