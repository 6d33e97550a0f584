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
from engine_bridge.puppet.puppet import ChannelTable, MorphTable
from puppetline.errors import PuppetError
from solver.motion.limbs import bones_of

from ..refusals import refused

RATE = 48_000
BEND = 'bend = { channel = "voice", degrees = 30, axis = "x" }\n'


@pytest.fixture
def loud_take(tmp_path, write_wav, record_events, frames, dance):
    """A take beside which somebody speaks from 0.8 s to 1.4 s after its first frame; the sound begins 0.5 s earlier."""
    t = np.arange(3 * RATE) / RATE
    tone = 0.3 * np.sin(2 * np.pi * 200 * t) * ((t >= 1.3) & (t < 1.9))
    write_wav(tone + 0.001 * np.random.default_rng(1).normal(size=len(t)), name="loud.wav")
    return record_events(
        tmp_path / "loud.log", [Cue(7.0, "sound", {"file": "loud.wav", "at": 6.5}), *frames(dance(), 7.0)]
    )


@pytest.fixture
def bent_puppet(blob_file, write_puppet, limb_tables):
    """The figure, whose head is bent by the voice."""
    joints = 'joints = ["shoulder_center", "head"]\n'
    text = limb_tables.replace(joints, joints + BEND)
    return puppet_file.load(write_puppet(blob_file.with_name("bent.toml"), blob_file.name, handles=text))


def moved(puppet, motions, voice):
    """Return the pose that a voice makes of motions of the bones, and the pose without it."""
    pose = TargetPose(puppet.handle_positions, motions, np.zeros(3))
    return ChannelMotion(puppet, bones_of(puppet.limbs)).moved(pose, {"voice": voice}), pose


def test_a_take_has_the_voice_of_the_sound_beside_it(loud_take):
    timeline, _ = load_timeline(loud_take, Settings())
    voice = timeline.channels["voice"]
    assert voice[timeline.times < 0.8].max() <= 0.02
    assert voice[(timeline.times > 0.9) & (timeline.times < 1.35)].min() > 0.8
    assert voice[timeline.times > 1.55].max() <= 0.1
    assert timeline.frame(30).channels == {"voice": pytest.approx(float(voice[30]))}
    assert timeline.part(20, 40).channels["voice"].tolist() == voice[20:40].tolist()


def test_without_its_sound_a_take_has_the_channels_that_were_recorded(tmp_path, record_events, frames, dance):
    played = [
        replace(frame, channels={} if number == 4 else {"voice": number / 100, "smile": 0.5})
        for number, frame in enumerate(frames(dance(), 7.0))
    ]
    pose = Calibration(played[0].positions, SensorTilt(0.0, 1.0)).to_json()
    opening = Cue(7.0, "stage", {"characters": {"a": {"user": 1, "calibration": pose}}})
    path = record_events(tmp_path / "a.log", [opening, Cue(7.0, "sound", {"file": "a.wav", "at": 7}), *played])
    timeline, notes = load_timeline(path, Settings())
    assert_allclose(timeline.channels["voice"], np.arange(len(timeline.times)) / 100, atol=1e-6)
    assert set(timeline.channels["smile"]) == {0.5}
    (note,) = [each for each in notes if "sound" in each]
    assert "cannot be read" in note
    assert "mouths move as they did in the recording" in note
    (clip,) = read_log(path)
    assert [frame.channels for frame in clip.frames()][3:5] == [{"voice": pytest.approx(0.03), "smile": 0.5}, None]


def test_a_limb_bends_about_its_first_point_and_carries_what_hangs_on_it(bent_puppet):
    bones, rng = bones_of(bent_puppet.limbs), np.random.default_rng(2)
    turns = Rotation.random(len(bones), random_state=rng).as_matrix()
    motions = np.concatenate([turns, rng.normal(size=(len(bones), 1, 3))], axis=1)
    pose, _ = moved(bent_puppet, motions, 0.5)
    (is_head,) = np.nonzero(np.isclose(bones.heads, [0, 1.25, 0]).all(axis=1))
    (head,) = is_head
    assert_array_equal(np.delete(pose.bones, head, axis=0), np.delete(motions, head, axis=0))
    turn, neck, point = Rotation.from_rotvec([np.radians(15), 0, 0]), bones.heads[head], np.array([0.1, 1.7, 0.3])
    expected = (turn.apply(point - neck) + neck) @ motions[head, :3] + motions[head, 3]
    assert_allclose(point @ pose.bones[head, :3] + pose.bones[head, 3], expected, atol=1e-12)
    assert ChannelMotion(bent_puppet, bones).moved(pose, None) is pose


