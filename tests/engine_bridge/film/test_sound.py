"""Sound tracks: parts, times, gains, fades and files that cannot be used."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from engine_bridge.film import music
from engine_bridge.film.scene import MusicTable, SoundTable
from engine_bridge.film.sound import SAMPLE_RATE, Mixer

av = pytest.importorskip("av", reason="the extra film is not installed")

RAMP = np.linspace(-0.8, 0.8, 2 * SAMPLE_RATE)
STEP = 2 / 32767
"""Rounding of a .wav of 16 bits."""


@pytest.fixture
def mixed(tmp_path):
    """Return the sound of some tracks, read in blocks of odd sizes."""

    def read(*tables, seconds=3.0):
        mixer = Mixer([SoundTable(**table) for table in tables], tmp_path / "scene.toml", seconds)
        count = round(seconds * SAMPLE_RATE)
        return np.concatenate([mixer.read(min(1601, count - start)) for start in range(0, count, 1601)]), mixer

    return read


def test_a_part_of_a_file_is_at_its_time_to_the_sample(mixed, write_wav):
    write_wav(RAMP)
    sound, _ = mixed({"file": "sound.wav", "at": 0.5, "start": 0.25, "stop": 1.25})
    expected = np.zeros(3 * SAMPLE_RATE)
    expected[24_000:72_000] = RAMP[12_000:60_000]
    assert_allclose(sound, np.column_stack([expected, expected]), atol=STEP)


@pytest.mark.parametrize("length", [1, 2])
def test_gains_are_decibels_and_fades_are_linear_up_to_the_end_of_the_film(mixed, write_wav, length):
    write_wav(np.full(length * SAMPLE_RATE, 0.5))
    sound, _ = mixed({"file": "sound.wav", "gain": -6.0206, "fade_in": 0.25, "fade_out": 0.5}, seconds=1.0)
    t = np.arange(SAMPLE_RATE) / SAMPLE_RATE
    assert_allclose(sound[:, 0], 0.25 * np.clip(4 * t, 0, 1) * np.clip(2 * (1 - t), 0, 1), atol=2 * STEP)


def test_tracks_are_added_and_what_is_too_loud_is_cut_off(mixed, write_wav):
    write_wav(np.full(1000, 0.8))
    sound, mixer = mixed({"file": "sound.wav"}, {"file": "sound.wav", "at": 0.01}, seconds=0.05)
    assert sound[700].tolist() == [1, 1]
    assert mixer.peak == pytest.approx(1.6, abs=1e-3)
    muted, _ = mixed({"file": "sound.wav", "mute": True}, seconds=0.05)
    assert not muted.any()


@pytest.mark.parametrize(("rate", "channels"), [(44_100, 1), (16_000, 2)])
def test_other_rates_are_resampled_without_a_shift(mixed, write_wav, rate, channels):
    def tone(rate):
        return 0.5 * np.sin(2 * np.pi * 440 * np.arange(2 * rate) / rate)

    write_wav(np.repeat((tone(rate) * (np.arange(2 * rate) > rate))[:, None], channels, axis=1), rate)
    sound, _ = mixed({"file": "sound.wav"}, seconds=2.0)
    assert_allclose(sound[50_000:90_000, 0], tone(SAMPLE_RATE)[50_000:90_000], atol=0.01)
    assert np.abs(sound[:47_000]).max() < 0.01


@pytest.mark.parametrize(("kind", "codec"), [("flac", "flac"), ("mp3", "mp3"), ("m4a", "aac"), ("opus", "libopus")])
def test_other_formats_are_decoded_with_the_clap_where_it_was(mixed, write_wav, tmp_path, kind, codec):
    clap = np.zeros(SAMPLE_RATE)
    clap[24_000:24_400] = 0.9 * np.sin(np.arange(400) / 3)
    write_wav(clap)
    with av.open(str(tmp_path / "sound.wav")) as source, av.open(str(tmp_path / f"sound.{kind}"), "w") as target:
        stream = target.add_stream(codec, rate=SAMPLE_RATE, layout="mono")
        for frame in source.decode(audio=0):
            target.mux(stream.encode(frame))
        target.mux(stream.encode(None))
    sound, _ = mixed({"file": f"sound.{kind}"}, seconds=1.0)
    loud = np.flatnonzero(np.abs(sound[:, 0]) > 0.3)
    assert abs(loud[0] - 24_000) < 0.002 * SAMPLE_RATE


@pytest.mark.parametrize("content", [None, b"", b"RIFF....nothing of the kind"])
def test_the_rest_is_played_if_a_file_is_no_sound(mixed, write_wav, tmp_path, content):
    write_wav(np.full(SAMPLE_RATE, 0.5), name="other.wav")
    if content is not None:
        (tmp_path / "sound.wav").write_bytes(content)
    sound, mixer = mixed({"file": "sound.wav"}, {"file": "other.wav"}, seconds=1.0)
    assert_allclose(sound, 0.5, atol=STEP)
    (note,) = mixer.notes
    assert "scene.toml, [[sound]] 1, file" in note


def test_a_note_about_missing_music_names_a_key_that_music_has(tmp_path):
    mixer = Mixer((), tmp_path / "scene.toml", 1.0, MusicTable(file="none.wav"))
    (note,) = mixer.notes
    assert "scene.toml, [music], file" in note
    assert "mute" not in note
    assert not mixer.read(100).any()


@pytest.mark.parametrize("table", [{"loop": "waltz"}, {"file": "sound.wav"}])
def test_music_is_repeated_without_a_gap_and_fades_out_at_the_end_of_the_film(tmp_path, write_wav, table):
    tone = 0.3 * np.sin(np.arange(SAMPLE_RATE) * 2 * np.pi / 240)
    write_wav(tone)
    played = music.piece("waltz") if "loop" in table else np.stack([tone, tone], axis=1)
    seconds = 2.5 * len(played) / SAMPLE_RATE
    mixer = Mixer((), tmp_path / "scene.toml", seconds, MusicTable(**table, gain=-6.0206, fade_in=0, fade_out=0.5))
    sound = mixer.read(round(seconds * SAMPLE_RATE))
    expected = 0.5 * np.concatenate([played] * 3)[: len(sound)]
    share = np.clip(np.arange(len(sound), 0, -1) / (0.5 * SAMPLE_RATE), 0, 1)
    assert_allclose(sound, expected * share[:, None], atol=2 * STEP)
