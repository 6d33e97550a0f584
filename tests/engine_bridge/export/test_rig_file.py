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


def degenerate(shape):
    """Triangles without an area: three corners at one place, and on one line."""
    count = len(shape.vertices)
    line = shape.vertices[:1] + np.array([[0, 0, 0], [0.01, 0, 0], [0.02, 0, 0]])
    faces = [shape.faces, [[0, 0, 1], [5, 5, 5], [count, count + 1, count + 2]]]
    return np.concatenate([shape.vertices, line]), np.concatenate(faces)


def single_triangles(shape):
    """Parts of one triangle each, all over the surface."""
    corner = shape.vertices[::97]
    parts = (corner[:, None] + 0.02 * np.eye(3)).reshape(-1, 3)
    faces = len(shape.vertices) + np.arange(len(parts)).reshape(-1, 3)
    return np.concatenate([shape.vertices, parts]), np.concatenate([shape.faces, faces])


def unused(shape):
    """Vertices without a triangle."""
    return np.concatenate([shape.vertices, shape.vertices[:9] + 0.1]), shape.faces


def doubled(shape):
    """Every vertex twice, half of the triangles with each copy."""
    copies = np.arange(len(shape.faces))[:, None] % 2 * len(shape.vertices)
    return np.concatenate([shape.vertices, shape.vertices]), shape.faces + copies


@pytest.mark.parametrize("damaged", [degenerate, single_triangles, unused, doubled])
def test_every_vertex_of_a_damaged_mesh_has_weights(damaged, blob, glb, limb_tables, write_puppet, tmp_path):
    vertices, faces = damaged(blob)
    glb.node(glb.mesh(glb.primitive(vertices, faces.astype(np.uint32))))
    glb.save(tmp_path / "damaged.glb")
    puppet = write_puppet(tmp_path / "damaged.toml", "damaged.glb", handles=limb_tables)
    write_rig(puppet, tmp_path / "out.glb", RigSettings())
    document = read(tmp_path / "out.glb")
    weights = document.array(document.gltf["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"])
    assert len(weights) == len(vertices)
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-6)
    np.testing.assert_allclose(load_character(tmp_path / "out.glb").vertices, vertices, atol=1e-5)


def test_a_limb_of_200_bones_has_as_many_joints(blob_file, write_puppet, tmp_path):
    turns = np.linspace(0, 8 * np.pi, 201)
    points = np.column_stack([0.05 * np.cos(turns), np.linspace(0.4, 0.6, 201), 0.05 * np.sin(turns)])
    joints = ["hip_center", *["shoulder_center"] * 200]
    table = f'[[limb]]\nname = "trunk"\nfollow = "turn"\npoints = {points.tolist()}\njoints = {joints}'
    puppet = write_puppet(tmp_path / "spiral.toml", blob_file, handles=table)
    assert len(write_rig(puppet, tmp_path / "spiral.glb", RigSettings()).joints) == 200
    np.testing.assert_allclose(
        load_character(tmp_path / "spiral.glb").vertices, load_character(blob_file).vertices, atol=1e-5
    )


def test_a_new_skin_replaces_the_files_own_and_keeps_its_morph_targets(blob, glb, limb_tables, write_puppet, tmp_path):
    """The file's skin has one joint, which has turned the mesh by 90° since it was bound."""
    smile = (blob.vertices * [0.0, 0.1, 0.2]).astype(np.float32)
    bound = np.zeros((len(blob.vertices), 4), dtype=np.float32)
    bound[:, 0] = 1
    turned_back = blob.vertices @ np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    primitive = glb.primitive(
        turned_back,
        blob.faces.astype(np.uint32),
        JOINTS_0=np.zeros(bound.shape, dtype=np.uint8),
        WEIGHTS_0=bound,
        targets=[{"POSITION": smile}],
    )
    joint = glb.node(name="joint", rotation=[0.0, 0.0, -np.sqrt(0.5), np.sqrt(0.5)])
    glb.node(glb.mesh(primitive, weights=[0.0]), skin=0)
    glb.file.skins.append({"joints": [joint]})
    path = glb.save(tmp_path / "own.glb")
    before = load_character(path)
    np.testing.assert_allclose(before.vertices, blob.vertices, atol=1e-5)
    puppet = write_puppet(tmp_path / "own.toml", path.name, handles=limb_tables)
    summary = write_rig(puppet, tmp_path / "out.glb", RigSettings(keep_skin=False))
    assert "The character's own skeleton is replaced." in summary.notes
    np.testing.assert_allclose(load_character(tmp_path / "out.glb").vertices, blob.vertices, atol=1e-5)
    for file in (path, tmp_path / "out.glb"):
        document = read(file)
        document.gltf["meshes"][0]["weights"] = [1.0]
        document.save(tmp_path / f"smiling_{file.name}")
    smiling = [load_character(tmp_path / f"smiling_{name}.glb").vertices for name in ("own", "out")]
    np.testing.assert_allclose(smiling[1], smiling[0], atol=1e-5)
    assert np.abs(smiling[0] - before.vertices).max() > 0.01
