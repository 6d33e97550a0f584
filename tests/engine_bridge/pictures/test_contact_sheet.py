import numpy as np
import pytest
from PIL import Image

from engine_bridge.pictures.contact_sheet import PAPER, write_contact_sheet


@pytest.mark.parametrize(("title", "top"), [("A take", 52), ("", 10)])
def test_a_sheet_has_room_for_all_tiles_labels_and_the_title(tmp_path, title, top):
    tiles = [np.full((20, 40, 3), 10 * i, np.uint8) for i in range(5)]
    write_contact_sheet(tiles, [f"{i} s" for i in range(5)], 2, tmp_path / "sheet.png", title)
    sheet = np.array(Image.open(tmp_path / "sheet.png"))
    cells = sheet[top:-10, 10:].reshape(3, 20 + 30, 2, 40 + 10, 3).swapaxes(1, 2).reshape(6, 50, 50, 3)
    for tile, cell in zip(tiles, cells, strict=False):
        np.testing.assert_array_equal(cell[:20, :40], tile)
        assert (cell[20:, :40] < 128).any()  # the label's ink
    assert (cells[5] == PAPER).all()  # no sixth tile
