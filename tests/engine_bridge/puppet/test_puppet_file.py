import re
import tomllib

import pytest

from engine_bridge.puppet import puppet_file
from engine_bridge.puppet.puppet import Puppet
from puppetline.errors import PuppetError
from puppetline.toml_schema import Table

from ..refusals import refused
from .test_puppet import CHARACTER, PUPPET

WHOLE = r"""
[character]
mesh = "a \"dog\" \\ \u0007 é 🐕.glb"
body = 2
up = "-z"
front = "x"
turn = -30.5
scale = 1e-300

[[limb]]
name = "trunk"
points = [[0.1, -1e9, 0.0], [0.0, 1.0, 0.30000000000000004]]
joints = ["hip_center", ["spine", "shoulder_center"]]
follow = "turn"
gain = -0.5

[[limb]]
name = "tail's end"
nodes = ["Tail.001", "#7"]
points = [[0.0, 1.0, 0.0], [0.0, 2.0, 0.0]]
joints = ["spine", "head"]
parent = "trunk"
stands = true
delay = 0.25
bend = {channel = "voice", degrees = -180.0, axis = "-y"}

[[handle]]
name = "\ttail"
position = [1.0, -2.5, 3e-7]
joint = "head"
axes = ""
gain = 1e9

[[handle]]
name = "ear"
position = [0.0, 0.0, 0.0]
joints = ["hand_left", "hand_right"]
channel = "voice"
moves = [0.0, 0.0, 0.4]

[[morph]]
target = "jawOpen"
channel = "mouth_open"
gain = 0.5

[[channel]]
name = "smile"
neutral = 0.1
full = -1e9

[root]
joint = "head"
axes = "y"
turns = false
feet = "free"
walk = "forward"

[retarget]
mirror = true
scale = 1e-300
arm_space = -90.0
hands_meet = false

[smoothing]
alpha = 1e-9
gamma = 1.0
jitter_radius = 1e9
max_deviation = inf
prediction = 2.5

[solver]
fields = 64
isolines = 2
iterations = 1000
rotations = "covariance"

[vrm]
name = "Ada"
authors = ["Ben", "Cleo"]
licence = "https://creativecommons.org/licenses/by/4.0/"
version = "2"
"""
"""A puppet with a value of its own for every key."""


def test_a_puppet_that_is_written_and_read_again_is_the_same(tmp_path):
    made = puppet_file.loads(WHOLE, "a.toml")
    puppet_file.dump(made, tmp_path / "made.toml")
    assert puppet_file.load(tmp_path / "made.toml") == made
    written = (tmp_path / "made.toml").read_text(encoding="utf-8")
    assert tomllib.loads(written) == tomllib.loads(WHOLE)
    assert re.findall(r"[^\n]\n\[+\w+\]", written) == []  # a blank line precedes each table


def test_the_puppet_above_has_every_key_of_a_file():
    """A key that is new needs a value there."""
    keys, tables = set(re.findall(r"(\w+) = ", WHOLE)), [Puppet, *Table.__subclasses__()]
    assert {key for table in tables if table.__module__ == Puppet.__module__ for key in table.model_fields} == keys | {
        *("character", "limb", "handle", "morph", "channel", "root", "retarget", "smoothing", "solver", "vrm")
    }


def test_a_root_is_written_as_a_whole():
    made = puppet_file.loads(PUPPET + "[root]\n", "a.toml")
    assert tomllib.loads(puppet_file.dumps(made))["root"] == {"joint": "hip_center", "axes": "xz"}


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (CHARACTER + "[[handle]]\nname = tail\n", 4),
        ('[character]\nmesh = "dog.glb\n', 2),
        (CHARACTER + 'mesh = "cat.glb"\n', 3),
        (PUPPET + CHARACTER, 6),
    ],
)
def test_a_syntax_error_is_named_with_its_line(content, line):
    error = refused(PuppetError, puppet_file.loads, content, "dog.toml")
    assert error.where == "dog.toml"
    assert f"line {line}, column" in error.found


def test_a_file_that_is_a_mesh_or_no_text_or_not_there_or_nested_without_end_is_refused(blob_file, tmp_path):
    binary, deep = tmp_path / "binary.toml", tmp_path / "deep.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    deep.write_text("x = " + "[" * 50_000)
    for path in (binary, deep, tmp_path / "none.toml", tmp_path, blob_file):
        error = refused(PuppetError, puppet_file.load, path)
        assert error.where == str(path)
    assert f"puppetline new {blob_file}" in error.fix
