"""`puppetline serve` as a process, with skeletons over UDP and ZeroMQ clients."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from contextlib import closing
from select import select

import numpy as np
import pytest

from capture import body
from capture.events import Cue
from capture.skeleton import JOINT_INDEX
from engine_bridge.service.discovery import find
from engine_bridge.service.protocol.scene import Scene
from solver.model.binding import Binding

from ...waiting import wait_until
from .conftest import Sender

pytestmark = pytest.mark.slow

SERVE = ("serve", "--port", "0", "--no-announce")


@pytest.fixture
def playing(serve, blob_puppet, sender, kung_fu):
    """Start a service with one character, and a performer who moves until the end of the test."""
    service = serve("--puppet", blob_puppet, "--source", sender.uri, "--calibrate", "at_once")
    with sender.playing(kung_fu):
        yield service


@pytest.fixture(scope="module")
def shared(serve_module, blob_puppet, kung_fu):
    """Start the same for all tests that only read; return the service and the performer's sender."""
    with closing(Sender()) as sender:
        service = serve_module("--puppet", blob_puppet, "--source", sender.uri, "--calibrate", "at_once")
        with sender.playing(kung_fu):
            yield service, sender


def performing(message):
    return message.header.state == 2


def test_a_late_subscriber_receives_the_scene_and_then_controls_that_move_it(shared, blob_rig):
    playing, _ = shared
    playing.client("blob/controls").until(performing)
    late = playing.client("blob/scene", "blob/controls")
    [scene] = late.until(lambda _: True, "scene")
    assert isinstance(scene.body, Scene)
    frames = late.until(lambda message: performing(message) and message.header.sequence % 50 == 0, "controls")
    assert {frame.header.revision for frame in frames} == {scene.header.revision}
    assert frames[-1].body.shape == (30, 3, 4)
    numbers = [frame.header.sequence for frame in frames]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    vertices = Binding.of_solver_mesh(blob_rig.model, blob_rig.mesh).vertices(frames[-1].body)
    assert np.isfinite(vertices).all()
    moved = np.linalg.norm(vertices - blob_rig.mesh.vertices, axis=1).max()
    assert 1e-3 < moved / blob_rig.mesh.diagonal < 1.5


def test_a_stalled_service_goes_on_with_the_newest_frame(shared):
    playing, _ = shared
    client = playing.client("blob/controls")
    client.until(performing)
    playing.process.send_signal(signal.SIGSTOP)
    time.sleep(1.0)
    client.pending()
    playing.process.send_signal(signal.SIGCONT)
    woken = client.until(lambda message: performing(message) and message.header.sequence % 30 == 0, "controls")
    # older frames were dropped: no frame was published much later than it was received
    assert all(message.header.published - message.header.received < 0.5e9 for message in woken)
    playing.client("service/status").until(lambda status: status.body["stages"][0]["dropped"] >= 20)


def test_reloading_keeps_clients_and_performers(playing, blob_puppet):
    client = playing.client("blob/scene", "blob/controls", "service/characters")
    [first] = client.until(lambda _: True, "scene")
    client.until(performing, "controls")
    text = blob_puppet.read_text()
    try:
        blob_puppet.write_text(text.replace('name = "head"', 'name = "nose"'))
        playing.process.send_signal(signal.SIGHUP)
        [scene] = client.until(lambda message: message.header.revision != first.header.revision, "scene")
        assert [handle["name"] for handle in scene.body.facts["handles"]].count("nose") == 1
        frames = client.until(lambda m: performing(m) and m.header.revision == scene.header.revision, "controls")
        assert frames[-1].header.user == 1
        blob_puppet.write_text(text.replace("position = ", "position =" + " 7 #"))
        error = playing.ask("reload")
        assert str(blob_puppet) in error["where"]
        client.until(performing, "controls")
    finally:
        blob_puppet.write_text(text)
    assert playing.ask("reload") == {"characters": ["blob"]}


def test_clients_and_performer_continue_after_a_killed_service_is_restarted(
    serve, blob_puppet, sender, kung_fu, tmp_path, free_port
):
    arguments = ("--puppet", blob_puppet, "--source", sender.uri, "--port", free_port())
    service = serve(*arguments)
    client = service.client("blob/controls")
    sender.play(kung_fu[:60] + kung_fu[:60], interval=1 / 30)  # still for a second, even if frames are lost
    seen = client.until(performing)
    for _ in range(200):  # until the calibration is stored
        if (tmp_path / "state" / "puppetline" / "performers.json").exists():
            break
        sender.play(kung_fu[-8:], interval=1 / 30)
    service.process.kill()
    service.process.wait()
    last = max(message.header.sequence for message in [*seen, *client.pending()])
    serve(*arguments)
    # never still for a second: only a stored calibration lets this performer drive the character
    with sender.playing(kung_fu[100:], interval=1 / 30):
        restarted = client.until(lambda message: message.header.sequence < last, "controls")
        frames = client.until(performing, "controls")
    assert restarted[-1].header.revision == frames[-1].header.revision
    assert frames[-1].header.state == 2


