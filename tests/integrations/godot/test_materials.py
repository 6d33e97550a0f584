"""The addon's shaders reproduce the look of standard materials: comparison of images drawn with OpenGL."""

import numpy as np
import pytest
from PIL import Image

from engine_bridge.performance.character_motion import make_deformer
from engine_bridge.performance.prepared_character import load_prepared
from engine_bridge.service.protocol.quantisation import quantised
from engine_bridge.service.protocol.scene import StreamedCharacter
from solver.motion.deformer import to_file_units
from solver.motion.motion_blend import moved_by

MEAN, MOST = 0.1, 1.0
"""What pictures may differ, in steps of 255: on the average, and in all but a thousandth of the pixels. In a mesh Godot
rounds normals and colours, in a shader of the addon they are exact."""


@pytest.fixture(scope="module")
def figure(blob, new_glb, write_puppet, tmp_path_factory):
    """A puppet of the figure with texture coordinates and vertex colours."""
    glb = new_glb()
    attributes = {"NORMAL": blob.normals, "TEXCOORD_0": blob.uv, "COLOR_0": blob.colors}
    glb.node(glb.mesh(glb.primitive(blob.vertices, blob.faces.astype(np.uint32), **attributes)))
    mesh = glb.save(tmp_path_factory.mktemp("figure") / "figure.glb")
    return write_puppet(mesh.with_name("figure.toml"), mesh.name)


def write_payloads(puppet, folder):
    """Write what a service would send of a puppet, at rest and bent."""
    prepared = load_prepared(puppet)
    character = StreamedCharacter("figure", prepared, 1)
    (folder / "scene.bin").write_bytes(character.scene)
    deformer, random = make_deformer(prepared), np.random.default_rng(3)
    pulled = deformer.handles + prepared.mesh.diagonal * random.uniform(-0.15, 0.15, deformer.handles.shape)
    bones = deformer.bones
    rest = np.tile(np.eye(4, 3), (len(bones), 1, 1))
    turns = np.hstack([random.uniform(-0.5, 0.5, (len(bones), 3)), np.zeros((len(bones), 3))])
    bent = deformer.solve(pulled, moved_by(bones, rest, turns, 1.0))
    for name, R in (("rest", prepared.model.rest_controls), ("bent", bent)):
        controls = to_file_units(R, prepared.model)
        (folder / f"{name}.bin").write_bytes(controls.tobytes())
        vertices = np.stack(character.binding.vertices_and_normals(controls)).astype("<f4")
        (folder / "vertices.bin").write_bytes(vertices.tobytes())
        box, places, folded = quantised(*vertices)
        parts = box.tobytes(), places.tobytes(), bytes(-places.nbytes % 4), folded.tobytes()
        (folder / "vertices16.bin").write_bytes(b"".join(parts))


def picture(path):
    return np.asarray(Image.open(path).convert("RGB")).astype(float)


def assert_alike(one, other):
    away = np.abs(one - other)
    assert away.mean() <= MEAN
    assert np.percentile(away, 99.9) <= MOST


def test_each_property_looks_the_same(run_godot, screen, figure, tmp_path):
    write_payloads(figure, tmp_path)
    cases = [told["case"] for told in run_godot("render_materials.gd", tmp_path, screen=screen(), timeout=600)]
    drawn = {case: picture(tmp_path / f"{case} own.png") for case in cases}
    for case in cases:
        if case != "plain":
            assert np.abs(drawn[case] - drawn["plain"]).mean() > 0.02, f"{case} shows nothing of its own"
        assert_alike(drawn[case], picture(tmp_path / f"{case} made.png"))
    assert_alike(drawn["bent"], picture(tmp_path / "bent vertices.png"))
    assert {"normal", "orm", "colors", "bent", "user's"} <= set(cases)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["khronos_Fox", "kaykit_Knight", "quaternius_George", "cubevc"])
def test_an_imported_character_looks_as_it_does_without_the_addon(
    run_godot, screen, add_glb, real_data, commands, tmp_path, name
):
    """Textures, fifteen materials, loose triangles, vertex colours: as in the files of other people."""
    puppet, own = tmp_path / f"{name}.toml", tmp_path / "own.glb"
    for arguments in (
        ["new", real_data / "mesh" / "gltf" / f"{name}.glb", "-o", puppet],
        ["shader-mesh", puppet, "-o", own],
    ):
        commands.run(*arguments).check_returncode()
    write_payloads(puppet, tmp_path)
    run_godot("render_materials.gd", tmp_path, add_glb(own), screen=screen(), timeout=600)
    drawn = picture(tmp_path / "imported own.png")
    assert np.std(drawn) > 10
    assert_alike(drawn, picture(tmp_path / "imported made.png"))
