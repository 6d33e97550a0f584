"""Files from `puppetline shader-mesh` after Godot's import: every vertex still has the inputs of its shader."""

import base64
import subprocess

import numpy as np
import pytest

from engine_bridge.export.shader_mesh import write_shader_mesh
from engine_bridge.performance.rig import load_rig
from engine_bridge.service.protocol.frame import StreamedCharacter
from engine_bridge.service.protocol.scene import Scene

pytestmark = pytest.mark.slow

SETTINGS = {
    "the importer's defaults": {},
    "no levels of detail": {"meshes/generate_lods": "false"},
    "no shadow meshes": {"meshes/create_shadow_meshes": "false"},
    "no compression": {"meshes/force_disable_compression": "true"},
    "no tangents": {"meshes/ensure_tangents": "false"},
}


def array(text, kind, width):
    return np.frombuffer(base64.b64decode(text), kind).reshape(-1, width)


def imported(godot, project, run_godot, puppet, settings):
    write_shader_mesh(puppet, project / "figure.glb")
    params = "".join(f"{name}={value}\n" for name, value in settings.items())
    (project / "figure.glb.import").write_text(f'[remap]\n\nimporter="scene"\n\n[params]\n\n{params}')
    command = [godot, "--headless", "--path", project, "--import"]
    subprocess.run(command, capture_output=True, text=True, check=True, timeout=300)
    for name, value in settings.items():
        assert f"{name}={value}" in (project / "figure.glb.import").read_text()
    return run_godot("imported_file.gd", "res://figure.glb")


@pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS)
def test_customs_are_those_of_the_scene_by_number(settings, godot, project, run_godot, blob_puppet):
    (surface,) = imported(godot, project, run_godot, blob_puppet, settings)
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
