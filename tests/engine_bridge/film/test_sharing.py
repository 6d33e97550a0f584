"""The poster and the .gif of a film."""

import numpy as np
import pytest
from PIL import Image

from engine_bridge.film.sharing import GIF_SECONDS, check_sharing, share_video
from engine_bridge.film.video import VideoWriter
from puppetline.errors import OutputError

from ..refusals import refused

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


def test_a_very_wide_film_of_one_frame_has_a_poster_and_a_gif(tmp_path):
    video = tmp_path / "film.mp4"
    with VideoWriter(video, (7680, 16), FPS) as writer:
        writer.add(np.zeros((16, 7680, 4), np.uint8))
    share_video(video)
    with Image.open(tmp_path / "film.gif") as gif:
        assert gif.size == (480, 2)


@pytest.mark.parametrize(
    ("existing", "picture", "replace", "found"),
    [
        ((), "film.jpg", False, "an input file"),
        (("film.jpg",), "film.jpg", True, "an input file"),
        (("film.jpg",), "other.jpg", False, "an existing file"),
        (("film.gif",), "other.jpg", False, "an existing file"),
        (("film.jpg", "film.gif"), "other.jpg", True, None),
        ((), "other.jpg", False, None),
    ],
)
def test_no_picture_of_the_user_is_replaced(tmp_path, existing, picture, replace, found):
    scene = tmp_path / "scene.toml"
    background = f'[film]\nseconds = 1.0\n[background]\npicture = "{picture}"\n'
    scene.write_text(background + '[[character]]\nname = "dog"\npuppet = "dog.toml"\n')
    for name in existing:
        (tmp_path / name).touch()
    if found is None:
        check_sharing(tmp_path / "film.mp4", scene, replace)
    else:
        assert refused(OutputError, check_sharing, tmp_path / "film.mp4", scene, replace).found == found
