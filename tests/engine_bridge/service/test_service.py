"""The whole service: in this process on the given clock, and as a process where that is the subject."""

import fcntl
import json
import os
import re
import signal
import subprocess
import sys
import urllib.request
from unittest.mock import Mock

import numpy as np
import pytest

from capture import body
from capture.events import Cue
from capture.skeleton import JOINT_INDEX
from engine_bridge.service.commands import commands
from engine_bridge.service.discovery import Announcement
from puppetline.errors import ServiceError

WALK = ("--source", "demo:walk?loop", "--calibrate", "at_once")
SERVE = ("serve", "--port", "0", "--no-announce")


@pytest.fixture
def performed(play, blob_puppet, sender, kung_fu):
    """Play a service with one character, and a performer who moves for ten seconds and has been calibrated."""
    service = play("--puppet", blob_puppet, "--source", sender.uri, "--calibrate", "at_once")
    service.perform(sender, kung_fu[:300])
    service.until(lambda: service.frames and service.frames[-1].state == "performing")
    return service


def test_a_reload_ends_a_take_every_request_is_answered_and_a_restarted_service_knows_its_performers(
    performed, play, blob_puppet, sender, kung_fu, tmp_path
):
    performed.ask("record_start", name="short")
    requests = [performed.request("reload") for _ in range(3)]
    performed.until(lambda: all(requests))
    assert [json.loads(reply)["result"] for [reply] in requests] == [{"characters": ["blob"]}] * 3
    assert performed.stage()["recording"] is None
    assert (tmp_path / "takes" / "short.log").read_bytes().endswith(b"}\n")
    performed.run(6.0)  # until the calibration is stored
    performed.close()
    again = play("--puppet", blob_puppet, "--source", sender.uri)
    again.perform(sender, kung_fu[100:160])  # never still for a second
    assert "performing" in {frame.state for frame in again.run(2.0)}


def test_a_take_does_not_begin_while_a_reload_would_end_it(performed):
    arguments, begin = commands(performed.service)["record_start"]
    performed.service.reload()
    with pytest.raises(ServiceError, match="characters that are being loaded again"):
        begin(arguments.model_validate({"name": "late"}))
    performed.run(0.5)
    assert performed.ask("record_start", name="late")["take"] == "late"
    assert performed.runner.recording == "late"


def test_osc_and_the_watchdog_come_at_their_rates(play, blob_puppet, receiver, manager, monkeypatch):
    monkeypatch.setenv("WATCHDOG_USEC", "1000000")
    target = f"127.0.0.1:{receiver.port}"
    service = play("--puppet", blob_puppet, *WALK, "--osc", target, "--osc-rate", 10)
    service.run(3.0)
    assert [address for address, _ in receiver.messages()].count("/puppetline/blob/handle/head") in (30, 31)
    told = manager.datagrams()
    assert told.count(b"WATCHDOG=1") == 6
    assert b"STATUS=1 of 1 characters performing" in told


def test_the_status_has_the_performers_height_and_the_sensors_position_and_is_at_prometheus(
    play, blob_puppet, record_events, tmp_path, kung_fu, free_port
):
    stands, metrics = {"tilt": 12.0, "height": 1.3, "roll": -2.0}, free_port()
    take = record_events(tmp_path / "take.log", [Cue(kung_fu[0].time, "level", stands), *kung_fu])
    service = play("--puppet", blob_puppet, "--source", f"replay:{take}?loop", "--metrics", metrics)
    service.run(0.5)
    [user] = service.stage()["users"]
    distance, seen = user.pop("distance"), user.pop("seen")
    unknown = {"height": None, "reach": None}
    assert user == {"user": 1, "state": "calibrating", "character": "blob"} | unknown
    assert seen < 0.1
    assert distance == pytest.approx(np.hypot(*np.median(kung_fu[0].positions[:, ::2], axis=0)), abs=0.2)
    service.run(3.0)
    stage = service.stage()
    [user] = stage["users"]
    rest = body.resting_pose(np.stack([f.positions for f in kung_fu]), np.stack([f.confidence for f in kung_fu]), 0, 30)
    reach = body.reach(rest)[[JOINT_INDEX["hand_left"], JOINT_INDEX["hand_right"]]].mean()
    assert user["state"] == "performing"
    assert user["height"] == pytest.approx(body.height(rest), abs=0.01)
    assert user["reach"] == pytest.approx(reach, abs=0.01)
    assert stage["sensor"] == stands
    with urllib.request.urlopen(f"http://127.0.0.1:{metrics}/metrics") as answer:
        assert b'\npuppetline_character_state{character="blob",state="performing"} 1' in answer.read()


