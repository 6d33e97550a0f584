from pathlib import Path

import numpy as np
import pytest

from engine_bridge.character.character import load_character
from engine_bridge.character.document import Document
from engine_bridge.character.document_reader import load_document
from engine_bridge.export.rig_file import RigSettings, write_rig
from engine_bridge.rigging.naming_schemes import NAMES, SCHEMES
from puppetline.errors import OutputError, PuppetError


def read(path: Path) -> Document:
    return load_document(path, path.read_bytes())


@pytest.fixture(scope="module")
def rigged(limbed_puppet, tmp_path_factory):
    """The figure's rig: path and summary."""
    path = tmp_path_factory.mktemp("rigs") / "figure.glb"
    return path, write_rig(limbed_puppet, path, RigSettings())


def test_a_rig_has_the_character_its_joints_and_no_animation(rigged, blob_file):
    path, summary = rigged
    document = read(path)
    (skin,) = document.gltf["skins"]
    assert tuple(document.gltf["nodes"][joint]["name"] for joint in skin["joints"]) == summary.joints
    assert {"hips", "leftUpperArm", "rightLowerLeg", "hump"} <= set(summary.joints)
    assert document.gltf["animations"] == []
    assert summary.bytes == path.stat().st_size
    assert not summary.kept
    np.testing.assert_allclose(load_character(path).vertices, load_character(blob_file).vertices, atol=1e-5)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_humanoid_joints_are_named_as_asked_and_others_keep_their_names(scheme, limbed_puppet, rigged, tmp_path):
    summary = write_rig(limbed_puppet, tmp_path / "named.glb", RigSettings(names=scheme))
    assert summary.joints == tuple(NAMES[scheme].get(name, name) for name in rigged[1].joints)


def test_a_mesh_gets_proposed_limbs_and_the_assumptions_are_said(blob_file, tmp_path):
    summary = write_rig(blob_file, tmp_path / "proposed.glb", RigSettings())
    assert {"hips", "head", "leftLowerArm", "rightFoot"} <= set(summary.joints)
    assert any("up" in note for note in summary.notes)


def test_a_mesh_without_limbs_is_refused_with_what_to_do(new_glb, make_shape, tmp_path):
    ball, shape = new_glb(), make_shape([((0.0, 0.0, 0.0), (0.0, 0.01, 0.0), 0.5)])
    ball.node(mesh=ball.mesh(ball.primitive(shape.vertices, shape.faces.astype(np.uint32))))
    mesh = ball.save(tmp_path / "ball.glb")
    with pytest.raises(PuppetError, match="no limbs were found") as error:
        write_rig(mesh, tmp_path / "out.glb", RigSettings())
    assert "--limb" in str(error.value)
    assert not (tmp_path / "out.glb").exists()


def test_the_mesh_itself_is_never_overwritten(blob_file):
    with pytest.raises(OutputError):
        write_rig(blob_file, blob_file, RigSettings())


def test_a_file_with_a_skin_keeps_it_unless_a_new_one_is_asked_for(rigged, tmp_path):
    path, summary = rigged
    kept = write_rig(path, tmp_path / "kept.glb", RigSettings())
    assert kept.kept
    assert kept.joints == summary.joints
    assert kept.rms is None
    assert any("keeps its own skeleton" in note for note in kept.notes)
    before, after = read(path), read(tmp_path / "kept.glb")
    attributes = [document.gltf["meshes"][0]["primitives"][0]["attributes"] for document in (before, after)]
    for name in ("JOINTS_0", "WEIGHTS_0", "POSITION"):
        np.testing.assert_array_equal(before.array(attributes[0][name]), after.array(attributes[1][name]))
    made = write_rig(path, tmp_path / "new.glb", RigSettings(keep_skin=False))
    assert not made.kept
    assert "The character's own skeleton is replaced." in made.notes


def test_joints_of_a_kept_skin_are_renamed_where_the_limbs_are(rigged, tmp_path):
    renamed = write_rig(rigged[0], tmp_path / "godot.glb", RigSettings(names="godot"))
    assert {"Hips", "LeftUpperArm", "LeftLowerArm", "RightUpperLeg", "RightLowerLeg"} <= set(renamed.joints)
    assert "hump" in renamed.joints


def test_a_t_pose_makes_a_new_skin(rigged, tmp_path):
    summary = write_rig(rigged[0], tmp_path / "t.glb", RigSettings(pose="t"))
    assert not summary.kept
    assert summary.rms is not None
