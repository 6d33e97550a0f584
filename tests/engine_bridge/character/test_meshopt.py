import sys

import numpy as np
import pytest

from engine_bridge.character import meshopt_codec as codec
from engine_bridge.character.document import ARRAY_BUFFER, MESHOPT, Document
from engine_bridge.character.document_reader import load_document
from engine_bridge.character.meshopt import compress
from engine_bridge.character.schema import empty
from engine_bridge.export.convert import convert
from engine_bridge.performance.settings import Settings
from puppetline.errors import MeshError, OutputError

pytest.importorskip("meshoptimizer")

DIRECTIONS = np.random.default_rng(1).normal(size=(500, 3))
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)


def description(encoded, count):
    return {"mode": encoded.mode, "count": count, "byteStride": encoded.stride, "filter": encoded.filter or "NONE"}


def as_bytes(values):
    return np.ascontiguousarray(values).view(np.uint8).ravel()


def test_rows_are_decoded_to_the_same_bytes():
    values = as_bytes(np.random.default_rng(2).integers(0, 9, (300, 4)).astype(np.int16))
    encoded = codec.rows(values, 8)
    assert codec.decode(encoded.content, description(encoded, 300)) == values.tobytes()
    assert encoded.content[0] == 0xA0  # version 0, the only one of EXT_meshopt_compression


def test_floats_on_a_grid_are_decoded_to_the_same_bytes_from_fewer():
    values = as_bytes((np.random.default_rng(2).integers(-900, 900, (300, 3)) / 64).astype(np.float32))
    encoded = codec.exponential(values, 12)
    assert codec.decode(encoded.content, description(encoded, 300)) == values.tobytes()
    assert len(encoded.content) < 0.7 * len(codec.rows(values, 12).content)


@pytest.mark.parametrize("value", [np.nan, np.inf, -0.0, 1e-45, 1 / 3])
def test_floats_that_the_filter_does_not_hold_are_left_to_others(value):
    values = np.full((4, 1), 2.0**20, np.float32)
    values[1] = value
    assert codec.exponential(as_bytes(values), 4) is None


def test_unit_vectors_are_a_fraction_of_a_degree_off_and_stored_exactly():
    rounded = codec.octahedral_rounded(DIRECTIONS)
    shown = rounded / np.linalg.norm(rounded.astype(float), axis=1, keepdims=True)
    angles = np.degrees(np.arccos(np.clip((shown * DIRECTIONS).sum(axis=1), -1, 1)))
    assert angles.max() < 0.3
    padded = as_bytes(np.pad(rounded, ((0, 0), (0, 1))))
    encoded = codec.octahedral(padded)
    assert codec.decode(encoded.content, description(encoded, 500)) == padded.tobytes()


def test_the_sign_of_a_tangent_stays():
    tangents = np.column_stack([DIRECTIONS, np.where(np.arange(500) % 2, 1.0, -1.0)])
    np.testing.assert_array_equal(codec.octahedral_rounded(tangents)[:, 3], np.where(np.arange(500) % 2, 32767, -32767))


@pytest.mark.parametrize("size", [2, 4])
def test_indices_keep_their_order_and_triangles_their_direction(size):
    corners = np.random.default_rng(4).permuted(np.tile(np.arange(90), (200, 1)), axis=1)[:, :3]
    content = as_bytes(corners.astype(f"<u{size}"))
    sequence = codec.indices(content, size)
    assert codec.decode(sequence.content, description(sequence, 600)) == content.tobytes()
    packed = codec.triangles(content, size)
    shown = np.frombuffer(codec.decode(packed.content, description(packed, 600)), f"<u{size}").reshape(-1, 3)
    turned = [np.roll(corners, turn, axis=1) for turn in range(3)]
    assert (np.array([(shown == each).all(axis=1) for each in turned]).any(axis=0)).all()


@pytest.fixture
def packed(take, blob_puppet, tmp_path):
    """A file with floats, and the same compressed."""
    paths = tmp_path / "plain.glb", tmp_path / "packed.glb"
    for path, meshopt in zip(paths, (False, True), strict=True):
        convert(take, blob_puppet, path, Settings(meshopt=meshopt))
    return paths


