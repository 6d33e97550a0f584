import io
import json
import os

import numpy as np
import pygltflib as gltf
import pytest
from numpy.testing import assert_array_equal
from PIL import Image

from engine_bridge.character import schema
from engine_bridge.character.character import load_character
from engine_bridge.character.document_reader import COMPRESSIONS, load_document
from engine_bridge.export.animation import Keyframes, animate
from puppetline.errors import MeshError, PuppetlineError

from ...fuzz.corpus import pack, unpack
from ...oracles import assert_is_error_of, assert_is_sound_character
from ..refusals import refused, refused_place
from .conftest import CORNERS, SIDES

KINDS = {5120: "i1", 5121: "u1", 5122: "i2", 5123: "u2", 5125: "u4", 5126: "f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


def description(**more):
    return {"asset": {"version": "2.0"}} | more


def write_gltf(folder, **more):
    path = folder / "a.gltf"
    path.write_text(json.dumps(description(**more)))
    return path


def write_glb(folder, content, binary=b""):
    path = folder / "a.glb"
    path.write_bytes(pack(content, binary))
    return path


@pytest.fixture
def tetrahedron(glb, tmp_path):
    """A minimal character with a node, a colour and a material."""
    rgba = np.full((4, 4), 128, np.uint8)
    glb.file.materials = [gltf.Material(pbrMetallicRoughness=gltf.PbrMetallicRoughness(baseColorFactor=[1, 0, 0, 1]))]
    mesh = glb.mesh(glb.primitive(CORNERS, SIDES, material=0, NORMAL=CORNERS + np.float32(1), COLOR_0=rgba))
    glb.node(mesh, scale=[1, 2, 3], rotation=[0, 0, 0, 1], name="one")
    return glb.save(tmp_path / "tetrahedron.glb")


@pytest.mark.parametrize("kind", KINDS, ids=KINDS.values())
@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("interleaved", [False, True], ids=["packed", "interleaved"])
def test_an_array_comes_out_as_it_stands_in_the_file(tmp_path, kind, width, interleaved):
    rng = np.random.default_rng(kind)
    row = np.dtype(KINDS[kind]).itemsize * WIDTHS[width]
    stride = row + (-row % 4) + 8 if interleaved else row
    raw = rng.integers(0, 256, (7, stride), dtype=np.uint8)
    if kind == 5126:
        raw[:, :row] = rng.normal(size=(7, row // 4)).astype("<f4").view(np.uint8)
    expected = raw[:, :row].copy().view("<" + KINDS[kind])
    # an offset of the view, and one of the accessor in it
    view = {"buffer": 0, "byteOffset": 8, "byteLength": 4 + raw.size} | ({"byteStride": stride} if interleaved else {})
    accessor = {"bufferView": 0, "byteOffset": 4, "componentType": kind, "count": 7, "type": width}
    content = description(bufferViews=[view], accessors=[accessor], buffers=[{"byteLength": 12 + raw.size}])
    values = load_document(write_glb(tmp_path, content, bytes(12) + raw.tobytes())).array(0)
    assert values.dtype == expected.dtype
    assert_array_equal(values, expected[:, 0] if width == "SCALAR" else expected)


def places(value, path=()):
    """Every place in nested JSON."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield (*path, key)
        yield from places(item, (*path, key))


def replaced(content, path, value):
    copy = json.loads(json.dumps(content))
    inner = copy
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    return copy


@pytest.mark.parametrize("value", [-1, 2**62, 1.5, None, "text", {}, [1]], ids=repr)
def test_any_value_in_any_place_of_the_description_is_read_or_refused(tetrahedron, tmp_path, value):
    content, binary = unpack(tetrahedron.read_bytes())
    path = tmp_path / "hostile.glb"
    still = Keyframes("still", np.float32([0, 1]), np.zeros((2, 1), np.float32), np.zeros((2, 3), np.float32))
    for place in places(content):
        path.write_bytes(pack(replaced(content, place, value), binary))
        try:
            character = load_character(path)
            assert_is_sound_character(character)
            animate(character, still, lambda _: (np.zeros((1, 4, 3), np.float32), None)).save(path)
            assert_array_equal(load_character(path).vertices, character.vertices)
        except PuppetlineError as error:
            assert_is_error_of(error, MeshError, path)


@pytest.mark.parametrize(
    "damage",
    [
        *({"buffers": [{"byteLength": 1, "uri": f"data:;base64,{digits}"}]} for digits in ("*", "A", "YWJj*", "YW=Jj")),
        *({"asset": {"version": version}} for version in ("1.0", "20", "3", "", "two")),
        {"buffers": [{"byteLength": size, "uri": "data:;base64,YWJj"} for size in (3, 4)]},
        {"accessors": [{"componentType": 5126, "count": None, "type": "SCALAR"}]},
    ],
    ids=lambda damage: str(damage)[:60],
)
def test_a_damaged_description_is_refused(tmp_path, damage):
    path = write_gltf(tmp_path, **damage)
    assert refused_place(MeshError, path, load_character, path) == ("asset.version" if "asset" in damage else "")


@pytest.mark.parametrize(
    "uri",
    [
        *("../secret.bin", "%2e%2e/secret.bin", "sub/../../secret.bin", "https://example.org/a.bin", "nowhere.bin"),
        *("", ".", "a\0b", "a%00b", "x" * 5000, "link.bin", "TMP/secret.bin"),
        pytest.param("pipe.bin", marks=pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="named pipes are Unix's")),
    ],
)  # fmt: skip
def test_a_buffer_that_is_not_a_file_beside_the_gltf_is_refused_and_not_waited_for(tmp_path, uri):
    uri = uri.replace("TMP", str(tmp_path))
    (tmp_path / "secret.bin").write_bytes(bytes(16))
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "link.bin").symlink_to(tmp_path / "secret.bin")
    if uri == "pipe.bin":
        os.mkfifo(folder / uri)
    path = write_gltf(folder, buffers=[{"byteLength": 16, "uri": uri}])
    error = refused(MeshError, load_character, path)
    assert error.where == str(path)
    assert repr(uri)[:60] in error.found


@pytest.mark.parametrize("digits", ["YWJjZA==", "YWJjZA", "YWJj\r\n  ZA==\n", "YWJjZA="])
def test_a_data_uri_may_have_line_breaks_and_lack_padding(tmp_path, digits):
    document = load_document(write_gltf(tmp_path, buffers=[{"byteLength": 4, "uri": f"data:;base64,{digits}"}]))
    assert (bytes(document.blob), document.notes) == (b"abcd", [])


def test_properties_that_are_null_are_absent_but_in_extras_and_what_is_not_known(tetrahedron, tmp_path):
    content, binary = unpack(tetrahedron.read_bytes())
    kept = {"extras": {"name": None}, "own": None, "extensions": {"OTHER": {"name": None}}}
    content["nodes"][0].update(kept)
    whole = load_document(write_glb(tmp_path, content, binary))
    content["nodes"][0].update(skin=None, children=None)
    content["meshes"][0]["primitives"][0].update(targets=None, name=None)
    content.update(animations=None, skins=None)
    document = load_document(write_glb(tmp_path, content, binary))
    assert document.gltf == whole.gltf
    assert {name: document.gltf["nodes"][0][name] for name in kept} == kept
    assert (len(document.notes), whole.notes) == (1, [])


@pytest.mark.parametrize(
    "text",
    [
        *(b"{", b"{}", b"{" * 100_000, b'{"a":' * 100_000, b'{"buffers": 3}', b"{\xff}"),
        *(
            b'{"asset": {"version": "2.0"}, "extras": {"own": [%s]}}' % own
            for own in (b"1e999", b'"\\ud800"', b"-1e999")
        ),
    ],
    ids=lambda text: str(text[:60]),
)
def test_json_that_is_not_gltf_is_refused(tmp_path, text):
    path = tmp_path / "a.gltf"
    path.write_bytes(text)
    assert refused_place(MeshError, path, load_character, path) == ""


@pytest.mark.parametrize("extension", COMPRESSIONS)
def test_a_packed_copy_of_plain_data_is_left_out(tetrahedron, tmp_path, extension):
    content, binary = unpack(tetrahedron.read_bytes())
    content["extensionsUsed"] = [extension]
    content["meshes"][0]["primitives"][0]["extensions"] = {extension: {"bufferView": 0}, "OTHER": {}}
    content["bufferViews"][0]["extensions"] = {extension: {"buffer": 0}}
    document = load_document(write_glb(tmp_path, content, binary))
    assert document.gltf["meshes"][0]["primitives"][0]["extensions"] == {"OTHER": {}}
    assert document.gltf["bufferViews"][0]["extensions"] == {}
    assert (document.gltf["extensionsUsed"], len(document.notes)) == ([], 1)


def picture_of(document):
    return document.view(document.gltf["images"][0]["bufferView"])


@pytest.mark.parametrize(
    "uri", ["none.png", "../secret.png", "%2e%2e/secret.png", "..\\secret.png", "/etc/passwd", "x" * 5000]
)
def test_white_takes_the_place_of_a_picture_that_is_missing_or_elsewhere(tmp_path, uri):
    folder = tmp_path / "inner"
    folder.mkdir()
    (tmp_path / "secret.png").write_bytes(b"\x89PNG")
    document = load_document(write_gltf(folder, images=[{"uri": uri}]))
    picture = Image.open(io.BytesIO(picture_of(document)))
    assert (picture.size, picture.getpixel((0, 0))) == ((1, 1), (255, 255, 255))
    assert document.gltf["images"][0].items() >= {"mimeType": "image/png", "bufferView": 0}.items()
    (note,) = document.notes
    assert repr(uri[:60]) in note


def test_a_file_that_many_buffers_and_pictures_name_is_taken_in_once(tmp_path):
    (tmp_path / "a.bin").write_bytes(b"123456789")
    (tmp_path / "a.png").write_bytes(b"\x89PNG 8 bytes")
    buffers = [{"byteLength": size, "uri": uri} for size in (9, 3) for uri in ("a.bin", "./a.bin", "%61.bin")]
    views = [{"buffer": number, "byteOffset": 1, "byteLength": 2} for number in range(len(buffers))]
    images = [{"uri": "a.png"}, {"uri": "./a.png"}]  # begin at a multiple of four
    document = load_document(write_gltf(tmp_path, buffers=buffers, bufferViews=views, images=images))
    assert bytes(document.blob) == b"123456789\0\0\0\x89PNG 8 bytes"
    assert [view["byteOffset"] for view in document.gltf["bufferViews"]] == [1] * 6 + [12]
    assert [image["bufferView"] for image in document.gltf["images"]] == [6, 6]


@pytest.mark.parametrize(
    ("start", "kind"),
    [
        *((b"\x89PNG\r\n", "png"), (b"\xff\xd8\xff\xe0", "jpeg"), (b"RIFF\x04\0\0\0WEBP", "webp")),
        (b"\xabKTX 20\xbb", "ktx2"),
    ],
)
def test_a_picture_beside_the_file_is_taken_in_and_called_what_it_is(tmp_path, start, kind):
    (tmp_path / "my skin.png").write_bytes(start + b" and the rest of it")
    document = load_document(write_gltf(tmp_path, images=[{"uri": "my%20skin.png"}]))
    assert picture_of(document) == start + b" and the rest of it"
    assert document.gltf["images"][0]["mimeType"] == f"image/{kind}"


def test_whole_numbers_may_have_a_fraction_of_zero(tetrahedron, tmp_path):
    content, binary = unpack(tetrahedron.read_bytes())
    text = json.dumps(content).replace('"count": 4', '"count": 4.0').replace('"buffer": 0', '"buffer": 0.00')
    assert "4.0" in text
    document = load_document(write_glb(tmp_path, json.loads(text), binary))
    assert schema.compact(document.gltf) == schema.compact(load_document(tetrahedron).gltf)
