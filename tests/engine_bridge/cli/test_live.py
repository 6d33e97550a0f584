"""The commands of the live service as a user runs them."""

import json
import os
import signal
import socket
import stat
import subprocess
import sys
import threading
from contextlib import contextmanager
from itertools import cycle

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from capture.formats import read_log
from capture.recording import Recorder
from capture.trackers.mediapipe import LANDMARK_WEIGHTS
from engine_bridge.cli.checks.finding import Finding
from engine_bridge.cli.main import main
from engine_bridge.pictures.source_view import PANEL_HEIGHT, PERFORMER_COLORS

from ...terminal import Terminal

pytestmark = pytest.mark.slow


@pytest.fixture
def run(tmp_path, commands):
    def start(*arguments, code=0):
        result = commands.run(*arguments, cwd=tmp_path, env=os.environ | {"XDG_STATE_HOME": str(tmp_path / "state")})
        assert result.returncode == code, result.stderr
        return result

    return start


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["serve"], "Give --puppet or --config."),
        (["serve", "--config", "a.toml", "--puppet", "b.toml"], "--config cannot be combined"),
        (["serve", "--puppet", "a.toml", "--osc", "nowhere"], "--osc requires HOST:PORT"),
        (["serve", "--puppet", "a.toml", "--port", "70000"], "70000"),
        (["serve", "--puppet", "a.toml", "--people", "all"], "'all'"),
        (["record", "--source", "osc:1"], "Missing option '-o'"),
        (["look", "--source", "osc:1"], "Give -o, --live, or both."),
        (["look", "--source", "osc:1", "--live"], "--live requires a terminal"),
        (["listen", "--seconds", "nan"], "not a finite number"),
    ],
)
def test_wrong_use_is_told(arguments, message):
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 2
    assert message in result.output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--source", "osc:99999"], "expected PORT, HOST or HOST:PORT"),
        (["--source", "tv:1"], "found the scheme 'tv'; expected one of demo, replay, osc, vmc, "),
        (["--source", "demo:dance"], "found no example motion 'dance'"),
        (["--source", "replay:none.log"], "none.log"),
        (["--source", "osc:0", "--idle", "none.log"], "none.log"),
        (["--source", "osc:0", "--morphs", "none.glb"], "none.glb"),
        (["--source", "osc:0", "--host", "192.0.2.1"], "192.0.2.1"),
        (["--source", "osc:0", "--token-file", "none"], "none"),
        (["--source", "osc:0", "--source", "osc:0"], "2 times --source and 1 times --puppet"),
        (["--source", "osc:0", "--osc", "no.such.host.invalid:7000"], "no.such.host.invalid"),
    ],
)
def test_what_cannot_be_served_is_one_line_and_exit_code_1(run, blob_puppet, arguments, message):
    result = run("serve", "--puppet", blob_puppet, "--port", 0, "--no-announce", *arguments, code=1)
    lines = [line for line in result.stderr.splitlines() if line.startswith("puppetline: ")]
    assert len(lines) == 1
    assert message in lines[0]
    assert "Traceback" not in result.stderr
    assert "internal error" not in result.stderr


def test_a_port_that_is_taken_is_one_line(run, serve, blob_puppet):
    port = serve("--puppet", blob_puppet, "--source", "osc:0").port
    result = run("serve", "--puppet", blob_puppet, "--source", "osc:0", "--port", port, "--no-announce", code=1)
    assert f"addresses that cannot be bound: tcp://127.0.0.1:{port}" in result.stderr


def test_listen_says_what_arrives(run, serve, blob_puppet):
    service = serve("--puppet", blob_puppet, "--source", "demo:walk?loop")
    address = service.stream.removeprefix("tcp://")
    kinds = ("--kind", "controls", "--kind", "handles")
    report = json.loads(run("listen", address, "--seconds", 2, "--json", *kinds).stdout)
    heard = {each["topic"]: each for each in report["heard"]}
    assert heard["blob/controls"]["missing"] == 0
    assert heard["blob/controls"]["latency_ms"]["p50"] > 0
    assert 20 < heard["blob/handles"]["rate"] < 40
    assert "blob/controls" in run("listen", address, "--seconds", 1).stdout
    assert "expected a running service" in run("listen", "127.0.0.1:1", "--seconds", 0.3, code=1).stderr


def test_record_writes_a_take_that_can_be_read_and_is_not_overwritten(run, sender, kung_fu, tmp_path):
    stop = threading.Event()

    def perform():
        while not stop.is_set():
            sender.play(kung_fu[:30], until=stop.is_set)

    performer = threading.Thread(target=perform)
    performer.start()
    try:
        summary = json.loads(run("record", "--source", sender.uri, "-o", "take.log", "--seconds", 2, "--json").stdout)
    finally:
        stop.set()
        performer.join()
    [clip] = read_log(tmp_path / "take.log")
    assert len(clip.times) == summary["frames"] > 20
    assert (summary["users"], summary["ended"]) == ([1], "time")
    assert "replace it with --force" in run("record", "--source", "osc:0", "-o", "take.log", code=1).stderr


