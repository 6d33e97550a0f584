"""The real OpenNI2 library, with sensors that a test driver provides; see virtual_sensor.cpp."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from capture.sensors import openni_library as module
from capture.sensors.openni import OpenNIDevice, Selection
from capture.sensors.openni_library import Sensor, list_sensors, load_openni2, sensor_uris, usb_device_file

from ..conftest import refused

NAME = "openni:"


def test_a_sensor_on_usb_has_a_device_file():
    assert usb_device_file("1d27/0601@1/5") == Path("/dev/bus/usb/001/005")
    assert usb_device_file("virtual/0") is None


def test_sensors_are_listed_while_they_are_plugged_in_with_names_serial_numbers_and_errors(virtual_sensors):
    first, second = virtual_sensors
    assert list_sensors(NAME) == []
    first.plug()
    second.plug(refuses=["opening"])
    working, broken = list_sensors(NAME)
    assert working == Sensor("Puppetline virtual sensor 0", "virtual/0", "serial-0", None)
    assert (broken.name, broken.uri, broken.serial) == ("Puppetline virtual sensor 1", "virtual/1", "")
    assert broken.error.found == "a sensor that does not work (the virtual sensor refuses)"
    assert first.streaming == 0
    first.unplug()
    assert sensor_uris(load_openni2(NAME)) == ["virtual/1"]


def test_an_open_recording_does_not_count_as_a_sensor(recording, opened):
    opened("file", str(recording[0]))
    assert sensor_uris(load_openni2(NAME)) == []


def test_missing_permission_is_an_error_with_the_udev_rules(sensor, monkeypatch):
    sensor.unplug()
    sensor.plug(refuses=["opening"])
    monkeypatch.setattr(module, "usb_device_file", lambda uri: Path("/dev/bus/usb/001/005"))
    error = refused(OpenNIDevice, NAME, Selection())
    assert error.found == "a sensor at /dev/bus/usb/001/005 that this user may not open"
    assert "60-libopenni2-0.rules" in error.fix


ALONE = """
import os
os.chdir = None
from capture.sensors.openni_library import load_openni2
from puppetline.errors import SourceError
try:
    load_openni2("openni:")
    from openni import openni2
    print(openni2.is_initialized())
except SourceError as error:
    print(error.found, "|", error.fix)
"""


def alone(**environment):
    """Return what a new process prints that loads the library."""
    return subprocess.run(
        [sys.executable, "-c", ALONE], env=os.environ | environment, capture_output=True, text=True, check=True
    ).stdout


@pytest.mark.usefixtures("openni_folder")
def test_a_missing_library_is_an_error_with_the_package(tmp_path):
    said = alone(OPENNI2_REDIST=str(tmp_path))
    assert said.startswith("no OpenNI2 library that starts (none of libOpenNI2.so")
    assert "apt install libopenni2-0" in said


@pytest.mark.usefixtures("openni_folder")
def test_starting_the_library_does_not_change_the_working_directory():
    """The bindings' own function changes it temporarily; a take that begins then would be written elsewhere."""
    assert alone() == "True\n"


REOPEN = """
import sys, threading
from capture.sensors.openni_library import load_openni2, sensor_uris
from capture.sensors.source import SensorSource
from capture.source import wait
from puppetline.errors import SourceError

def unplugged():
    raise SourceError("openni:", found=f"{len(sensor_uris(library))} sensors", expected="one", fix="Plug it in.")

library = load_openni2("openni:")
for megabytes in range(64, 320, 16):  # large enough that the system frees a thread's memory when it ends
    threading.stack_size(megabytes << 20)
    source = SensorSource("openni:", unplugged, None)
    try:
        while True:
            wait(source, float("inf"))
            source.receive()
    except SourceError as error:
        print(error.found)
    source.close()
"""


@pytest.mark.usefixtures("openni_folder")
def test_opening_a_sensor_many_times_does_not_crash_the_library():
    """The library queries every thread that ever called it, which crashes on Linux if a thread has ended."""
    result = subprocess.run([sys.executable, "-c", REOPEN], capture_output=True, text=True, check=False)
    assert (result.returncode, result.stdout.splitlines()) == (0, ["0 sensors"] * 16)


def test_an_opening_that_never_returns_is_an_error_for_others(sensor, monkeypatch):
    monkeypatch.setattr(module, "LOCK_SECONDS", 0.1)
    with module._lock:
        assert "another sensor" in refused(OpenNIDevice, NAME, Selection()).found
