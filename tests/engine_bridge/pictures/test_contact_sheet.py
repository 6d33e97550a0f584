import numpy as np
import pytest
from PIL import Image

from engine_bridge.pictures.contact_sheet import PAPER, write_contact_sheet
from puppetline.errors import OutputError


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


def test_a_sheet_replaces_the_old_one_and_leaves_nothing_else(tmp_path):
    path = tmp_path / "sheet.png"
    path.write_text("old")
    write_contact_sheet([np.zeros((8, 8, 3), np.uint8)], ["0 s"], 1, path)
    assert Image.open(path).format == "PNG"
    assert [p.name for p in tmp_path.iterdir()] == ["sheet.png"]


def test_a_sheet_that_cannot_be_written_says_where(tmp_path):
    for path in (tmp_path / "nowhere" / "sheet.png", tmp_path):
        with pytest.raises(OutputError, match="cannot be written") as error:
            write_contact_sheet([np.zeros((8, 8, 3), np.uint8)], ["0 s"], 1, path)
        assert error.value.where == str(path)
