"""Pictures of takes for the page."""

import numpy as np
from PIL import Image

from capture.sound import WavWriter
from engine_bridge.studio.long_work.take_pictures import WAVE_SIZE, draw_wave


def test_a_wave_form_is_as_high_as_the_sound_is_loud(tmp_path):
    tone = np.sin(np.arange(48_000) / 3).astype(np.float32)
    with WavWriter(tmp_path / "take.wav") as file:
        file.write(np.concatenate([0 * tone, tone / 2, tone / 4]))
    draw_wave(tmp_path / "take.wav", tmp_path / "take.wave.png")
    alpha = np.asarray(Image.open(tmp_path / "take.wave.png"))[..., 3]
    assert alpha.shape == WAVE_SIZE[::-1]
    heights = (alpha == 255).sum(axis=0)
    quiet, loud, half = (np.median(part) for part in np.split(heights, 3))
    assert (quiet, loud, half) == (2, WAVE_SIZE[1], WAVE_SIZE[1] / 2)
