"""The command as a user runs it: exit codes, what is on which stream, and what is left in the folder."""

import json
import re
import shutil
import sys
import tomllib
from pathlib import Path

import click
import pytest

from engine_bridge.cli.main import COMMANDS, main

if not Path(sys.executable).with_name("puppetline").exists():
    pytest.skip("the command is not installed beside this Python", allow_module_level=True)


def names(folder):
    return {path.name for path in folder.iterdir()}


def test_exit_code_and_streams_of_a_process_are_those_of_the_command(run, stage):
    shown = run("inspect", "blob.glb", "--json")
    assert json.loads(shown.stdout)["kind"] == "character"
    assert shown.stderr == ""
    wrong = run("dance", code=2)
    assert wrong.stdout == ""
    assert wrong.stderr[:17] == "Usage: puppetline"
    bad = run("inspect", "none.glb", code=1)
    assert bad.stdout == ""
    assert bad.stderr[:12] == "puppetline: "
    assert bad.stderr.count("\n") == 1


def test_the_help_lists_every_command_and_a_misspelled_one_gets_a_suggestion(invoke):
    lines = invoke("--help").stdout.split("Commands:")[1].splitlines()
    assert [line.split()[0] for line in lines if line.strip()] == sorted(COMMANDS)
    shown = invoke(code=2)
    first = (shown.stdout + shown.stderr).split("First commands:")[1].split("Options:")[0]
    assert [line.split()[1] for line in first.splitlines() if line.strip()] == ["demo", "studio", "animate"]
    assert "'convert'" in invoke("conver", code=2).stderr


WRONG_USE = """
convert take.log                                                          → --output
convert take.log -o out.bvh --as morph                                    → --as
convert take.log --puppet blob.toml -o out.glb --fps 0                    → --fps
convert take.log --puppet blob.toml -o out.glb --targets none             → --targets
convert take.log --puppet blob.toml -o out.glb --as rig --targets 4       → --as morph
convert take.log --puppet blob.toml -o out.glb --rest-at nan              → --rest-at
convert take.log --puppet blob.toml -o out.glb --tolerance inf            → --tolerance
new blob.glb -o x.toml --handle head                                      → --handle
new blob.glb -o x.toml --handle nose=0,0,0 --handle nose=1,0,0            → --handle
demo dragon                                                               → dragon
demo dog --film                                                           → --film
rig blob.toml -o out.vrm --pose rest                                      → --pose rest
rig blob.toml -o out.vrm --keep-skin                                      → --keep-skin
rig blob.toml -o out.glb --keep-skin --pose t                             → --pose t
rig blob.toml -o out.glb --author Ada                                     → .vrm
film scene.toml -o film.glb --draft                                       → --draft
animate blob.glb take.log --targets 3 --as rig                            → --targets
align take.log -o two.toml                                                → recordings
batch take.log --puppet blob.toml -o out --shard 0/3                      → 0/3
batch take.log --puppet blob.toml -o out --shard 4/3                      → 4/3
batch take.log --puppet blob.toml -o out --targets 3 --as rig             → --targets
batch take.log -o out                                                     → --performer
batch take.log -o out --puppet blob.toml --performer bvh                  → --performer
batch take.log -o out --performer bvh --as rig                            → --as
serve                                                                     → --config
serve --config a.toml --puppet b.toml                                     → --puppet
serve --config a.toml --loop --port 0                                     → --loop, --port
serve --config a.toml --no-announce                                       → --announce/--no-announce
serve --puppet a.toml --osc nowhere                                       → HOST:PORT
serve --puppet a.toml --port 70000                                        → 70000
serve --puppet a.toml --people all                                        → 'all'
serve --puppet a.toml --origin http://localhost:8000                      → --websocket
serve --puppet a.toml --websocket 65536                                   → 65536
record --source osc:1                                                     → '-o'
look --source osc:1                                                       → --live
look --source osc:1 --live                                                → terminal
listen --seconds nan                                                      → --seconds
"""
"""Commands, and what their errors name."""


def told(table):
    """Return the lines of a table, each as the command's words and the parts of what is said."""
    lines = (line.split("→") for line in table.strip().splitlines())
    return [pytest.param(command.split(), parts.strip().split("; "), id=command.strip()) for command, parts in lines]


