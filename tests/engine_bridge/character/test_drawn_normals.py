import igl
import numpy as np

from engine_bridge.character.character import load_character
from engine_bridge.character.drawn_normals import drawn_normals


def test_normals_have_no_numbers_that_a_graphics_card_takes_for_zero(glb, tmp_path, blob):
    normals = np.tile(np.float32([-3.5e-39, -1.0, 2e-38]), (len(blob.vertices), 1))
    glb.node(glb.mesh(glb.primitive(blob.vertices, blob.faces.astype(np.uint32), NORMAL=normals)))
    drawn = drawn_normals(load_character(glb.save(tmp_path / "upside_down.glb")))
    np.testing.assert_array_equal(drawn, np.tile([0.0, -1.0, np.float32(2e-38)], (len(normals), 1)))


def test_a_file_without_normals_gets_smooth_ones(glb, tmp_path, blob):
    with_normals = glb.primitive(blob.vertices, blob.faces.astype(np.uint32), NORMAL=blob.normals)
    without = glb.primitive(blob.vertices, blob.faces.astype(np.uint32))
    glb.node(glb.mesh(with_normals, without))
    normals = drawn_normals(load_character(glb.save(tmp_path / "two.glb")))
    smooth = igl.per_vertex_normals(blob.vertices.astype(float), blob.faces)
    np.testing.assert_allclose(normals, np.concatenate([blob.normals, smooth]), atol=1e-6)
