import errno
import os
import socket
from types import SimpleNamespace

import pytest

from engine_bridge.inspection import machine
from engine_bridge.inspection.finding import Finding
from engine_bridge.inspection.machine import PORTS, examine, required, text

SENSORS = ("libfreenect", "OpenNI 2", "MediaPipe", "OpenCV", "NiTE 2")


def named(findings, name):
    (finding,) = [each for each in findings if each.name == name]
    return finding


def test_every_requirement_of_the_service_is_checked_without_changing_anything(tmp_path):
    before = sorted(tmp_path.rglob("*"))
    findings = examine(tmp_path / "takes")
    assert sorted(tmp_path.rglob("*")) == before
    names = [finding.name for finding in findings]
    assert len(names) == len(set(names))
    checked = {"Python", "processor", "cache", "state", "takes", "clock", "systemd", "multicast DNS"}
    assert checked | {*required(), *SENSORS} <= set(names)
    assert {f"port {port}/{kind}" for kind, port, _ in PORTS} <= set(names)
    for library in required():
        assert named(findings, library).ok is True
    assert all(finding.fix for finding in findings if finding.ok is False)
    assert all(finding.fix for finding in findings if "not installed; " in finding.detail)


def test_a_library_that_is_missing_is_named_and_the_rest_is_still_looked_at(monkeypatch):
    monkeypatch.setattr(machine, "requires", lambda _: ["numpy>=2", "no-such-thing[a]>1", "click", 'tornado; x == "y"'])
    good, bad, also_good = machine._libraries()
    assert (good.ok, bad.ok, also_good.ok) == (True, False, True)
    assert (bad.detail, bad.fix[:7]) == ("No module named 'no_such_thing'", "Install")


@pytest.mark.parametrize("kind", ["tcp", "udp"])
def test_a_port_in_use_is_no_failure_and_its_owner_is_named(monkeypatch, kind):
    with socket.socket(type=socket.SOCK_STREAM if kind == "tcp" else socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        if kind == "tcp":
            other.listen()
        port = other.getsockname()[1]
        monkeypatch.setattr(machine, "PORTS", ((kind, port, "stream"),))
        (taken,) = machine._ports()
    (free,) = machine._ports()
    assert (taken.name, taken.ok, free.ok) == (f"port {port}/{kind}", None, True)
    assert f"process {os.getpid()} (stream)" in taken.detail
    assert free.detail == "free (stream)"


def test_a_machine_without_loopback_is_a_failure(monkeypatch):
    class Socket(socket.socket):
        def bind(self, _address):
            raise OSError(errno.EADDRNOTAVAIL, "Cannot assign requested address")

    monkeypatch.setattr(socket, "socket", Socket)
    assert [finding.ok for finding in machine._ports()] == [False] * len(PORTS)


def test_a_folder_that_is_not_there_yet_is_judged_by_the_one_it_would_be_made_in(tmp_path):
    finding = machine._folder("takes", tmp_path / "a" / "b")
    assert finding.ok is True
    assert "will be created" in finding.detail


def test_an_unwritable_folder_is_a_failure_if_the_user_asked_for_it(tmp_path, monkeypatch):
    def refuse(dir):  # noqa: A002 - tempfile's own name
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(machine.tempfile, "TemporaryFile", refuse)
    findings = examine()
    assert [named(findings, name).ok for name in ("cache", "state", "takes")] == [None] * 3
    takes = named(examine(tmp_path), "takes")
    assert (takes.ok, takes.detail) == (False, f"{tmp_path}: cannot be written to (Permission denied)")


def test_low_disk_space_a_coarse_clock_no_curve_and_no_network_are_reported_and_no_failure(tmp_path, monkeypatch):
    def no_network(_seconds):
        raise OSError("Network is unreachable")

    assert machine._pyzmq("27.0.0").fix == ""
    monkeypatch.setattr(machine, "LOW_DISK_BYTES", 1e18)
    monkeypatch.setattr(machine.time, "get_clock_info", lambda _name: SimpleNamespace(resolution=0.015625))
    monkeypatch.setattr("zmq.has", {"curve": False}.get)
    monkeypatch.setattr("engine_bridge.service.discovery.find", no_network)
    disk, time, zeromq = machine._folder("takes", tmp_path), machine._clock(), machine._pyzmq("27.0.0")
    network = machine._network()
    assert [each.ok for each in (disk, time, zeromq, network)] == [True, True, True, None]
    assert "15625000 ns, too coarse" in time.detail
    assert "Network is unreachable" in network.detail
    assert all(each.fix for each in (disk, zeromq, network))


def test_given_sources_are_opened_once_and_fail_if_they_cannot_be_opened(given_clock):
    with socket.socket(type=socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        silent = f"osc:{probe.getsockname()[1]}"
    asked = ["demo:walk", silent, "demo:walk", "demo:nobody", "replay:no such file"]
    findings = [each for each in examine(sources=asked) if each.name in asked]
    assert [(each.name, each.ok, each.detail) for each in findings] == [
        ("demo:walk", True, "works"),
        (silent, True, f"can be opened; no data within {machine.FIRST_DATA_SECONDS:g} s"),
        ("demo:nobody", False, "no example motion 'nobody'"),
        ("replay:no such file", False, "no such file: a file that cannot be read (No such file or directory)"),
    ]
    assert findings[2].fix == "Use one of these names, for example demo:walk?loop."


def test_findings_are_lines_to_read():
    findings = ("Python", True, "3.11"), ("port 7400/tcp", False, "in use", "End it."), ("cameras", None, "none")
    assert text([Finding(*each) for each in findings]).splitlines() == [
        "ok  Python         3.11",
        "!!  port 7400/tcp  in use",
        "                   → End it.",
        "--  cameras        none",
    ]