@pytest.mark.parametrize(("command", "named"), told(WRONG_USE))
def test_wrong_use_is_exit_code_2_with_the_usage_and_what_is_wrong(invoke, stage, tmp_path, command, named):
    before = names(tmp_path)
    result = invoke(*command, code=2)
    usage, _, error = result.stderr.partition("Error: ")
    assert result.stdout == ""
    assert usage[:17] == "Usage: puppetline"
    assert named[0] in " ".join(error.split())
    assert names(tmp_path) == before


@pytest.fixture
def faults(stage, tmp_path, limbed_puppet, blob_file):
    """Put files with mistakes beside the others."""
    whole = "1" + " 0.5" * 60 + "\n"
    (tmp_path / "bad.log").write_text(2 * whole + "6 0.1 0.2\n" + whole)
    (tmp_path / "bad.toml").write_text(stage.read_text().replace("gain = 0.8", "gian = 0.8", 1))
    (tmp_path / "scene.toml").write_text("[film]\ncolour = 1\n")
    shutil.copy(limbed_puppet, tmp_path / "figure.toml")
    shutil.copy(blob_file, tmp_path / blob_file.name)


UNUSABLE = """
convert bad.log --puppet blob.toml -o out.glb                             → bad.log; line 3 has 3 columns; CSV
convert take.log --puppet bad.toml -o out.glb                             → bad.toml, [[handle]] 3 'head', gian; 'gain'
convert take.log --puppet blob.toml -o no/out.glb                         → no/out.glb; mkdir -p no
convert take.log --puppet blob.toml -o blob.glb                           → blob.glb; an input file
convert take.log --puppet figure.toml -o take.vrm                         → take.vrma
convert take.log --puppet blob.toml -o out.glb --rest-at 100              → take.log; 100 s; --rest-at
animate take.log blob.glb                                                 → puppetline animate blob.glb take.log
animate blob.toml take.log                                                → convert take.log --puppet blob.toml
animate blob.glb take.log -o blob.glb                                     → blob.glb; an input file
animate blob.glb take.log --puppet-out blob.toml                          → blob.toml; --force
animate take.log take.log                                                 → a recording; MESH RECORDING
animate blob.glb take.log -o .                                            → a folder
nothing.glb                                                               → nothing.glb; no such file
rig blob.toml -o blob.vrm --name A --author A --licence https://a.b/      → no limb for hips; leftHand
film scene.toml -o film.mp4                                               → scene.toml, [film], colour
look --source osc:0 -o look.jpg                                           → look.jpg
serve --puppet blob.toml --source demo:walk --sound none.wav --port 0     → none.wav
serve --puppet blob.toml --source osc:0 --idle none.log --port 0          → none.log
serve --puppet blob.toml --source osc:0 --host 192.0.2.1 --port 0         → 192.0.2.1
serve --puppet blob.toml --source osc:0 --source osc:0 --port 0           → 2 times --source and 1 times --puppet
serve --puppet blob.toml --source osc:0 --osc no.invalid:7000 --port 0    → no.invalid
"""


@pytest.mark.parametrize(("command", "parts"), told(UNUSABLE))
def test_what_cannot_be_used_is_one_line_and_leaves_nothing(assert_refused, faults, command, parts):
    assert_refused(*command, *["--no-announce"] * (command[0] == "serve"), parts=parts)


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="no folder that refuses files")
def test_a_folder_that_takes_no_files_is_found_out_before_the_work(assert_refused, stage):
    assert_refused("convert", "take.log", "--puppet", stage, "-o", "/proc/out.glb", parts=["/proc/out.glb"])


def test_json_of_convert_is_json_and_nothing_else(invoke, stage):
    converted = invoke("convert", "take.log", "--puppet", stage, "-o", "out.glb", "--targets", "3", "--json")
    summary = json.loads(converted.stdout)
    assert summary["frames"] == 58
    assert summary["targets"] == 3
    assert summary["output"] == "out.glb"
    assert converted.stderr == ""


