"""Sound beside a take: on the computer's clock whatever the sound card's does, and readable after a crash."""

import itertools
import sys
import threading
import time
import types
import wave

import numpy as np
import pytest

from capture import sound_input
from capture.sound import SAMPLE_RATE, Block, ClockedSound, WavWriter, read_wav
from capture.sound_input import SoundInput, open_sound
from puppetline.errors import OutputError, SourceError

BLOCK = 960


def claps(seconds, drift, jitter=0.0, lost=(), every=10.0):
    """Yield blocks of a card whose clock is too fast by `drift`, with a clap of one sample every 10 s."""
    rng = np.random.default_rng(5)
    rate = SAMPLE_RATE * (1 + drift)
    marks = np.round(np.arange(every, seconds, every) * rate).astype(int)
    for first in range(0, int(seconds * rate), BLOCK):
        samples = np.zeros(BLOCK, np.float32)
        inside = marks[(marks >= first) & (marks < first + BLOCK)] - first
        samples[inside] = 1.0
        now = first / rate
        if not any(begin <= now < end for begin, end in lost):
            yield Block(100.0 + now + jitter * rng.uniform(-1, 1), samples)


class Card:
    """A sound card that has delivered some blocks."""

    def __init__(self, blocks, rate=SAMPLE_RATE):
        self.waiting, self.rate, self.closed_in = blocks, rate, None

    def blocks(self):
        assert self.closed_in is None
        yield from self.waiting

    def close(self):
        self.closed_in = threading.current_thread()


@pytest.mark.slow
@pytest.mark.parametrize(("drift", "jitter"), [(1e-4, 0.004), (-3e-4, 0.0)])
def test_claps_of_ten_minutes_are_within_20_ms_although_the_clock_drifts(drift, jitter, tmp_path):
    source = Card(claps(600, drift, jitter))
    sound = SoundInput(lambda: source)
    sound.record(tmp_path / "a.wav")
    sound.take_in()
    start = sound.start
    sound.stop()
    heard, rate = read_wav(tmp_path / "a.wav")
    assert rate == SAMPLE_RATE
    places = np.flatnonzero(heard > 0.3) / SAMPLE_RATE
    places = places[np.insert(np.diff(places) > 1, 0, True)]
    expected = np.arange(10.0, 600, 10.0)
    assert len(places) == len(expected)
    late = places + (start - 100.0) - expected
    assert np.abs(late).max() < 0.020
    assert np.abs(late[5:] - late[5:].mean()).max() < 0.004


def test_without_drift_samples_stay_as_they_are():
    sound, tone = ClockedSound(), np.sin(np.arange(48_000) / 7).astype(np.float32)
    made = [sound.add(Block(5 + k / SAMPLE_RATE, tone[k : k + BLOCK])) for k in range(0, 48_000, BLOCK)]
    made = np.concatenate(made)
    np.testing.assert_allclose(made, tone[: len(made)], atol=1e-6)
    assert len(made) >= 48_000 - 2


def test_lost_blocks_become_silence_of_their_length():
    sound = ClockedSound()
    heard = np.concatenate([sound.add(block) for block in claps(60, 0.0, lost=[(12.0, 14.5)])])
    places = np.flatnonzero(heard > 0.3) / SAMPLE_RATE
    np.testing.assert_allclose(places, np.arange(10.0, 60, 10.0), atol=0.002)


def test_a_file_is_readable_before_it_is_closed(tmp_path):
    writer = WavWriter(tmp_path / "a.wav")
    tone = np.sin(np.arange(480) / 9).astype(np.float32)
    for _ in range(510):
        writer.write(tone)
    with wave.open(str(tmp_path / "a.wav")) as file:
        assert (file.getframerate(), file.getnchannels(), file.getsampwidth()) == (SAMPLE_RATE, 1, 2)
        assert file.getnframes() == 510 * 480
        samples = np.frombuffer(file.readframes(480), "<i2")
    np.testing.assert_array_equal(samples, np.rint(tone * 32767))
    writer.close()
    writer.close()
    with wave.open(str(tmp_path / "a.wav")) as file:
        assert file.getnframes() == 510 * 480
    assert writer.seconds == pytest.approx(5.1)


def test_a_folder_that_does_not_exist_is_one_message(tmp_path):
    with pytest.raises(OutputError, match="a file that cannot be written"):
        WavWriter(tmp_path / "none" / "a.wav")


def test_an_empty_block_changes_nothing():
    sound = ClockedSound()
    assert len(sound.add(Block(3.0, np.zeros(0, np.float32)))) == 0
    assert sound.start is None
    assert sum(len(sound.add(block)) for block in itertools.islice(claps(1, 0.0), 3)) >= 3 * BLOCK - 2


