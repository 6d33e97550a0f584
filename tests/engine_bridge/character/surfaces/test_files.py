import io
import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from engine_bridge.character.surfaces.files import Folder
from engine_bridge.character.surfaces.surface import ImageFile

PIXELS = np.random.default_rng(7).integers(0, 256, (6, 5, 4), dtype=np.uint8)


def encoded(kind, mode="RGB"):
    into = io.BytesIO()
    Image.fromarray(PIXELS).convert(mode).save(into, kind)
    return into.getvalue()


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "here" / "textures").mkdir(parents=True)
    (tmp_path / "secret.png").write_bytes(encoded("PNG"))
    return Folder(tmp_path / "here" / "mesh.obj", [])


@pytest.fixture
def here(folder, tmp_path):
    return tmp_path / "here"


@pytest.mark.parametrize(
    ("name", "found", "notes"),
    [
        *((name, "textures/skin one.png", 0) for name in ("textures/skin one.png", "textures\\skin one.png",
                                                         "./textures/../textures/skin one.png")),
        *((name, "skin.png", 1) for name in ("C:\\Users\\someone\\skin.png", "C:/Users/skin.png", "/home/a/SKIN.PNG",
                                            "../../skin.png", "maps/Skin.png", "\\\\server\\skin.png")),
        *((name, None, 1) for name in ("textures/none.png", "C:\\none.png")),
    ],
)  # fmt: skip
def test_a_file_is_found_with_either_slash_and_with_a_note_by_the_path_of_another_computer(
    folder, here, name, found, notes
):
    (here / "textures" / "skin one.png").touch()
    (here / "skin.png").touch()
    assert folder.find(name, here, "a.mtl, line 1") == (found and (here / found).resolve())
    assert len(folder.notes) == notes


@pytest.mark.parametrize(
    "name",
    [
        *(
            "../secret.png",
            "../../etc/passwd",
            "/etc/passwd",
            "textures/../../secret.png",
            "..\\secret.png",
            "link.png",
        ),
        *("a" * 5000, "a\0b"),
    ],
)
def test_a_path_that_leaves_the_folder_or_is_none_is_not_read_and_noted_with_its_place(folder, here, name):
    (here / "link.png").symlink_to("../secret.png")
    assert folder.image(name, here, "a.mtl, line 3") is None
    (note,) = folder.notes
    assert note.startswith(f"a.mtl, line 3: {name[:60]!r} ")


@pytest.mark.parametrize(("kind", "mime"), [("PNG", "image/png"), ("JPEG", "image/jpeg"), ("MPO", "image/jpeg")])
def test_png_and_jpeg_are_kept_byte_for_byte(folder, here, kind, mime):
    (here / "skin.of.wolf").write_bytes(encoded(kind))  # known by its content
    assert folder.image("skin.of.wolf", here, "a.mtl, line 1") == ImageFile("skin.of", mime, encoded(kind))
    assert folder.notes == []


@pytest.mark.parametrize(
    ("kind", "mode"),
    [("BMP", "RGB"), ("TGA", "RGBA"), ("TIFF", "RGBA"), ("GIF", "P"), ("WEBP", "RGB"), ("DDS", "RGBA"), ("PPM", "L")],
)
def test_other_pictures_become_png_of_the_same_pixels(folder, here, kind, mode):
    (here / "skin").write_bytes(encoded(kind, mode))
    picture = folder.image("skin", here, "a.mtl, line 1")
    shown, stated = (Image.open(io.BytesIO(content)) for content in (picture.content, encoded(kind, mode)))
    assert (picture.mime, shown.format) == ("image/png", "PNG")
    np.testing.assert_array_equal(shown.convert("RGBA"), stated.convert("RGBA"))
    assert ("A" in shown.getbands()) == (mode == "RGBA")
    assert len(folder.notes) == 1


def png_claiming(width, height):
    """Return a picture of another size than its data."""
    made = bytearray(encoded("PNG"))
    made[16:24] = struct.pack(">II", width, height)
    made[29:33] = struct.pack(">I", zlib.crc32(made[12:29]))
    return bytes(made)


@pytest.mark.parametrize(
    "content",
    [encoded("PNG")[:-40], encoded("JPEG")[:200], b"", b"GIF89a", b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n",
     png_claiming(8000, 8000), png_claiming(100_000, 100_000), b"<svg/>"],
)  # fmt: skip
def test_a_picture_that_is_damaged_or_too_large_is_left_out_with_a_note(folder, here, content, recwarn):
    (here / "skin.png").write_bytes(content)
    assert folder.image("skin.png", here, "a.mtl, line 1") is None
    assert folder.image("skin.png", here, "a.mtl, line 2") is None
    (note,) = folder.notes
    assert "'skin.png'" in note
    assert not recwarn.list
