from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from capture.sensors.picture_jpeg import MAX_JPEG_BYTES, MAX_WIDTH, jpeg, shaded
from capture.trackers.picture import Lens, Picture


def decoded(content):
    image = Image.open(BytesIO(content))
    assert image.format == "JPEG"
    return np.asarray(image).astype(int)


def test_colours_keep_their_places_and_depth_without_colours_is_shaded():
    depth = np.full((480, 640), 2.0, np.float32)
    depth[:, 320:] = 0
    color = np.where(depth[..., None] > 0, [200, 40, 30], [20, 60, 180]).astype(np.uint8)
    lens = Lens(640, 480, 525.0)
    for picture, expected in (
        (Picture(0.0, lens, color, None), color),
        (Picture(0.0, lens, None, depth), shaded(depth)),
    ):
        off = np.abs(decoded(jpeg(picture)) - expected.astype(int))
        assert np.delete(off, np.s_[300:340], axis=1).max() <= 4


@pytest.mark.parametrize(("width", "height"), [(1920, 1080), (1080, 1920), (640, 480)])
def test_the_worst_picture_is_bounded(width, height):
    noise = np.random.default_rng(0).integers(0, 256, (height, width, 3)).astype(np.uint8)
    content = jpeg(Picture(0.0, Lens(width, height, 500.0), noise, None))
    assert len(content) <= MAX_JPEG_BYTES
    shape = decoded(content).shape
    assert max(shape) <= MAX_WIDTH
    assert shape[1] / shape[0] == pytest.approx(width / height, rel=0.02)


def test_nearer_depth_is_lighter_and_unknown_depth_is_violet():
    depth = np.array([[1, 2, 3, 4]], np.float32).repeat(9, axis=0).repeat(9, axis=1)
    grey = shaded(depth)[4, 4::9].astype(int)
    assert (np.diff(grey[:, 0]) < 0).all()
    assert (grey == grey[:, :1]).all()
    np.testing.assert_array_equal(shaded(depth * 0), np.broadcast_to((52, 26, 66), (9, 36, 3)))
