import json

import igl
import numpy as np
import pytest

from capture.skeleton import JOINT_INDEX
from engine_bridge.inspection.files import inspect
from puppetline.errors import PuppetlineError


def test_a_puppet_is_described_with_all_values_including_defaults(blob_puppet):
    facts = inspect(blob_puppet)
    assert facts["kind"] == "puppet"
    assert facts["character"] == "blob.glb"
    assert facts["mesh_found"]
    assert list(facts["handles"]) == ["left hand", "right hand", "head", "left foot", "right foot"]
    assert facts["handles"]["head"] == {"position": [0.0, 2.1, 0.3], "joints": ["head"], "axes": "xz", "gain": 0.8}
    assert facts["handles"]["right hand"]["joints"] == ["hand_right", "wrist_right"]
    assert facts["handles"]["left foot"]["joints"] == []
    assert facts["limbs"] == {}
    assert facts["root"] == {"joint": "hip_center", "axes": "xz", "turns": True, "feet": "lock", "walk": "in place"}
    assert facts["retarget"] == {"mirror": False, "scale": 1.3, "arm_space": 0.0, "hands_meet": True}
    assert facts["solver"] == {"fields": 5, "isolines": 6, "iterations": 4, "rotations": "automatic"}
    assert json.loads(json.dumps(facts)) == facts


def test_a_puppet_is_described_with_its_limbs_and_without_the_mesh_that_it_misses(limbed_puppet, tmp_path):
    alone = tmp_path / "alone.toml"
    alone.write_bytes(limbed_puppet.read_bytes())
    facts = inspect(alone)
    assert not facts["mesh_found"]
    limbs = facts["limbs"]
    assert list(limbs) == ["trunk", "head", "left arm", "right arm", "left leg", "right leg"]
    assert limbs["trunk"]["parent"] is None
    assert limbs["head"] == {
        "nodes": None,
        "points": [[0.0, 1.25, 0.0], [0.0, 1.9, 0.25]],
        "joints": [["shoulder_center"], ["head"]],
        "follow": "direction",
        "gain": 1.0,
        "parent": "trunk",
    }


def test_a_recording_is_described_with_performers_rates_gaps_and_losses(record, dance, tmp_path):
    positions = dance(40)
    positions[:10, JOINT_INDEX["foot_left"]] = np.nan
    positions[20:25] = np.nan
    facts = inspect(record(tmp_path / "a.log", positions))
    assert (facts["kind"], facts["format"]) == ("log", "Puppetline's own recordings")
    user = facts["users"]["1"]
    assert user["tracked_frames"] == 35
    assert user["frames"] == 40
    assert user["seconds"] == pytest.approx(39 / 30)
    assert user["frames_a_second"] == pytest.approx(30, rel=1e-3)
    assert user["longest_gap_seconds"] == pytest.approx(1 / 30, abs=1e-4)
    assert user["joints_lost"] == pytest.approx((10 + 5 * 20) / 800)
    assert user["joints_tracked"] == pytest.approx(1 - (10 + 5 * 20) / 800)
    assert json.loads(json.dumps(facts)) == facts


def test_a_character_is_described_with_its_render_mesh_and_solver_mesh(blob, blob_file):
    facts = inspect(blob_file)
    assert facts["kind"] == "character"
    assert (facts["vertices"], facts["triangles"], facts["primitives"]) == (len(blob.vertices), len(blob.faces), 1)
    assert (facts["solver_vertices"], facts["solver_triangles"]) == (len(blob.vertices), len(blob.faces))
    assert (facts["connected_parts"], facts["repairs"]) == (1, [])
    assert facts["diagonal"] == pytest.approx(blob.diagonal)
    np.testing.assert_allclose(facts["bounds"], [blob.vertices.min(axis=0), blob.vertices.max(axis=0)])
    assert facts["animations"] == []
    assert facts["stands"]["up"] == "y"
    assert json.loads(json.dumps(facts)) == facts


def test_parts_and_doubled_triangles_are_counted(blob, tmp_path):
    apart = np.concatenate([blob.vertices, blob.vertices + np.float32([10, 0, 0])]).astype(float)
    faces = np.concatenate([blob.faces, blob.faces + len(blob.vertices), blob.faces[:3]])
    igl.writeOFF(str(tmp_path / "two.off"), apart, faces)
    facts = inspect(tmp_path / "two.off")
    assert facts["connected_parts"] == 2
    assert facts["repairs"] == ["3 doubled faces are left out"]


def test_folders_and_unknown_kinds_of_files_are_refused(tmp_path):
    (tmp_path / "notes.txt").write_text("hello")
    for name, found in (("none", "no such file"), ("", "a folder"), ("notes.txt", "text with lines such as 'hello'")):
        with pytest.raises(PuppetlineError) as error:
            inspect(tmp_path / name)
        assert error.value.found == found
    assert all(kind in error.value.expected for kind in ("puppet", "recording", ".glb", ".obj"))


def test_a_character_is_recognised_whatever_its_file_name(blob_file, tmp_path):
    (tmp_path / "avatar.vrm").write_bytes(blob_file.read_bytes())
    assert inspect(tmp_path / "avatar.vrm") == inspect(blob_file)
