"""Pieces of music that are made by code, from notes; they are in the public domain (CC0) and can be repeated."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from engine_bridge.film.scene import MusicLoop

SAMPLE_RATE = 48_000
"""Samples per second of a piece, as of a film's sound."""

PEAK = 0.8

NAMES = {"C": 0, "D": 2, "E": 4, "F": 5, "G": 7, "A": 9, "B": 11}
"""Half tones of notes above C."""


class Piece(NamedTuple):
    """A piece of music.

    Attributes
    ----------
    tempo : float
        Beats per minute.
    beats : int
        Per bar.
    chords : str
        One per bar: notes that are joined by plus signs.
    melody : str
        Notes that last half a beat each; ``-`` goes on with the one before, ``.`` is silence, ``|`` separates bars.
    instrument : str
        Of the melody, in `INSTRUMENTS`.
    pattern : str
        When the chord is played in a bar, one letter per half beat: ``b`` its lowest note, ``c`` the others, ``p`` all
        of them, for the whole bar.
    drums : str
        When drums are played in a bar: ``k`` a low one, ``h`` a high one, ``t`` a tick.
    """

    tempo: float
    beats: int
    chords: str
    melody: str
    instrument: str
    pattern: str
    drums: str


PIECES: dict[MusicLoop, Piece] = {
    "cheerful": Piece(
        132, 4, "C3+E4+G4 A2+E4+A4 F2+F4+A4 G2+D4+G4 C3+E4+G4 A2+E4+A4 F2+F4+A4 G2+D4+B4",
        "E5 . G5 . C6 - B5 A5 | G5 . E5 . C5 - D5 E5 | F5 . A5 . C6 - A5 F5 | G5 - - D5 E5 . D5 . |"
        "E5 . G5 . C6 - B5 A5 | G5 . E5 . A5 - G5 E5 | F5 . E5 . D5 - E5 F5 | G5 - B5 - C6 - - .",
        "marimba", "b.c.b.c.", "k.h.k.hh",
    ),
    "calm": Piece(
        72, 4, "F2+C4+E4+A4 G2+B3+D4+G4 E2+B3+D4+G4 A2+C4+E4+G4 D2+A3+C4+F4 G2+B3+D4+F4 C3+E4+G4+B4 C3+E4+G4+A4",
        "A5 - - - E5 - C6 - | B5 - - - G5 - - - | G5 - - - B5 - D6 - | C6 - - - - - - . |"
        "A5 - - - F5 - A5 - | G5 - F5 - D5 - - - | E5 - - - G5 - B5 - | A5 - - - - - - .",
        "bell", "p.......", "........",
    ),
    "waltz": Piece(
        150, 3, "C3+E4+G4 G2+D4+F4 G2+D4+F4 C3+E4+G4 A2+E4+A4 D3+F4+A4 G2+D4+F4 C3+E4+G4",
        "E5 - - - F5 G5 | F5 - - - D5 - | B4 - - - C5 D5 | E5 - G5 - C6 - |"
        "A5 - - - B5 C6 | A5 - F5 - D5 - | G5 - F5 - D5 - | C5 - - - - .",
        "musicbox", "b.c.c.", "k.t.t.",
    ),
    "adventure": Piece(
        120, 4, "D3+D4+F4+A4 D3+D4+F4+A4 Bb2+D4+F4 C3+E4+G4 D3+D4+F4+A4 F2+C4+F4+A4 Bb2+D4+F4 A2+E4+A4",
        "D5 - - A5 - - G5 F5 | E5 - F5 - D5 - - - | F5 - - D5 F5 - Bb5 - | G5 - - E5 G5 - C6 - |"
        "D5 - - A5 - - G5 F5 | A5 - C6 - F5 - - - | D6 - C6 - Bb5 - A5 - | A5 - - - E5 - - .",
        "horn", "bccbccbc", "k..hk.h.",
    ),
    "suspense": Piece(
        84, 4, "A1+A2+C4 A1+A2+B3 F1+A2+C4 E1+B2+D4 A1+A2+C4 A1+A2+E4 F1+A2+D4 E1+B2+E4",
        "A4 - . . . . C5 - | B4 - . . . . . . | A4 - . . . . F5 - | E5 - - - . . . . |"
        "A4 - . . . . E5 - | D5 - C5 - . . . . | A4 - . . B4 - C5 - | B4 - - - . . . .",
        "bell", "p.......", "t.t.t.k.",
    ),
}  # fmt: skip