def test_a_handle_moves_with_its_channel_along_axes_that_turn_with_the_trunk(blob_puppet, limb_tables):
    text = blob_puppet.read_text().replace("[[handle]]\n", '[[handle]]\nchannel = "voice"\nmoves = [0, 0, 0.4]\n', 1)
    turned = np.vstack([Rotation.from_rotvec([0, np.pi / 2, 0]).as_matrix().T, np.zeros(3)])
    for more, expected in (("", [0, 0, 0.2]), (limb_tables, [0.2, 0, 0])):
        puppet = puppet_file.loads(text + more, "a.toml")
        shown, pose = moved(puppet, np.tile(turned, (len(bones_of(puppet.limbs)), 1, 1)), 0.5)
        way = shown.targets - pose.targets
        assert_allclose(way[0], expected, atol=1e-12)
        assert not way[1:].any()


def test_the_character_opens_its_mouth_when_the_performer_speaks(bent_puppet, limbed_figure, loud_take):
    timeline, _ = load_timeline(loud_take, Settings())
    puppets = bent_puppet, limbed_figure.puppet
    bent, same = (solve(replace(limbed_figure, puppet=puppet), timeline, Settings()) for puppet in puppets)
    apart, voice = np.abs(bent.bones[:] - same.bones[:]).max(axis=(1, 2, 3)), timeline.channels["voice"]
    assert apart[voice == 0].max() < 1e-6
    assert apart[voice > 0.8].min() > 0.2
    assert np.abs(bent.R[:] - same.R[:]).max(axis=(1, 2))[voice > 0.8].min() > 0.01


def test_a_target_that_the_mesh_does_not_have_is_named(blob_puppet):
    path = blob_puppet.with_name("jaw.toml")
    path.write_text(blob_puppet.read_text() + '[[morph]]\ntarget = "jawOpen"\nchannel = "voice"\n')
    assert refused(PuppetError, load_prepared, path).where == f"{path}, [[morph]] 1, target"


@pytest.mark.parametrize(("neutral", "full", "expected"), [(0.1, 0.6, [0, 0.5, 1]), (0.6, 0.1, [1, 0.5, 0])])
def test_a_channels_range_becomes_0_to_1_for_targets_and_limbs(bent_puppet, neutral, full, expected):
    puppet = bent_puppet.model_copy(
        update={
            "morph": (MorphTable(target="a", channel="voice"), MorphTable(target="b", channel="index_1_left", gain=2)),
            "channel": (ChannelTable(name="voice", neutral=neutral, full=full),),
        }
    )
    measured = np.array([0.0, 0.35, 0.9], np.float32)
    weights = morph_weights(puppet, {"voice": measured, "index_1_left": measured})
    assert_allclose(weights["a"], expected, atol=1e-6)
    assert_allclose(weights["b"], np.minimum(2 * measured, 1))
    assert morph_weights(puppet, None) == {}
    still = np.tile(np.eye(4, 3), (len(bones_of(puppet.limbs)), 1, 1))
    turns = [Rotation.from_matrix(moved(puppet, still, voice)[0].bones[:, :3]) for voice in measured.tolist()]
    assert_allclose([np.degrees(turn.magnitude()).max() for turn in turns], 30 * np.array(expected), atol=1e-4)


def test_a_mirrored_character_has_the_channels_of_the_other_side_while_the_take_mirrors(limbed_figure, dance, standing):
    left = np.arange(1, 7, dtype=np.float32)
    given = {"point_left": left, "smile": left}

    def shown(timeline, puppet=limbed_figure.puppet):
        channels = solve(replace(limbed_figure, puppet=puppet), timeline, Settings()).channels
        return {name: values.tolist() for name, values in channels.items()}

    seen = 30, dance(6), np.ones((6, 20), np.float32), ()
    later = {2: (standing, None), 4: (standing, False)}
    take, plain = TakeTimeline(*seen, channels=given, mirror=True, later=later), Timeline(*seen, channels=given)
    smile = {"smile": left.tolist()}
    assert shown(take) == {"point_left": [0, 0, 0, 0, 5, 6], "point_right": [1, 2, 3, 4, 0, 0]} | smile
    for mirrors, name in ((False, "point_left"), (True, "point_right")):
        assert shown(plain, mirrored(limbed_figure.puppet, mirrors)) == {name: left.tolist()} | smile
