"""The validator of exported files finds faults: what it says nothing about is right."""

import numpy as np
import pytest

from .engine_bridge.conftest import Glb


def test_the_validator_names_the_accessor_without_bounds(validate, assert_valid_gltf, tmp_path):
    quad = Glb()
    quad.node(quad.mesh(quad.primitive(np.eye(3, dtype=np.float32), np.array([0, 1, 2], np.uint16))))
    assert_valid_gltf(quad.save(tmp_path / "good.glb"))
    positions = quad.file.meshes[0].primitives[0].attributes.POSITION
    quad.file.accessors[positions].min = None
    path = quad.save(tmp_path / "broken.glb")
    (message,) = validate(path)["messages"]
    assert message["code"] == "MESH_PRIMITIVE_POSITION_ACCESSOR_WITHOUT_BOUNDS"
    assert message["pointer"] == "/meshes/0/primitives/0/attributes/POSITION"
    with pytest.raises(pytest.fail.Exception, match=message["code"]):
        assert_valid_gltf(path)
