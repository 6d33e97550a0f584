import json
import subprocess

import numpy as np
import pytest
from numpy.testing import assert_allclose

from capture.formats.bvh import motion_of
from capture.formats.bvh_parser import parse
from engine_bridge.export.performer.bvh import UNITS_PER_METRE, write_bvh

METRES = 1e-5
"""Largest difference of a joint's position, which other programs read."""

BLENDER = """
import json, sys, bpy
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_anim.bvh(filepath=sys.argv[1], global_scale=0.01, update_scene_fps=True, update_scene_duration=True)
(armature,) = bpy.data.objects
frames = []
for frame in range(1, bpy.context.scene.frame_end + 1, 25):
    bpy.context.scene.frame_set(frame)
    frames.append({b.name: list(armature.matrix_world @ b.head) for b in armature.pose.bones})
json.dump(frames, open(sys.argv[2], "w"))
"""


@pytest.fixture(scope="module")
def path(motion, tmp_path_factory):
    path = tmp_path_factory.mktemp("bvh") / "kung_fu.bvh"
    write_bvh(path, motion)
    return path


def test_joint_positions_are_equal_when_the_file_is_read_back(path, places):
    nodes, motion, frame_time, _ = parse(path, None)
    positions = motion_of(nodes, motion).positions
    assert frame_time == pytest.approx(1 / 30)
    for node, found in zip(nodes, positions, strict=True):
        name = node.name or f"{nodes[node.parent].name}_end"
        assert_allclose(found / UNITS_PER_METRE, places[name], rtol=0, atol=METRES)


def test_angles_do_not_jump(path):
    _, values, _, _ = parse(path, None)
    assert np.abs(np.diff(values[:, 3:], axis=0)).max() < 180


@pytest.mark.slow
def test_blender_reads_the_same_positions(path, places, players, tmp_path):
    command = players.commands()["Blender"]
    if command is None:
        pytest.skip("bpy is not installed (make peers)")
    (tmp_path / "script.py").write_text(BLENDER)
    subprocess.run([command[0], tmp_path / "script.py", path, tmp_path / "out.json"], check=True, capture_output=True)
    frames = json.loads((tmp_path / "out.json").read_text())
    assert len(frames) == 13
    for number, frame in enumerate(frames):
        for name, (x, y, z) in frame.items():
            assert_allclose([x, z, -y], places[name][25 * number], rtol=0, atol=METRES)
