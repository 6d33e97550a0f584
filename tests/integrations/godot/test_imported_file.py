"""A rig after Godot's import keeps its skeleton."""

import base64

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine_bridge.character.character import from_document
from engine_bridge.character.document_reader import load_document
from engine_bridge.character.scene import world_transforms
from engine_bridge.export.rig_file import RigSettings, write_rig

pytestmark = pytest.mark.slow


def array(text, kind, width):
    return np.frombuffer(base64.b64decode(text), kind).reshape(-1, width)


def test_a_rig_has_its_names_hierarchy_and_axes_and_bends_where_a_bone_is_turned(
    add_glb, run_godot, limbed_puppet, tmp_path
):
    """Godot sorts vertices, so that those before and after the turn are compared in the order of the first."""
    path = tmp_path / "figure.glb"
    write_rig(limbed_puppet, path, RigSettings(names="godot"))
    document, file = load_document(path, path.read_bytes()), add_glb(path, {"meshes/force_disable_compression": "true"})
    *bones, places = run_godot("imported_rig.gd", file, "LeftUpperArm", 60)
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
