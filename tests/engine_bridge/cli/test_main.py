"""The command as a user runs it: processes, exit codes, and what is on which stream."""

import json
import os
import pty
import re
import select
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from engine_bridge.cli.main import COMMANDS, main

COMMAND = str(Path(sys.executable).with_name("puppetline"))

if not Path(COMMAND).exists():
    pytest.skip("the command is not installed beside this Python", allow_module_level=True)


@pytest.fixture
def invoke(tmp_path, monkeypatch):
    """Run the command in an empty folder and in this process; what a process adds are tests of their own."""
    monkeypatch.chdir(tmp_path)

    def start(*arguments):
        result = CliRunner().invoke(main, [*map(str, arguments)], prog_name="puppetline")
        assert result.exception is None or isinstance(result.exception, SystemExit)
        return SimpleNamespace(returncode=result.exit_code, stdout=result.stdout, stderr=result.stderr)

    return start


@pytest.fixture
def stage(tmp_path, take, blob_file, write_puppet):
    """Put a log, a mesh and a puppet file into the folder."""
    shutil.copy(take, tmp_path / "take.log")
    shutil.copy(blob_file, tmp_path / "blob.glb")
    return write_puppet(tmp_path / "blob.toml", "blob.glb")


@pytest.fixture(scope="module")
def long_take(record, dance, tmp_path_factory):
    """A recording whose conversion takes some seconds."""
    return record(tmp_path_factory.mktemp("long") / "long.log", np.tile(dance(), (500, 1, 1)))


def names(folder):
    return {path.name for path in folder.iterdir()}


def assert_one_line(result, *parts):
    """Assert that a command printed one line on standard error and nothing else."""
    assert result.stdout == ""
    assert result.stderr.startswith("puppetline: ")
    assert (result.stderr.count("\n"), result.stderr[-1]) == (1, "\n")
    assert "internal error" not in result.stderr
    for part in parts:
        assert part in result.stderr


@pytest.fixture
def assert_refused(invoke, tmp_path):
    """Assert that a command prints one line with some parts, fails, and changes no name in the folder."""

    def check(*arguments, parts):
        before = names(tmp_path)
        result = invoke(*arguments)
        assert result.returncode == 1
        assert_one_line(result, *parts)
        assert names(tmp_path) == before

    return check


def test_exit_code_and_streams_of_a_process_are_those_of_the_command(commands, tmp_path, stage):
    """Right use, wrong use, and an error of a file."""
    shown, wrong, bad = (
        commands.run(*arguments, cwd=tmp_path)
        for arguments in (["inspect", "blob.glb", "--json"], ["dance"], ["inspect", "none.glb"])
    )
    assert (shown.returncode, shown.stderr) == (0, "")
    assert json.loads(shown.stdout)["kind"] == "character"
    assert (wrong.returncode, wrong.stdout) == (2, "")
    assert wrong.stderr.startswith("Usage: puppetline")
    assert bad.returncode == 1
    assert_one_line(bad, "none.glb")


@pytest.mark.parametrize("command", [[], *([command] for command in COMMANDS)], ids=lambda c: " ".join(c) or "all")
def test_help_of_every_command_is_there(invoke, command):
    result = invoke(*command, "--help")
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout.startswith(f"Usage: puppetline {' '.join(command)}".rstrip())


def test_the_help_lists_every_command(invoke):
    lines = invoke("--help").stdout.split("Commands:")[1].splitlines()
    assert [line.split()[0] for line in lines if line.strip()] == sorted(COMMANDS)


def test_without_a_command_the_first_ones_are_shown(invoke):
    shown = invoke()
    first = (shown.stdout + shown.stderr).split("First commands:")[1].split("Options:")[0]
    assert [line.split()[1] for line in first.splitlines() if line.strip()] == ["demo", "studio", "new"]


def test_a_misspelled_command_gets_a_suggestion(invoke):
    assert "No such command 'conver'. Did you mean 'convert'?" in invoke("conver").stderr


