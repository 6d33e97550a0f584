import base64
import io
import json
import os
import struct

import numpy as np
import pygltflib as gltf
import pytest
from PIL import Image

from engine_bridge.character import schema
from engine_bridge.character.character import load_character
from engine_bridge.character.document_reader import COMPRESSIONS, load_document
from engine_bridge.export.animation import Keyframes, animate
from puppetline.errors import MeshError, PuppetlineError

from ...oracles import assert_is_error_of, assert_is_sound_character

KINDS = {5120: "i1", 5121: "u1", 5122: "i2", 5123: "u2", 5125: "u4", 5126: "f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
HEADER = 12

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
SIDES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], np.uint16)


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


def pack(content, binary=b""):
    """A .glb from its JSON and its bytes."""
    text = content if isinstance(content, bytes) else json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    binary += bytes(-len(binary) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(binary), b"BIN\0") + binary if binary else b""
    return struct.pack("<4sII", b"glTF", 2, HEADER + len(chunks)) + chunks


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
    # a leading buffer of odd length, an offset of the view, and one of the accessor in it
    content = description(
        buffers=[{"byteLength": 5}, {"byteLength": 12 + raw.size}],
        bufferViews=[
            {"buffer": 0, "byteLength": 5},
            {
                "buffer": 1,
                "byteOffset": 8,
                "byteLength": 4 + raw.size,
                **({"byteStride": stride} if interleaved else {}),
            },
        ],
        accessors=[{"bufferView": 1, "byteOffset": 4, "componentType": kind, "count": 7, "type": width}],
    )
    content["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(b"12345").decode()
    content["buffers"][1]["uri"] = "some%20bytes.bin"
    (tmp_path / "some bytes.bin").write_bytes(bytes(12) + raw.tobytes())
    values = load_document(write_gltf(tmp_path, **content)).array(0)
    assert values.dtype == expected.dtype
    np.testing.assert_array_equal(values, expected[:, 0] if width == "SCALAR" else expected)


def refused(path):
    """The error for a character file, which must be a MeshError."""
    with pytest.raises(MeshError) as error:
        load_character(path)
    return error.value


def test_a_file_cut_off_anywhere_is_refused(tetrahedron, tmp_path):
    whole = tetrahedron.read_bytes()
    path = tmp_path / "cut.glb"
    for length in [*range(40), *range(40, len(whole), 11), len(whole) - 1]:
        path.write_bytes(whole[:length])
        assert str(path) in refused(path).where


def test_a_file_cut_off_anywhere_whose_announced_length_fits_is_refused(tetrahedron, tmp_path):
    whole = tetrahedron.read_bytes()
    path = tmp_path / "cut.glb"
    for length in [*range(HEADER, 40), *range(40, len(whole) - 4, 11), len(whole) - 4]:
        path.write_bytes(whole[:8] + struct.pack("<I", length) + whole[12:length])
        assert refused(path).where == str(path)


def test_flipped_bytes_are_read_as_something_else_or_refused(tetrahedron, tmp_path):
    whole = tetrahedron.read_bytes()
    path = tmp_path / "flipped.glb"
    rng = np.random.default_rng(5)
    outcomes = {True: 0, False: 0}
    for place in rng.choice(len(whole), 250, replace=False):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(damaged)
        try:
            assert_is_sound_character(load_character(path))
            outcomes[True] += 1
        except PuppetlineError as error:
            assert_is_error_of(error, MeshError, path)
            outcomes[False] += 1
    assert min(outcomes.values()) > 30


def unpack(path):
    """A .glb's JSON and its bytes."""
    whole = path.read_bytes()
    size = int.from_bytes(whole[12:16], "little")
    return json.loads(whole[20 : 20 + size]), whole[28 + size :]


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


@pytest.mark.parametrize(
    "value",
    [
        -1,
        2**62,
        1.5,
        None,
        "text",
        {},
        *[pytest.param(v, marks=pytest.mark.slow) for v in (7, 1e300, True, [], [1], [[0]])],
    ],
    ids=repr,
)
def test_any_value_in_any_place_of_the_description_is_read_or_refused(tetrahedron, tmp_path, value):
    content, binary = unpack(tetrahedron)
    path = tmp_path / "hostile.glb"
    still = Keyframes("still", np.float32([0, 1]), np.zeros((2, 1), np.float32), np.zeros((2, 3), np.float32))
    tried = 0
    for place in places(content):
        path.write_bytes(pack(replaced(content, place, value), binary))
        try:
            character = load_character(path)
            assert_is_sound_character(character)
            animate(character, still, lambda _: (np.zeros((1, 4, 3), np.float32), None)).save(path)
            np.testing.assert_array_equal(load_character(path).vertices, character.vertices)
        except PuppetlineError as error:
            assert_is_error_of(error, MeshError, path)
        except AssertionError:
            raise
        except BaseException as error:
            pytest.fail(f"{place} = {value!r}: {type(error).__name__}: {error}")
        tried += 1
    assert tried > 80


@pytest.mark.parametrize("count", [10**6, 10**12, 2**63])
@pytest.mark.parametrize("indexed", [True, False])
def test_an_array_larger_than_the_file_is_refused_before_memory_is_asked_for(tmp_path, glb, count, indexed):
    glb.node(glb.mesh(glb.primitive(CORNERS, SIDES if indexed else None)))
    for accessor in glb.file.accessors:
        accessor.count = count
    error = refused(glb.save(tmp_path / "large.glb"))
    assert error.found == f"{count:,} values that lie outside the file's data"
    assert error.where.startswith(f"{tmp_path / 'large.glb'}, accessors[")


def test_a_buffer_larger_than_the_file_is_refused_before_memory_is_asked_for(tmp_path):
    path = write_glb(tmp_path, description(buffers=[{"byteLength": 10**15}]), b"1234")
    assert refused(path).found == "4 bytes of data of 1,000,000,000,000,000 announced"


@pytest.mark.parametrize(
    "uri",
    [
        "../secret.bin",
        "%2e%2e/secret.bin",
        "sub/../../secret.bin",
        "https://example.org/a.bin",
        "nowhere.bin",
        "",
        ".",
        "a\0b",
        "a%00b",
        "x" * 5000,
        "link.bin",
        "TMP/secret.bin",
    ],
)
def test_a_buffer_that_is_not_beside_the_file_is_refused(tmp_path, uri):
    uri = uri.replace("TMP", str(tmp_path))
    (tmp_path / "secret.bin").write_bytes(bytes(16))
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "link.bin").symlink_to(tmp_path / "secret.bin")
    path = write_gltf(folder, buffers=[{"byteLength": 16, "uri": uri}])
    error = refused(path)
    assert error.where == str(path)
    assert error.found == f"a reference to {uri!r}, which is not a readable file in its folder"


