"""Nodes that are attached to a character: compared with the positions of all vertices in the same frames."""

import json

import numpy as np
import pytest
from scipy.spatial import cKDTree

from engine_bridge.performance.rig import load_rig

from ..surface import affine, outward

CONTROLS, VERTICES, MORPHS = range(3)
SAMPLES = 20
ALIKE = 1e-5
"""Maximum difference of positions, relative to the diagonal."""

TURNED = [0.0, 1.2, 1.6, -2.0, 0.0, 0.0, 0.0, -0.8, 0.6, 3.0, -1.0, 2.0]
"""Columns and origin: rotated, and scaled by 2, 2 and 1."""

MIRRORED = [-1.5, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 3.0, 0.0, 1.0, 0.0]


class Sample:
    """Poses of attachments and all positions in the same frame, both in world coordinates."""

    def __init__(self, told, local):
        self.local = local
        self._space = np.reshape(told["puppet"], (4, 3))
        self.positions = local @ self._space[:3] + self._space[3]
        self.poses = [np.reshape(pose, (4, 3)) for pose in told["poses"]]
        """Rows are the axes and the origin."""
        self.surface = [np.reshape(pose, (4, 3)) for pose in told["surface"]]
        self.scale = np.linalg.norm(self._space[:3], axis=1).max()


@pytest.fixture
def attach(start_godot, tmp_path):
    """Attach nodes to a character; return its positions at rest and samples."""

    def run(port, vertices, *attachments, parent=TURNED, **puppet):
        file = tmp_path / "positions.bin"
        asked = {"puppet": {"port": port, **puppet}, "parent": parent, "attachments": attachments}
        asked |= {"samples": SAMPLES, "apart": 6, "file": str(file)}
        told = start_godot("attach.gd", json.dumps(asked)).finish(120)
        assert [each["warnings"] for each in told[SAMPLES:]] == [[]] * len(attachments)
        rest, positions = np.split(np.fromfile(file, "<f4").reshape(-1, 3).astype(float), [-SAMPLES * vertices])
        return rest, [Sample(*each) for each in zip(told[:SAMPLES], np.split(positions, SAMPLES), strict=True)]

    return run


def assert_rigid(pose):
    np.testing.assert_allclose(pose[:3] @ pose[:3].T, np.eye(3), atol=1e-5)
    assert np.linalg.det(pose[:3]) == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize("mode", [CONTROLS, VERTICES])
