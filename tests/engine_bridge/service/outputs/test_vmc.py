import math
import socket
from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pythonosc.osc_bundle import OscBundle
from scipy.spatial.transform import Rotation

from capture.network.source import open_vmc
from capture.skeleton import JOINT_INDEX, LOST, SkeletonFrame, to_character_axes
from capture.source import wait
from engine_bridge.performance.prepared_character import load_prepared
from engine_bridge.performance.retargeting import PERFORMER
from engine_bridge.puppet.puppet import MorphTable
from engine_bridge.service.outputs.osc import OscOutput, OscTable
from engine_bridge.service.outputs.vmc import DATAGRAM_BYTES, datagrams
from engine_bridge.service.protocol.scene import StreamedCharacter
from solver.motion.limb_motion import LimbMotion

from .frames import frame_of, messages, pose_of

SIDE = """
[[limb]]
name = "{side} arm"
points = [[{x}0.3, 1.12, 0.02], [{x}0.8, 1.2, 0.04], [{x}1.2, 1.26, 0.06], [{x}1.4, 1.3, 0.07]]
joints = ["shoulder_{side}", "elbow_{side}", "wrist_{side}", "hand_{side}"]

[[limb]]
name = "{side} leg"
points = [[{x}0.1, -0.15, 0.0], [{x}0.3, -0.8, 0.05], [{x}0.48, -1.4, 0.05], [{x}0.5, -1.5, 0.12]]
joints = ["hip_{side}", "knee_{side}", "ankle_{side}", "foot_{side}"]
"""
LIMBS = (
    """
[[limb]]
name = "trunk"
points = [[0, 0, 0], [0, 0.5, 0], [0, 1.15, 0]]
joints = ["hip_center", "spine", "shoulder_center"]

[[limb]]
name = "head"
points = [[0, 1.15, 0], [0, 1.9, 0.25]]
joints = ["shoulder_center", "head"]
"""
    + SIDE.format(side="left", x="")
    + SIDE.format(side="right", x="-")
)


@pytest.fixture(scope="module")
def figure(blob_file, write_puppet):
    """The figure with the limbs of a humanoid."""
    path = write_puppet(blob_file.with_name("humanoid.toml"), blob_file.name, handles=LIMBS, character="scale = 0.5\n")
    return StreamedCharacter("figure", load_prepared(path), 1)


@pytest.fixture
def source(until_end):
    return until_end(open_vmc("127.0.0.1:0"))


@pytest.fixture
def moved_by(figure):
    """Make frames of the figure whose bones are where they rest, or elsewhere."""

    def make(sequence=0, state="performing", root=(0.0, 0.0, 0.0), character=figure, channels=None, **more):
        pose = pose_of(character.prepared, root=np.array(root), channels=channels, **more)
        return frame_of(character, sequence, state=state, user=1, pose=pose)

    return make


def bones(sent):
    """Place and quaternion of each bone."""
    return {
        values[0]: (np.array(values[1:4]), Rotation.from_quat(values[4:8]))
        for address, values in messages(sent)
        if address == "/VMC/Ext/Bone/Pos"
    }


def test_morph_targets_that_channels_move_are_blend_shapes_and_return_as_the_same_channels(figure, moved_by, source):
    targets = {"A": "mouth_open", "Blink_L": "blink_left", "blinkRight": "blink_right", "Joy": "smile"}
    channels = dict(zip(targets.values(), (0.5, 0.25, 1.0, 0.75), strict=True))
    morphs = tuple(MorphTable(target=target, channel=channel) for target, channel in targets.items())
    puppet = figure.prepared.puppet.model_copy(update={"morph": morphs})
    sent = list(datagrams(moved_by(character=figure.remapped(puppet), channels=channels), 0.0))
    blends = [("/VMC/Ext/Blend/Val", [target, channels[channel]]) for target, channel in targets.items()]
    assert messages(sent)[-5:] == [*blends, ("/VMC/Ext/Blend/Apply", [])]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for datagram in [*sent, *sent]:  # a frame precedes its blend shapes
            sender.sendto(datagram, ("127.0.0.1", source.port))
        assert next_frame(source).channels == channels


