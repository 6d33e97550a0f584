"""Channels: from the sound beside a take to jaws that open and morph targets that move."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from capture.events import Cue
from capture.formats import read_log
from capture.sensor_tilt import SensorTilt
from capture.timeline import Timeline
from engine_bridge.performance.calibration import Calibration
from engine_bridge.performance.channels import ChannelMotion, morph_weights
from engine_bridge.performance.character_motion import mirrored
from engine_bridge.performance.clip import TakeTimeline, load_timeline, solve
from engine_bridge.performance.pose import TargetPose
from engine_bridge.performance.prepared_character import load_prepared
from engine_bridge.performance.settings import Settings
from engine_bridge.puppet import puppet_file
from puppetline.errors import PuppetError
from solver.motion.limbs import bones_of

from ..refusals import refused

RATE = 48_000
BEND = 'bend = { channel = "voice", degrees = 30, axis = "x" }\n'


@pytest.fixture
def loud_take(tmp_path, write_wav, record_events, frames, dance):
    """A take beside which somebody speaks from 0.8 s to 1.4 s after its first frame; the sound begins 0.5 s earlier."""
    first, *others = frames(dance(), 7.0)
    cue = Cue(7.0, "sound", {"file": "loud.wav", "at": 6.5})
    t = np.arange(3 * RATE) / RATE
    tone = 0.3 * np.sin(2 * np.pi * 200 * t) * ((t >= 1.3) & (t < 1.9))
    write_wav(tone + 0.001 * np.random.default_rng(1).normal(size=len(t)), name="loud.wav")
    return record_events(tmp_path / "loud.log", [first, cue, *others])


@pytest.fixture
def bent_puppet(blob_file, write_puppet, limb_tables):
    """The figure, whose head is bent by the voice."""
    text = limb_tables.replace(
        'joints = ["shoulder_center", "head"]\n', 'joints = ["shoulder_center", "head"]\n' + BEND
    )
    return write_puppet(blob_file.with_name("bent.toml"), blob_file.name, handles=text)


def test_a_take_has_the_voice_of_the_sound_beside_it(loud_take):
    timeline, _ = load_timeline(loud_take, Settings())
    voice = timeline.channels["voice"]
    assert voice[timeline.times < 0.8].max() <= 0.02
    assert voice[(timeline.times > 0.9) & (timeline.times < 1.35)].min() > 0.8
    assert voice[timeline.times > 1.55].max() <= 0.1
    assert timeline.frame(30).channels == {"voice": pytest.approx(float(voice[30]))}
    assert timeline.part(20, 40).channels["voice"].tolist() == voice[20:40].tolist()


def test_without_its_sound_a_take_has_the_channels_that_were_recorded(tmp_path, record_events, frames, dance):
    first, *others = (
        replace(frame, channels={} if number == 5 else {"voice": number / 100, "smile": 0.5})
        for number, frame in enumerate(frames(dance(), 7.0))
    )
    pose = Calibration(first.positions, SensorTilt(0.0, 1.0)).to_json()
    opening = Cue(7.0, "stage", {"characters": {"a": {"user": first.user, "calibration": pose}}})
    path = record_events(tmp_path / "a.log", [opening, first, Cue(7.0, "sound", {"file": "a.wav", "at": 7}), *others])
    timeline, notes = load_timeline(path, Settings())
    assert_allclose(timeline.channels["voice"], np.arange(len(timeline.times)) / 100, atol=1e-6)
    assert set(timeline.channels["smile"]) == {0.5}
    (note,) = [each for each in notes if "sound" in each]
    assert note.endswith(
        "cannot be read (No such file or directory). It is silent; mouths move as they did in the recording."
    )
    (clip,) = read_log(path)
    assert [frame.channels for frame in clip.frames()][4:6] == [{"voice": pytest.approx(0.04), "smile": 0.5}, None]


def test_a_limb_bends_about_its_first_point_and_carries_what_hangs_on_it(bent_puppet):
    puppet = puppet_file.load(bent_puppet)
    bones = bones_of(puppet.limbs)
    rng = np.random.default_rng(2)
    motions = np.array(
        [np.vstack([Rotation.random(random_state=k).as_matrix(), rng.normal(size=3)]) for k in range(len(bones))]
    )
    pose = TargetPose(np.empty((0, 3)), motions, np.zeros(3))
    bent = ChannelMotion(puppet, bones).moved(pose, {"voice": 0.5}).bones
    (head,) = [b for b in range(len(bones)) if np.allclose(bones.heads[b], [0, 1.25, 0])]
    others = [b for b in range(len(bones)) if b != head]
    assert_array_equal(bent[others], motions[others])
    turn = Rotation.from_rotvec([np.radians(15), 0, 0])
    point = np.array([0.1, 1.7, 0.3])
    expected = (turn.apply(point - bones.heads[head]) + bones.heads[head]) @ motions[head, :3] + motions[head, 3]
    assert_allclose(point @ bent[head, :3] + bent[head, 3], expected, atol=1e-12)
    assert ChannelMotion(puppet, bones).moved(pose, None) is pose


def test_a_handle_moves_with_its_channel_along_axes_that_turn_with_the_trunk(blob_puppet, limb_tables):
    text = blob_puppet.read_text().replace("[[handle]]\n", '[[handle]]\nchannel = "voice"\nmoves = [0, 0, 0.4]\n', 1)
    turned = np.vstack([Rotation.from_rotvec([0, np.pi / 2, 0]).as_matrix().T, np.zeros(3)])
    for more, expected in (("", [0, 0, 0.2]), (limb_tables, [0.2, 0, 0])):
        puppet = puppet_file.loads(text + more, "a.toml")
        bones = bones_of(puppet.limbs)
        pose = TargetPose(puppet.handle_positions, np.tile(turned, (len(bones), 1, 1)), np.zeros(3))
        way = ChannelMotion(puppet, bones).moved(pose, {"voice": 0.5}).targets - pose.targets
        assert_allclose(way[0], expected, atol=1e-12)
        assert not way[1:].any()


def test_the_character_opens_its_mouth_when_the_performer_speaks(bent_puppet, limbed_puppet, loud_take):
    prepared, plain = load_prepared(bent_puppet), load_prepared(limbed_puppet)
    timeline, _ = load_timeline(loud_take, Settings())
    bent, same = (solve(each, timeline, Settings()) for each in (prepared, plain))
    moved = np.abs(bent.bones[:] - same.bones[:]).max(axis=(1, 2, 3))
    quiet, loud = timeline.channels["voice"] == 0, timeline.channels["voice"] > 0.8
    assert moved[quiet].max() < 1e-6
    assert moved[loud].min() > 0.2
    assert np.abs(bent.R[:] - same.R[:]).max(axis=(1, 2))[loud].min() > 0.01


@pytest.mark.parametrize(
    ("more", "where"),
    [
        ('[[morph]]\ntarget = "jawOpen"\nchannel = "voice"\n', "[[morph]] 1, target"),
        ('[[morph]]\ntarget = "jawOpen"\nchannel = "loudness"\n', "[[morph]] 1, channel"),
        ('[[channel]]\nname = "smile"\nfull = 0.0\n', "'smile', full"),
        ('[[handle]]\nname = "jaw"\nposition = [0, 1, 0]\nchannel = "voice"\n', "'jaw', moves"),
    ],
)
def test_a_wrong_target_or_channel_is_one_message(blob_puppet, tmp_path, more, where):
    path = tmp_path / "a.toml"
    path.write_text(blob_puppet.read_text().replace("blob.glb", str(blob_puppet.with_name("blob.glb"))) + more)
    assert where in refused(PuppetError, load_prepared, path).where


@pytest.mark.parametrize(("neutral", "full", "expected"), [(0.1, 0.6, [0, 0.5, 1]), (0.6, 0.1, [1, 0.5, 0])])
def test_a_channels_range_becomes_0_to_1_for_targets_and_limbs(bent_puppet, neutral, full, expected):
    text = bent_puppet.read_text() + (
        '[[morph]]\ntarget = "a"\nchannel = "voice"\n[[morph]]\ntarget = "b"\nchannel = "index_1_left"\ngain = 2\n'
        f'[[channel]]\nname = "voice"\nneutral = {neutral}\nfull = {full}\n'
    )
    puppet = puppet_file.loads(text, "a.toml")
    measured = np.array([0.0, 0.35, 0.9], np.float32)
    weights = morph_weights(puppet, {"voice": measured, "index_1_left": measured})
    assert_allclose(weights["a"], expected, atol=1e-6)
    assert_allclose(weights["b"], np.minimum(2 * measured, 1))
    assert morph_weights(puppet, None) == {}
    bones = bones_of(puppet.limbs)
    pose = TargetPose(np.empty((0, 3)), np.tile(np.eye(4, 3), (len(bones), 1, 1)), np.zeros(3))
    turned = [
        np.degrees(Rotation.from_matrix(motions[:, :3]).magnitude()).max()
        for value in measured.tolist()
        for motions in [ChannelMotion(puppet, bones).moved(pose, {"voice": value}).bones]
    ]
    assert_allclose(turned, 30 * np.array(expected), atol=1e-4)


def test_a_mirrored_character_has_the_channels_of_the_other_side_while_the_take_mirrors(limbed_puppet, dance, standing):
    prepared = load_prepared(limbed_puppet)
    left = np.arange(1, 7, dtype=np.float32)
    given = {"point_left": left, "smile": left}
    take = TakeTimeline(30, dance(6), np.ones((6, 20), np.float32), (), channels=given, mirror=True)
    take = replace(take, later={2: (standing, None), 4: (standing, False)})
    assert {name: values.tolist() for name, values in solve(prepared, take, Settings()).channels.items()} == {
        "point_left": [0, 0, 0, 0, 5, 6],
        "point_right": [1, 2, 3, 4, 0, 0],
        "smile": left.tolist(),
    }
    plain = Timeline(30, take.positions, take.confidence, (), channels=given)
    for mirrors, expected in ((False, given), (True, {"point_right": left, "smile": left})):
        shown = solve(replace(prepared, puppet=mirrored(prepared.puppet, mirrors)), plain, Settings()).channels
        assert {name: values.tolist() for name, values in shown.items()} == {n: v.tolist() for n, v in expected.items()}
