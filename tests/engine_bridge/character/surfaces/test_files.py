import io
import zlib

import numpy as np
import pytest
from PIL import Image

from engine_bridge.character.surfaces.files import Folder

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
    "name", ["textures/skin one.png", "textures\\skin one.png", "./textures/../textures/skin one.png"]
)
def test_a_file_below_the_mesh_is_found_with_either_slash(folder, here, name):
    (here / "textures" / "skin one.png").write_bytes(b"")
    assert folder.find(name, here, "a.mtl, line 1") == (here / "textures" / "skin one.png").resolve()
    assert folder.notes == []


@pytest.mark.parametrize(
    "name",
    [
        "C:\\Users\\someone\\skin.png",
        "C:/Users/skin.png",
        "/home/someone/SKIN.PNG",
        "../../skin.png",
        "maps/Skin.png",
        "\\\\server\\skin.png",
    ],
)
def test_a_path_of_another_computer_stands_for_the_file_of_that_name_here(folder, here, name):
    (here / "skin.png").write_bytes(b"")
    assert folder.find(name, here, "a.mtl, line 1") == (here / "skin.png").resolve()
    assert folder.notes == [f"{name!r} is missing; using 'skin.png' in the mesh's folder."]


@pytest.mark.parametrize(
    "name", ["../secret.png", "../../etc/passwd", "/etc/passwd", "textures/../../secret.png", "..\\secret.png"]
)
def test_a_path_that_leaves_the_folder_is_not_read(folder, here, name):
    assert folder.image(name, here, "a.mtl, line 3") is None
    last = name.replace("\\", "/").rpartition("/")[2]
    assert folder.notes == [
        f"a.mtl, line 3: {name!r} is outside the mesh's folder and is not read. Copy {last!r} into that folder."
    ]


@pytest.mark.parametrize("name", ["a" * 5000, "a\0b"])
def test_an_invalid_file_name_is_noted(folder, here, name):
    assert folder.image(name, here, "a.mtl, line 3") is None
    assert folder.notes == [f"a.mtl, line 3: {name[:60]!r} is not a file name and is ignored."]


def test_a_link_that_leaves_the_folder_is_not_read(folder, here):
    (here / "skin.png").symlink_to("../secret.png")
    assert folder.image("skin.png", here, "a.mtl, line 3") is None
    assert folder.notes == [
        "a.mtl, line 3: 'skin.png' is outside the mesh's folder and is not read. Copy 'skin.png' into that folder."
    ]


def test_a_file_that_is_not_there_is_noted(folder, here):
    assert folder.find("textures/none.png", here, "a.mtl, line 1") is None
    assert folder.image("C:\\none.png", here, "a.mtl, line 1") is None
    assert folder.notes == ["'textures/none.png' is missing.", "'C:\\\\none.png' is missing."]


@pytest.mark.parametrize(("kind", "mime"), [("PNG", "image/png"), ("JPEG", "image/jpeg"), ("MPO", "image/jpeg")])
def test_png_and_jpeg_are_kept_byte_for_byte(folder, here, kind, mime):
    (here / "skin.of.wolf").write_bytes(encoded(kind))  # known by its content
    picture = folder.image("skin.of.wolf", here, "a.mtl, line 1")
    assert (picture.name, picture.mime, picture.content) == ("skin.of", mime, encoded(kind))
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
    assert folder.notes == ["The image 'skin' is converted to PNG."]


def png_claiming(width, height):
    def chunk(kind, data):
        return len(data).to_bytes(4, "big") + kind + data + zlib.crc32(kind + data).to_bytes(4, "big")

    size = width.to_bytes(4, "big") + height.to_bytes(4, "big")
    data = zlib.compress(bytes(1000))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", size + b"\x08\2\0\0\0") + chunk(b"IDAT", data) + chunk(b"IEND", b"")


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
    assert note.startswith("The image 'skin.png' cannot be read (")
    assert not recwarn.list
