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

from ..conftest import Receiver

UNIT = Path(__file__).parents[4] / "packaging" / "systemd" / "puppetline.service"


@pytest.fixture
def notifier(until_end):
    return lambda: until_end(Notifier())


def test_each_state_is_a_datagram_as_sd_notify_sends_it(manager, notifier, given_clock):
    told = notifier()
    told.ready()
    told.status("2 users,\n30 frames a second\nREADY=0")
    told.reloading()
    told.stopping()
    assert manager.datagrams() == [
        b"READY=1",
        b"STATUS=2 users, 30 frames a second READY=0",
        b"RELOADING=1\nMONOTONIC_USEC=%d" % round(1e6 * given_clock.now()),
        b"STOPPING=1",
    ]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="abstract sockets are Linux's")
def test_the_socket_may_be_abstract(notifier, monkeypatch, until_end):
    name = f"puppetline-test-{os.getpid()}"
    manager = until_end(Receiver(f"\0{name}", socket.AF_UNIX))
    monkeypatch.setenv("NOTIFY_SOCKET", f"@{name}")
    notifier().ready()
    assert manager.datagrams() == [b"READY=1"]


def test_the_watchdog_is_fed_by_frames_and_by_nothing_else(manager, notifier, monkeypatch, given_clock):
    monkeypatch.setenv("WATCHDOG_USEC", "10000000")
    told = notifier()

    def feed(*frames, after=0.0):
        for number in frames:
            given_clock.advance(after)
            told.watchdog(number)
        return len(manager.datagrams())

    assert feed(0) == 0
    assert feed(1) == 1
    assert feed(*range(2, 50), after=0.1) == 0  # not more often than at half of the time
    given_clock.advance_to(1005.0)
    assert feed(50) == 1
    assert feed(*[50] * 100, after=1.0) == 0  # time alone does not feed it
    assert feed(51) == 1


@pytest.mark.parametrize(
    ("usec", "pid", "count"), [("", None, 0), ("10000000", "1", 0), ("x", None, 0), ("10000000", "own", 1)]
)
def test_only_a_watchdog_for_this_process_is_fed(manager, notifier, monkeypatch, usec, pid, count):
    monkeypatch.setenv("WATCHDOG_USEC", usec)
    if pid is not None:
        monkeypatch.setenv("WATCHDOG_PID", str(os.getpid()) if pid == "own" else pid)
    notifier().watchdog(5)
    assert manager.datagrams() == [b"WATCHDOG=1"] * count


def test_a_manager_that_is_gone_or_does_not_listen_is_not_waited_for(notifier, monkeypatch, tmp_path, until_end):
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "none"))
    told = notifier()
    told.ready()
    deaf = until_end(Receiver(str(tmp_path / "none"), socket.AF_UNIX))
    for k in range(10_000):  # far more than its queue holds
        told.status(str(k))
    assert deaf.datagrams()[0] == b"STATUS=0"


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