def test_a_command_imports_no_other_command():
    modules = [f"engine_bridge.cli.{name.replace('-', '_')}" for name in COMMANDS]
    program = (
        f"import sys; from engine_bridge.cli.main import main; main.get_command(None, 'inspect'); "
        f"print([name for name in {modules} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "['engine_bridge.cli.inspect']"


@pytest.mark.parametrize(
    "arguments",
    [
        ["convert", "take.log"],
        ["convert", "take.log", "-o", "out.bvh", "--as", "morph"],
        ["convert", "take.log", "--puppet", "blob.toml", "-o", "out.glb", "--fps", "0"],
        ["convert", "take.log", "--puppet", "blob.toml", "-o", "out.glb", "--targets", "none"],
        ["new", "blob.glb", "-o", "x.toml", "--handle", "head"],
        ["demo", "dragon"],
    ],
    ids=" ".join,
)
def test_wrong_use_is_exit_code_2_with_the_usage(invoke, stage, tmp_path, arguments):
    before = names(tmp_path)
    result = invoke(*arguments)
    assert (result.returncode, result.stdout) == (2, "")
    assert result.stderr.startswith("Usage: puppetline")
    assert "Traceback" not in result.stderr
    assert names(tmp_path) == before


def test_a_bad_log_is_one_line_and_leaves_nothing(assert_refused, stage, tmp_path):
    whole = "1" + " 0.5" * 60 + "\n"
    (tmp_path / "bad.log").write_text(2 * whole + "6 0.1 0.2\n" + whole)
    parts = ["bad.log, line 3", "3 columns", "61 columns"]
    assert_refused("convert", "bad.log", "--puppet", stage, "-o", "out.glb", parts=parts)


def test_a_bad_puppet_is_one_line_and_leaves_nothing(assert_refused, stage):
    stage.write_text(stage.read_text().replace("gain = 0.8", "gian = 0.8", 1))
    parts = ["blob.toml, [[handle]] 3 'head', gian", "Did you mean 'gain'?"]
    assert_refused("convert", "take.log", "--puppet", stage, "-o", "out.glb", parts=parts)


@pytest.mark.parametrize(
    ("output", "parts"),
    [
        ("no/out.glb", ["no/out.glb", "no folder no", "mkdir -p no"]),
        (".", ["a folder", "Add a file name"]),
        pytest.param(
            "/proc/out.glb",
            ["/proc/out.glb", "cannot be written"],
            marks=pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="no folder that refuses files"),
        ),
    ],
)
def test_a_bad_output_is_one_line_before_any_work(assert_refused, stage, output, parts):
    assert_refused("convert", "take.log", "--puppet", stage, "-o", output, parts=parts)


@pytest.mark.parametrize(
    "arguments",
    [
        ["convert", "none.log", "--puppet", "blob.toml", "-o", "out.glb"],
        ["convert", "take.log", "--puppet", "none.toml", "-o", "out.glb"],
        ["studio", "--no-browser", "--port", "0", "--sound", "none.wav"],
        ["serve", "--puppet", "blob.toml", "--source", "demo:walk", "--port", "0", "--sound", "none.wav"],
    ],
    ids=" ".join,
)
def test_a_file_that_is_not_there_is_one_line(assert_refused, stage, arguments):
    assert_refused(*arguments, parts=["none."])


def test_convert_prints_what_a_rig_and_a_vertex_cache_consist_of(invoke, stage):
    rig = invoke("convert", "take.log", "--puppet", stage.name, "-o", "rig.glb", "--as", "rig")
    assert re.search(r"joints         \d+ animated, \d+ follow, of a new skeleton; largest error 0\.0", rig.stdout)
    frames = invoke("convert", "take.log", "--puppet", stage.name, "-o", "frames.glb", "--as", "frames")
    assert "morph targets  58, one for each keyframe, exactly as solved" in frames.stdout


def test_an_option_of_another_form_is_refused():
    result = CliRunner().invoke(main, ["convert", "x", "--puppet", "x", "-o", "x", "--as", "rig", "--targets", "4"])
    assert result.exit_code == 2
    assert "--targets requires --as morph." in result.output


