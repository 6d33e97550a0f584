"""The channel voice: opens and closes in time, ignores the room, and does not depend on blocks."""

import numpy as np
import pytest

from capture.voice import STEP_SECONDS, Voice, voice_of

RATE = 48_000


def room(seconds, loudness=0.002):
    return loudness * np.random.default_rng(1).normal(size=round(seconds * RATE))


def rumble(seconds, loudness=0.002):
    """Pink noise that swells three times per second, like a fan."""
    spectrum = np.fft.rfft(room(seconds, 1.0))
    pink = np.fft.irfft(spectrum / np.sqrt(np.maximum(np.arange(len(spectrum)), 1)), round(seconds * RATE))
    return loudness * pink / pink.std() * (1 + 0.3 * np.sin(6 * np.pi * np.arange(len(pink)) / RATE))


def tone(seconds, begin, end):
    t = np.arange(round(seconds * RATE)) / RATE
    harmonics = sum(np.sin(2 * np.pi * 180 * k * t) / k for k in range(1, 20))
    return 0.3 * harmonics / np.abs(harmonics).max() * ((t >= begin) & (t < end))


def heard(samples, rate=RATE):
    """Return the values, and the times at which the steps before them end."""
    values = Voice(rate).add(samples)
    return values, (np.arange(len(values)) + 1) * STEP_SECONDS


@pytest.mark.parametrize("noise", [room, rumble])
@pytest.mark.parametrize("loudness", [0.0, 0.0005, 0.002, 0.01])
def test_a_voice_opens_within_60_ms_and_closes_within_150_whatever_the_gain(noise, loudness):
    sound = noise(4, loudness) + tone(4, 1.0, 2.0) + tone(4, 2.5, 3.0)
    values, times = heard(sound)
    for begin, end in ((1.0, 2.0), (2.5, 3.0)):
        assert times[(times >= begin) & (values > 0.5)][0] <= begin + 0.06
        assert values[(times > begin + 0.1) & (times < end)].min() > 0.7
        assert times[(times >= end) & (values < 0.1)][0] <= end + 0.15
    assert values[times < 1.0].max(initial=0) <= 0.02
    if loudness == 0.002:
        np.testing.assert_allclose(values, heard(sound / 10)[0], atol=0.05)


@pytest.mark.parametrize("loudness", [0.0002, 0.002, 0.02])
def test_the_room_stays_closed(loudness):
    hum = loudness * 5 * np.sin(2 * np.pi * 50 * np.arange(20 * RATE) / RATE)
    offset = np.full(5 * RATE, loudness * 5)
    for noise in (room(20, loudness), room(20, loudness) + hum, rumble(20, loudness), 0 * offset, offset):
        assert heard(noise)[0].max() <= 0.02


def test_a_louder_room_is_the_new_floor_after_some_seconds():
    values, times = heard(np.concatenate([room(3, 0.0005), room(20, 0.005)]))
    assert values[times > 18].max() <= 0.02


def test_blocks_do_not_matter():
    sound, voice = room(2) + tone(2, 0.5, 1), Voice(RATE)
    parts = np.concatenate([voice.add(part) for part in np.split(sound, [1, 700, 5000, 41_111])])
    np.testing.assert_array_equal(parts, heard(sound)[0])


def test_values_are_at_the_times_of_the_sound():
    values = voice_of(room(3, 0.001) + tone(3, 1, 2), RATE, np.array([-1.0, 0.5, 1.5, 2.5, 9.0]))
    assert values == pytest.approx([0, 0, 1, 0, 0], abs=0.1)
    assert voice_of(np.zeros(0), RATE, np.zeros(3)).tolist() == [0, 0, 0]
