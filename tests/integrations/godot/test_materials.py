"""What was a standard material looks the same when a shader of the addon draws it: pictures of both, from OpenGL."""

import numpy as np
import pytest
from PIL import Image

from engine_bridge.live.frame import StreamedCharacter
from engine_bridge.rig import load_rig
from solver.deformer import Deformer, to_file_units

MEAN, MOST = 0.15, 4.0
"""What pictures may differ, in steps of 255: on the average, and in all but a thousandth of the pixels. In a mesh Godot
rounds normals, in a shader of the addon they are exact."""


@pytest.fixture(scope="module")
def figure(blob, new_glb, write_puppet, tmp_path_factory):
    """A puppet of the figure with texture coordinates and vertex colours."""
    glb = new_glb()
    attributes = {"NORMAL": blob.normals, "TEXCOORD_0": blob.uv, "COLOR_0": blob.colors}
    glb.node(glb.mesh(glb.primitive(blob.vertices, blob.faces.astype(np.uint32), **attributes)))
    mesh = glb.save(tmp_path_factory.mktemp("figure") / "figure.glb")
    return write_puppet(mesh.with_name("figure.toml"), mesh.name)


@pytest.fixture(scope="module")
def payloads(figure, tmp_path_factory):
    """What a service would send of the figure, at rest and bent, in files."""
    folder, rig = tmp_path_factory.mktemp("payloads"), load_rig(figure)
    character = StreamedCharacter("figure", rig, 1)
    (folder / "scene.bin").write_bytes(character.scene)
    deformer = Deformer(rig.model, rig.mesh, rig.puppet.handle_positions)
    pulled = deformer.handles + np.array([[-0.4, 0.8, 0.3], [0.3, -0.7, 0.5], [0.0, -0.2, 0.5], [0, 0, 0], [0, 0, 0.3]])
    for name, R in (("rest", rig.model.rest_controls), ("bent", deformer.solve(pulled))):
        controls = to_file_units(R, rig.model)
        (folder / f"{name}.bin").write_bytes(controls.tobytes())
        vertices = np.stack(character.binding.vertices_and_normals(controls)).astype("<f4")
        (folder / "vertices.bin").write_bytes(vertices.tobytes())
    return folder


def picture(path):
    return np.asarray(Image.open(path).convert("RGB")).astype(float)


def assert_alike(one, other):
    away = np.abs(one - other)
    assert away.mean() <= MEAN
    assert np.percentile(away, 99.9) <= MOST


def test_each_property_looks_the_same(run_godot, payloads):
    cases = [told["case"] for told in run_godot("render_materials.gd", payloads, display=True, timeout=300)]
    drawn = {case: picture(payloads / f"{case} own.png") for case in cases}
    for case in cases:
        if case != "plain":
            assert np.abs(drawn[case] - drawn["plain"]).mean() > 0.2, f"{case} shows nothing of its own"
        assert_alike(drawn[case], picture(payloads / f"{case} made.png"))
    assert_alike(drawn["bent"], picture(payloads / "bent vertices.png"))
    assert {"normal", "orm", "colors", "bent"} <= set(cases)