def test_json_of_convert_and_inspect_is_json_and_nothing_else(invoke, stage):
    converted = invoke("convert", "take.log", "--puppet", stage, "-o", "out.glb", "--targets", "3", "--json")
    assert (converted.returncode, converted.stderr) == (0, "")
    summary = json.loads(converted.stdout)
    assert (summary["frames"], summary["targets"], summary["output"]) == (58, 3, "out.glb")
    for file, kind in (("out.glb", "character"), ("take.log", "log"), ("blob.toml", "puppet")):
        result = invoke("inspect", file, "--json")
        assert (result.returncode, result.stderr) == (0, "")
        assert json.loads(result.stdout)["kind"] == kind


def test_an_avatar_is_rigged_and_has_no_animation(invoke, assert_refused, stage, limbed_puppet, blob_file, tmp_path):
    shutil.copy(limbed_puppet, tmp_path / "figure.toml")
    shutil.copy(blob_file, tmp_path / blob_file.name)
    stated = ("--name", "Figure", "--author", "Ada", "--licence", "https://vrm.dev/licenses/1.0/")
    made = invoke("rig", "figure.toml", "-o", "figure.vrm", *stated)
    assert (made.returncode, made.stderr) == (0, "")
    assert made.stdout.startswith("figure.vrm: ")
    assert_refused("rig", "blob.toml", "-o", "blob.vrm", *stated, parts=["no limb for hips", "leftHand"])
    assert_refused("rig", "figure.toml", "-o", "none.vrm", parts=["[vrm]", "--licence"])
    assert_refused("convert", "take.log", "--puppet", "figure.toml", "-o", "take.vrm", parts=["take.vrma"])
    wrong = invoke("rig", "figure.toml", "-o", "figure.glb", *stated)
    assert wrong.returncode == 2
    assert "require -o CHARACTER.vrm" in wrong.stderr


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("-o", "out.vrm", "--pose", "rest"), "--pose rest requires a .glb"),
        (("-o", "out.vrm", "--keep-skin"), "--keep-skin cannot be combined with a .vrm"),
        (("-o", "out.glb", "--keep-skin", "--pose", "t"), "--keep-skin cannot be combined with --pose t"),
    ],
)
def test_rig_refuses_options_that_it_could_not_follow(options, message):
    refused = CliRunner().invoke(main, ["rig", __file__, *options])
    assert refused.exit_code == 2
    assert message in " ".join(refused.output.split())


def test_new_makes_a_puppet_that_converts_right_away_and_is_not_overwritten(invoke, stage, tmp_path):
    made = invoke("new", "blob.glb", "-o", "made.toml", "--map", "head=hand_left,hand_right")
    assert (made.returncode, made.stderr) == (0, "")
    assert made.stdout.startswith(
        "made.toml: 6 limbs, shown in made.handles.png\n"
        "  Body plan 'upright'. Two legs and an upright body: limbs point as the performer's do.\n"
        "  assumed: y looks like up: it stands\n"
    )
    assert "  head             (turn)  ←  hand_left, hand_right\n" in made.stdout
    assert names(tmp_path) >= {"made.toml", "made.handles.png"}
    assert invoke("convert", "take.log", "--puppet", "made.toml", "-o", "out.glb").returncode == 0
    assert (tmp_path / "out.glb").stat().st_size > 10_000

    first = (tmp_path / "made.toml").read_bytes()
    another = ("new", "blob.glb", "-o", "made.toml", "--handle", "crown=0,2.1,0.3", "--map", "crown=head")
    again = invoke(*another)
    assert (again.returncode, again.stdout) == (1, "")
    assert again.stderr == (
        "puppetline: made.toml: found an existing file; expected a new name. Choose another name, or replace it with "
        "--force.\n"
    )
    assert (tmp_path / "made.toml").read_bytes() == first
    forced = invoke(*another, "--force")
    assert (forced.returncode, forced.stderr) == (0, "")
    assert "crown" in forced.stdout
    assert invoke("convert", "take.log", "--puppet", "made.toml", "-o", "out.glb").returncode == 0


def test_new_says_how_a_recording_is_converted(assert_refused, stage):
    assert_refused("new", "take.log", "-o", "made.toml", parts=["a recording", "puppetline convert"])