def test_measured_fingers_bend_down_in_a_t_pose_and_those_of_the_other_hand_are_not_sent(figure, moved_by):
    down, back = np.array([0, -1.0, 0]), np.array([0, 0, -1.0])  # Unity's axes
    for side, out in (("left", np.array([-1.0, 0, 0])), ("right", np.array([1.0, 0, 0]))):
        bent = {f"{bone}_{side}": value for bone, value in (("index_1", 0.75), ("index_2", 0.0), ("thumb_2", 0.75))}
        sent = bones(datagrams(moved_by(channels=bent), 0.0))
        fingers = {name.removeprefix(side.title()): sent[name] for name in sent.keys() - set(figure.humanoid.names)}
        assert len(fingers) == 15
        assert not any(name.startswith(("Left", "Right")) for name in fingers)
        assert_allclose(fingers["IndexProximal"][1].apply(out), down, atol=1e-6)
        assert_allclose(fingers["ThumbIntermediate"][1].apply(out), back, atol=1e-6)
        assert fingers["LittleDistal"][1].magnitude() == 0
        assert all(place @ out > 0 for place, _ in fingers.values())


def test_a_frame_is_bundles_that_travel_in_one_piece_and_say_all_that_the_protocol_wants(figure, moved_by):
    sent = list(datagrams(moved_by(root=(2.0, 0.0, -1.0)), 12.5))
    assert all(len(datagram) <= DATAGRAM_BYTES and OscBundle.dgram_is_bundle(datagram) for datagram in sent)
    assert len(sent) == 2
    assert sum(map(len, sent)) > DATAGRAM_BYTES
    read, placed = messages(sent), bones(sent)
    assert read[:3] == [
        ("/VMC/Ext/OK", [1, 3, 0, 1]),
        ("/VMC/Ext/T", [12.5]),
        ("/VMC/Ext/Root/Pos", ["root", 0, 0, 0, 0, 0, 0, 1]),
    ]
    assert {address for address, _ in read[3:]} == {"/VMC/Ext/Bone/Pos"}
    assert list(placed) == list(figure.humanoid.names)
    assert len(read) == 3 + len(placed) == 3 + 21
    place, turn = placed["Hips"]
    assert_allclose(place, [-1.0, -0.5 * figure.rest[:, 1].min(), -0.5], rtol=1e-6)
    assert turn.magnitude() == 0
    assert_allclose(placed["LeftUpperLeg"][0], [-0.05, -0.075, 0], atol=1e-7)


def test_the_state_is_the_protocols_and_the_clock_the_senders(moved_by, output, receiver, give, given_clock):
    out = output(rate=10, send=("vmc",))
    for state in ("waiting", "calibrating", "performing", "leaving"):
        give(out, moved_by(state=state))
        given_clock.advance(0.1)
    told = receiver.messages()
    states = [values for address, values in told if address == "/VMC/Ext/OK"]
    assert states == [[1, 0, 0, 0], [1, 2, 0, 0], [1, 3, 0, 1], [1, 0, 0, 0]]
    times = [values[0] for address, values in told if address == "/VMC/Ext/T"]
    assert_allclose(times, [0.0, 0.1, 0.2, 0.3], atol=1e-4)


def directions(figure, motions, joints):
    """Return where the character's bones and those of a performer point, except for feet (b, 3), (b, 3)."""
    bones = zip(
        motions[:, :3],
        (end - start for limb in figure.prepared.puppet.limbs for start, end in pairwise(limb.points)),
        (pair for limb in figure.prepared.puppet.limb for pair in pairwise(limb.joints)),
        strict=True,
    )
    found = np.array(
        [
            (along @ turn, joints[JOINT_INDEX[head]] - joints[JOINT_INDEX[tail]])
            for turn, along, (tail, head) in bones
            if not head.startswith("foot")
        ]
    )
    return np.moveaxis(found / np.linalg.norm(found, axis=2, keepdims=True), 1, 0)


def test_a_vmc_reader_recovers_the_directions_of_the_characters_bones(
    figure, moved_by, kung_fu, given_clock, give, source, until_end
):
    """Our own reader, which poses a body of its own by them."""
    motion = LimbMotion(figure.prepared.puppet.limbs, PERFORMER, np.full((20, 3), np.nan))
    out = until_end(OscOutput(OscTable(host="127.0.0.1", port=source.port, rate=1000, send=("vmc",))))
    for number, performed in enumerate(kung_fu[30:180:5]):
        motions = motion.step(performed.time, to_character_axes(performed.positions), performed.confidence)
        give(out, moved_by(number, bones=motions))
        given_clock.advance(0.1)
        frame = next_frame(source)
        assert (frame.confidence > LOST).all()
        own, read = directions(figure, motions, to_character_axes(frame.positions))
        assert math.degrees(np.arccos(np.clip((read * own).sum(axis=1), -1, 1)).max()) < 0.05
    assert not source.counts.refused


def next_frame(source):
    while not (frames := [each for each in source.receive() if isinstance(each, SkeletonFrame)]):
        wait(source, math.inf)
    return frames[0]
