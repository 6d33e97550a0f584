import igl
import numpy as np
import pytest

from capture.skeleton import JOINT_INDEX
from engine_bridge.inspection.files import inspect
from puppetline.errors import PuppetlineError

from ..refusals import refused


def test_a_puppet_is_described_with_all_values_including_defaults(blob_puppet):
    facts = inspect(blob_puppet)
    assert facts == facts | {
        "kind": "puppet",
        "character": "blob.glb",
        "mesh_found": True,
        "limbs": {},
        "root": {"joint": "hip_center", "axes": "xz", "turns": True, "feet": "lock", "walk": "in place"},
        "retarget": {"mirror": False, "scale": 1.3, "arm_space": 0.0, "hands_meet": True},
        "solver": {"fields": 5, "isolines": 6, "iterations": 4, "rotations": "automatic"},
    }
    assert {name: handle["joints"] for name, handle in facts["handles"].items()} == {
        "left hand": ["hand_left"],
        "right hand": ["hand_right", "wrist_right"],
        "head": ["head"],
        "left foot": [],
        "right foot": [],
    }
    assert facts["handles"]["head"] == {"position": [0.0, 2.1, 0.3], "joints": ["head"], "axes": "xz", "gain": 0.8}


def test_a_puppet_is_described_with_its_limbs_and_without_the_mesh_that_it_misses(limbed_puppet, tmp_path):
    alone = tmp_path / "alone.toml"
    alone.write_bytes(limbed_puppet.read_bytes())
    facts = inspect(alone)
    assert not facts["mesh_found"]
    trunk, head, *_ = facts["limbs"].values()
    assert list(facts["limbs"]) == ["trunk", "head", "left arm", "right arm", "left leg", "right leg"]
    assert trunk["parent"] is None
    assert head == {
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
    user, lost = facts["users"]["1"], (10 + 5 * 20) / 800
    assert (user["tracked_frames"], user["frames"]) == (35, 40)
    found = [user[name] for name in ("seconds", "frames_a_second", "joints_lost", "joints_tracked")]
    assert found == pytest.approx([39 / 30, 30, lost, 1 - lost], rel=1e-3)
    assert user["longest_gap_seconds"] == pytest.approx(1 / 30, abs=1e-4)


def test_a_character_is_described_with_its_render_mesh_and_solver_mesh_whatever_its_file_name(
    blob, blob_file, tmp_path
):
    facts = inspect(blob_file)
    counts = dict.fromkeys(("vertices", "solver_vertices"), len(blob.vertices))
    counts |= dict.fromkeys(("triangles", "solver_triangles"), len(blob.faces))
    about = {"kind": "character", "primitives": 1, "connected_parts": 1, "repairs": [], "animations": []}
    assert facts == facts | about | counts
    assert facts["diagonal"] == pytest.approx(blob.diagonal)
    np.testing.assert_allclose(facts["bounds"], [blob.vertices.min(axis=0), blob.vertices.max(axis=0)])
    assert facts["stands"]["up"] == "y"
    (tmp_path / "avatar.vrm").write_bytes(blob_file.read_bytes())
    assert inspect(tmp_path / "avatar.vrm") == facts


def test_parts_and_doubled_triangles_are_counted(blob, tmp_path):
    apart = np.concatenate([blob.vertices, blob.vertices + np.float32([10, 0, 0])]).astype(float)
    faces = np.concatenate([blob.faces, blob.faces + len(blob.vertices), blob.faces[:3]])
    igl.writeOFF(str(tmp_path / "two.off"), apart, faces)
    facts = inspect(tmp_path / "two.off")
    assert (facts["connected_parts"], facts["repairs"]) == (2, ["3 doubled faces are left out"])


def test_folders_and_unknown_kinds_of_files_are_refused(tmp_path):
    (tmp_path / "notes.txt").write_text("hello")
    for name, found in (("none", "no such file"), ("", "a folder"), ("notes.txt", "text with lines such as 'hello'")):
        error = refused(PuppetlineError, inspect, tmp_path / name)
        assert error.found == found
    assert all(kind in error.expected for kind in ("puppet", "recording", ".glb", ".obj"))
