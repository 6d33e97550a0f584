"""Titles and backgrounds: where they are, and what cannot be shown."""

import numpy as np
import pytest
from PIL import Image

from engine_bridge.film import overlays
from engine_bridge.film.scene import BackgroundTable, TitleTable

SIZE = (320, 180)


@pytest.mark.parametrize(("place", "rows"), [("top", (10, 50)), ("middle", (70, 110)), ("bottom", (130, 170))])
def test_a_title_is_centred_at_its_place(tmp_path, place, rows):
    picture = overlays.title(TitleTable(text="HOH", place=place), SIZE, "title", tmp_path)
    shown = picture[..., 3] > 0
    inside, columns = (np.flatnonzero(shown.any(axis=axis)) for axis in (1, 0))
    assert rows[0] <= inside.min() < inside.max() < rows[1]
    assert columns.min() + columns.max() == pytest.approx(SIZE[0], abs=4)
    assert (picture[picture[..., 3] == 255][:, :3] == 255).all(axis=1).any()


def test_a_long_title_is_broken_at_spaces_and_stays_in_the_picture(tmp_path):
    def title(text):
        return overlays.title(TitleTable(text=text), SIZE, "title", tmp_path)

    long = title("The knight and the great dinosaur that wanted to dance\nof the Lake")
    columns = np.flatnonzero((long[..., 3] > 0).any(axis=0))
    assert 0.04 * SIZE[0] < columns.min() < columns.max() < 0.96 * SIZE[0]
    np.testing.assert_array_equal(long, title("The knight and the great dinosaur that\nwanted to dance\nof the Lake"))


def test_a_title_fades_in_and_out():
    times = [0.9, 1.0, 1.25, 2.0, 2.75, 3.0, 3.1]
    assert [overlays.fading(time, 1, 2, 0.5) for time in times] == pytest.approx([0, 0, 0.5, 1, 0.5, 0, 0])
    assert overlays.fading(0, 0, 3, 0) == 1


def test_a_background_runs_from_its_first_colour_to_its_second(tmp_path):
    pixels = overlays.background(BackgroundTable(colors=("black", "#ff8000")), SIZE, tmp_path / "scene.toml")
    assert pixels[[0, -1], 0].tolist() == [[0, 0, 0, 255], [255, 128, 0, 255]]
    assert (np.diff(pixels[:, 0, 0].astype(int)) >= 0).all()


def test_a_picture_covers_the_frame_without_being_stretched(tmp_path):
    rows = np.repeat(np.arange(100, dtype=np.uint8), 300).reshape(100, 100, 3)
    Image.fromarray(rows).save(tmp_path / "a.png")
    pixels = overlays.background(BackgroundTable(picture="a.png"), SIZE, tmp_path / "scene.toml")
    assert pixels.shape == (180, 320, 4)
    left_out = 100 * (1 - 9 / 16) / 2
    assert pixels[[0, -1], 0, 0] == pytest.approx([left_out, 100 - left_out], abs=2)
