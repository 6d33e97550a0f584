"""Music that is made by code."""

import numpy as np
import pytest

from engine_bridge.film.music import PEAK, PIECES, SAMPLE_RATE, piece


@pytest.mark.parametrize("name", PIECES)
def test_a_piece_has_whole_bars_in_its_key_and_its_end_goes_over_into_its_beginning(name):
    tempo, beats, chords, melody, _, pattern, drums = PIECES[name]
    steps = 2 * beats
    assert [len(bar.split()) for bar in melody.split("|")] == [steps] * len(chords.split())
    assert len(pattern) == len(drums) == steps
    sound = piece(name)
    assert len(sound) == round(len(chords.split()) * beats * 60 / tempo * SAMPLE_RATE)
    assert np.abs(sound).max() == pytest.approx(PEAK)
    assert np.abs(sound[0] - sound[-1]).max() <= np.abs(np.diff(sound, axis=0)).max()
    loudness = np.sqrt((sound.reshape(-1)[: len(sound) // 10 * 20].reshape(10, -1) ** 2).mean(axis=1))
    assert loudness.min() > 0.2 * loudness.max()
