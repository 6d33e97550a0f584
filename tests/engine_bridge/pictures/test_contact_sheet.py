import numpy as np
import pytest
from PIL import Image

from engine_bridge.pictures.contact_sheet import PAPER, write_contact_sheet


@pytest.mark.parametrize(("title", "height"), [("A take", 52 + 3 * (20 + 30) + 10), ("", 10 + 3 * (20 + 30) + 10)])
def test_a_sheet_has_room_for_all_tiles_labels_and_the_title(tmp_path, title, height):
    tiles = [np.full((20, 40, 3), 10 * i, np.uint8) for i in range(5)]
    write_contact_sheet(tiles, [f"{i} s" for i in range(5)], 2, tmp_path / "sheet.png", title)
    sheet = np.array(Image.open(tmp_path / "sheet.png"))
    assert sheet.shape == (height, 10 + 2 * (40 + 10), 3)
    top = height - 3 * 50 - 10
    for i, tile in enumerate(tiles):
        y, x = top + i // 2 * 50, 10 + i % 2 * 50
        np.testing.assert_array_equal(sheet[y : y + 20, x : x + 40], tile)
        assert (sheet[y + 20 : y + 50, x : x + 40] < 128).any()  # the label's ink
    assert (sheet[top + 100 :, 60:] == PAPER).all()  # no sixth tile