@pytest.mark.parametrize("digits", ["*", "A", "YWJj*", "YW=Jj"])
def test_a_data_uri_that_is_no_base64_is_refused(tmp_path, digits):
    path = write_gltf(tmp_path, buffers=[{"byteLength": 1, "uri": f"data:;base64,{digits}"}])
    assert "a data URI that is not base64" in refused(path).found


@pytest.mark.parametrize("digits", ["YWJjZA==", "YWJjZA", "YWJj\r\n  ZA==\n", "YWJjZA="])
def test_a_data_uri_may_have_line_breaks_and_lack_padding(tmp_path, digits):
    document = load_document(write_gltf(tmp_path, buffers=[{"byteLength": 4, "uri": f"data:;base64,{digits}"}]))
    assert (bytes(document.blob), document.notes) == (b"abcd", [])


@pytest.mark.parametrize("version", ["2", "2.0", "2.1"])
def test_any_gltf_of_version_2_is_read(tmp_path, version):
    assert load_document(write_gltf(tmp_path, asset={"version": version})).gltf["asset"]["version"] == version


@pytest.mark.parametrize("version", ["1.0", "20", "3", "", "two"])
def test_any_other_gltf_is_refused(tmp_path, version):
    error = refused(write_gltf(tmp_path, asset={"version": version}))
    assert (error.where, error.found) == (f"{tmp_path / 'a.gltf'}, asset.version", f"glTF {version}")


def test_properties_that_are_null_are_absent_but_in_extras_and_what_is_not_known(tetrahedron, tmp_path):
    content, binary = unpack(tetrahedron)
    kept = {"extras": {"name": None}, "own": None, "extensions": {"OTHER": {"name": None}}}
    content["nodes"][0].update(kept)
    whole = load_document(write_glb(tmp_path, content, binary))
    content["nodes"][0].update(skin=None, children=None)
    content["meshes"][0]["primitives"][0].update(targets=None, name=None)
    content.update(animations=None, skins=None)
    document = load_document(write_glb(tmp_path, content, binary))
    assert document.gltf == whole.gltf
    assert {name: document.gltf["nodes"][0][name] for name in kept} == kept
    assert document.notes == [
        "Properties that are null are read as absent: animations, children, name, skin, skins, targets."
    ]
    assert whole.notes == []


