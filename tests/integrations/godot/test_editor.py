"""Characters in Godot's editor, and recording them with its button."""

import pytest
from PIL import Image

from engine_bridge.export.shader_mesh import write_shader_mesh

from ..clips import clip_of
from ..stage import performed
from .test_clips import assert_recorded

pytestmark = pytest.mark.slow

EMPTY = """[gd_scene format=3]
[node name="World" type="Node3D"]
"""
WORLD = """[gd_scene load_steps=3 format=3]
[ext_resource type="Script" path="res://addons/puppetline/puppet_3d.gd" id="1"]
[ext_resource type="Resource" path="res://dance.clip" id="2"]
[node name="World" type="Node3D"]
[node name="Puppet" type="Node3D" parent="."]
script = ExtResource("1")
clip = ExtResource("2")
clip_speed = 0.0
"""
STAGE = """[gd_scene load_steps=3 format=3]
[ext_resource type="Script" path="res://addons/puppetline/puppet_3d.gd" id="1"]
[ext_resource type="Script" path="res://addons/puppetline/puppet_recorder.gd" id="2"]
[node name="World" type="Node3D"]
[node name="Puppet" type="Node3D" parent="."]
script = ExtResource("1")
port = {port}
[node name="Recorder" type="Node" parent="Puppet"]
script = ExtResource("2")
path = "res://dance.res"
"""


def test_a_click_selects_the_character(run_editor, drive_editor, project, take, limbed_puppet, tmp_path):
    (project / "dance.clip").write_bytes(clip_of(performed(limbed_puppet, take)))
    run_editor(120)  # imports it
    picture = tmp_path / "editor.png"
    told = drive_editor("click_puppet.gd", WORLD, PICTURE=str(picture))
    assert told == [{"before": []}, {"clicked": ["Puppet"]}, {"beside": []}]
    assert Image.open(picture).size == (1600, 1000)


def test_a_dropped_shader_mesh_becomes_a_character(add_glb, drive_editor, project, limbed_puppet, tmp_path):
    glb = tmp_path / "figure.shader.glb"
    write_shader_mesh(limbed_puppet, glb)
    add_glb(glb)
    picture = tmp_path / "editor.png"
    told = drive_editor("drop_file.gd", EMPTY, PICTURE=str(picture))
    shown, plain = (told[1]["dropped"][0][0], "figure"), told[2]["undone"][0]
    assert [{when: [tuple(node) for node in nodes] for when, nodes in each.items()} for each in told] == [
        {"before": []},
        {"dropped": [shown]},
        {"undone": [(plain[0], None)]},
        {"undone again": []},
        {"redone": [shown]},
    ]
    scene = (project / "world.tscn").read_text()
    assert "puppet_3d.gd" in scene
    assert "figure.shader.glb" in scene
    assert "ArrayMesh" not in scene
    assert Image.open(picture).size == (1600, 1000)


def test_the_button_records_a_clip(drive_editor, start_godot, stage, tmp_path):
    stage.is_playing, picture = True, tmp_path / "editor.png"
    told = drive_editor("press_record.gd", STAGE.format(port=stage.port), PICTURE=str(picture))
    frames = [each["frame"] for each in told if "frame" in each]
    [moments] = [each["moments"] for each in told if "moments" in each]
    assert len(frames) == len(moments)
    assert [each for each in told if not each.keys() & {"frame", "moments"}] == [
        {"visible": True, "text": "Record Clip"},
        {"pressed": True, "timed": True},
        {"saved": "res://dance.res", "problem": "", "listed": "Resource"},
        {"pressed": False, "text": "Record Clip"},
        {"visible": False},
    ]
    assert Image.open(picture).size == (1600, 1000)
    stage.close()
    _, *played = start_godot("play_clip.gd", "res://dance.res", *moments[::10]).finish()
    assert_recorded(played, moments[::10], stage, frames[::10])