@pytest.mark.usefixtures("quick_pictures")
def test_new_makes_a_puppet_that_converts_right_away_and_is_not_overwritten(invoke, assert_refused, stage, tmp_path):
    made = invoke("new", "blob.glb", "-o", "made.toml", "--map", "head=hand_left,hand_right")
    assert made.stderr == ""
    assert made.stdout.startswith("made.toml: 6 limbs, shown in made.handles.png\n  Body plan 'upright'.")
    assert "  assumed: y looks like up: it stands\n" in made.stdout
    assert "  head             (turn)  ←  hand_left, hand_right\n" in made.stdout
    assert names(tmp_path) >= {"made.toml", "made.handles.png"}
    another = ("new", "blob.glb", "-o", "made.toml", "--handle", "crown=0,2.1,0.3", "--map", "crown=head")
    assert_refused(*another, parts=["made.toml", "--force"])
    assert "crown" in invoke(*another, "--force").stdout
    invoke("convert", "take.log", "--puppet", "made.toml", "-o", "out.glb")
    assert (tmp_path / "out.glb").stat().st_size > 10_000


@pytest.mark.usefixtures("quick_pictures", "stage")
def test_animate_is_new_and_convert_in_one_and_names_that_nobody_chose_replace_nothing(invoke, tmp_path):
    once = invoke("animate", "blob.glb", "take.log", "--puppet-out", "once.toml", "--front=-z", "--stop", "1")
    assert "contact sheet  blob_take.sheet.png\n  Body plan 'upright'." in once.stdout
    invoke("new", "blob.glb", "--front=-z", "--force")
    assert (tmp_path / "once.toml").read_bytes() == (tmp_path / "blob.toml").read_bytes()
    animated = (tmp_path / "blob_take.glb").read_bytes()
    converting = ("convert", "take.log", "--puppet", "blob.toml", "--stop", "1")
    assert "blob_take.glb" in invoke(*converting, code=1).stderr
    assert "blob_take.glb" in invoke("animate", "blob.glb", "take.log", code=1).stderr
    assert (tmp_path / "blob_take.glb").read_bytes() == animated
    (tmp_path / "blob_take.glb").write_bytes(b"")
    invoke(*converting, "--force")
    assert (tmp_path / "blob_take.glb").read_bytes() == animated


SERVICE = "[[stage]]\nsource = 'osc:7110'\ncharacter = [{ puppet = 'blob.toml' }]\n"

SUGGESTED = {
    "blob.glb": ["animate", "new", "studio", "rig", "inspect"],
    "take.log": ["animate", "convert", "look", "inspect"],
    "blob.toml": ["convert", "studio", "serve", "inspect"],
    "scene.toml": ["film", "inspect"],
    "service.toml": ["serve", "inspect"],
}
"""Commands that are suggested for a file."""


@pytest.mark.usefixtures("faults")
def test_a_file_alone_is_answered_with_commands_that_take_it(invoke, tmp_path):
    (tmp_path / "scene.toml").write_text("[[character]]\nname = 'a'\n")
    (tmp_path / "service.toml").write_text(SERVICE)
    for file, commands in SUGGESTED.items():
        suggested = [line.split("  ")[0].split()[1:] for line in invoke(file).stdout.splitlines()]
        assert [name for name, *_ in suggested] == commands
        assert all(file in line or f"replay:{file}" in line for line in suggested)
        for name, *arguments in suggested:  # the command takes these arguments
            command = main.get_command(click.Context(main), name)
            command.make_context(name, arguments)
    (tmp_path / "blob.glb").rename(tmp_path / "my blob.glb")
    assert invoke("take.log", "my blob.glb").stdout == "puppetline animate 'my blob.glb' take.log\n"


AXES = ("--up", "z", "--front=-y", "--scale", "0.01", "--preview", "look.png")


@pytest.mark.usefixtures("quick_pictures")
def test_new_takes_axes_scale_and_the_pictures_name(invoke, stage, tmp_path):
    before = names(tmp_path)
    made = invoke("new", "blob.glb", "-o", "made.toml", *AXES)
    assert "assumed" not in made.stdout
    assert names(tmp_path) == before | {"made.toml", "look.png"}
    table = tomllib.loads((tmp_path / "made.toml").read_text())["character"]
    assert table == {"mesh": "blob.glb", "up": "z", "front": "-y", "scale": 0.01}


def test_convert_prints_what_a_rig_and_a_vertex_cache_consist_of(invoke, stage):
    prepared = invoke("convert", "take.log", "--puppet", stage.name, "-o", "rig.glb", "--as", "rig")
    assert re.search(r"joints         \d+ animated, \d+ follow, of a new skeleton; largest error 0\.0", prepared.stdout)
    frames = invoke("convert", "take.log", "--puppet", stage.name, "-o", "frames.glb", "--as", "frames")
    assert "morph targets  58, one for each keyframe, exactly as solved" in frames.stdout