@pytest.mark.parametrize("parent", [TURNED, MIRRORED], ids=["turned", "mirrored"])
def test_they_lie_on_the_vertices(attach, playing, blob_puppet, take, mode, parent):
    rig = load_rig(blob_puppet)
    count = len(rig.character.vertices)
    chosen = [0, count // 3, count // 2, count - 1]
    service = playing(blob_puppet, take)
    _, samples = attach(service.port, count, *({"vertex": each} for each in chosen), mode=mode, parent=parent)
    for sample in samples:
        for vertex, pose, local in zip(chosen, sample.poses, sample.surface, strict=True):
            assert_rigid(pose)
            assert_rigid(local)
            tolerance = ALIKE * rig.mesh.diagonal
            assert np.abs(pose[3] - sample.positions[vertex]).max() <= tolerance * sample.scale
            assert np.abs(local[3] - sample.local[vertex]).max() <= tolerance
            # the mean of a patch, so it differs from the normal of the vertex, which a mirrored space turns inside out
            side = 1.0 if parent is TURNED else -1.0
            assert side * pose[1] @ outward(sample.positions, rig.character.triangles, vertex) > 0.97
            assert local[1] @ outward(sample.local, rig.character.triangles, vertex) > 0.97
    moved = np.ptp([sample.poses for sample in samples], axis=0)
    assert moved[:, 3].max() > 0.01 * rig.mesh.diagonal
    assert moved[:, :3].max() > 0.05


def test_morph_targets_carry_them_too(attach, playing, add_glb, blob_puppet, take, tmp_path, commands):
    commands.run("bake", blob_puppet, "-o", tmp_path / "baked.glb", "--log", take).check_returncode()
    source, service = add_glb(tmp_path / "baked.glb"), playing(blob_puppet, take, "--morphs", tmp_path / "baked.glb")
    rig = load_rig(blob_puppet)
    count = len(rig.character.vertices)
    chosen = [0, count // 2, count - 1]
    settings = {"mode": MORPHS, "mesh_source": source}
    rest, samples = attach(service.port, count, *({"vertex": each} for each in chosen), **settings)
    imported = cKDTree(rest).query(rig.character.vertices)[1]  # the importer has an order of its own
    for sample in samples:
        for vertex, pose in zip(chosen, sample.poses, strict=True):
            assert_rigid(pose)
            away = pose[3] - sample.positions[imported[vertex]]
            assert np.abs(away).max() <= 1e-4 * rig.mesh.diagonal * sample.scale  # Godot's targets are compressed
    assert np.ptp([sample.poses for sample in samples], axis=0).max() > 0.01 * rig.mesh.diagonal


def test_handles_limbs_and_rotations(attach, playing, limbed_puppet, take):
    rig = load_rig(limbed_puppet)
    rest = rig.character.vertices
    attachments = [
        {"handle": "hump"},
        {"limb": "head"},
        {"limb": "left arm", "limb_position": 0.5},
        {"handle": "hump", "follow_rotation": False},
    ]
    _, samples = attach(playing(limbed_puppet, take).port, len(rest), *attachments)
    at_handle = np.linalg.norm(rest - np.array(rig.puppet.handle[0].position), axis=1).argmin()
    ends = {limb.name: (np.array(limb.points[0]), np.array(limb.points[-1])) for limb in rig.puppet.limb}
    points = ends["head"][1], (ends["left arm"][0] + ends["left arm"][1]) / 2
    for sample in samples:
        hump, head, arm, upright = sample.poses
        for pose in sample.poses:
            assert_rigid(pose)
        for pose in hump, upright:
            assert np.abs(pose[3] - sample.positions[at_handle]).max() <= ALIKE * rig.mesh.diagonal * sample.scale
        np.testing.assert_allclose(upright[:3], np.reshape(TURNED, (4, 3))[:3] / [[2], [2], [1]], atol=1e-5)
        for limb, point, pose in ("head", points[0], head), ("left arm", points[1], arm):
            along_x, along_y, along_z, expected = affine(rest, sample.positions, point)
            assert np.abs(pose[3] - expected).max() <= 1e-4 * rig.mesh.diagonal * sample.scale
            direction = (ends[limb][1] - ends[limb][0]) @ [along_x, along_y, along_z]
            assert pose[1] @ direction / np.linalg.norm(direction) > 0.9
    assert np.ptp([sample.poses[2] for sample in samples], axis=0).max() > 0.05


PICKED = """[gd_scene load_steps=3 format=3]
[ext_resource type="Script" path="res://addons/puppetline/puppet_3d.gd" id="1"]
[ext_resource type="Script" path="res://addons/puppetline/puppet_attachment_3d.gd" id="2"]
[node name="World" type="Node3D"]
[node name="Puppet" type="Node3D" parent="."]
script = ExtResource("1")
port = {port}
follow_root = false
[node name="Attachment" type="Node3D" parent="Puppet"]
script = ExtResource("2")
"""


@pytest.mark.slow
def test_a_vertex_is_picked_in_the_editor(drive_editor, playing, blob_puppet, take, tmp_path):
    scene = PICKED.format(port=playing(blob_puppet, take).port)
    before, picked, shown, undone = drive_editor("pick_vertex.gd", scene, PICTURE=str(tmp_path / "editor.png"))
    assert before == {"before": -1, "shown": True, "chosen": True}
    assert picked["picked"] == picked["expected"] >= 0
    assert picked["pressed"] is False
    assert shown["distance"] > 0.1
    assert undone == {"undone": -1}
