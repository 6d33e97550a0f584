import DracoPy
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from engine_bridge.character.document import Document
from engine_bridge.character.document_reader import DRACO, load_document
from engine_bridge.character.draco import decode
from engine_bridge.character.schema import empty
from puppetline.errors import MeshError

from ..refusals import refused

RANDOM = np.random.default_rng(6)
CORNERS = RANDOM.permuted(np.tile(np.arange(90), (120, 1)), axis=1)[:, :3]
VALUES = {
    "POSITION": RANDOM.uniform(-2, 3, (90, 3)).astype(np.float32),
    "JOINTS_0": RANDOM.integers(0, 200, (90, 4)).astype(np.uint8),
    "WEIGHTS_0": RANDOM.dirichlet(np.ones(4), 90).astype(np.float32),
}
VALUES["WEIGHTS_0"][3], VALUES["JOINTS_0"][3] = (1, 0, 0, 0), (5, 0, 0, 0)
NUMBERS = {"POSITION": 8, "JOINTS_0": 7, "WEIGHTS_0": 5}
STEP = 5 / 2**16
"""Distance of quantised positions, approximately."""


@pytest.fixture
def packed(tmp_path):
    """A function that writes a file with two primitives that share compressed bytes, whose description is changed."""

    def write(cut=0, count=90, **numbers):
        joints = (VALUES["JOINTS_0"] + 9 * (VALUES["WEIGHTS_0"] == 0)).astype(np.uint8)
        generic = {NUMBERS["JOINTS_0"]: joints, NUMBERS["WEIGHTS_0"]: np.float32(1.01) * VALUES["WEIGHTS_0"]}
        content = DracoPy.encode(VALUES["POSITION"], CORNERS, 16, preserve_order=True, generic_attributes=generic)
        document = Document(empty(), name="packed")
        about = {"bufferView": document.add_view(content[: len(content) - cut]), "attributes": NUMBERS | numbers}
        described = [("SCALAR", 5123, CORNERS.size), ("VEC3", 5126, count), ("VEC4", 5121, 90), ("VEC4", 5126, 90)]
        for kind, component, length in 2 * described:
            document.gltf["accessors"].append({"type": kind, "componentType": component, "count": length})
        primitives = [
            {
                "attributes": {name: k + j for j, name in enumerate(VALUES, 1)},
                "indices": k,
                "extensions": {DRACO: about},
            }
            for k in (0, 4)
        ]
        document.gltf["meshes"] = [{"primitives": primitives}]
        document.gltf["nodes"], document.gltf["scenes"] = [{"mesh": 0}], [{"nodes": [0]}]
        document.gltf["extensionsUsed"] = document.gltf["extensionsRequired"] = [DRACO]
        document.save(tmp_path / "packed.glb")
        return tmp_path / "packed.glb"

    return write


def test_triangles_are_those_that_were_compressed(packed):
    """Weights sum to 1 again, and joints without weight are 0, as glTF requires."""
    document = load_document(packed())
    for primitive in document.gltf["meshes"][0]["primitives"]:
        assert_array_equal(document.array(primitive["indices"]), CORNERS.ravel())
        for name, values in VALUES.items():
            read = document.attribute(primitive, name, 90, values.shape[1])
            assert read.dtype == values.dtype
            assert_allclose(read, values, rtol=0, atol=STEP if name == "POSITION" else 1e-6)
    assert not document.gltf["extensionsRequired"]
    assert not document.gltf["extensionsUsed"]


def test_weights_may_be_compressed_and_their_joints_not():
    weights = {NUMBERS["WEIGHTS_0"]: np.float32(1.01) * VALUES["WEIGHTS_0"]}
    content = DracoPy.encode(VALUES["POSITION"], CORNERS, preserve_order=True, generic_attributes=weights)
    _, values = decode(content, {"WEIGHTS_0": NUMBERS["WEIGHTS_0"]})
    assert_allclose(values["WEIGHTS_0"], VALUES["WEIGHTS_0"], rtol=0, atol=1e-6)


def test_what_the_compressed_bytes_hold_counts_if_it_is_more_than_the_file_says(packed):
    document = load_document(packed(count=88))
    primitive = document.gltf["meshes"][0]["primitives"][0]
    assert_allclose(document.attribute(primitive, "POSITION", 90, 3), VALUES["POSITION"], rtol=0, atol=STEP)


@pytest.mark.parametrize("change", [{"cut": 40}, {"count": 91}, {"JOINTS_0": 9}])
def test_damage_is_refused(packed, change):
    refused(MeshError, load_document, packed(**change))
