import numpy as np
import pytest

from engine_bridge.service.protocol.clip_file import ClipFacts, beginning, frame_message, read_clip
from engine_bridge.service.protocol.header import PAYLOAD_OFFSET, Header, Kind, WireError, join, split, topic
from engine_bridge.service.protocol.scene import StreamedCharacter
from engine_bridge.service.states import STATES
from solver.motion.deformer import to_file_units

ROOT = np.array([0.25, 0.0, -1.5], dtype=np.float32)
WEIGHTS = np.array([0.25, 0.5], dtype=np.float32)


@pytest.fixture(scope="module")
def character(blob_rig):
    return StreamedCharacter.of("blob", blob_rig)


@pytest.fixture(scope="module")
def messages(character):
    """The description, the scene and three frames of a clip file."""
    R = character.rig.model.rest_controls.astype(np.float32)
    content = beginning(character, ClipFacts("blob", character.revision, 3, 30.0, "walk"))
    size = PAYLOAD_OFFSET + split(content).header.length
    frames = [
        frame_message(character, number, number / 30, R * (1 + number), number * ROOT, number * WEIGHTS)
        for number in range(3)
    ]
    return [content[:size], content[size:], *frames]


def test_a_clip_is_read_as_it_was_written(character, messages):
    facts, scene, *frames = read_clip(b"".join(messages))
    assert facts.topic == "blob/clip"
    expected = {"character": "blob", "revision": character.revision, "frames": 3, "fps": 30.0, "recording": "walk"}
    assert facts.body == expected
    assert bytes(messages[1][PAYLOAD_OFFSET:]) == character.scene
    assert scene.body.facts["revision"] == character.revision
    R = character.rig.model.rest_controls.astype(np.float32)
    for number, frame in enumerate(frames):
        controls = to_file_units(R * (1 + number), character.rig.model)
        controls[:, :, 3] += number * ROOT
        np.testing.assert_array_equal(frame.body, controls)
        np.testing.assert_array_equal(frame.targets, number * WEIGHTS)
        header = frame.header
        assert (header.sequence, header.time, header.root) == (number, number / 30, tuple((number * ROOT).tolist()))
        assert STATES[header.state] == "performing"


def test_messages_of_a_clip_have_the_revision_of_its_scene(character, messages):
    assert {split(message).header.revision for message in messages} == {character.revision}


def test_the_revision_depends_on_the_name_and_the_mesh(character, blob_rig):
    assert StreamedCharacter.of("blob", blob_rig).revision == character.revision
    assert StreamedCharacter.of("other", blob_rig).revision != character.revision


def other_scene(message):
    head = split(message).header
    return message[:64] + head._replace(revision=head.revision ^ 1).pack() + message[PAYLOAD_OFFSET:]


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda messages: messages[:-1], "2 frames, and 3 are described"),
        (lambda messages: [*messages, messages[-1]], "4 frames, and 3 are described"),
        (lambda messages: messages[:1], "0 frames"),
        (lambda messages: [], "0 frames"),
        (lambda messages: [messages[1], messages[0]], "message 0 of kind 1"),
        (lambda messages: [messages[0], *messages[2:]], "message 1 of kind 2"),
        (lambda messages: [*messages[:4], other_scene(messages[4])], "message 4 of the scene"),
        (lambda messages: [*messages[:4], messages[4][:-1]], "7 bytes for 2 weights"),
        (lambda messages: [*messages[:4], messages[4][:100]], "100 bytes"),
        (
            lambda messages: [join(topic("blob", Kind.CLIP), Header(kind=Kind.CLIP, length=2), b"{}"), *messages[1:]],
            "without a number of frames",
        ),
    ],
)
def test_a_damaged_clip_is_refused_with_the_reason(messages, damage, says):
    with pytest.raises(WireError, match=says):
        list(read_clip(b"".join(damage(messages))))
