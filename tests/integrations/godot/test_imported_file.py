"""Files after Godot's import: vertices keep the inputs of their shader, and a rig its skeleton."""

import base64
import subprocess

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine_bridge.character.character import from_document
from engine_bridge.character.document_reader import load_document
from engine_bridge.character.scene import world_transforms
from engine_bridge.export.rig_file import RigSettings, write_rig
from engine_bridge.export.shader_mesh import write_shader_mesh
from engine_bridge.performance.rig import load_rig
from engine_bridge.service.protocol.scene import Scene, StreamedCharacter

pytestmark = pytest.mark.slow

OTHER = {
    "meshes/generate_lods": "false",
    "meshes/create_shadow_meshes": "false",
    "meshes/force_disable_compression": "true",
    "meshes/ensure_tangents": "false",
}
"""Every setting that changes vertices, in another way than by default."""


def array(text, kind, width):
    return np.frombuffer(base64.b64decode(text), kind).reshape(-1, width)


def import_file(godot, project, settings):
    params = "".join(f"{name}={value}\n" for name, value in settings.items())
    (project / "figure.glb.import").write_text(f'[remap]\n\nimporter="scene"\n\n[params]\n\n{params}')
    command = [godot, "--headless", "--path", project, "--import"]
    subprocess.run(command, capture_output=True, text=True, check=True, timeout=300)
    for name, value in settings.items():
        assert f"{name}={value}" in (project / "figure.glb.import").read_text()


@pytest.mark.parametrize("settings", [{}, OTHER], ids=["default", "other"])
def test_customs_are_those_of_the_scene_by_number(settings, godot, project, run_godot, blob_puppet):
    write_shader_mesh(blob_puppet, project / "figure.glb")
    import_file(godot, project, settings)
    (surface,) = run_godot("imported_file.gd", "res://figure.glb")
    scene = Scene.decode(StreamedCharacter("figure", load_rig(blob_puppet), 1).scene)
    count, fields = scene.facts["vertices"], scene.facts["fields"]
    numbers = array(surface["custom_2"], "<f4", 2)
    number = numbers[:, 0].astype(int)
    np.testing.assert_array_equal(numbers, np.column_stack([number, np.zeros(len(number))]))
    assert sorted(number) == list(range(count))
    isoline_coordinates = np.hstack([array(surface[f"custom_{which}"], "<f4", 4) for which in range(2)])
    np.testing.assert_array_equal(isoline_coordinates[:, :fields], scene.arrays["ladder"][number])
    assert not isoline_coordinates[:, fields:].any()
    # compression rounds positions to 16 bits of the box
    box = np.ptp(scene.arrays["positions"], axis=0).max()
    positions = array(surface["positions"], "<f4", 3)
    np.testing.assert_allclose(positions, scene.arrays["positions"][number], atol=box / 65535)
    assert surface["identity"]
    # Godot's front faces are clockwise
    triangles = number[array(surface["triangles"], "<i4", 3)][:, ::-1]
    first = triangles.argmin(axis=1)
    turned = np.take_along_axis(triangles, (first[:, None] + np.arange(3)) % 3, axis=1)
    expected = scene.arrays["triangles"].astype(int)
    start = expected.argmin(axis=1)
    expected = np.take_along_axis(expected, (start[:, None] + np.arange(3)) % 3, axis=1)
    assert set(map(tuple, turned)) == set(map(tuple, expected))


def test_a_rig_has_its_names_hierarchy_and_axes_and_bends_where_a_bone_is_turned(
    godot, project, run_godot, limbed_puppet
):
    """Godot sorts vertices, so that those before and after the turn are compared in the order of the first."""
    write_rig(limbed_puppet, project / "figure.glb", RigSettings(names="godot"))
    document = load_document(project / "figure.glb", (project / "figure.glb").read_bytes())
    import_file(godot, project, {"meshes/force_disable_compression": "true"})
    *bones, places = run_godot("imported_rig.gd", "res://figure.glb", "LeftUpperArm", 60)
    nodes, world = document.gltf["nodes"], world_transforms(document)
    (skin,) = document.gltf["skins"]
    names = {node: nodes[node]["name"] for node in skin["joints"]}
    above = {child: names[node] for node in names for child in nodes[node].get("children", [])}
    assert {each["bone"]: each["parent"] for each in bones} == {
        name: above.get(node, "") for node, name in names.items()
    }
    assert {"Hips", "Spine", "Head", "LeftUpperArm", "RightHand", "LeftFoot"} <= {each["bone"] for each in bones}
    assert all(
        each["profile"] in (None, each["parent"]) for each in bones
    )  # only the handle's joint is none of Godot's
    rest = {each["bone"]: np.reshape(each["rest"], (4, 3)) for each in bones}
    for node, name in names.items():
        np.testing.assert_allclose(rest[name], world[node][:3].T, atol=1e-5)
    along = rest["LeftLowerArm"][3] - rest["LeftUpperArm"][3]
    np.testing.assert_allclose(rest["LeftUpperArm"][1], along / np.linalg.norm(along), atol=1e-5)
    before = from_document(document).vertices
    (arm,) = (node for node, name in names.items() if name == "LeftUpperArm")
    turn = Rotation.from_quat(nodes[arm]["rotation"]) * Rotation.from_euler("x", 60, degrees=True)
    nodes[arm]["rotation"] = turn.as_quat().tolist()
    found, expected = (array(places[when], "<f4", 3) for when in ("before", "after")), from_document(document).vertices
    start, end = found
    nearest = np.linalg.norm(start[:, None] - before[None], axis=2).argmin(axis=1)
    size = np.linalg.norm(np.ptp(before, axis=0))
    np.testing.assert_allclose(start, before[nearest], atol=2e-6 * size)
    np.testing.assert_allclose(end, expected[nearest], atol=2e-5 * size)
    assert np.abs(end - start).max() > 0.1 * size
