"""A rig after Godot's import keeps its skeleton."""

import numpy as np
import pytest

from engine_bridge.character.document_reader import load_document
from engine_bridge.character.scene import world_transforms
from engine_bridge.export.rig_file import RigSettings, write_rig

pytestmark = pytest.mark.slow


def test_a_rig_has_its_names_hierarchy_and_axes(add_glb, run_godot, limbed_puppet, tmp_path):
    path = tmp_path / "figure.glb"
    write_rig(limbed_puppet, path, RigSettings(names="godot"))
    document, file = load_document(path, path.read_bytes()), add_glb(path, {"meshes/force_disable_compression": "true"})
    bones = run_godot("imported_rig.gd", file)
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