def test_a_reload_reads_the_stages_of_the_service_file_again(play, blob_puppet, tmp_path, monkeypatch):
    file, announced = tmp_path / "service.toml", []
    monkeypatch.setattr(Announcement, "__init__", lambda _, *arguments: announced.append(arguments))
    monkeypatch.setattr(Announcement, "rename", lambda _, names: announced.append(names))
    monkeypatch.setattr(Announcement, "close", Mock())

    def write(**stages):
        tables = "".join(
            f'[[stage]]\nname = "{name}"\nsource = "demo:{source}"\ncalibrate = "at_once"\n'
            f'[[stage.character]]\npuppet = "{blob_puppet}"\nname = "{name}"\n'
            for name, source in stages.items()
        )
        file.write_text("[network]\nport = 0\n" + tables)

    write(one="walk?loop")
    service = play("--config", file)
    ports = [int(each.rpartition(":")[2]) for each in (*service.service.stream, *service.service.control.endpoints)]
    assert announced == [("127.0.0.1", *ports, "NULL", ["one"])]
    early = service.client("two/scene")
    before = service.run(1.0)[-1]
    write(one="walk?loop", two="rear?loop")
    assert service.ask("reload") == {"characters": ["one", "two"]}
    assert announced[-1] == ["one", "two"]
    assert [message.topic for message in service.heard(early)] == ["two/scene"]
    service.run(1.0)
    later, other = service.of("one")[-1], service.of("two")[-1]
    [listed] = service.heard(service.client("service/characters"))
    assert [each["name"] for each in listed.body] == ["one", "two"]
    assert before.state == later.state == other.state == "performing"
    assert later.character.revision == before.character.revision
    numbers = [frame.sequence for frame in service.frames if frame.character.name == "one"]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    write(one="nothing")
    assert "nothing" in service.ask("reload")["found"]
    assert service.ask("list")["characters"] == ["one", "two"]
    write(two="roar?loop")
    service.ask("record_start", stage="two", name="take")
    service.run(1.0)
    service.ask("record_stop", stage="two")
    service.ask("play_take", character="two", take="take")
    assert service.ask("pause")["paused"]
    assert service.ask("reload") == {"characters": ["two"]}
    stage = service.stage()
    assert stage["name"] == "two"
    assert stage["source"] == "demo:roar?loop"
    late = service.client("one/performer", "one/scene", "two/scene")
    assert [message.topic for message in service.heard(late)] == ["two/scene"]
    service.run(2.0)
    held = [frame.pose.R for frame in service.run(1.0)]  # the take drives the character, nobody else
    assert len(held) >= 29
    assert all(np.array_equal(R, held[0]) for R in held)
    service.ask("stop")
    turned = service.run(1.0)[-1]
    assert turned.state == "performing"
    assert not np.array_equal(turned.pose.R, held[0])


# From here on the process is the subject.


@pytest.mark.slow
def test_a_stopped_service_ends_cleanly_and_leaves_a_complete_take(serve, blob_puppet, tmp_path, manager):
    service = serve("--puppet", blob_puppet, *WALK)
    service.ask("record_start", name="last")
    service.client("blob/controls").until(lambda message: message.header.sequence % 40 == 0)
    assert service.stop() == 0
    first, *_, last = manager.datagrams()
    assert first == b"READY=1"
    assert last == b"STOPPING=1"
    assert (tmp_path / "takes" / "last.log").read_bytes().endswith(b"}\n")
    assert not [line for line in service.log if "Traceback" in line]


@pytest.mark.slow
@pytest.mark.parametrize("loaded", ["engine_bridge.service.system_signals", "engine_bridge.service.monitoring.logs"])
def test_a_stop_during_the_start_ends_it_cleanly(blob_puppet, loaded):
    command = [sys.executable, "-m", "puppetline", *SERVE, "--puppet", blob_puppet, "--source", "osc:0"]
    told = os.environ | {"PYTHONPROFILEIMPORTTIME": "1"}  # each module on standard error, as soon as it is loaded
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=told)
    next(line for line in process.stderr if line.rpartition("|")[2].strip() == loaded)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate()
    assert process.returncode in (0, 1)
    assert "Traceback" not in said
    assert "internal error" not in said


@pytest.mark.slow
def test_reloads_by_signal_with_a_log_that_is_not_read_delay_nothing(listen, blob_puppet, commands):
    command = [*SERVE, "--puppet", blob_puppet, *WALK, "--log-format", "json", "--status"]
    process = commands.start(*command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        served = json.loads(process.stderr.readline())["fields"]
        assert re.match(r"Puppetline \S+  up 0:0\d:\d\d  \d+ MB .* of 64 clients", process.stdout.readline())
        assert process.stdout.readline().strip().startswith("stage (demo:walk?loop): ")
        fcntl.fcntl(process.stderr, fcntl.F_SETPIPE_SZ, 4096)
        client = listen(served["stream"][0], "blob/scene", "blob/controls")
        after = 0
        for _ in range(40):  # each reload says a line: more than the pipe holds
            process.send_signal(signal.SIGHUP)
            after = client.until(lambda message, last=after: message.header.sequence > last, "controls")[-1]
            after = after.header.sequence
        client.until(lambda message: message.header.sequence > after + 10, "controls")
    finally:
        process.terminate()
        assert process.wait() == 0
        process.stdout.close()
        process.stderr.close()
