"""The validator of exported files finds faults: what it says nothing about is right."""

import numpy as np
import pytest

from .engine_bridge.conftest import Glb


def test_a_file_that_lacks_bounds_is_not_valid(assert_valid_gltf, tmp_path):
    quad = Glb()
    quad.show(np.eye(3), np.array([0, 1, 2], np.uint16))
    assert_valid_gltf(quad.save(tmp_path / "good.glb"))
    quad.file.accessors[0].min = None
    with pytest.raises(pytest.fail.Exception, match="ACCESSOR_WITHOUT_BOUNDS /meshes/0/primitives/0/"):
        assert_valid_gltf(quad.save(tmp_path / "broken.glb"))
