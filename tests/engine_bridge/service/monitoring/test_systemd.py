import os
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from engine_bridge.performance.prepared_character import cache_folder
from engine_bridge.service.monitoring.systemd import Notifier
from engine_bridge.service.stages.calibration_store import state_file
from engine_bridge.studio.server import studio_folder

UNIT = Path(__file__).parents[4] / "packaging" / "systemd" / "puppetline.service"


@pytest.fixture(params=["path", "abstract"])
def manager(request, tmp_path, monkeypatch):
    """A socket as systemd has one, in the file system or abstract; gives all datagrams that have come."""
    if request.param == "abstract" and not sys.platform.startswith("linux"):
        pytest.skip("abstract sockets are Linux's")
    address = str(tmp_path / "notify") if request.param == "path" else f"\0puppetline-test-{os.getpid()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as receiver:
        receiver.bind(address)
        receiver.setblocking(False)
        monkeypatch.setenv("NOTIFY_SOCKET", address.replace("\0", "@"))
        monkeypatch.delenv("WATCHDOG_USEC", raising=False)
        monkeypatch.delenv("WATCHDOG_PID", raising=False)

        def received():
            came = []
            while True:
                try:
                    came.append(receiver.recv(4096).decode())
                except BlockingIOError:
                    return came

        yield received


@pytest.fixture
def notifier(until_end):
    return lambda: until_end(Notifier())


def test_each_state_is_a_datagram_as_sd_notify_sends_it(manager, notifier, given_clock):
    told = notifier()
    told.ready()
    told.status("2 users,\n30 frames a second\nREADY=0")
    told.reloading()
    told.stopping()
    ready, status, reloading, stopping = manager()
    assert ready == "READY=1"
    assert stopping == "STOPPING=1"
    assert status == "STATUS=2 users, 30 frames a second READY=0"
    assert reloading == f"RELOADING=1\nMONOTONIC_USEC={round(1e6 * given_clock.now())}"


def test_the_watchdog_is_fed_by_frames_and_by_nothing_else(manager, notifier, monkeypatch, given_clock):
    monkeypatch.setenv("WATCHDOG_USEC", "10000000")
    told = notifier()
    told.watchdog(0)
    assert manager() == []
    told.watchdog(1)
    assert manager() == ["WATCHDOG=1"]
    for k in range(2, 50):  # not more often than at half of the time
        given_clock.advance(0.1)
        told.watchdog(k)
    assert manager() == []
    given_clock.advance_to(1005.0)
    told.watchdog(50)
    assert manager() == ["WATCHDOG=1"]
    for _ in range(100):  # time alone does not feed it
        given_clock.advance(1.0)
        told.watchdog(50)
    assert manager() == []
    told.watchdog(51)
    assert manager() == ["WATCHDOG=1"]


@pytest.mark.parametrize(
    ("usec", "pid", "told"), [("", "", []), ("10000000", "1", []), ("x", "", []), ("10000000", "own", ["WATCHDOG=1"])]
)
def test_only_a_watchdog_for_this_process_is_fed(manager, notifier, monkeypatch, usec, pid, told):
    for name, value in (("WATCHDOG_USEC", usec), ("WATCHDOG_PID", pid.replace("own", str(os.getpid())))):
        if value:
            monkeypatch.setenv(name, value)
    notifier().watchdog(5)
    assert manager() == told


def test_a_manager_that_is_gone_or_does_not_listen_is_not_waited_for(notifier, monkeypatch, tmp_path):
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "none"))
    told = notifier()
    told.ready()
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as deaf:
        deaf.bind(str(tmp_path / "none"))
        for k in range(10_000):  # far more than its queue holds
            told.status(str(k))
        assert deaf.recv(100) == b"STATUS=0"


def test_systemd_has_nothing_against_the_unit_file_and_calls_it_hard(tmp_path):
    if shutil.which("systemd-analyze") is None:
        pytest.skip("systemd-analyze is not here")
    unit = tmp_path / UNIT.name
    unit.write_text(UNIT.read_text().replace("/opt/puppetline/bin/puppetline", shutil.which("true")))

    def analyze(*arguments):
        return subprocess.run(["systemd-analyze", *arguments, unit], capture_output=True, text=True, check=False)

    result = analyze("verify", "--man=no")
    assert result.returncode == 0
    assert result.stdout == ""
    assert result.stderr == ""
    result = analyze("security", "--offline=true", "--threshold=20")
    assert result.returncode == 0 or "unrecognized option" in result.stderr, result.stdout


def test_files_kept_between_runs_are_in_folders_that_the_unit_may_write_to(tmp_path, monkeypatch):
    settings = [line.partition("=") for line in UNIT.read_text().splitlines() if line and line[0] != "#"]
    environment = dict(pair.split("=") for key, _, value in settings if key == "Environment" for pair in value.split())
    owned = {key: value for key, _, value in settings if key in ("CacheDirectory", "StateDirectory")}
    monkeypatch.delenv("HOME", raising=False)  # a dynamic user has none
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert str(cache_folder()) == f"/var/cache/{owned['CacheDirectory']}/models"
    assert str(state_file()) == f"/var/lib/{owned['StateDirectory']}/performers.json"
    assert str(studio_folder()) == f"/var/lib/{owned['StateDirectory']}/studio"
    assert environment["NUMBA_CACHE_DIR"].startswith(f"/var/cache/{owned['CacheDirectory']}/")
