import json
import os
import socket
from dataclasses import asdict
from pathlib import Path

import pytest

from engine_bridge.live import doctor
from engine_bridge.live.doctor import LIBRARIES, PORTS, examine, text
from engine_bridge.live.finding import Finding

SENSORS = ("libfreenect", "OpenNI 2", "MediaPipe", "OpenCV", "NiTE 2")


def named(findings, name):
    (finding,) = [each for each in findings if each.name == name]
    return finding


def test_it_looks_at_everything_that_the_service_needs_and_changes_nothing(tmp_path):
    before = sorted(tmp_path.rglob("*"))
    findings = examine(tmp_path / "takes")
    assert sorted(tmp_path.rglob("*")) == before
    names = [finding.name for finding in findings]
    assert len(names) == len(set(names))
    assert {
        "Python",
        "processor",
        "cache",
        "state",
        "takes",
        "clock",
        "systemd",
        "multicast DNS",
        *LIBRARIES,
        *SENSORS,
    } <= set(names)
    assert {f"port {port}/{kind}" for kind, port, _ in PORTS} <= set(names)
    for library in LIBRARIES:
        assert named(findings, library).ok is True
    assert "CURVE there" in named(findings, "pyzmq").detail
    assert all(finding.fix for finding in findings if finding.ok is False)
    assert not any(finding.fix for finding in findings if finding.ok is None)


def test_the_libraries_are_those_that_the_distribution_depends_on():
    import tomllib

    project = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())
    needed = {dependency.partition(">")[0] for dependency in project["project"]["dependencies"]}
    assert needed - {"typing-extensions"} == set(LIBRARIES)


def test_a_library_that_is_missing_is_named_and_the_rest_is_still_looked_at(monkeypatch):
    monkeypatch.setattr(doctor, "LIBRARIES", {"numpy": "numpy", "no-such-thing": "no_such_thing", "click": "click"})
    good, bad, also_good = doctor._libraries()
    assert (good.ok, bad.ok, also_good.ok) == (True, False, True)
    assert (bad.detail, bad.fix[:7]) == ("No module named 'no_such_thing'", "Install")


@pytest.mark.parametrize("kind", ["tcp", "udp"])
def test_a_port_that_is_taken_is_said_to_be_with_who_has_it(monkeypatch, kind):
    with socket.socket(type=socket.SOCK_STREAM if kind == "tcp" else socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        if kind == "tcp":
            other.listen()
        port = other.getsockname()[1]
        monkeypatch.setattr(doctor, "PORTS", ((kind, port, "stream"),))
        (taken,) = doctor._ports()
    (free,) = doctor._ports()
    assert (taken.name, taken.ok, free.ok) == (f"port {port}/{kind}", False, True)
    assert f"process {os.getpid()} (stream)" in taken.detail
    assert free.detail == "free (stream)"


def test_a_folder_that_is_not_there_yet_is_judged_by_the_one_it_would_be_made_in(tmp_path):
    finding = doctor._folder("takes", tmp_path / "a" / "b")
    assert finding.ok is True
    assert "will be made" in finding.detail


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission_is_a_finding_with_a_fix(tmp_path):
    (tmp_path / "closed").mkdir(mode=0o500)
    finding = doctor._folder("takes", tmp_path / "closed")
    assert finding.ok is False
    assert str(tmp_path / "closed") in finding.fix


def test_a_file_in_the_way_of_a_folder_is_a_finding(tmp_path, monkeypatch):
    def refuse(dir):  # noqa: A002 - tempfile's own name
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(doctor.tempfile, "TemporaryFile", refuse)
    finding = doctor._folder("takes", tmp_path)
    assert (finding.ok, finding.detail) == (False, f"{tmp_path}: cannot be written to (Permission denied)")


def test_little_room_is_a_finding(tmp_path, monkeypatch):
    monkeypatch.setattr(doctor, "LITTLE_ROOM", 1e18)
    finding = doctor._folder("takes", tmp_path)
    assert (finding.ok, finding.fix) == (False, "Make room on that disk.")


def test_findings_are_lines_to_read_and_json():
    findings = [
        Finding("Python", True, "3.11"),
        Finding("port 7400/tcp", False, "in use", "End it."),
        Finding("cameras", None, "none"),
    ]
    assert text(findings).splitlines() == [
        "ok  Python         3.11",
        "!!  port 7400/tcp  in use",
        "                   → End it.",
        "--  cameras        none",
    ]
    assert json.loads(json.dumps([asdict(finding) for finding in findings]))[1] == {
        "name": "port 7400/tcp",
        "ok": False,
        "detail": "in use",
        "fix": "End it.",
    }
