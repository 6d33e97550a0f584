"""`puppetline serve` as a process, with skeletons over UDP and ZeroMQ clients."""

import itertools
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
from pythonosc.osc_message import OscMessage

from capture import body
from capture.events import Cue
from capture.skeleton import JOINT_INDEX
from engine_bridge.service.discovery import find
from engine_bridge.service.protocol.scene import Scene
from solver.model.binding import Binding

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


def test_every_kind_of_frame_is_sent_to_its_subscribers(shared, blob_rig):
    playing, _ = shared
    kinds = ("controls", "vertices", "vertices16", "joints", "handles")
    client = playing.client(*(f"blob/{kind}" for kind in kinds))
    at_one_moment = {}
    first = client.until(performing)[-1].header.sequence
    for message in client.until(lambda message: performing(message) and message.header.sequence > first + 60):
        at_one_moment.setdefault(message.header.sequence, {})[message.topic.removeprefix("blob/")] = message.body
    whole = [bodies for bodies in at_one_moment.values() if len(bodies) == len(kinds)]
    assert whole
    diagonal = blob_rig.mesh.diagonal
    for bodies in whole:
        positions = bodies["vertices"].positions
        box = np.ptp(positions, axis=0).max()
        np.testing.assert_allclose(bodies["vertices16"].positions, positions, atol=box / 65535)
        assert bodies["joints"].shape == (20, 4)
        reached = Binding.of_solver_mesh(blob_rig.model, blob_rig.mesh).vertices(bodies["controls"])
        nearest = [np.linalg.norm(reached - handle, axis=1).min() for handle in bodies["handles"]]
        assert max(nearest) < 0.1 * diagonal


def test_a_take_plays_again_to_the_same_controls(playing, serve, blob_puppet, tmp_path):
    live = playing.client("blob/controls")
    live.until(performing)
    assert playing.ask("record_start", name="take")["take"] == "take"
    start = time.monotonic()
    recorded = live.until(lambda _: time.monotonic() > start + 3.0, "controls")
    playing.ask("record_stop")
    assert [take["name"] for take in playing.ask("list")["takes"]] == ["take"]
    replaying = serve("--puppet", blob_puppet, "--source", f"replay:{tmp_path / 'takes' / 'take.log'}?loop")
    replay = replaying.client("blob/controls")
    before = {message.header.time: message for message in recorded}
    last = max(before)
    again = [
        m for m in replay.until(lambda message: message.header.time > last - 0.5, "controls") if m.header.time in before
    ]
    assert len(again) > 40
    settled = again[0].header.time + 1.0  # the take begins no later than what is seen of it
    for message in again:
        was = before[message.header.time]
        assert (message.header.state, message.header.user) == (was.header.state, was.header.user)
        if message.header.time > settled:
            np.testing.assert_allclose(message.body, was.body, atol=5e-3)
            np.testing.assert_allclose(message.header.root, was.header.root, atol=5e-3)


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


def test_a_character_returns_to_rest_when_its_source_is_silent_and_moves_again_with_it(
    serve, blob_puppet, sender, kung_fu
):
    service = serve("--puppet", blob_puppet, "--source", sender.uri, "--calibrate", "at_once")
    client = service.client("blob/controls")
    sender.play(kung_fu[:90], until=lambda: False)
    client.until(performing)
    client.until(lambda message: message.header.state == 3)
    client.until(lambda message: message.header.state == 0)
    sender.play(kung_fu[90:], interval=1 / 30)
    states = [state for state, _ in itertools.groupby(message.header.state for message in client.pending())]
    assert states[states.index(1) :][:2] == [1, 2]


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


def test_a_client_is_shown_what_the_source_sees(shared):
    playing, _ = shared
    playing.client("blob/controls").until(performing)
    seen = playing.ask("look", stage="stage")
    assert seen["picture"] is None
    (performer,) = seen["performers"]
    assert (performer["user"], performer["joints"]) == (1, None)
    assert performer["text"].startswith(f"user 1: {performer['joints_seen']} of 20 joints tracked")
    assert playing.ask("look", stage="other")["found"] == "no stage 'other'"