def test_a_compressed_file_is_read_as_the_other_one(packed):
    plain, same = (load_document(path) for path in packed)
    indices = plain.gltf["meshes"][0]["primitives"][0]["indices"]
    for number in range(len(plain.gltf["accessors"])):
        if number != indices:
            np.testing.assert_array_equal(same.array(number), plain.array(number))
    assert {**same.gltf, "bufferViews": 0, "buffers": 0} == {**plain.gltf, "bufferViews": 0, "buffers": 0}
    assert len(same.blob) <= len(plain.blob) + 4


def test_a_compressed_file_requires_the_extension_and_has_no_uncompressed_copy(packed, raw):
    file = raw(packed[1]).file
    assert file.extensionsRequired == file.extensionsUsed == [MESHOPT]
    binary, fallback = file.buffers
    assert fallback.uri is None
    assert fallback.extensions == {MESHOPT: {"fallback": True}}
    for view in file.bufferViews:
        if MESHOPT in view.extensions:
            about = view.extensions[MESHOPT]
            assert (view.buffer, about["buffer"]) == (1, 0)
            assert about["count"] * about["byteStride"] == view.byteLength
            assert about["byteOffset"] + about["byteLength"] <= binary.byteLength
            assert view.byteOffset + view.byteLength <= fallback.byteLength


def test_unknown_bytes_and_images_stay_as_they_are():
    document = Document(empty())
    content = np.random.default_rng(0).bytes(4000)
    unknown, image = document.add_view(bytes(4000)), document.add_view(content)
    document.gltf["images"].append({"bufferView": image, "mimeType": "image/png"})
    document.add(np.zeros((5000, 3), np.float32), ARRAY_BUFFER)
    compress(document)
    assert document.view(unknown) == bytes(4000)
    assert document.view(image) == content
    assert MESHOPT in document.gltf["bufferViews"][2]["extensions"]


def test_a_missing_package_is_named_before_any_work(take, blob_puppet, tmp_path, monkeypatch):
    monkeypatch.setattr(codec, "is_installed", lambda: False)
    with pytest.raises(OutputError, match=r"pip install 'puppetline\[compact\]'"):
        convert(take, blob_puppet, tmp_path / "a.glb", Settings(meshopt=True))
    assert not (tmp_path / "a.glb").exists()


def test_is_installed_asks_for_the_package(monkeypatch):
    assert codec.is_installed()
    monkeypatch.setattr(sys, "path", [])
    monkeypatch.setattr(sys, "meta_path", [])
    monkeypatch.delitem(sys.modules, "meshoptimizer", raising=False)
    assert not codec.is_installed()


@pytest.mark.parametrize(
    "change",
    [
        {"count": 10**12},
        {"count": -1},
        {"count": "many"},
        {"byteStride": 7},
        {"byteStride": 0},
        {"mode": "OTHER"},
        {"filter": "OTHER"},
        {"filter": "QUATERNION"},
        {"filter": "OCTAHEDRAL"},
        {"buffer": 9},
        {"buffer": None},
        {"byteLength": 3},
        {"byteOffset": 10**9},
        {"byteOffset": -8},
    ],
)
def test_damaged_compression_is_refused(packed, change):
    document = Document(*_parts(packed[1]))
    view = next(view for view in document.gltf["bufferViews"] if view.get("byteStride") or "target" in view)
    view["extensions"][MESHOPT].update(change)
    document.unpacked_size = 10**7
    path = packed[1].with_name("damaged.glb")
    document.save(path)
    with pytest.raises(MeshError, match=r"complete glTF 2\.0 file"):
        load_document(path)


def _parts(path):
    """The description and the bytes of a .glb, as they are."""
    from engine_bridge.character.gltf_file import parse_description, split_glb

    text, binary = split_glb(path, path.read_bytes())
    return parse_description(path, text)[0], binary
