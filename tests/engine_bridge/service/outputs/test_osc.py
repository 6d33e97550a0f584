import socket
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from capture.skeleton import JOINTS, SkeletonFrame
from engine_bridge.service.outputs.osc import CHUNK_VERTICES, EARLY_SHARE, KINDS, OscOutput, OscTable, part_names
from engine_bridge.service.protocol.scene import StreamedCharacter
from puppetline.errors import ServiceError

from ...refusals import refused
from .frames import Basis, frame_of, messages, pose_of


@pytest.fixture(scope="module")
def dog(prepared_blob):
    return StreamedCharacter("dog", prepared_blob, 1, Basis())


@pytest.fixture
def sent(output, receiver, give):
    """Send a frame, and return what comes: address and arguments."""

    def send(frame, *kinds):
        give(output(send=kinds), frame)
        return receiver.messages()

    return send


def performed(character, sequence=0, *, is_seen=True, state="performing", user=2, **more):
    """Return a frame with a value in every field, or with others in its pose; one joint is unknown."""
    joints = np.arange(60.0).reshape(20, 3)
    joints[3] = np.nan
    R = character.prepared.model.rest_controls * (1 + 0.01 * sequence)
    pose = pose_of(character.prepared, **{"R": R, "root": np.array([1.0, 2.0, 3.0])} | more)
    seen = SkeletonFrame(0.0, 2, joints, np.linspace(0, 1, 20, dtype=np.float32)) if is_seen else None
    return frame_of(character, sequence, state=state, user=user, pose=pose, seen=seen)


def test_each_kind_has_its_addresses_and_values_and_what_is_not_known_is_not_sent(sent, dog):
    frame = performed(dog, 3)
    got = {
        address.removeprefix("/puppetline/dog/"): values
        for address, values in sent(frame, "controls", "morphs", "joints", "handles")
    }
    assert_array_equal(np.float32(got.pop("controls")), frame.pose.controls.ravel())
    assert [got.pop(name) for name in ("morphs", "residual", "root")] == [[0.5, 0, 1], [0.125], [1, 2, 3]]
    known = [number for number, name in enumerate(JOINTS) if name != "head"]
    joints = [got.pop(f"joint/{JOINTS[number]}") for number in known]
    assert_allclose(joints, np.column_stack([frame.seen.positions, frame.seen.confidence])[known], rtol=1e-6)
    assert list(got) == [f"handle/{handle.name.replace(' ', '_')}" for handle in dog.prepared.puppet.handle]
    assert_allclose(list(got.values()), frame.handles, rtol=1e-6)
    bare = performed(replace(dog, basis=None), is_seen=False)
    kinds = {address.split("/")[3] for address, _ in sent(bare, *KINDS)}
    assert kinds == {"controls", "handle", "performer", "vertices"}


def test_bones_are_rotations_by_the_name_of_the_joint_and_positions_of_those_that_travel(sent, limbed_figure):
    figure = StreamedCharacter("figure", limbed_figure, 1)
    turns = Rotation.random(len(limbed_figure.model.bones), random_state=3).as_matrix()
    frame = performed(figure, bones=np.concatenate([turns, np.zeros((len(turns), 1, 3))], axis=1))
    got = {address.removeprefix("/puppetline/figure/"): values for address, values in sent(frame, "bones")}
    skeleton, pose = figure.skeleton, frame.bones
    rotations = [got.pop(f"bone/{name}") for name in skeleton.names]
    assert_allclose(rotations, pose.rotations, rtol=1e-6)
    travelling = np.array(skeleton.names)[skeleton.travelling].tolist()
    assert set(travelling) == {"hips", "hump"}
    assert list(got) == [f"bone_position/{name}" for name in travelling]
    assert_allclose(list(got.values()), pose.translations, rtol=1e-6)


def test_vertices_come_in_numbered_chunks_that_fit_a_datagram(output, receiver, give, dog):
    frame = performed(dog, 2**31 + 5)
    give(output(send=("vertices",)), frame)
    datagrams = receiver.datagrams()
    assert max(map(len, datagrams)) <= 9000
    told = messages(datagrams)
    heads = [[5, chunk, len(told), chunk * CHUNK_VERTICES] for chunk in range(len(told))]
    assert [(address, params[:4]) for address, params in told] == [("/puppetline/dog/vertices", head) for head in heads]
    vertices = np.concatenate([np.reshape(params[4:], (-1, 6)) for _, params in told])
    assert_array_equal(vertices, np.concatenate(frame.vertices_and_normals, axis=1))


