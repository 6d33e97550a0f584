"""Whether a file keeps its own skeleton: if that moves every limb, at the joints or beside them."""

import numpy as np
import pytest

from engine_bridge.character.character import load_character
from engine_bridge.character.document_reader import load_document
from engine_bridge.character.evaluation import Evaluation
from engine_bridge.character.scene import local_transform
from engine_bridge.export.convert import convert
from engine_bridge.export.own_skeleton import own_skeleton
from engine_bridge.export.rig_file import RigSettings, write_rig
from engine_bridge.performance.prepared_character import load_prepared, make_prepared
from engine_bridge.performance.settings import Settings
from engine_bridge.puppet.proposal import new_puppet

from .conftest import solved


@pytest.fixture(scope="module")
def skinned(limbed_puppet, tmp_path_factory):
    """The figure with a skeleton of its own along its limbs."""
    file = tmp_path_factory.mktemp("skinned") / "skinned.glb"
    write_rig(limbed_puppet, file, RigSettings())
    return file


@pytest.fixture
def stiff(skinned, tmp_path):
    """The same with a left arm whose vertices follow the joint that the trunk's do."""
    document = load_document(skinned)
    (primitive,), (skin,) = document.gltf["meshes"][0]["primitives"], document.gltf["skins"]
    names = [document.gltf["nodes"][joint]["name"] for joint in skin["joints"]]
    follows = primitive["attributes"]["JOINTS_0"]
    chest, *arm = (names.index(name) for name in ("chest", "leftUpperArm", "leftLowerArm", "leftHand"))
    joints = document.array(follows)
    document.replace(follows, np.where(np.isin(joints, arm), chest, joints).astype(np.uint8))
    document.save(tmp_path / "stiff.glb")
    return tmp_path / "stiff.glb"


@pytest.fixture
def puppet_of(write_puppet, limb_tables):
    """Write a puppet file beside a mesh; its left arm begins so much lower than the joint."""

    def write(mesh, by=0.0, handles=False):
        tables = limb_tables if handles else limb_tables.partition("[[handle]]")[0]
        tables = tables.replace("[0.2, 1.12, 0.01]", f"[0.2, {1.12 - by}, 0.01]")
        return write_puppet(mesh.with_suffix(".toml"), mesh.name, handles=tables, replaces=True)

    return write


def test_a_skeleton_along_the_limbs_is_kept_unless_somebody_wants_a_new_one(skinned, puppet_of, take, tmp_path):
    _, kept = convert(take, puppet_of(skinned), tmp_path / "kept.glb", Settings())
    assert kept.rms is None
    assert load_document(tmp_path / "kept.glb").gltf["skins"] == load_document(skinned).gltf["skins"]
    assert 0.5 < kept.stretch_p1 < kept.stretch_p50 < kept.stretch_p99 < 2
    _, new = convert(take, puppet_of(skinned), tmp_path / "new.glb", Settings(keep_skin=False))
    assert new.rms < 0.01
    assert not any("would not move" in note for note in new.notes)


@pytest.mark.parametrize(
    ("options", "unmoved"), [({"by": 0.07}, ()), ({"by": 0.1}, ()), ({"handles": True}, ("hump",))]
)
def test_joints_beside_the_limbs_are_found_and_handles_have_none(skinned, puppet_of, tmp_path, options, unmoved):
    """Limbs that are found from the shape do not begin exactly at joints."""
    mesh = tmp_path / "skinned.glb"
    mesh.write_bytes(skinned.read_bytes())
    found = own_skeleton(load_prepared(puppet_of(mesh, **options)))
    assert (found.usable is not None, found.bones.missing, found.unmoved) == (not unmoved, (), unmoved)


def test_a_file_whose_skeleton_leaves_an_arm_still_gets_another_that_moves_it(stiff, puppet_of, take, tmp_path):
    puppet = puppet_of(stiff)
    assert own_skeleton(load_prepared(puppet)).unmoved == ("left arm",)
    clip, summary = convert(take, puppet, tmp_path / "moved.glb", Settings())
    assert [note for note in summary.notes if "would not move left arm" in note]
    prepared = clip.motion.prepared
    shown = Evaluation(load_document(tmp_path / "moved.glb"), prepared.character.parts)
    found = np.array([*shown.positions(clip.motion.times)])
    away = np.linalg.norm(found - solved(clip)[:, prepared.mesh.of_render], axis=2)
    assert away.max() <= (summary.error + summary.tolerance) * prepared.mesh.diagonal
    rigged = write_rig(puppet, tmp_path / "rigged.glb", RigSettings())
    assert not rigged.kept
    assert [note for note in rigged.notes if "would not move left arm" in note]


def test_a_skeleton_with_a_joint_that_cannot_be_animated_moves_nothing(skinned, puppet_of, tmp_path):
    document = load_document(skinned)
    joint = next(node for node in document.gltf["nodes"] if node.get("name") == "leftLowerArm")
    sheared = local_transform(joint) @ [[1, 0.3, 0, 0], *np.eye(4)[1:]]
    for name in ("translation", "rotation", "scale"):
        joint.pop(name, None)
    joint["matrix"] = sheared.T.ravel().tolist()
    document.save(tmp_path / "sheared.glb")
    prepared = load_prepared(puppet_of(tmp_path / "sheared.glb"))
    found = own_skeleton(prepared)
    assert (found.usable, len(found.unmoved)) == (None, len(prepared.puppet.limb))
    assert "it has a joint with a sheared matrix" in found.notes[0]


@pytest.mark.parametrize("name", ["wild/mesh/dr_CesiumMan", "mesh/gltf/kenney/character"])
def test_skeletons_that_once_left_arms_still_move_all_limbs(real_data, name):
    """Joints without names, and parts that follow nodes without a skin."""
    path = real_data / f"{name}.glb"
    found = own_skeleton(make_prepared(new_puppet(path, path).puppet, load_character(path)))
    assert (found.usable.missing, found.unmoved) == ((), ())
