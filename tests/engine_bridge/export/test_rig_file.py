import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from engine_bridge.character.character import from_document, load_character
from engine_bridge.character.document_reader import load_document
from engine_bridge.export.rig_file import RigSettings, write_rig
from puppetline.errors import OutputError, PuppetError

from ..refusals import refused


@pytest.fixture(scope="module")
def rigged(limbed_puppet, tmp_path_factory):
    """The figure's rig: path and summary."""
    path = tmp_path_factory.mktemp("rigs") / "figure.glb"
    return path, write_rig(limbed_puppet, path, RigSettings())


def test_a_rig_has_the_character_its_joints_and_no_animation(rigged, blob_file):
    path, summary = rigged
    document = load_document(path)
    (skin,) = document.gltf["skins"]
    assert tuple(document.gltf["nodes"][joint]["name"] for joint in skin["joints"]) == summary.joints
    assert {"hips", "leftUpperArm", "rightLowerLeg", "hump"} <= set(summary.joints)
    assert document.gltf["animations"] == []
    assert (summary.bytes, summary.kept) == (path.stat().st_size, False)
    assert_allclose(load_character(path).vertices, load_character(blob_file).vertices, atol=1e-5)
    refused(OutputError, write_rig, blob_file, blob_file, RigSettings())


def test_a_mesh_without_limbs_is_refused_with_what_to_do(new_glb, make_shape, tmp_path):
    ball, shape = new_glb(), make_shape([((0.0, 0.0, 0.0), (0.0, 0.01, 0.0), 0.5)])
    ball.node(mesh=ball.mesh(ball.primitive(shape.vertices, shape.faces)))
    mesh = ball.save(tmp_path / "ball.glb")
    assert "--limb" in refused(PuppetError, write_rig, mesh, tmp_path / "out.glb", RigSettings()).fix
    assert not (tmp_path / "out.glb").exists()


def attribute(document, name):
    """An attribute of the only surface."""
    return document.array(document.gltf["meshes"][0]["primitives"][0]["attributes"][name])


def test_a_file_with_a_skin_keeps_it_unless_a_new_one_or_a_t_pose_is_asked_for(rigged, tmp_path):
    path, summary = rigged
    kept = write_rig(path, tmp_path / "kept.glb", RigSettings())
    assert (kept.kept, kept.joints, kept.rms) == (True, summary.joints, None)
    before, after = load_document(path), load_document(tmp_path / "kept.glb")
    for name in ("JOINTS_0", "WEIGHTS_0", "POSITION"):
        assert_array_equal(*(attribute(document, name) for document in (before, after)))
    for new in (RigSettings(keep_skin=False), RigSettings(pose="t")):
        made = write_rig(path, tmp_path / "new.glb", new)
        assert (made.kept, made.rms is None) == (False, False)
        shown = [load_character(each).vertices for each in (path, tmp_path / "new.glb")]
        assert np.allclose(*shown, atol=1e-5) == (new.pose == "rest")


@pytest.mark.parametrize("keep_skin", [True, False])
def test_joints_are_renamed_where_the_limbs_are(rigged, tmp_path, keep_skin):
    renamed = write_rig(rigged[0], tmp_path / "godot.glb", RigSettings(names="godot", keep_skin=keep_skin))
    assert {"Hips", "LeftUpperArm", "LeftLowerArm", "RightUpperLeg", "RightLowerLeg"} <= set(renamed.joints)
    assert ("hump" in renamed.joints) == keep_skin  # a handle
    assert any("up" in note for note in renamed.notes)


def damaged(shape):
    """Every vertex twice, triangles without an area, parts of one triangle each, and vertices without a triangle."""
    count = len(shape.vertices)
    parts = (shape.vertices[::97][:, None] + 0.02 * np.eye(3)).reshape(-1, 3)
    copies = np.arange(len(shape.faces))[:, None] % 2 * count
    more = 2 * count + np.arange(len(parts)).reshape(-1, 3)
    vertices = np.concatenate([shape.vertices, shape.vertices, parts, shape.vertices[:9] + 0.1])
    return vertices, np.concatenate([shape.faces + copies, [[0, 0, 1], [5, 5, 5]], more])


def test_every_vertex_of_a_damaged_mesh_has_weights(blob, glb, limb_tables, write_puppet, tmp_path):
    vertices, faces = damaged(blob)
    glb.show(vertices, faces)
    glb.save(tmp_path / "damaged.glb")
    puppet = write_puppet(tmp_path / "damaged.toml", "damaged.glb", handles=limb_tables)
    write_rig(puppet, tmp_path / "out.glb", RigSettings())
    weights = attribute(load_document(tmp_path / "out.glb"), "WEIGHTS_0")
    assert len(weights) == len(vertices)
    assert_allclose(weights.sum(axis=1), 1, atol=1e-6)
    assert_allclose(load_character(tmp_path / "out.glb").vertices, vertices, atol=1e-5)


def test_a_new_skin_replaces_the_files_own_and_keeps_its_morph_targets(blob, glb, limb_tables, write_puppet, tmp_path):
    """The file's skin has one joint, which has turned the mesh by 90° since it was bound."""
    turned_back = blob.vertices @ np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    bound = np.tile([1, 0, 0, 0], (len(turned_back), 1))
    more = {"JOINTS_0": np.uint8(0 * bound), "WEIGHTS_0": np.float32(bound)}
    more["targets"] = [{"POSITION": np.float32(blob.vertices * [0.0, 0.1, 0.2])}]
    joint = glb.node(name="joint", rotation=[0.0, 0.0, -np.sqrt(0.5), np.sqrt(0.5)])
    glb.node(glb.mesh(glb.primitive(turned_back, blob.faces, **more), weights=[0.0]), skin=0)
    glb.file.skins.append({"joints": [joint]})
    path = glb.save(tmp_path / "own.glb")
    puppet = write_puppet(tmp_path / "own.toml", path.name, handles=limb_tables)
    summary = write_rig(puppet, tmp_path / "out.glb", RigSettings(keep_skin=False))
    assert "The character's own skeleton is replaced." in summary.notes
    for weight in (0.0, 1.0):
        before, after = load_document(path), load_document(tmp_path / "out.glb")
        for document in (before, after):
            document.gltf["meshes"][0]["weights"] = [weight]
        shown = from_document(before).vertices
        assert_allclose(from_document(after).vertices, shown, atol=1e-5)
        assert (np.abs(shown - blob.vertices).max() < 1e-5) == (weight == 0)