def test_a_late_frame_has_the_voice_of_its_own_time_and_mouths_close_without_sound():
    tone = 0.3 * np.sin(np.arange(SAMPLE_RATE) / 38).astype(np.float32)
    quiet = np.zeros(SAMPLE_RATE // 2, np.float32)
    sound = SoundInput(lambda: Card([Block(7.0, quiet), Block(7.5, tone), Block(8.5, quiet)]))
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
        self.streams.append(types.SimpleNamespace(callback=callback, closed=False, start=lambda: None))
        self.streams[-1].close = lambda stream=self.streams[-1]: setattr(stream, "closed", True)
        return self.streams[-1]

    def hear(self, gain=0.3):
        """Deliver a block to the newest stream."""
        now = types.SimpleNamespace(currentTime=1.0, inputBufferAdcTime=1.0, input_overflow=False)
        self.streams[-1].callback(gain * np.sin(np.arange(BLOCK) / 38)[:, None].astype(np.float32), BLOCK, now, now)


def test_a_microphone_that_vanishes_is_reported_once_and_heard_again_when_it_is_back(
    monkeypatch, clock, caplog, tmp_path
):
    caplog.set_level("INFO")
    devices = Microphones()
    monkeypatch.setitem(sys.modules, "sounddevice", devices)
    monkeypatch.setattr(sound_input, "RETRY_SECONDS", 0.001)
    sound = open_sound("default", tmp_path)
    devices.hear(0)
    sound.take_in()
    devices.plugged = False
    for _ in range(5):
        clock.advance(1.6)
        sound.take_in()
    scans = devices.scans
    while devices.scans < scans + 2:  # it is looked for
        time.sleep(0.001)
    assert [record.message.partition(";")[0] for record in caplog.records] == ["the microphone is silent"]
    devices.plugged = True
    while sound.voice_at(time.monotonic() + 0.1) <= 0.5:
        if len(devices.streams) == 2:
            devices.hear()
        sound.take_in()
    assert [record.message for record in caplog.records][1:] == ["the microphone is back"]
    sound.close()
    assert all(stream.closed for stream in devices.streams)


def test_a_microphone_that_comes_back_with_another_rate_is_resampled_and_never_read_after_it_was_closed(
    monkeypatch, clock, tmp_path
):
    monkeypatch.setattr(sound_input, "RETRY_SECONDS", 0.001)
    now = time.monotonic()

    def tone(rate, begin):
        """Two seconds of 400 Hz after a moment of silence, in blocks of 20 ms."""
        every = rate // 50
        wave = 0.3 * np.sin(2 * np.pi * 400 * np.arange(2 * rate) / rate).astype(np.float32)
        wave[: rate // 20] = 0
        return [Block(begin + k / rate, wave[k : k + every]) for k in range(0, len(wave), every)]

    cards = [Card(tone(SAMPLE_RATE, now)), Card([], 44_100)]
    waiting = iter(cards)
    sound = SoundInput(lambda: next(waiting))
    sound.record(tmp_path / "a.wav")
    sound.take_in()
    cards[0].waiting = []
    clock.advance(6.0)
    sound.take_in()
    cards[1].waiting = tone(44_100, now + 6.0)
    while sound.voice_at(now + 7.5) <= 0.5:
        sound.take_in()
    assert cards[0].closed_in not in (None, threading.current_thread())
    cards[1].waiting = []
    sound.close()
    assert cards[1].closed_in is threading.current_thread()
    heard, rate = read_wav(tmp_path / "a.wav")
    assert rate == SAMPLE_RATE
    assert len(heard) / rate == pytest.approx(8.0, abs=0.005)
    spectrum = np.abs(np.fft.rfft(heard[6 * rate + 4800 : 8 * rate - 4800]))
    assert spectrum.argmax() / (1.8) == pytest.approx(400, abs=1)
    assert not heard[2 * rate + 480 : 6 * rate - 480].any()


def test_a_microphone_that_comes_back_after_the_end_is_released(monkeypatch, clock):
    opened, may_open = threading.Event(), threading.Event()
    cards = [Card([]), Card([])]
    waiting = iter(cards)

    def opener():
        card = next(waiting)
        if card is cards[1]:
            opened.set()
            may_open.wait()
        return card

    monkeypatch.setattr(sound_input, "RETRY_SECONDS", 0.001)
    sound = SoundInput(opener)
    clock.advance(6.0)
    sound.take_in()
    opened.wait()
    sound.close()
    may_open.set()
    while cards[1].closed_in is None:
        time.sleep(0.001)


@pytest.mark.parametrize(("name", "found"), [("a.wav", "a file that cannot be read"), ("no such device", "sound")])
def test_a_sound_that_cannot_be_opened_is_one_message(name, found, tmp_path):
    with pytest.raises(SourceError, match=found):
        open_sound(name, tmp_path)