INSTRUMENTS: dict[str, tuple[tuple[tuple[float, float], ...], float, float]] = {
    "marimba": (((1, 1.0), (4, 0.25), (10, 0.06)), 0.004, 0.35),
    "bell": (((1, 1.0), (2, 0.3), (2.76, 0.18), (5.4, 0.08)), 0.01, 1.6),
    "musicbox": (((1, 1.0), (3, 0.35), (6.1, 0.12)), 0.003, 0.9),
    "horn": (((1, 1.0), (2, 0.6), (3, 0.4), (4, 0.2), (5, 0.1)), 0.05, 1.2),
    "strings": (((0.997, 0.6), (1.003, 0.6), (2, 0.3), (3, 0.12), (4, 0.06)), 0.25, 4.0),
    "pluck": (((1, 1.0), (2, 0.45), (3, 0.2), (4, 0.1)), 0.003, 0.3),
}
"""Multiples of a note's frequency with their loudness, the attack and the time constant of the decay, in seconds."""


def piece(name: MusicLoop) -> NDArray[np.float32]:
    """Return the samples (n, 2) of a piece, whose end goes over into its beginning."""
    tempo, beats, chords, melody, instrument, pattern, drums = PIECES[name]
    half = 30 / tempo
    bars = chords.split()
    count = round(len(bars) * beats * 2 * half * SAMPLE_RATE)
    left, right = np.zeros((2, count))
    for start, length, note in _notes(melody):
        tone = 0.9 * _tone(instrument, note, length * half)
        _add(left, start * half, tone)
        _add(right, start * half + 0.008, tone)
    for bar, chord in enumerate(bars):
        notes = [_frequency(each) for each in chord.split("+")]
        for step, (letter, drum) in enumerate(zip(pattern, drums, strict=True)):
            at = (bar * beats * 2 + step) * half
            played = {"b": notes[:1], "c": notes[1:], "p": notes}.get(letter, [])
            for number, note in enumerate(played):
                tone = _tone("strings", note, beats * 2 * half) if letter == "p" else _tone("pluck", note, half)
                _add(left, at, (0.4 if number % 2 else 0.28) * tone)
                _add(right, at, (0.28 if number % 2 else 0.4) * tone)
            if drum in "kht":
                for channel in (left, right):
                    _add(channel, at, _drum(drum))
    both = np.column_stack([left, right])
    return (PEAK * both / np.abs(both).max()).astype(np.float32)


def _notes(melody: str) -> list[tuple[int, int, float]]:
    """Return the beginnings and lengths in half beats, and the frequencies of the notes of a melody."""
    notes: list[tuple[int, int, float]] = []
    for step, word in enumerate(melody.replace("|", " ").split()):
        if word == "-":
            start, length, note = notes[-1]
            notes[-1] = start, length + 1, note
        elif word != ".":
            notes.append((step, 1, _frequency(word)))
    return notes


def _frequency(name: str) -> float:
    """Return the frequency of a note such as A4 or Bb4, in hertz."""
    return float(440 * 2 ** ((NAMES[name[0]] - 9 - name.count("b")) / 12 + int(name[-1]) - 4))


def _tone(instrument: str, frequency: float, length: float) -> NDArray[np.float64]:
    partials, attack, decay = INSTRUMENTS[instrument]
    t = np.arange(round((length + min(decay, 1.0)) * SAMPLE_RATE)) / SAMPLE_RATE
    tone = np.zeros_like(t)
    for multiple, loudness in partials:
        tone += loudness * np.exp(-t * multiple**0.5 / decay) * np.sin(2 * np.pi * frequency * multiple * t)
    release = np.clip((t[-1] - t) / min(decay, 1.0), 0, 1)
    shaped: NDArray[np.float64] = tone * np.clip(t / attack, 0, 1) * release
    return shaped / sum(loudness for _, loudness in partials)


def _drum(kind: str) -> NDArray[np.float64]:
    t = np.arange(round(0.25 * SAMPLE_RATE)) / SAMPLE_RATE
    noise = np.diff(np.random.default_rng(0).normal(size=len(t) + 1))
    if kind == "k":
        return 0.7 * np.exp(-t / 0.07) * np.sin(2 * np.pi * (55 * t + 8 * (1 - np.exp(-t / 0.02)) / 2))
    return (0.12 if kind == "h" else 0.07) * np.exp(-t / (0.05 if kind == "h" else 0.012)) * noise


def _add(channel: NDArray[np.float64], at: float, tone: NDArray[np.float64]) -> None:
    """Add a tone from a time on; what leaves the end is added at the beginning."""
    places = (round(at * SAMPLE_RATE) + np.arange(len(tone))) % len(channel)
    channel[places] += tone