def test_a_token_and_keys_are_for_their_owner_alone(run, tmp_path):
    run("token", "secret")
    run("keys", "kiosk.key_secret")
    for name in ("secret", "kiosk.key_secret"):
        assert stat.S_IMODE((tmp_path / name).stat().st_mode) == 0o600
    assert (tmp_path / "kiosk.key").exists()
    run("token", "secret", code=1)


def test_doctor_tells_programs_as_well(tmp_path):
    arguments = ["doctor", "--json", "--source", "demo:walk", "--source", "demo:nobody", "--takes", str(tmp_path)]
    result = CliRunner().invoke(main, arguments)
    findings = json.loads(result.stdout)
    assert {"name", "ok", "detail", "fix"} == findings[0].keys()
    assert {"demo:walk": True, "demo:nobody": False, "takes": True}.items() <= {
        each["name"]: each["ok"] for each in findings
    }.items()
    assert result.exit_code == 1


@pytest.mark.parametrize(("states", "code"), [((True, None), 0), ((True, None, False), 1)])
def test_only_a_fault_sets_the_exit_code_of_doctor(monkeypatch, states, code):
    findings = [Finding(f"thing {k}", ok, "found", "Do it.") for k, ok in enumerate(states)]
    monkeypatch.setattr("engine_bridge.cli.checks.machine.examine", lambda _takes, _sources: findings)
    result = CliRunner().invoke(main, ["doctor"])
    assert result.exit_code == code
    assert [line[:2] for line in result.stdout.splitlines()[::2]] == ["ok", "--", "!!"][: len(states)]


def test_bake_makes_a_file_that_serve_plays(run, serve, blob_puppet, tmp_path):
    summary = json.loads(run("bake", blob_puppet, "-o", "blob.morphs.glb", "--targets", 8, "--json").stdout)
    service = serve("--puppet", blob_puppet, "--source", "demo:walk?loop", "--morphs", tmp_path / "blob.morphs.glb")
    client = service.client("blob/morphs")
    frames = client.until(lambda message: message.header.state == 2 and message.header.sequence % 40 == 0, "morphs")
    assert {frame.body.weights.shape for frame in frames} == {(summary["targets"],)}
    assert 0 < frames[-1].body.residual < 0.05
    assert service.ask("describe")["characters"][0]["morphs"] == [f"motion_{k}" for k in range(summary["targets"])]


def test_demo_live_streams_the_examples(tmp_path, run, commands):
    with socket.socket() as port:
        if port.connect_ex(("127.0.0.1", 7400)) == 0:
            pytest.skip("somebody has the default port")
    process = commands.start(
        *("demo", "dog", "--live", "-o", tmp_path),
        stderr=subprocess.PIPE,
        env=os.environ | {"XDG_STATE_HOME": str(tmp_path / "state")},
    )
    try:
        line = next(line for line in process.stderr if "serving" in line)
        assert "tcp://127.0.0.1:7400" in line
        report = json.loads(run("listen", "--seconds", 1, "--json").stdout)
        assert [each["topic"] for each in report["heard"]] == ["dog/controls"]
    finally:
        process.terminate()
        assert process.wait(10) == 0
        process.stderr.close()


def test_a_restarted_service_does_not_wait_for_what_it_does_not_need():
    heavy = ("scipy.linalg", "scipy.spatial", "scipy.sparse.linalg", "zeroconf", "prometheus_client")
    program = f"import sys, engine_bridge.service.service; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_look_draws_who_is_seen_and_says_so(run, tmp_path):
    seen = run("look", "--source", "demo:walk?loop", "-o", "look.png", "--seconds", 1, "--json")
    report = json.loads(seen.stdout)
    assert [(each["user"], each["joints_seen"]) for each in report["performers"]] == [(1, 20)]
    assert (report["picture"], report["reasons"]) == (None, [])
    with Image.open(tmp_path / "look.png") as picture:
        picture.load()
        assert (picture.format, picture.mode) == ("PNG", "RGB")


