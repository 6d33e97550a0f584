"""The poster and the .gif of a film."""

import numpy as np
import pytest
from PIL import Image

from engine_bridge.film.sharing import GIF_SECONDS, share_video
from engine_bridge.film.video import VideoWriter

av = pytest.importorskip("av")

WIDTH, HEIGHT, FPS = 640, 360, 30


@pytest.mark.parametrize("seconds", [0.1, 3.0, 17.0])
def test_the_poster_is_a_third_into_the_film_and_the_gif_has_its_beginning(tmp_path, seconds):
    """The film's picture becomes brighter from its begin to its end."""
    video, count = tmp_path / "film.mp4", round(seconds * FPS)
    levels = np.linspace(20, 220, count).round().astype(np.uint8)
    with VideoWriter(video, (WIDTH, HEIGHT), FPS) as writer:
        for level in levels:
            writer.add(np.full((HEIGHT, WIDTH, 4), level, np.uint8))
    share_video(video)
    with Image.open(tmp_path / "film.jpg") as poster:
        assert poster.size == (WIDTH, HEIGHT)
        assert np.mean(np.asarray(poster)) == pytest.approx(levels[int(np.ceil(count / 3))], abs=4)
    with av.open(str(tmp_path / "film.gif")) as gif:
        shown = [frame.to_ndarray(format="gray").mean() for frame in gif.decode(video=0)]
        assert (gif.streams.video[0].width, gif.streams.video[0].height) == (480, 270)
    expected = levels[: round(GIF_SECONDS * FPS)][::2]
    assert len(shown) == pytest.approx(len(expected), abs=1)
    # the colours are those of eight frames
    np.testing.assert_allclose(shown, expected[: len(shown)], atol=np.ptp(expected) / 8 + 4)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["film.gif", "film.jpg", "film.mp4"]