def test_new_takes_axes_scale_and_the_pictures_name(invoke, assert_refused, stage, tmp_path):
    before = names(tmp_path)
    options = ["--up", "z", "--front=-y", "--scale", "0.01", "--preview", "look.png"]
    made = invoke("new", "blob.glb", "-o", "made.toml", *options)
    assert (made.returncode, made.stderr) == (0, "")
    assert "assumed" not in made.stdout
    assert names(tmp_path) == before | {"made.toml", "look.png"}
    table = tomllib.loads((tmp_path / "made.toml").read_text())["character"]
    assert table == {"mesh": "blob.glb", "up": "z", "front": "-y", "scale": 0.01}
    assert_refused("new", "blob.glb", "-o", "other.toml", "--preview", "look.jpg", parts=["look.jpg"])


def drain(terminal, process, seconds=60):
    """Read what a process writes to its terminal until it ends."""
    text, end = b"", time.monotonic() + seconds
    while time.monotonic() < end:
        if select.select([terminal], [], [], 0.1)[0]:
            try:
                text += os.read(terminal, 65536)
            except OSError:  # Linux's way to say that the other end is closed
                break
        elif process.poll() is not None:
            break
    return text.decode()


def test_progress_is_on_the_terminal_and_the_standard_output_stays_clean(commands, stage, tmp_path):
    terminal, other = pty.openpty()
    command = ["convert", "take.log", "--puppet", stage, "-o", "out.glb", "--preview", "out.png"]
    before = names(tmp_path)
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "100"}
    with commands.start(*command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=other, env=environment) as process:
        os.close(other)
        shown = drain(terminal, process)
        output = process.stdout.read()
    os.close(terminal)
    assert process.returncode == 0
    assert "Fitting morph targets" in shown
    assert "100%" in shown
    assert output.startswith("out.glb: 58 frames, 1.9 s, ")
    assert "\x1b" not in output
    assert names(tmp_path) == before | {"out.glb", "out.png"}


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.0, 0.7])
def test_an_interrupt_ends_quickly_and_leaves_no_partial_file(commands, stage, long_take, tmp_path, delay):
    (tmp_path / "out.glb").write_text("old")
    before = names(tmp_path)
    terminal, other = pty.openpty()
    command = ["convert", long_take, "--puppet", stage, "-o", "out.glb"]
    with commands.start(*command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=other) as process:
        os.close(other)
        select.select([terminal], [], [], 60)  # the first sign of progress
        time.sleep(delay)
        assert process.poll() is None
        process.send_signal(signal.SIGINT)
        shown = drain(terminal, process, 20)
        assert process.wait(timeout=20) not in (0, None)
        assert process.stdout.read() == ""
    os.close(terminal)
    assert "Traceback" not in shown
    assert names(tmp_path) == before
    assert (tmp_path / "out.glb").read_text() == "old"


@pytest.mark.parametrize("option", ["--fps", "--rest-at", "--max-gap", "--tolerance"])
@pytest.mark.parametrize("value", ["nan", "inf"])
def test_a_number_that_is_none_is_wrong_use(option, value):
    arguments = ["convert", "take.log", "--puppet", "blob.toml", "-o", "out.glb", option, value]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 2
    assert option in result.output


def test_a_result_never_replaces_what_it_is_made_from(assert_refused, stage, tmp_path):
    before = (tmp_path / "blob.glb").read_bytes()
    assert_refused("convert", "take.log", "--puppet", stage, "-o", "blob.glb", parts=["blob.glb", "an input file"])
    assert (tmp_path / "blob.glb").read_bytes() == before


def test_a_rest_pose_after_the_end_of_the_log_is_refused(assert_refused, stage):
    parts = ["take.log", "the rest pose, 100 s", "--rest-at"]
    assert_refused("convert", "take.log", "--puppet", stage, "-o", "out.glb", "--rest-at", "100", parts=parts)


def test_handles_given_twice_are_wrong_use(tmp_path):
    twice = ["--handle", "nose=0,0,0", "--handle", "nose=1,0,0"]
    result = CliRunner().invoke(main, ["new", "blob.glb", "-o", str(tmp_path / "x.toml"), *twice])
    assert result.exit_code == 2
    assert "each name once" in result.output