def test_the_performer_is_sent_on_each_change_and_every_second(output, receiver, give, dog, given_clock):
    out = output(send=("performer",), rate=100)
    for step in range(251):
        state, user = ("performing", 2) if step < 120 else ("leaving", None)
        give(out, performed(dog, step, state=state, user=user))
        given_clock.advance(0.01)
    told = [params for address, params in receiver.messages() if address == "/puppetline/dog/performer"]
    assert told == [["performing", 2], ["performing", 2], ["leaving", -1], ["leaving", -1]]


@pytest.mark.parametrize(("offered", "rate"), [(120, 30), (60, 25), (30, 100)])
def test_frames_are_sent_at_most_at_the_rate_and_the_newest_is_chosen(
    output, receiver, dog, given_clock, offered, rate
):
    out, start, count, sent = output(rate=rate, send=("handles",)), given_clock.now(), 4 * offered, []
    late = np.random.default_rng(3).uniform(0, 0.1, count)
    for number, arrival in enumerate(start + (np.arange(count) + late) / offered):
        if out.due() <= arrival:
            given_clock.advance_to(out.due())
            out.send_due()
            [(_, [shown, *_]), *_] = receiver.messages()
            assert shown == number - 1  # the newest that has been offered
            sent.append(given_clock.now())
        given_clock.advance_to(arrival)
        out.offer(performed(dog, number, targets=np.full((5, 3), number), root=np.zeros(3)))
    times = np.array(sent)
    for apart in (1, 5, 50):
        assert (times[apart:] - times[:-apart] >= (apart - EARLY_SHARE) / rate - 1e-9).all()
    assert len(sent) >= 0.93 * 4 * min(rate, offered)
    assert out.statistics.sent == len(sent)
    assert out.statistics.skipped == count - len(sent) - 1


def test_the_turns_of_characters_and_targets_are_their_own(output, receiver, give, dog, given_clock):
    outputs = output(send=("handles",)), output(send=("handles",), characters=("cat",), rate=1)
    for _ in range(2):
        for out in outputs:
            give(out, performed(dog), performed(replace(dog, name="cat")))
        given_clock.advance(0.5)
    counts = [address.split("/")[2] for address, _ in receiver.messages() if address.endswith("head")]
    assert sorted(counts) == ["cat"] * 3 + ["dog"] * 2


def test_a_payload_is_computed_only_when_it_is_sent(output, give, dog):
    frame = performed(dog)
    give(output(send=("controls",)), frame, performed(dog))
    assert "controls" not in vars(frame.pose)


def test_errors_are_counted_and_the_next_frame_is_another_try(output, receiver, give, dog, given_clock):
    out, many = output(send=("controls",)), performed(dog)
    vars(many.pose)["controls"] = np.zeros((2000, 3, 4), dtype=np.float32)  # no datagram is so large
    for frame, sent in ((many, 0), (performed(dog), 1)):
        give(out, frame)
        assert out.statistics.sent == sent
        assert out.statistics.failed == 1
        given_clock.advance(1)
    [datagram] = receiver.datagrams()
    assert out.statistics.bytes == len(datagram)
    receiver.close()
    for _ in range(5):  # nobody receives, which is no error
        give(out, performed(dog))
        given_clock.advance(1)
    assert out.statistics.sent == 6
    assert out.statistics.failed == 1


def test_a_name_that_nobody_knows_is_said_at_once():
    host = "no-such-machine.invalid"
    assert refused(ServiceError, OscOutput, OscTable(host=host, port=9000)).where == f"[[osc]], host {host!r}"


def test_names_in_addresses_hold_nothing_that_osc_forbids_and_differ():
    names = {"left hand": "left_hand", "left_hand": "left_hand_1", "a/b#c": "a_b_c", "Ärmel": "_rmel", "x": "x"}
    assert part_names(names) == [*names.values()]


def test_a_whole_network_can_be_a_target(give, dog, given_clock, until_end):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as heard:
        heard.bind(("", 0))
        heard.settimeout(5)
        port = heard.getsockname()[1]
        give(until_end(OscOutput(OscTable(host="127.255.255.255", port=port, send=("performer",)))), performed(dog))
        assert heard.recv(1000).startswith(b"/puppetline/")
