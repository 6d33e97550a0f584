import json
import signal
import socket

import pytest
from PIL import Image

from ...terminal import Terminal

pytestmark = pytest.mark.slow

SEEN = "  user 1: 20 of 20 joints tracked"


def assert_is_picture(path):
    with Image.open(path) as picture:
        picture.load()
        assert picture.format == "PNG"
        assert picture.mode == "RGB"


def test_look_draws_and_reports_performers(invoke, tmp_path, given_clock):
    seen = invoke("look", "--source", "demo:walk?loop", "-o", "look.png", "--seconds", 1, "--json")
    report = json.loads(seen.stdout)
    assert [(each["user"], each["joints_seen"]) for each in report["performers"]] == [(1, 20)]
    assert report["picture"] is None
    assert report["reasons"] == []
    assert_is_picture(tmp_path / "look.png")


def test_look_without_a_performer_explains_why_and_fails(invoke, tmp_path, given_clock):
    with socket.socket(type=socket.SOCK_DGRAM) as sender, socket.socket(type=socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        other.close()
        given_clock.call_at(given_clock.now() + 0.1, lambda: sender.sendto(b"nonsense", ("127.0.0.1", port)))
        said = invoke("look", "--source", f"osc:{port}", "-o", "look.png", "--seconds", 0.5, code=1)
    assert "  Packets arrived, but none were understood: " in said.stdout
    assert "    → Set the sender to one of the formats in docs/senders.md." in said.stdout
    assert_is_picture(tmp_path / "look.png")


@pytest.fixture
def look_live(tmp_path, commands):
    """Run `puppetline look --live` on a terminal."""
    started = []

    def start(source, *arguments):
        started.append(Terminal(commands, "look", "--source", source, "--live", *arguments, cwd=tmp_path))
        return started[-1]

    yield start
    for terminal in started:
        terminal.kill()


def printed_last(terminal, code=0):
    """Wait for the end; return what the terminal then shows, whose status line was erased."""
    assert terminal.end() == code
    assert terminal.heard.count("\x1b[?25h") == terminal.heard.count("\x1b[?25l") > 0  # the cursor is there again
    return terminal.heard.rpartition("\x1b[2K")[2]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_the_live_look_and_leaves_the_report_and_the_image(look_live, tmp_path, number):
    terminal = look_live("demo:walk?loop", "-o", "look.png")
    terminal.hear("No problems found. · user 1: 20 of 20 joints tracked")
    if number == signal.SIGINT:
        terminal.type(b"\x03")
    else:
        terminal.process.send_signal(number)
    last = printed_last(terminal)
    assert "look.png: demo:walk?loop, " in last
    assert SEEN in last
    assert_is_picture(tmp_path / "look.png")


def test_after_its_seconds_or_the_end_of_a_recording_the_live_look_ends(look_live, record_events, kung_fu, tmp_path):
    record_events(tmp_path / "short.log", kung_fu[:10])
    for source, seconds in (("demo:walk?loop", 0.5), ("replay:short.log", 600)):
        assert SEEN in printed_last(look_live(source, "--seconds", seconds))


def test_a_sender_that_comes_later_is_seen_and_one_that_goes_is_missed(look_live, sender, kung_fu):
    terminal = look_live(sender.uri)
    terminal.hear("No packet received for")
    with sender.playing(kung_fu):
        terminal.hear("user 1: 20 of 20 joints tracked")
    before = terminal.heard.count("No packet received for")
    while terminal.heard.count("No packet received for") == before:
        terminal.read()
    terminal.type(b"\x03")
    assert "  user 1" not in printed_last(terminal, code=1)


def test_a_window_that_is_closed_ends_the_live_look(look_live, tmp_path):
    terminal = look_live("demo:walk?loop", "-o", "look.png")
    terminal.hear("user 1")
    terminal.close()
    assert terminal.process.wait() == 1
    assert (tmp_path / "look.png").exists()


def test_a_camera_that_is_not_there_is_waited_for(look_live, camera):
    terminal = look_live("camera:77")
    terminal.hear("found no /dev/video77")
    terminal.hear("The source is opened again twice per second.")
    terminal.type(b"\x03")
    last = printed_last(terminal, code=1)
    assert "found no /dev/video77" in last
    assert "opened again" not in last
