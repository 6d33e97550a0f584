"""A short film of two example characters, with a sound that is made by code and stands for speech."""

import numpy as np
from numpy.typing import NDArray

SAMPLE_RATE = 48_000

BARKS = (6.52, 6.97, 7.42)
"""Times at which the dog barks, in seconds."""

SYLLABLES = (
    (1.0, 0.16, 165, "a"), (1.2, 0.14, 180, "i"), (1.38, 0.3, 150, "o"),
    (9.3, 0.14, 190, "e"), (9.48, 0.16, 205, "a"), (9.7, 0.36, 170, "o"),
)  # fmt: skip
"""Begin and length in seconds, pitch in hertz, and vowel of each syllable of the human."""

FORMANTS = {"a": (730, 1090, 2440), "e": (530, 1840, 2480), "i": (270, 2290, 3010), "o": (570, 840, 2410)}
"""Resonances of vowels in hertz (Peterson and Barney 1952, men)."""

SCENE = """\
# Two characters, four shots: puppetline film film.toml -o film.mp4

[film]
seconds = 11.5
fade_in = 0.5
fade_out = 0.5

[background]
set = "meadow"

[music]
loop = "cheerful"
gain = -20

[[character]]
name = "human"
puppet = "human.toml"
position = [-0.75, 0.0]     # metres to the right and to the front
turn = 55                   # degrees to its left
height = 1.6

[[character]]
name = "dog"
puppet = "dog.toml"
position = [1.0, 0.1]
turn = -60
height = 0.95

[[take]]
character = "human"
file = "train.log"

[[take]]
character = "dog"
file = "bark.log"

[[sound]]
file = "film.wav"
fade_out = 0.5

[[camera]]                  # a wide shot of everybody
azimuth = 5

[[camera]]                  # the dog gives its paw
at = 4.0
shot = "follow"
azimuth = -15

[[camera]]                  # it barks
at = 6.2
shot = "close"
show = ["dog"]
azimuth = -40
fade = 0.4

[[camera]]
at = 8.6
azimuth = -20

[[title]]
text = "The new dog"
at = 0.4
seconds = 2.6
place = "top"
font = "round"

[[bubble]]
character = "human"
text = "Sit!"
at = 2.9
seconds = 1.0

[[bubble]]
character = "dog"
text = "Woof!"
at = 6.5
seconds = 1.4

[[bubble]]
character = "human"
text = "Good dog!"
at = 9.0
seconds = 1.3

[[title]]
text = "The end"
at = 10.3
seconds = 1.2
place = "top"
font = "round"
"""


def sound(seconds: float = 11.5) -> NDArray[np.float32]:
    """Return the film's sound (n,) within [-1, 1]: syllables of a voice, and barks."""
    samples = np.zeros(round(seconds * SAMPLE_RATE))
    for begin, length, pitch, vowel in SYLLABLES:
        _add(samples, begin, 0.5 * _vowel(length, pitch, FORMANTS[vowel]))
    for begin in BARKS:
        _add(samples, begin, 0.6 * _bark(0.22))
    return samples.astype(np.float32)


def _vowel(length: float, pitch: float, formants: tuple[int, ...]) -> NDArray[np.float64]:
    """Return a vowel: harmonics of a falling pitch, louder near the formants."""
    t = np.arange(round(length * SAMPLE_RATE)) / SAMPLE_RATE
    phase = 2 * np.pi * pitch * (t - 0.15 * t**2 / length)
    tone = np.zeros_like(t)
    for harmonic in range(1, int(4000 // pitch)):
        near = sum(
            1 / (1 + ((harmonic * pitch - formant) / 90) ** 2) / rank for rank, formant in enumerate(formants, 1)
        )
        tone += near / harmonic**0.5 * np.sin(harmonic * phase)
    return _enveloped(tone, t, length)


def _bark(length: float) -> NDArray[np.float64]:
    """Return a bark: rough noise around a pitch that falls."""
    t = np.arange(round(length * SAMPLE_RATE)) / SAMPLE_RATE
    noise = np.random.default_rng(3).normal(size=len(t)).cumsum()
    noise -= np.convolve(noise, np.full(200, 1 / 200), "same")
    phase = 2 * np.pi * (420 * t - 700 * t**2)
    return _enveloped(np.sign(np.sin(phase)) * 0.5 + noise / np.abs(noise).max(), t, length)


def _enveloped(tone: NDArray[np.float64], t: NDArray[np.float64], length: float) -> NDArray[np.float64]:
    """Return a tone that begins and ends softly, with a peak of 1."""
    shaped = tone * np.clip(t / 0.02, 0, 1) * np.clip((length - t) / 0.06, 0, 1)
    return shaped / np.abs(shaped).max()


def _add(samples: NDArray[np.float64], begin: float, sound_: NDArray[np.float64]) -> None:
    first = round(begin * SAMPLE_RATE)
    samples[first : first + len(sound_)] += sound_[: len(samples) - first]