def test_look_at_nobody_says_why_draws_that_too_and_fails(run, tmp_path):
    with socket.socket(type=socket.SOCK_DGRAM) as sender, socket.socket(type=socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        other.close()
        done = threading.Event()

        def chatter():
            while not done.wait(0.1):
                sender.sendto(b"nonsense", ("127.0.0.1", port))

        chatting = threading.Thread(target=chatter)
        chatting.start()
        try:
            said = run("look", "--source", f"osc:{port}", "-o", "look.png", "--seconds", 0.5, code=1)
        finally:
            done.set()
            chatting.join()
    assert "  Packets arrived, but none were understood: " in said.stdout
    assert "    → Set the sender to one of the formats in docs/senders.md." in said.stdout
    assert "Traceback" not in said.stderr
    with Image.open(tmp_path / "look.png") as picture:
        picture.load()


@pytest.mark.parametrize(("output", "message"), [("look.jpg", "expected '.png'"), ("none/look.png", "no folder none")])
def test_look_says_at_once_where_it_cannot_write(run, output, message):
    assert message in run("look", "--source", "osc:0", "-o", output, code=1).stderr


@pytest.fixture
def look_live(tmp_path, commands):
    """Run `puppetline look --live` on a terminal."""
    started = []

    def start(source, *arguments, **more):
        command = ("look", "--source", source, "--live", *arguments)
        started.append(Terminal(commands, *command, cwd=tmp_path, **more))
        return started[-1]

    yield start
    for terminal in started:
        terminal.kill()


@contextmanager
def performing(sender, frames, user=1):
    """Send frames over and over."""
    done = threading.Event()
    playing = threading.Thread(target=sender.play, args=[cycle(frames)], kwargs={"user": user, "until": done.is_set})
    playing.start()
    try:
        yield
    finally:
        done.set()
        playing.join()


def printed_last(terminal):
    """Return what a terminal that has ended says once its status line was erased."""
    assert terminal.heard.count("\x1b[?25h") == terminal.heard.count("\x1b[?25l") > 0  # the cursor is there again
    return terminal.heard.rpartition("\x1b[2K")[2]


def test_the_live_look_keeps_a_status_line_and_ctrl_c_leaves_the_last_words_and_the_picture(look_live, tmp_path):
    terminal = look_live("demo:walk?loop", "-o", "look.png")
    terminal.hear("No problems found. · user 1: 20 of 20 joints tracked")
    terminal.type(b"\x03")
    assert terminal.end() == 0
    last = printed_last(terminal)
    assert "look.png: demo:walk?loop, " in last
    assert "  user 1: 20 of 20 joints tracked" in last
    with Image.open(tmp_path / "look.png") as picture:
        picture.load()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_what_ends_the_live_look_leaves_the_last_words(look_live, number):
    terminal = look_live("demo:walk?loop")
    terminal.hear("user 1")
    terminal.process.send_signal(number)
    assert terminal.end() == 0
    assert "  user 1: 20 of 20 joints tracked" in printed_last(terminal)


def test_after_its_seconds_or_the_end_of_a_recording_the_live_look_ends(look_live, kung_fu, tmp_path):
    with Recorder(tmp_path / "short.log") as recorder:
        for frame in kung_fu[:30]:
            recorder.write(frame)
    for source, seconds in (("demo:walk?loop", 1), ("replay:short.log", 600)):
        terminal = look_live(source, "--seconds", seconds)
        assert terminal.end() == 0
        assert "  user 1: 20 of 20 joints tracked" in printed_last(terminal)


def test_a_sender_that_comes_later_is_seen_and_one_that_goes_is_missed(look_live, sender, kung_fu):
    terminal = look_live(sender.uri)
    terminal.hear("No packet received for")
    with performing(sender, kung_fu):
        terminal.hear("user 1: 20 of 20 joints tracked")
    before = terminal.heard.count("No packet received for")
    while terminal.heard.count("No packet received for") == before:
        terminal.read()
    terminal.type(b"\x03")
    assert terminal.end() == 1
    assert "  user 1" not in printed_last(terminal)


def test_a_window_that_is_closed_ends_the_live_look(look_live, tmp_path):
    terminal = look_live("demo:walk?loop", "-o", "look.png")
    terminal.hear("user 1")
    terminal.close()
    assert terminal.process.wait(60) == 1
    assert (tmp_path / "look.png").exists()


def test_a_camera_that_is_not_there_is_waited_for(look_live, camera):
    terminal = look_live("camera:77")
    terminal.hear("found no /dev/video77")
    terminal.hear("The source is opened again twice per second.")
    terminal.type(b"\x03")
    assert terminal.end() == 1
    last = printed_last(terminal)
    assert "found no /dev/video77" in last
    assert "opened again" not in last


def test_the_skeleton_lies_on_the_performer_of_a_real_video(run, camera, real_data, tmp_path):
    folder = real_data / "video" / "tfjs"
    run("look", "--source", f"video:{folder / 'pose_squats.mp4'}", "-o", "look.png")
    frames = json.loads((folder / "pose_squats.full.json").read_text())  # which of them was seen last is chance
    # the video is 1280 pixels high and 720 wide
    places = (LANDMARK_WEIGHTS @ np.array(frames)[..., :2]) * PANEL_HEIGHT / 1280
    with Image.open(tmp_path / "look.png") as picture:
        panel = np.asarray(picture.convert("RGB")).astype(int)[12:, 12:][:PANEL_HEIGHT, : PANEL_HEIGHT * 720 // 1280]
    drawn = np.argwhere(np.abs(panel - PERFORMER_COLORS[1]).max(axis=2) < 8)[:, ::-1] + 0.5
    distances = np.array([np.linalg.norm(each[:, None] - drawn, axis=2).min(axis=1).max() for each in places])
    assert distances.min() < 6  # 1.2 % of the height