def test_osc_is_sent_at_no_more_than_its_rate(serve, blob_puppet):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(60)
        target = f"127.0.0.1:{receiver.getsockname()[1]}"
        serve("--puppet", blob_puppet, "--source", "demo:walk?loop", "--osc", target, "--osc-rate", 10)
        arrived = []
        while len(arrived) < 10:
            if b"/puppetline/blob/handle/head" in receiver.recv(65536):
                arrived.append(time.monotonic())
    assert arrived[-1] - arrived[0] > 0.8


def test_a_stopped_service_ends_cleanly_and_leaves_a_complete_take(playing, tmp_path):
    client = playing.client("blob/controls")
    client.until(performing)
    playing.ask("record_start", name="last")
    client.until(lambda message: message.header.sequence % 40 == 0)
    assert playing.stop() == 0
    assert (tmp_path / "takes" / "last.log").read_bytes().endswith(b"}\n")
    assert not [line for line in playing.log if "Traceback" in line]


def test_the_watchdog_is_notified_of_frames(serve, blob_puppet, tmp_path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        path = tmp_path / "notify"
        systemd.bind(str(path))
        systemd.settimeout(60)
        environment = {"NOTIFY_SOCKET": str(path), "WATCHDOG_USEC": "400000"}
        service = serve("--puppet", blob_puppet, "--source", "demo:walk?loop", env=environment)
        told = []
        while told.count("WATCHDOG=1") < 3:
            told.append(systemd.recv(4096).decode())
        assert told[0] == "READY=1"
        assert any(line.startswith(("STATUS=1 of 1 characters", "STATUS=0 of 1")) for line in told)
        service.stop()
        rest = []
        while select([systemd], [], [], 0)[0]:
            rest.append(systemd.recv(4096).decode())
        assert rest[-1] == "STOPPING=1"


def test_a_reload_ends_a_take_and_every_reload_request_is_answered(playing, tmp_path):
    playing.client("blob/controls").until(performing)
    playing.ask("record_start", name="short")
    answers = []
    asking = [threading.Thread(target=lambda: answers.append(playing.ask("reload"))) for _ in range(3)]
    for thread in asking:
        thread.start()
    for thread in asking:
        thread.join()
    assert answers == [{"characters": ["blob"]}] * 3
    assert playing.ask("describe")["status"]["stages"][0]["recording"] is None
    assert playing.logged("the reload ends the take")
    assert (tmp_path / "takes" / "short.log").read_bytes().endswith(b"}\n")


@pytest.mark.parametrize(
    "loaded", ["engine_bridge.service.system_signals", "numpy", "zmq", "engine_bridge.service.service"]
)
def test_a_stop_during_the_start_ends_it_cleanly(blob_puppet, sender, loaded):
    command = [sys.executable, "-m", "puppetline", *SERVE, "--puppet", blob_puppet, "--source", sender.uri]
    told = os.environ | {"PYTHONPROFILEIMPORTTIME": "1"}  # each module on standard error, as soon as it is loaded
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=told)
    next(line for line in process.stderr if line.rpartition("|")[2].strip() == loaded)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode in (0, 1)
    assert "Traceback" not in said
    assert "internal error" not in said


def test_a_log_that_is_not_read_delays_nothing(listen, blob_puppet, commands):
    command = [*SERVE, "--puppet", blob_puppet, "--source", "demo:walk?loop", "--log-format", "json"]
    process = commands.start(*command, stderr=subprocess.PIPE)
    try:
        served = json.loads(process.stderr.readline())["fields"]
        client = listen(served["stream"][0], "blob/controls")
        for _ in range(600):  # each reload says a line: more than a pipe holds
            process.send_signal(signal.SIGHUP)
            time.sleep(0.002)
        after = client.until(lambda _: True)[-1].header.sequence
        client.until(lambda message: message.header.sequence > after + 60)
    finally:
        process.terminate()
        assert process.wait(60) == 0
        process.stderr.close()


