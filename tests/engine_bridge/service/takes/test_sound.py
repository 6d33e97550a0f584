"""A service that hears: characters talk live and in takes, and the sound is beside the take on the same clock."""

import shutil

import numpy as np
import pytest

from capture.formats import puppetline_log
from capture.sound import SAMPLE_RATE, WavWriter, read_wav
from engine_bridge.performance.prepared_character import load_prepared
from engine_bridge.service.outputs import osc
from engine_bridge.service.protocol.header import Kind
from engine_bridge.service.protocol.payloads import decode, message
from engine_bridge.service.protocol.scene import describe
from engine_bridge.service.takes.take_track import TakeTrack

from ..outputs.frames import messages

BEND = 'bend = { channel = "voice", degrees = 30, axis = "x" }\n'


@pytest.fixture
def loud(tmp_path):
    """Write a sound: noise, with a voice from 0.8 s to 1.4 s and from 2.2 s on."""
    t = np.arange(4 * SAMPLE_RATE) / SAMPLE_RATE
    speaks = ((t >= 0.8) & (t < 1.4)) | (t >= 2.2)
    noise = 0.001 * np.random.default_rng(1).normal(size=len(t))
    with WavWriter(tmp_path / "loud.wav") as writer:
        writer.write((0.3 * np.sin(2 * np.pi * 200 * t) * speaks + noise).astype(np.float32))
    return "loud.wav"


@pytest.fixture
def talking_puppet(talking):
    """The figure whose voice opens a jaw: a morph target of the mesh, and a limb that bends."""
    path = talking(limbs=True)
    head = 'joints = ["shoulder_center", "head"]\n'
    path.write_text(path.read_text().replace(head, head + BEND))
    return path


@pytest.fixture
def theatre(make_theatre, loud, talking_puppet):
    """Play a service that records the performer, with sound, for three seconds; say when the sound began."""
    made = make_theatre(("dog",), stage=f'sound = "{loud}"', puppet=talking_puppet)
    made.began = made.runner.source.now()
    made.ask("record_start", name="take1")
    made.run(3.0)
    return made


def test_the_voice_opens_the_mouth_live_in_every_output(theatre):
    frames = theatre.of("dog")
    values = [frame.pose.channels["voice"] for frame in frames]
    for at, value in zip([frame.time - theatre.began for frame in frames], values, strict=True):
        assert value > 0.8 or not (0.9 < at < 1.35 or at > 2.3)
        assert value < 0.05 or not (at < 0.8 or 1.6 < at < 2.2)
    quiet, spoken = frames[values.index(0)], frames[int(np.argmax(np.array(values) > 0.8))]
    for frame in (quiet, spoken):
        weight = np.float32(frame.pose.channels["voice"])
        for kind in (Kind.CONTROLS, Kind.VERTICES16, Kind.BONES):
            assert decode(message(kind, frame)).targets.tolist() == [weight]
        sent = messages(osc._DATAGRAMS["channels"]("/puppetline/dog", frame))
        assert sent == [(f"/puppetline/dog/{name}", [weight]) for name in ("channel/voice", "target/jaw")]
    character, places = spoken.character, spoken.vertices_and_normals[0]
    assert np.abs(places - character.binding.vertices(spoken.pose.controls)).max() > 0.05
    assert character.displacements[0].min() == pytest.approx(-0.2)
    assert describe(character)["targets"] == ["jaw"]


def sound_cue(path):
    [cue] = [event for event in puppetline_log.events(path) if getattr(event, "do", "") == "sound"]
    return cue.arguments


def assert_a_kill_would_leave_all_but_a_second(path, folder):
    """What is on the disk three seconds after the beginning of take and sound is readable."""
    for ending in (".log", ".wav"):
        shutil.copy(path.with_suffix(ending), folder / f"left{ending}")
    *_, last = puppetline_log.events(folder / "left.log")
    samples, rate = read_wav(folder / "left.wav")
    seen = last.time - sound_cue(folder / "left.log")["at"]
    assert 1.9 <= seen < 3.01
    assert seen - 1.1 <= len(samples) / rate <= seen + 0.5


def test_a_take_with_sound_replays_bit_for_bit_and_has_the_sound_on_its_clock(
    theatre, make_player, talking_puppet, tmp_path
):
    frames, path = theatre.of("dog"), tmp_path / "takes" / "take1.log"
    assert_a_kill_would_leave_all_but_a_second(path, tmp_path)
    theatre.ask("record_stop")
    track = TakeTrack(make_player("dog", prepared=load_prepared(talking_puppet)), path)
    assert len(track.times) == len(frames)
    for number, frame in enumerate(frames):
        shown, (_, pose) = track.frame(number)
        assert np.array_equal(pose.R, frame.pose.R)
        assert shown.channels == frame.pose.channels
    cue, (samples, rate) = sound_cue(path), read_wav(path.with_suffix(".wav"))
    assert cue["file"] == "take1.wav"
    assert len(samples) / rate == pytest.approx(3.0, abs=0.1)
    onset = np.flatnonzero(np.abs(samples) > 0.1)[0] / rate + cue["at"] - theatre.began
    assert onset == pytest.approx(0.8, abs=0.005)