def test_garbage_is_counted_and_frames_continue(shared):
    playing, sender = shared
    client = playing.client("blob/controls")
    client.until(performing)
    for datagram in (b"", b"\0", b"#bundle\0" + bytes(12), bytes(65000), b"/joint\0\0,sifff\0\0", b"{}" * 500):
        sender.raw(datagram)
    playing.client("service/status").until(lambda status: sum(status.body["stages"][0]["refused"].values()) >= 5)
    client.until(lambda message: performing(message) and message.header.sequence % 20 == 0, "controls")
    assert playing.ask("describe")["status"]["stages"][0]["faults"] == 0


def test_two_performers_drive_two_characters(serve, blob_puppet, sender, kung_fu, tmp_path):
    other = blob_puppet.with_name("cat.toml")
    other.write_text(blob_puppet.read_text())
    service = serve("--puppet", blob_puppet, "--puppet", other, "--source", sender.uri, "--calibrate", "at_once")
    client = service.client("blob/controls", "cat/controls")
    for frame in kung_fu[:120]:
        sender.send(frame, user=4)
        sender.send(frame, user=8)
        time.sleep(1 / 60)
    users = {(message.topic, message.header.user) for message in client.pending() if performing(message)}
    assert users == {("blob/controls", 4), ("cat/controls", 8)}


def test_osc_is_sent_at_no_more_than_its_rate(serve, blob_puppet, sender, kung_fu):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(0.5)
        target = f"127.0.0.1:{receiver.getsockname()[1]}"
        serve(
            "--puppet", blob_puppet, "--source", sender.uri, "--calibrate", "at_once", "--osc", target, "--osc-rate", 10
        )
        thread = threading.Thread(target=sender.play, args=(kung_fu[:180],))
        start = time.monotonic()
        thread.start()
        handles = []
        while time.monotonic() < start + 3.0:
            datagram = receiver.recv(65536)
            if b"/handle" in datagram[:120]:
                handles.append(datagram)
        took = time.monotonic() - start
        thread.join()
    assert 5 < len(handles) <= 10 * took * len({datagram[:60] for datagram in handles}) + 10
    [first, *_] = handles
    if not first.startswith(b"#bundle"):
        assert OscMessage(first).address.startswith("/puppetline/blob/")


def test_an_address_that_other_machines_reach_requires_credentials(serve, blob_puppet, sender):
    service = serve("--puppet", blob_puppet, "--source", sender.uri, "--host", "0.0.0.0")
    assert service.process.wait() == 1
    service._read.join()
    [line] = [line for line in service.log if line.startswith("puppetline:")]
    assert "no credentials" in line


def test_only_clients_with_the_token_receive_anything(serve, blob_puppet, sender, kung_fu, tmp_path):
    token = b"correct-horse-battery-staple"
    file = tmp_path / "token"
    file.write_bytes(token)
    file.chmod(0o600)
    service = serve("--puppet", blob_puppet, "--source", sender.uri, "--host", "0.0.0.0", "--token-file", file)
    service.stream = service.stream.replace("0.0.0.0", "127.0.0.1")
    service.control = service.control.replace("0.0.0.0", "127.0.0.1")
    strangers = [service.client("blob/controls"), service.client("blob/controls", token=b"wrong-horse-battery-staple")]
    client = service.client("blob/controls", token=token)
    [first] = client.until(lambda _: True)
    client.until(lambda message: message.header.sequence >= first.header.sequence + 15)
    assert [stranger.pending() for stranger in strangers] == [[], []]
    assert service.ask("ping", token=token) == "pong"


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
        service = serve(
            "--puppet",
            blob_puppet,
            "--source",
            "demo:walk?loop",
            env={"NOTIFY_SOCKET": str(path), "WATCHDOG_USEC": "400000"},
        )
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
    command = [
        *SERVE[:-1],
        "--puppet",
        blob_puppet,
        "--source",
        "demo:walk?loop",
        "--status",
        "--metrics",
        str(metrics),
    ]
    process = commands.start(*command, stdout=subprocess.PIPE)
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
    assert service.ask("reload") == {"characters": ["two"]}
    wait = time.monotonic() + 30
    while stages(service) != {"two": "demo:roar?loop"}:
        assert time.monotonic() < wait
        time.sleep(0.1)
    client.until(lambda message: performing(message) and message.topic == "two/controls", "controls")
