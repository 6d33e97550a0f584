import json
import signal
import socket
import threading

import numpy as np
import pytest
from PIL import Image

from capture.trackers.mediapipe import LANDMARK_WEIGHTS
from engine_bridge.pictures.source_view import PANEL_HEIGHT, PERFORMER_COLORS

from ...terminal import Terminal

pytestmark = pytest.mark.slow


def test_look_draws_and_reports_performers(run, tmp_path):
    seen = run("look", "--source", "demo:walk?loop", "-o", "look.png", "--seconds", 1, "--json")
    report = json.loads(seen.stdout)
    assert [(each["user"], each["joints_seen"]) for each in report["performers"]] == [(1, 20)]
    assert (report["picture"], report["reasons"]) == (None, [])
    with Image.open(tmp_path / "look.png") as picture:
        picture.load()
        assert (picture.format, picture.mode) == ("PNG", "RGB")


def test_look_without_a_performer_explains_why_and_fails(run, tmp_path):
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
def test_look_checks_the_output_first(run, output, message):
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


def printed_last(terminal):
    """Return what a closed terminal shows after its status line was erased."""
    assert terminal.heard.count("\x1b[?25h") == terminal.heard.count("\x1b[?25l") > 0  # the cursor is there again
    return terminal.heard.rpartition("\x1b[2K")[2]


def test_the_live_look_shows_a_status_line_and_ctrl_c_leaves_the_report_and_the_image(look_live, tmp_path):
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
def test_a_signal_ends_the_live_look_and_leaves_the_report(look_live, number):
    terminal = look_live("demo:walk?loop")
    terminal.hear("user 1")
    terminal.process.send_signal(number)
    assert terminal.end() == 0
    assert "  user 1: 20 of 20 joints tracked" in printed_last(terminal)


def test_after_its_seconds_or_the_end_of_a_recording_the_live_look_ends(look_live, record_events, kung_fu, tmp_path):
    record_events(tmp_path / "short.log", kung_fu[:30])
    for source, seconds in (("demo:walk?loop", 1), ("replay:short.log", 600)):
        terminal = look_live(source, "--seconds", seconds)
        assert terminal.end() == 0
        assert "  user 1: 20 of 20 joints tracked" in printed_last(terminal)


def test_a_sender_that_comes_later_is_seen_and_one_that_goes_is_missed(look_live, sender, kung_fu):
    terminal = look_live(sender.uri)
    terminal.hear("No packet received for")
    with sender.playing(kung_fu):
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
