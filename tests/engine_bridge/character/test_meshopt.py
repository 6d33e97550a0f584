import numpy as np
import pytest

from engine_bridge.character import meshopt
from engine_bridge.character.document import MESHOPT, Document
from engine_bridge.character.document_reader import load_document
from engine_bridge.character.schema import empty
from puppetline.errors import MeshError
from tests.fuzz.corpus import pack

from ..refusals import refused

encoder = pytest.importorskip("meshoptimizer")

ROWS = np.random.default_rng(2).integers(-900, 900, (300, 4)).astype(np.int16)
CORNERS = np.random.default_rng(4).permuted(np.tile(np.arange(90), (200, 1)), axis=1)[:, :3]


def encoded_rows(values):
    return encoder.encode_vertex_buffer(values.view(np.uint8).ravel(), len(values), values[0].nbytes)


@pytest.fixture
def packed(tmp_path):
    """A function that writes a file with compressed rows, whose description is changed."""

    def write(**change):
        document, content = Document(empty(), name="packed"), encoded_rows(ROWS)
        view = document.gltf["bufferViews"][document.add_view(content)]
        about = {"buffer": 0, "byteLength": len(content), "byteStride": 8, "mode": "ATTRIBUTES", "count": len(ROWS)}
        view["buffer"], view["byteLength"], view["extensions"] = 1, ROWS.nbytes, {MESHOPT: about | change}
        document.gltf["accessors"].append({"bufferView": 0, "componentType": 5122, "count": len(ROWS), "type": "VEC4"})
        document.gltf["extensionsUsed"] = document.gltf["extensionsRequired"] = [MESHOPT]
        fallback = {"byteLength": ROWS.nbytes, "extensions": {MESHOPT: {"fallback": True}}}
        document.gltf["buffers"] = [{"byteLength": len(content)}, fallback]
        (tmp_path / "packed.glb").write_bytes(pack(document.gltf, bytes(document.blob)))
        return tmp_path / "packed.glb"

    return write


def test_rows_are_decoded_to_the_same_bytes(packed):
    document = load_document(packed())
    np.testing.assert_array_equal(document.array(0), ROWS)
    assert not document.gltf["extensionsUsed"]


@pytest.mark.parametrize("size", [2, 4])
def test_indices_keep_their_order_and_triangles_their_direction(size):
    about = {"count": CORNERS.size, "byteStride": size}
    corners = CORNERS.astype(np.uint32).ravel()
    sequence = meshopt.decode(encoder.encode_index_sequence(corners), about | {"mode": "INDICES"})
    assert sequence == corners.astype(f"<u{size}").tobytes()
    shown = meshopt.decode(encoder.encode_index_buffer(corners), about | {"mode": "TRIANGLES"})
    triangles = np.frombuffer(shown, f"<u{size}").reshape(-1, 3)
    turned = [np.roll(CORNERS, turn, axis=1) for turn in range(3)]
    assert (np.array([(triangles == each).all(axis=1) for each in turned]).any(axis=0)).all()


@pytest.mark.parametrize(
    ("name", "stored", "expected"),
    [
        ("OCTAHEDRAL", np.int8([0, 127, 127, 5]), np.int8([0, 127, 0, 5])),
        ("QUATERNION", np.int16([0, 0, 0, 32767]), np.int16([0, 0, 0, 32767])),
        ("EXPONENTIAL", np.int32([(-2 << 24) + 6]), np.float32([1.5])),
    ],
)
def test_filters_are_those_of_the_extension(name, stored, expected):
    """Values by hand: a point on the octahedron's corner, no rotation with w the largest, and 6 · 2⁻²."""
    about = {"count": 16, "byteStride": stored.nbytes, "mode": "ATTRIBUTES", "filter": name}
    assert meshopt.decode(encoded_rows(np.tile(stored, (16, 1))), about) == 16 * expected.tobytes()


@pytest.mark.parametrize(
    "change",
    [
        *({"count": count} for count in (10**12, -1, "many")),
        *(
            {"byteStride": 7},
            {"byteStride": 0},
            {"mode": "OTHER"},
            {"filter": "OTHER"},
            {"buffer": 9},
            {"buffer": None},
        ),
        *({"byteLength": 3}, {"byteOffset": 10**9}, {"byteOffset": -8}),
        {"filter": "QUATERNION", "byteStride": 4, "count": 600},
        {"filter": "OCTAHEDRAL", "byteStride": 16, "count": 150},
    ],
)
def test_damaged_compression_is_refused(packed, change):
    refused(MeshError, load_document, packed(**change))
