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
from capture.skeleton import JOINT_INDEX, PARENTS
from capture.trackers.mediapipe import MIXTURE
from engine_bridge.cli.doctor.diagnosis import Finding
from engine_bridge.cli.main import main
from engine_bridge.pictures.look import PERFORMERS

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
        (["serve"], "Give --puppet, or --config."),
        (["serve", "--config", "a.toml", "--puppet", "b.toml"], "--config goes without"),
        (["serve", "--puppet", "a.toml", "--osc", "nowhere"], "--osc wants HOST:PORT"),
        (["serve", "--puppet", "a.toml", "--port", "70000"], "70000"),
        (["serve", "--puppet", "a.toml", "--people", "all"], "'all'"),
        (["record", "--source", "osc:1"], "Missing option '-o'"),
        (["look", "--source", "osc:1"], "Give -o, --live, or both."),
        (["look", "--source", "osc:1", "--live"], "--live wants a terminal"),
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
        (["--source", "demo:dance"], "found no performance 'dance'"),
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
    assert "a fault in Puppetline itself" not in result.stderr


def test_a_port_that_is_taken_is_one_line(run, serve, blob_puppet):
    port = serve("--puppet", blob_puppet, "--source", "osc:0").port
    result = run("serve", "--puppet", blob_puppet, "--source", "osc:0", "--port", port, "--no-announce", code=1)
    assert f"cannot listen at tcp://127.0.0.1:{port}" in result.stderr


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
    monkeypatch.setattr("engine_bridge.cli.doctor.checks.examine", lambda _takes, _sources: findings)
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
    assert "  What came were no performers: " in said.stdout
    assert "    → Set the sender to one of the formats of docs/senders.md." in said.stdout
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


def says(words):
    """Return whether a screen says something, however its lines are broken."""
    return lambda screen: words in " ".join(screen.text())


def is_restored(screen):
    return screen.cursor and not screen.alternate


def test_the_live_look_shows_the_skeleton_where_its_joints_are_and_says_what_is_amiss(look_live, sender, kung_fu):
    user, still = 4, kung_fu[0]  # of the colour that nothing else has
    with performing(sender, [still], user):
        terminal = look_live(sender.uri)
        terminal.until(says("User 4 does not move at all"))
        screen = terminal.screen
    assert (screen.alternate, screen.cursor) == (True, False)
    assert says("See whether the sender tracks somebody")(screen)
    assert says("user 4: 20 of 20 joints seen")(screen)
    assert screen.text()[0].split("  ")[0] == "from the front"

    # 17 lines are left for a panel of 34 pixels that shows whole steps of half a metre, and a tenth more
    size, x_y = 34, still.positions[:, :2]
    low, high = np.floor(2 * x_y.min(axis=0)) / 2, np.ceil(2 * x_y.max(axis=0)) / 2
    places = size / 2 - (x_y - (low + high) / 2) * size / (1.1 * max(high - low))
    panel = screen.pixels()[2 : 2 + size, :size]
    own = np.abs(panel - PERFORMERS[0]).max(axis=2) < 90
    drawn = np.argwhere(own)[:, ::-1] + 0.5  # right and down
    for name, index in JOINT_INDEX.items():
        assert np.linalg.norm(drawn - places[index], axis=1).min() < 1.5, name
    bones = [places[[JOINT_INDEX[child], JOINT_INDEX[parent]]] for child, parent in PARENTS.items()]
    along = np.concatenate([np.linspace(*bone, 50) for bone in bones])
    assert np.linalg.norm(drawn[:, None] - along, axis=2).min(axis=1).max() < 2.5  # a head's radius, and a pixel's


def test_ctrl_c_restores_the_terminal_and_leaves_the_last_words_and_the_picture(look_live, tmp_path):
    terminal = look_live("demo:walk?loop", "-o", "look.png")
    terminal.until(says("user 1: 20 of 20 joints seen"))
    terminal.type(b"\x03")
    assert terminal.end() == 0
    assert is_restored(terminal.screen)
    assert "look.png: demo:walk?loop, " in terminal.screen.printed
    assert "  user 1: 20 of 20 joints seen" in terminal.screen.printed
    with Image.open(tmp_path / "look.png") as picture:
        picture.load()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_what_ends_the_live_look_restores_the_terminal(look_live, number):
    terminal = look_live("demo:walk?loop")
    terminal.until(says("user 1"))
    terminal.process.send_signal(number)
    assert terminal.end() == 0
    assert is_restored(terminal.screen)