def test_a_required_value_must_not_be_null(tetrahedron, tmp_path):
    content, binary = unpack(tetrahedron)
    content["accessors"][0]["count"] = None
    error = refused(write_glb(tmp_path, content, binary))
    assert error.found == "a description that is not glTF (accessors[0].count: Field required)"


@pytest.mark.parametrize("text", [b"{", b"{}", b"{" * 100_000, b'{"a":' * 100_000, b'{"buffers": 3}', b"{\xff}"])
def test_json_that_is_not_gltf_is_refused(tmp_path, text):
    path = tmp_path / "a.gltf"
    path.write_bytes(text)
    assert refused(path).where == str(path)
    path = write_glb(tmp_path, text)
    assert refused(path).where == str(path)


def test_glb_of_another_version_is_refused(tetrahedron):
    whole = bytearray(tetrahedron.read_bytes())
    whole[4] = 1
    tetrahedron.write_bytes(whole)
    assert refused(tetrahedron).found.startswith("glTF version 1,")


@pytest.mark.parametrize("extension", COMPRESSIONS)
def test_a_packed_copy_of_plain_data_is_left_out(tetrahedron, tmp_path, extension):
    content, binary = unpack(tetrahedron)
    content["extensionsUsed"] = [extension]
    content["meshes"][0]["primitives"][0]["extensions"] = {extension: {"bufferView": 0}, "OTHER": {}}
    content["bufferViews"][0]["extensions"] = {extension: {"buffer": 0}}
    document = load_document(write_glb(tmp_path, content, binary))
    assert document.gltf["meshes"][0]["primitives"][0]["extensions"] == {"OTHER": {}}
    assert document.gltf["bufferViews"][0]["extensions"] == {}
    assert document.gltf["extensionsUsed"] == []
    assert document.notes == [f"The copy of the mesh that is compressed with {extension} is omitted."]


