import socket
from dataclasses import replace

import numpy as np
import pytest
from pythonosc.osc_bundle import OscBundle
from pythonosc.osc_message import OscMessage
from scipy.spatial.transform import Rotation

from capture.network.osc import encode
from capture.skeleton import JOINTS
from engine_bridge.export.live_basis import Projection
from engine_bridge.service.monitoring.status import OutputStatus
from engine_bridge.service.outputs.osc import CHUNK_VERTICES, EARLY_SHARE, KINDS, OscOutput, OscTable, part_names
from engine_bridge.service.protocol.scene import StreamedCharacter
from puppetline.errors import ServiceError

from .frames import frame_of


class Basis:
    names = ("a", "b")

    def project(self, R):
        return Projection(np.array([0.5, 1], dtype=np.float32), 0.125, False)


@pytest.fixture(scope="module")
def dog(blob_rig):
    return StreamedCharacter("dog", blob_rig, 1, Basis())


@pytest.fixture
def receiver():
    """A socket that takes what targets are sent."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as made:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        made.bind(("127.0.0.1", 0))
        made.setblocking(False)
        yield made


@pytest.fixture
def output(receiver, given_clock, until_end):
    port = receiver.getsockname()[1]
    return lambda **more: until_end(OscOutput(OscTable(port=port, **more)))


@pytest.fixture
def sent(output, receiver):
    """Send a frame, and return what comes: address and arguments."""

    def send(frame, *kinds):
        out = output(send=kinds)
        out.offer(frame)
        out.send_due()
        return messages(receiver)

    return send


def performed(character, sequence=0, **more):
    """Return a frame with a value in every field; one joint is unknown."""
    joints = np.arange(60.0).reshape(20, 3)
    joints[3] = np.nan
    values = {
        "state": "performing",
        "user": 2,
        "R": character.rig.model.rest_controls * (1 + 0.01 * sequence),
        "root": np.array([1.0, 2.0, 3.0]),
        "joints": joints,
        "confidence": np.linspace(0, 1, 20, dtype=np.float32),
    }
    return frame_of(character, sequence, **values | more)


def received(receiver):
    """All datagrams that have come."""
    datagrams = []
    while True:
        try:
            datagrams.append(receiver.recv(65536))
        except BlockingIOError:
            return datagrams


def messages(receiver):
    """All that has come, as python-osc reads it: address and arguments."""
    found = []
    for datagram in received(receiver):
        contents = [OscMessage(datagram)] if datagram.startswith(b"/") else list(OscBundle(datagram))
        found += [(message.address, message.params) for message in contents]
    return found


def test_controls_are_one_datagram_of_floats(sent, dog):
    frame = performed(dog, 3)
    [(address, numbers)] = sent(frame, "controls")
    assert address == "/puppetline/dog/controls"
    assert len(numbers) == 12 * len(frame.controls)
    np.testing.assert_array_equal(np.array(numbers, dtype=np.float32), frame.controls.ravel())


def test_morphs_are_weights_in_one_datagram_and_what_goes_with_them(sent, dog):
    assert sent(performed(dog), "morphs") == [
        ("/puppetline/dog/morphs", [0.5, 1]),
        ("/puppetline/dog/residual", [0.125]),
        ("/puppetline/dog/root", [1, 2, 3]),
    ]


def test_joints_that_are_known_and_handles_have_their_names_in_the_address(sent, dog):
    frame = performed(dog)
    got = dict(sent(frame, "joints", "handles"))
    joints = {name: got.pop(f"/puppetline/dog/joint/{name}") for name in JOINTS if name != "head"}
    for name, values in joints.items():
        number = JOINTS.index(name)
        np.testing.assert_allclose(values, [*frame.joints[number], frame.confidence[number]], rtol=1e-6)
    names = [handle.name.replace(" ", "_") for handle in dog.rig.puppet.handle]
    assert list(got) == [f"/puppetline/dog/handle/{name}" for name in names]
    np.testing.assert_allclose(list(got.values()), frame.targets, rtol=1e-6)


def test_bones_are_rotations_by_the_name_of_the_joint_and_positions_of_those_that_travel(sent, limbed_rig):
    figure = StreamedCharacter("figure", limbed_rig, 1)
    turns = Rotation.from_rotvec(np.random.default_rng(3).normal(size=(len(limbed_rig.model.bones), 3)))
    motions = np.concatenate([turns.as_matrix(), np.zeros((len(turns), 1, 3))], axis=1)
    frame = performed(figure, motions=motions)
    got = dict(sent(frame, "bones"))
    skeleton, pose = figure.skeleton, frame.bones
    rotations = [got.pop(f"/puppetline/figure/bone/{name}") for name in skeleton.names]
    np.testing.assert_allclose(rotations, pose.rotations, rtol=1e-6)
    travelling = np.array(skeleton.names)[skeleton.travelling]
    assert {"hips", "hump"} == set(travelling)
    assert list(got) == [f"/puppetline/figure/bone_position/{name}" for name in travelling]
    np.testing.assert_allclose(list(got.values()), pose.translations, rtol=1e-6)


def test_vertices_come_in_numbered_chunks_that_fit_a_datagram(output, receiver, dog):
    out, frame = output(send=("vertices",)), performed(dog, 2**31 + 5)
    out.offer(frame)
    out.send_due()
    datagrams = received(receiver)
    assert max(map(len, datagrams)) <= 9000
    vertices = np.zeros((len(dog.rest), 6), dtype=np.float32)
    for number, datagram in enumerate(datagrams):
        message = OscMessage(datagram)
        sequence, chunk, chunks, first, *floats = message.params
        assert (message.address, sequence, chunk, chunks) == ("/puppetline/dog/vertices", 5, number, len(datagrams))
        assert first == chunk * CHUNK_VERTICES
        vertices[first : first + CHUNK_VERTICES] = np.reshape(floats, (-1, 6))
    np.testing.assert_array_equal(vertices, np.concatenate(frame.vertices_and_normals, axis=1))


def test_a_value_that_a_frame_lacks_is_not_sent(sent, dog):
    addresses = {
        address for address, _ in sent(performed(replace(dog, basis=None), joints=None, confidence=None), *KINDS)
    }
    assert not any(kind in address for address in addresses for kind in ("morphs", "/joint/", "/bone"))
    assert "/puppetline/dog/controls" in addresses


def test_the_performer_is_sent_on_each_change_and_every_second(output, receiver, dog, given_clock):
    out = output(send=("performer",), rate=100)
    for step in range(251):
        state, user = ("performing", 2) if step < 120 else ("leaving", None)
        out.offer(performed(dog, step, state=state, user=user))
        out.send_due()
        given_clock.advance(0.01)
    told = [params for address, params in messages(receiver) if address == "/puppetline/dog/performer"]
    assert told == [["performing", 2], ["performing", 2], ["leaving", -1], ["leaving", -1]]


@pytest.mark.parametrize(("offered", "rate"), [(30, 30), (120, 30), (60, 25), (1000, 7.5), (30, 100)])
def test_frames_are_sent_at_most_at_the_rate_and_the_newest_is_chosen(
    output, receiver, dog, given_clock, offered, rate
):
    out = output(rate=rate, send=("handles",))
    start, sent, seconds, tick = given_clock.now(), [], 4, 0.001
    random = np.random.default_rng(3)
    frames, arrivals = 0, np.arange(offered * seconds) / offered + random.uniform(0, 0.1 / offered, offered * seconds)
    for step in range(int(seconds / tick)):
        given_clock.advance_to(start + step * tick)
        while frames < len(arrivals) and arrivals[frames] <= step * tick:
            out.offer(performed(dog, frames, targets=dog.rig.puppet.handle_positions * 0 + frames))
            frames += 1
        if out.due() <= given_clock.now():
            out.send_due()
            got = messages(receiver)
            sent.append((given_clock.now(), got[0][1][0]))
            assert got[0][1][0] == frames - 1  # the newest that has been offered
    times = np.array([time for time, _ in sent])
    for count in (1, 5, 50):
        if len(times) > count:
            assert (times[count:] - times[:-count] >= (count - EARLY_SHARE) / rate - 1e-9).all()
    assert len(sent) >= 0.93 * seconds * min(rate, offered)
    assert out.statistics.sent == len(sent)
    assert out.statistics.skipped == frames - len(sent) - (out.due() < float("inf"))


def test_the_turns_of_characters_and_targets_are_their_own(receiver, dog, given_clock):
    port = receiver.getsockname()[1]
    cat = replace(dog, name="cat")
    targets = [
        OscTable(port=port, send=("handles",)),
        OscTable(port=port, send=("handles",), characters=("cat",), rate=1),
    ]
    outputs = [OscOutput(target) for target in targets]
    for _ in range(2):
        for out in outputs:
            for character in (dog, cat):
                out.offer(performed(character))
            out.send_due()
        given_clock.advance(0.5)
    for out in outputs:
        out.close()
    counts = [address.split("/")[2] for address, _ in messages(receiver) if address.endswith("head")]
    assert sorted(counts) == ["cat"] * 3 + ["dog"] * 2


def test_a_payload_is_computed_only_when_it_is_sent(output, dog):
    out, frame = output(send=("controls",)), performed(dog)
    out.offer(frame)
    assert "controls" not in vars(frame)
    out.offer(performed(dog))
    out.send_due()
    assert "controls" not in vars(frame)


def test_errors_are_counted_and_the_next_frame_is_another_try(output, receiver, dog, given_clock):
    out = output(send=("controls",))
    many = replace(performed(dog))
    many.__dict__["controls"] = np.zeros((2000, 3, 4), dtype=np.float32)  # no datagram is so large
    out.offer(many)
    out.send_due()
    assert (out.statistics.sent, out.statistics.failed) == (0, 1)
    given_clock.advance(1)
    out.offer(performed(dog))
    out.send_due()
    assert (out.statistics.sent, out.statistics.failed) == (1, 1)
    assert len(received(receiver)) == 1


def test_sending_without_a_receiver_is_no_error(dog, given_clock):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as closed:
        closed.bind(("127.0.0.1", 0))
        port = closed.getsockname()[1]
    out = OscOutput(OscTable(host="localhost", port=port, send=("performer",)))
    for step in range(5):
        given_clock.advance(1)
        out.offer(performed(dog, step))
        out.send_due()
    out.close()
    size = len(encode("/puppetline/dog/performer", "performing", 2))
    assert out.statistics == OutputStatus("osc", f"localhost:{port}", sent=5, bytes=5 * size, skipped=0, failed=0)


def test_a_name_that_nobody_knows_is_said_at_once():
    with pytest.raises(ServiceError, match="an unknown name"):
        OscOutput(OscTable(host="no-such-machine.invalid", port=9000))


def test_names_in_addresses_hold_nothing_that_osc_forbids_and_differ():
    assert part_names(["left hand", "left_hand", "a/b#c", "Ärmel", "x"]) == [
        "left_hand",
        "left_hand_1",
        "a_b_c",
        "_rmel",
        "x",
    ]


def test_a_whole_network_can_be_a_target(dog, given_clock):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as heard:
        heard.bind(("", 0))
        heard.settimeout(5)
        out = OscOutput(OscTable(host="127.255.255.255", port=heard.getsockname()[1], send=("performer",)))
        out.offer(performed(dog, 0))
        out.send_due()
        assert heard.recv(1000).startswith(b"/puppetline/")
        out.close()