def test_after_its_seconds_or_the_end_of_a_recording_the_live_look_ends(look_live, kung_fu, tmp_path):
    with Recorder(tmp_path / "short.log") as recorder:
        for frame in kung_fu[:30]:
            recorder.write(frame)
    for source, seconds in (("demo:walk?loop", 1), ("replay:short.log", 600)):
        terminal = look_live(source, "--seconds", seconds)
        terminal.until(says("user 1"))
        assert terminal.end() == 0
        assert is_restored(terminal.screen)


def test_a_sender_that_comes_later_is_seen_and_one_that_goes_is_missed(look_live, sender, kung_fu):
    terminal = look_live(sender.uri)
    terminal.until(says("Nothing has come in"))
    assert says("Start the sender, have it send to this machine and port")(terminal.screen)
    with performing(sender, kung_fu):
        terminal.until(says("■ user 1: 20 of 20 joints seen"))
        assert not says("Nothing has come in")(terminal.screen)
    terminal.until(says("Nothing has come in"))
    assert not says("user 1")(terminal.screen)
    terminal.type(b"\x03")
    assert terminal.end() == 1
    assert is_restored(terminal.screen)


def test_the_live_look_follows_the_size_of_its_window(look_live):
    terminal = look_live("demo:walk?loop", columns=30, lines=12)
    terminal.until(says("This terminal is too small"))
    for columns, lines in ((100, 30), (60, 20)):
        terminal.resize(columns, lines)
        terminal.until(says("All is well."))
        pixels = terminal.screen.pixels()
        assert (pixels[2 : 2 * (lines - 6)] >= 0).all()
        assert (pixels[2 * (lines - 6) :] == -1).all()


def test_a_terminal_without_colours_is_drawn_on_in_shades(look_live):
    terminal = look_live("demo:walk?loop", NO_COLOR="1")
    terminal.until(says("All is well."))
    assert (terminal.screen.colors == -1).all()
    assert set("░▓") < set("".join(terminal.screen.text()[1:18])) <= set(" ░▒▓█")


def test_a_terminal_that_does_not_answer_is_drawn_on_all_the_same(look_live):
    terminal = look_live("demo:walk?loop", answers=False)
    terminal.hear("frames a second")  # which nobody knows at the first view
    terminal.type(b"\x03")
    assert terminal.end() == 0
    assert is_restored(terminal.screen)


def test_a_window_that_is_closed_ends_the_live_look(look_live, tmp_path):
    terminal = look_live("demo:walk?loop", "-o", "look.png")
    terminal.until(says("user 1"))
    terminal.close()
    assert terminal.process.wait(60) == 1
    assert (tmp_path / "look.png").exists()


def test_a_halted_terminal_does_not_keep_the_live_look_from_its_end(look_live, tmp_path):
    terminal = look_live("demo:walk?loop", "-o", "look.png", columns=200, lines=60)
    terminal.until(says("user 1"))
    terminal.until(lambda screen: True)  # and from now on nothing is read: the pipe is soon full
    terminal.process.send_signal(signal.SIGTERM)
    assert terminal.process.wait(60) in (0, 1)
    assert (tmp_path / "look.png").exists()


def test_a_camera_that_is_not_there_is_waited_for(look_live, camera):
    terminal = look_live("camera:77")
    terminal.until(says("found no /dev/video77"))
    assert says("It is opened again twice a second.")(terminal.screen)
    terminal.type(b"\x03")
    assert terminal.end() == 1
    assert "found no /dev/video77" in terminal.screen.printed
    assert "opened again" not in terminal.screen.printed


def test_the_skeleton_lies_on_the_performer_of_a_real_video(look_live, camera, real_data):
    folder = real_data / "video" / "tfjs"
    terminal = look_live(f"video:{folder / 'pose_squats.mp4'}", columns=160, lines=50)
    assert terminal.end() == 0  # with the film; what is on the other screen stays as it was
    last = json.loads((folder / "pose_squats.full.json").read_text())[-10:]  # which of them was seen last is chance
    places = (MIXTURE @ np.array(last)[..., :2]) * 82 / 1280  # 41 lines are left of a film that is 1280 pixels high
    own = np.abs(terminal.screen.pixels()[2:84, :46] - PERFORMERS[1]).max(axis=2) < 90
    drawn = np.argwhere(own)[:, ::-1] + 0.5
    distances = np.linalg.norm(places[:, :, None] - drawn, axis=3).min(axis=2).max(axis=1)
    assert distances.min() < 2