def test_an_unknown_extension_is_kept_unchanged(tetrahedron, tmp_path):
    content, binary = unpack(tetrahedron)
    content["nodes"][0].update(weights=[], extras={"a": None, "b": [1, {"c": 2}]}, own=3)
    content["cameras"] = [{"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}, "extras": 1}]
    content["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
    content["materials"][0]["extensions"] = {"KHR_materials_sheen": {"sheenColorFactor": [1, 0.5, 0]}}
    load_document(write_glb(tmp_path, content, binary)).save(tmp_path / "b.glb")
    again, same = unpack(tmp_path / "b.glb")
    assert same == binary
    assert again == content


def test_a_picture_beside_the_file_is_taken_in(tmp_path):
    picture = b"\x89PNG\r\n\x1a\n and the rest of it"
    (tmp_path / "my skin.png").write_bytes(picture)
    document = load_document(write_gltf(tmp_path, images=[{"uri": "my%20skin.png"}]))
    assert picture_of(document) == picture
    (image,) = document.gltf["images"]
    assert image == {"mimeType": "image/png", "name": "my skin", "bufferView": 0}


def picture_of(document):
    return document.view(document.gltf["images"][0]["bufferView"])


def test_white_takes_the_place_of_a_picture_that_is_missing(tmp_path):
    document = load_document(write_gltf(tmp_path, images=[{"uri": "none.png"}]))
    assert document.notes == ["The image 'none.png' is missing; it is shown in white."]
    picture = Image.open(io.BytesIO(picture_of(document)))
    assert (picture.size, picture.getpixel((0, 0))) == ((1, 1), (255, 255, 255))


@pytest.mark.parametrize("uri", ["../secret.png", "%2e%2e/secret.png", "..\\secret.png", "/etc/passwd", "x" * 5000])
def test_white_takes_the_place_of_a_picture_elsewhere(tmp_path, uri):
    folder = tmp_path / "inner"
    folder.mkdir()
    (tmp_path / "secret.png").write_bytes(b"\x89PNG")
    document = load_document(write_gltf(folder, images=[{"uri": uri}]))
    picture = Image.open(io.BytesIO(picture_of(document)))
    assert (picture.size, picture.getpixel((0, 0))) == ((1, 1), (255, 255, 255))
    assert document.gltf["images"] == [{"mimeType": "image/png", "bufferView": 0}]
    assert document.notes == [f"The image {uri[:60]!r} is not a file in the folder of the glTF; it is shown in white."]


def test_a_file_that_many_buffers_and_pictures_name_is_taken_in_once(tmp_path):
    (tmp_path / "a.bin").write_bytes(b"12345678")
    (tmp_path / "a.png").write_bytes(b"\x89PNG 8 bytes")
    buffers = [{"byteLength": size, "uri": uri} for size in (8, 3) for uri in ("a.bin", "./a.bin", "%61.bin")]
    views = [{"buffer": number, "byteOffset": 1, "byteLength": 2} for number in range(len(buffers))]
    images = [{"uri": "a.png"}, {"uri": "./a.png"}]
    document = load_document(write_gltf(tmp_path, buffers=buffers, bufferViews=views, images=images))
    assert bytes(document.blob) == b"12345678\x89PNG 8 bytes"
    assert [view["byteOffset"] for view in document.gltf["bufferViews"]] == [1] * 6 + [8]
    assert [image["bufferView"] for image in document.gltf["images"]] == [6, 6]


def test_each_buffer_of_a_shared_file_has_to_have_its_bytes(tmp_path):
    (tmp_path / "a.bin").write_bytes(b"12345678")
    buffers = [{"byteLength": size, "uri": "a.bin"} for size in (8, 9)]
    assert refused(write_gltf(tmp_path, buffers=buffers)).found == "8 bytes of data of 9 announced"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with names are Unix's")
def test_a_pipe_beside_the_file_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.bin")
    path = write_gltf(tmp_path, buffers=[{"uri": "pipe.bin", "byteLength": 1}])
    assert "which is not a readable file in its folder" in refused(path).found
    document = load_document(write_gltf(tmp_path, images=[{"uri": "pipe.bin"}]))
    assert document.notes == ["The image 'pipe.bin' is not a file in the folder of the glTF; it is shown in white."]


@pytest.mark.parametrize("value", [b"1e999", b'"\\ud800"', b"-1e999"])
def test_a_number_that_json_does_not_have_is_refused_in_any_place(tmp_path, value):
    path = tmp_path / "a.gltf"
    path.write_bytes(b'{"asset": {"version": "2.0"}, "extras": {"own": [%s]}}' % value)
    assert "a description that is not glTF" in refused(path).found


def test_of_many_faults_the_first_is_named(tmp_path):
    error = refused(write_gltf(tmp_path, nodes=[{}, *[1] * 100_000]))
    assert error.found == "a description that is not glTF (nodes[1]: Input should be a valid dictionary)"


@pytest.mark.parametrize(
    ("start", "kind"),
    [
        (b"\x89PNG\r\n", "image/png"),
        (b"\xff\xd8\xff\xe0", "image/jpeg"),
        (b"RIFF\x04\0\0\0WEBP", "image/webp"),
        (b"\xabKTX 20\xbb", "image/ktx2"),
    ],
)
def test_a_picture_is_called_what_it_is(tmp_path, start, kind):
    (tmp_path / "skin").write_bytes(start)
    document = load_document(write_gltf(tmp_path, images=[{"uri": "skin"}]))
    assert document.gltf["images"][0]["mimeType"] == kind


def test_whole_numbers_may_have_a_fraction_of_zero(tetrahedron, tmp_path):
    content, binary = unpack(tetrahedron)
    text = json.dumps(content).replace('"count": 4', '"count": 4.0').replace('"buffer": 0', '"buffer": 0.00')
    assert "4.0" in text
    document = load_document(write_glb(tmp_path, text.encode(), binary))
    assert schema.compact(document.gltf) == schema.compact(load_document(tetrahedron).gltf)


def test_positions_that_are_nowhere_but_packed_are_refused_with_the_command_that_unpacks_them(tetrahedron, tmp_path):
    content, binary = unpack(tetrahedron)
    content["extensionsUsed"] = ["KHR_draco_mesh_compression"]
    primitive = content["meshes"][0]["primitives"][0]
    primitive["extensions"] = {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}}
    del content["accessors"][primitive["attributes"]["POSITION"]]["bufferView"]
    assert "npx @gltf-transform/cli copy" in refused(write_glb(tmp_path, content, binary)).fix
