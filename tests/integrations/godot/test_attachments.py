"""Nodes that are attached to a character: compared with the positions of all vertices in the same frames."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from engine_bridge.export.live_basis import LiveBasis

from ..stage import performed
from ..surface import assert_on_limb, assert_on_vertex, assert_rigid

CONTROLS, VERTICES, MORPHS = range(3)
SAMPLES = 20
ALIKE = 1e-5
"""Maximum difference of positions, relative to the diagonal."""

TURNED = [0.0, 1.2, 1.6, -2.0, 0.0, 0.0, 0.0, -0.8, 0.6, 3.0, -1.0, 2.0]
"""Columns and origin: rotated, and scaled by 2, 2 and 1."""

MIRRORED = [-1.5, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 3.0, 0.0, 1.0, 0.0]


@pytest.fixture
def attach(start_godot, tmp_path):
    """Attach nodes to a character; return its positions at rest and samples: poses of attachments (rows are axes and
    place), those in the character's own space, and all positions in both spaces."""

    def run(stage, *attachments, parent=TURNED, **puppet):
        stage.is_playing, file = True, tmp_path / "positions.bin"
        asked = {"puppet": {"port": stage.port, **puppet}, "parent": parent, "attachments": attachments}
        asked |= {"samples": SAMPLES, "apart": 6, "file": str(file)}
        told = start_godot("attach.gd", json.dumps(asked)).finish(120)
        assert [each["warnings"] for each in told[SAMPLES:]] == [[]] * len(attachments)
        stored = np.fromfile(file, "<f4").reshape(-1, 3).astype(float)
        rest, positions = np.split(stored, [-SAMPLES * len(stage.character.rest)])
        samples = []
        for each, local in zip(told[:SAMPLES], np.split(positions, SAMPLES), strict=True):
            *axes, origin = np.reshape(each["puppet"], (4, 3))
            poses, surface = (np.reshape(each[name], (-1, 4, 3)) for name in ("poses", "surface"))
            scale, world = np.linalg.norm(axes, axis=1).max(), local @ axes + origin
            samples.append(SimpleNamespace(poses=poses, surface=surface, local=local, world=world, scale=scale))
        moved = np.ptp([sample.poses for sample in samples], axis=0)
        assert moved[:, 3].max() > 0.01 * stage.diagonal
        assert moved[:, :3].max() > 0.05
        return rest, samples

    return run


@pytest.mark.parametrize("mode", [CONTROLS, VERTICES])
@pytest.mark.parametrize("parent", [TURNED, MIRRORED], ids=["turned", "mirrored"])
def test_they_lie_on_the_vertices(attach, stage, mode, parent):
    """A mirrored space turns triangles over."""
    count, triangles = len(stage.character.rest), stage.character.triangles
    chosen = [0, count // 3, count // 2, count - 1]
    tolerance, side = ALIKE * stage.diagonal, 1 if parent is TURNED else -1
    for sample in attach(stage, *({"vertex": each} for each in chosen), mode=mode, parent=parent)[1]:
        for vertex, pose, local in zip(chosen, sample.poses, sample.surface, strict=True):
            assert_on_vertex(pose, sample.world, triangles, vertex, tolerance * sample.scale, side)
            assert_on_vertex(local, sample.local, triangles, vertex, tolerance)


def test_morph_targets_carry_them_too(attach, new_stage, add_glb, blob_puppet, take, baked):
    stage = new_stage(performed(blob_puppet, take, basis=lambda prepared: LiveBasis.load(baked, prepared)))
    all_of_it = stage.character.rest
    chosen = [0, len(all_of_it) // 2, len(all_of_it) - 1]
    attachments = ({"vertex": each} for each in chosen)
    rest, samples = attach(stage, *attachments, mode=MORPHS, mesh_source=add_glb(baked))
    imported = cKDTree(rest).query(all_of_it)[1]  # the importer has an order of its own
    for sample in samples:
        for vertex, pose in zip(chosen, sample.poses, strict=True):
            assert_rigid(pose)
            away = pose[3] - sample.world[imported[vertex]]
            assert np.abs(away).max() <= 1e-4 * stage.diagonal * sample.scale  # Godot's targets are compressed


def test_handles_limbs_and_rotations(attach, new_stage, limbed_puppet, take):
    stage = new_stage(performed(limbed_puppet, take))
    rest, puppet = stage.character.rest, stage.character.prepared.puppet
    limbs = {limb.name: limb for limb in puppet.limb}
    at_handle = np.linalg.norm(rest - np.array(puppet.handle[0].position), axis=1).argmin()
    attachments = [
        {"handle": "hump"},
        {"limb": "head"},
        {"limb": "left arm", "limb_position": 0.5},
        {"handle": "hump", "follow_rotation": False},
    ]
    for sample in attach(stage, *attachments)[1]:
        hump, head, arm, upright = sample.poses
        for pose in sample.poses:
            assert_rigid(pose)
        for pose in hump, upright:
            assert np.abs(pose[3] - sample.world[at_handle]).max() <= ALIKE * stage.diagonal * sample.scale
        np.testing.assert_allclose(upright[:3], np.reshape(TURNED, (4, 3))[:3] / [[2], [2], [1]], atol=1e-5)
        for name, share, pose in ("head", 1.0, head), ("left arm", 0.5, arm):
            assert_on_limb(pose, rest, sample.world, limbs[name], share, 1e-4 * stage.diagonal * sample.scale)


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
def test_a_vertex_is_picked_in_the_editor(drive_editor, stage, tmp_path):
    stage.is_playing, scene = True, PICKED.format(port=stage.port)
    before, picked, shown, undone = drive_editor("pick_vertex.gd", scene, PICTURE=str(tmp_path / "editor.png"))
    assert before == {"before": -1, "shown": True, "chosen": True}
    assert picked["picked"] == picked["expected"] >= 0
    assert picked["pressed"] is False
    assert shown["distance"] > 0.1
    assert undone == {"undone": -1}
