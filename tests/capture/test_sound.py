"""Sound beside a take: on the computer's clock whatever the sound card's does, and readable after a crash."""

import sys
import threading
import types
import wave

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from capture.sound import SAMPLE_RATE, Block, ClockedSound, WavWriter, read_wav
from capture.sound_input import RETRY_SECONDS, SoundInput, open_sound
from puppetline.errors import OutputError, SourceError

from ..waiting import wait_until

BLOCK = 960


def tone(seconds, rate=SAMPLE_RATE, pitch=200):
    return 0.3 * np.sin(2 * np.pi * pitch * np.arange(seconds * rate) / rate).astype(np.float32)


def blocks(samples, begin, rate=SAMPLE_RATE):
    """Return samples in blocks of 20 ms."""
    every = rate // 50
    return [Block(begin + k / rate, samples[k : k + every]) for k in range(0, len(samples), every)]


def claps(seconds, drift, jitter=0.0):
    """Return blocks of a card whose clock is too fast by `drift`, with a clap of one sample every 10 s."""
    rng, rate = np.random.default_rng(5), SAMPLE_RATE * (1 + drift)
    samples = np.zeros(int(seconds * rate) // BLOCK * BLOCK, np.float32)
    samples[np.round(np.arange(10.0, seconds, 10.0) * rate).astype(int)] = 1.0
    return [
        Block(100.0 + k * BLOCK / rate + jitter * rng.uniform(-1, 1), part)
        for k, part in enumerate(np.split(samples, len(samples) // BLOCK))
    ]


def places_of(heard):
    """Return when the claps are in a sound."""
    places = np.flatnonzero(heard > 0.3) / SAMPLE_RATE
    return places[np.insert(np.diff(places) > 1, 0, True)]


class Card:
    """A sound card that has delivered some blocks, and was once not read in time."""

    overflows = 1

    def __init__(self, blocks, rate=SAMPLE_RATE):
        self.waiting, self.rate, self.closed_in = blocks, rate, None

    def blocks(self):
        assert self.closed_in is None
        given, self.waiting = self.waiting, []
        return given

    def close(self):
        self.closed_in = threading.current_thread()


@pytest.mark.parametrize(("drift", "jitter"), [(3e-4, 0.004), (-3e-4, 0.0)])
def test_claps_are_within_20_ms_although_the_clock_drifts_by_more(drift, jitter, tmp_path):
    seconds = 100
    sound = SoundInput(lambda: Card(claps(seconds, drift, jitter)))
    sound.record(tmp_path / "a.wav")
    sound.take_in()
    start = sound.start
    sound.stop()
    heard, rate = read_wav(tmp_path / "a.wav")
    assert rate == SAMPLE_RATE
    late = places_of(heard) + (start - 100.0) - np.arange(10.0, seconds, 10.0)
    assert np.abs(late).max() < 0.020
    assert np.abs(late[5:] - late[5:].mean()).max() < 0.004


def test_without_drift_samples_stay_as_they_are_and_an_empty_block_changes_nothing():
    sound, heard = ClockedSound(), tone(1)
    assert (len(sound.add(Block(3.0, heard[:0]))), sound.start) == (0, None)
    made = np.concatenate([sound.add(block) for block in blocks(heard, 5)])
    assert_allclose(made, heard[: len(made)], atol=1e-6)
    assert len(made) >= SAMPLE_RATE - 2


def test_lost_blocks_become_silence_of_their_length():
    sound = ClockedSound()
    heard = np.concatenate([sound.add(block) for block in claps(60, 0.0) if not 112.0 <= block.time < 114.5])
    assert_allclose(places_of(heard), np.arange(10.0, 60, 10.0), atol=0.002)


def test_a_file_is_readable_before_it_is_closed(tmp_path):
    writer = WavWriter(tmp_path / "a.wav")
    writer.write(tone(5))
    writer.write(tone(1))
    for _ in range(2):
        with wave.open(str(tmp_path / "a.wav")) as file:
            assert (file.getframerate(), file.getnchannels(), file.getsampwidth()) == (SAMPLE_RATE, 1, 2)
            assert file.getnframes() == 6 * SAMPLE_RATE
            assert_array_equal(np.frombuffer(file.readframes(SAMPLE_RATE), "<i2"), np.rint(tone(1) * 32767))
        writer.close()
    assert writer.seconds == pytest.approx(6)
    with pytest.raises(OutputError):
        WavWriter(tmp_path / "none" / "a.wav")


def test_a_late_frame_has_the_voice_of_its_own_time_and_mouths_close_without_sound():
    quiet = np.zeros(SAMPLE_RATE // 2, np.float32)
    sound = SoundInput(lambda: Card([Block(7.0, quiet), Block(7.5, tone(1)), Block(8.5, quiet)]))
    sound.take_in()
    assert [sound.voice_at(moment) for moment in (6.9, 7.4, 8.9, 9.4, 9.6)] == pytest.approx([0] * 5, abs=0.01)
    assert min(sound.voice_at(moment) for moment in (7.7, 8.0, 8.4)) > 0.8
    assert sound.voice_at(8.52) > 0.5


class Microphones(types.ModuleType):
    """A stand-in for sounddevice, with a microphone that can be unplugged."""

    class PortAudioError(Exception):
        pass

    def __init__(self):
        super().__init__("sounddevice")
        self.plugged, self.streams, self.scans = True, [], 0

    def _terminate(self):
        self.scans += 1

    def _initialize(self):
        assert all(stream.closed for stream in self.streams)

    def InputStream(self, callback, **_):  # noqa: N802
        if not self.plugged:
            raise self.PortAudioError("no device")
        stream = types.SimpleNamespace(callback=callback, closed=False, start=lambda: None)
        stream.close = lambda: setattr(stream, "closed", True)
        self.streams.append(stream)
        return stream

    def hear(self, gain=1.0):
        """Deliver a block to the newest stream."""
        now = types.SimpleNamespace(currentTime=1.0, inputBufferAdcTime=1.0, input_overflow=False)
        self.streams[-1].callback(gain * tone(1)[:BLOCK, None], BLOCK, now, now)


def test_a_microphone_that_vanishes_is_reported_once_and_heard_again_when_it_is_back(
    monkeypatch, given_clock, caplog, tmp_path
):
    caplog.set_level("INFO")
    devices = Microphones()
    monkeypatch.setitem(sys.modules, "sounddevice", devices)
    sound = open_sound("default", tmp_path)
    devices.hear(0)
    sound.take_in()
    devices.plugged = False
    for _ in range(5):
        given_clock.advance(1.6)
        sound.take_in()
    scans = devices.scans
    wait_until(lambda: given_clock.advance(RETRY_SECONDS) or devices.scans >= scans + 2)  # it is looked for
    assert [record.message.partition(";")[0] for record in caplog.records] == ["the microphone is silent"]
    devices.plugged = True
    wait_until(lambda: given_clock.advance(RETRY_SECONDS) or len(devices.streams) == 2)
    while sound.voice_at(given_clock.now()) <= 0.5:
        given_clock.advance(BLOCK / SAMPLE_RATE)
        devices.hear()
        sound.take_in()
    assert [record.message for record in caplog.records][1:] == ["the microphone is back"]
    sound.close()
    assert all(stream.closed for stream in devices.streams)


def test_a_microphone_that_comes_back_with_another_rate_is_resampled_and_never_read_after_it_was_closed(
    given_clock, tmp_path
):
    now, pitch = given_clock.now(), 400
    first, second = (tone(2, rate, pitch) for rate in (SAMPLE_RATE, 44_100))
    for each in (first, second):
        each[: len(each) // 40] = 0
    cards = [Card(blocks(first, now)), Card(blocks(second, now + 6.0, 44_100), 44_100)]
    waiting = iter(cards)
    sound = SoundInput(lambda: next(waiting))
    sound.record(tmp_path / "a.wav")
    sound.take_in()
    given_clock.advance(6.0)
    wait_until(lambda: given_clock.advance(RETRY_SECONDS) or sound.take_in() or sound.voice_at(now + 7.5) > 0.5)
    assert cards[0].closed_in not in (None, threading.current_thread())
    sound.close()
    heard, rate = read_wav(tmp_path / "a.wav")
    assert rate == SAMPLE_RATE
    assert len(heard) / rate == pytest.approx(8.0, abs=0.005)
    spectrum = np.abs(np.fft.rfft(heard[6 * rate + 4800 : 8 * rate - 4800]))
    assert spectrum.argmax() / 1.8 == pytest.approx(pitch, abs=1)
    assert not heard[2 * rate + 480 : 6 * rate - 480].any()


def test_a_microphone_that_comes_back_after_the_end_is_released(given_clock):
    opened, may_open = threading.Event(), threading.Event()
    cards = [Card([]), Card([])]
    waiting = iter(cards)

    def opener():
        card = next(waiting)
        if card is cards[1]:
            opened.set()
            may_open.wait()
        return card

    sound = SoundInput(opener)
    given_clock.advance(6.0)
    sound.take_in()
    wait_until(lambda: given_clock.advance(RETRY_SECONDS) or opened.is_set())
    sound.close()
    may_open.set()
    wait_until(lambda: cards[1].closed_in)


@pytest.mark.parametrize("name", ["a.wav", "no such device"])
def test_a_sound_that_cannot_be_opened_is_one_message(name, tmp_path):
    with pytest.raises(SourceError):
        open_sound(name, tmp_path)