def test_the_status_is_in_the_terminal_at_prometheus_and_in_the_announcement(blob_puppet, commands, free_port):
    metrics = free_port()
    source = ("--puppet", blob_puppet, "--source", "demo:walk?loop")
    process = commands.start(*SERVE[:-1], *source, "--status", "--metrics", metrics, stdout=subprocess.PIPE)
    try:
        service, stage = process.stdout.readline(), process.stdout.readline()
        assert re.match(r"Puppetline \S+  up 0:0\d:\d\d  \d+ MB .* of 64 clients", service)
        assert stage.strip().startswith("stage (demo:walk?loop): ")
        with urllib.request.urlopen(f"http://127.0.0.1:{metrics}/metrics", timeout=10) as answer:
            text = answer.read().decode()
        assert re.search(r'^puppetline_stage_frames_total\{stage="stage"\} [1-9]', text, re.MULTILINE)
        assert 'puppetline_character_state{character="blob",state="performing"}' in text
        found = [each for each in find(2.0, ["127.0.0.1"]) if each.characters == ("blob",)]
        assert [each.mechanism for each in found] == ["NULL"]
    finally:
        process.terminate()
        assert process.wait(60) == 0
        process.stdout.close()


def test_the_status_has_the_performers_height_and_the_sensors_position(
    serve, blob_puppet, record_events, tmp_path, kung_fu
):
    stands = {"tilt": 12.0, "height": 1.3, "roll": -2.0}
    take = record_events(tmp_path / "take.log", [Cue(kung_fu[0].time, "level", stands), *kung_fu])
    service = serve("--puppet", blob_puppet, "--source", f"replay:{take}?loop")

    def stage():
        return service.ask("describe")["status"]["stages"][0]

    while not (users := stage()["users"]) or users[0]["state"] == "waiting":
        time.sleep(0.02)
    assert users[0]["state"] == "performing" or (users[0]["height"], users[0]["reach"]) == (None, None)
    while not (users := stage()["users"]) or users[0]["state"] != "performing":
        time.sleep(0.02)
    rest = body.resting_pose(np.stack([f.positions for f in kung_fu]), np.stack([f.confidence for f in kung_fu]), 0, 30)
    hands = [JOINT_INDEX["hand_left"], JOINT_INDEX["hand_right"]]
    assert users[0]["height"] == pytest.approx(body.height(rest), abs=0.01)
    assert users[0]["reach"] == pytest.approx(body.reach(rest)[hands].mean(), abs=0.01)
    assert stage()["sensor"] == stands


def test_a_reload_reads_the_stages_of_the_service_file_again(serve, blob_puppet, tmp_path):
    file = tmp_path / "service.toml"

    def write(*stages):
        tables = "".join(
            f'[[stage]]\nname = "{name}"\nsource = "{source}"\ncalibrate = "at_once"\n'
            f'[[stage.character]]\npuppet = "{blob_puppet}"\nname = "{name}"\n'
            for name, source in stages
        )
        file.write_text("announce = false\n[network]\nport = 0\n" + tables)

    def stages(service):
        return {stage["name"]: stage["source"] for stage in service.ask("describe")["status"]["stages"]}

    def one_pose():
        client.pending()
        time.sleep(0.5)
        return len({each.body.tobytes() for each in client.pending() if each.topic == "two/controls"}) == 1

    write(("one", "demo:walk?loop"))
    service = serve("--config", file)
    client = service.client("one/controls", "two/controls", "one/scene")
    [before] = client.until(performing, "controls")[-1:]
    write(("one", "demo:walk?loop"), ("two", "demo:rear?loop"))
    assert service.ask("reload") == {"characters": ["one", "two"]}
    client.until(lambda message: performing(message) and message.topic == "two/controls", "controls")
    later = client.until(lambda message: performing(message) and message.topic == "one/controls", "controls")[-1]
    assert later.header.sequence > before.header.sequence
    assert later.header.revision == before.header.revision
    write(("one", "demo:nothing"))
    error = service.ask("reload")
    assert "nothing" in error["found"]
    assert service.ask("list")["characters"] == ["one", "two"]
    write(("two", "demo:roar?loop"))
    service.ask("record_start", stage="two", name="take")
    time.sleep(1.0)
    service.ask("record_stop", stage="two")
    wait_until(lambda: service.ask("play_take", character="two", take="take") and service.ask("pause").get("paused"))
    assert service.ask("reload") == {"characters": ["two"]}
    wait_until(lambda: stages(service) == {"two": "demo:roar?loop"})
    wait_until(one_pose)  # the take drives the character, nobody else
    service.ask("stop")
    client.until(lambda message: performing(message) and message.topic == "two/controls", "controls")
