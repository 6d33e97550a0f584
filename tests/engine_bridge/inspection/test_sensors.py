import ctypes
import ctypes.util
import os
import sys
from types import SimpleNamespace

import pytest

from capture.libraries import NotInstalledError
from capture.sensors import freenect, openni_library
from capture.sensors.openni_library import Sensor
from capture.trackers.mediapipe import INSTALL_FIX
from capture.trackers.nite import library_path
from engine_bridge.inspection import sensors
from engine_bridge.inspection.finding import Finding
from puppetline.errors import SourceError

from .test_machine import named


@pytest.fixture
def usb(tmp_path, monkeypatch):
    """Simulate USB devices in sysfs, with device files that this user may not open."""
    monkeypatch.setattr(sensors, "_USB", tmp_path / "usb")
    monkeypatch.setattr(sensors, "_NODES", tmp_path / "nodes")
    (tmp_path / "usb" / "1-0:1.0").mkdir(parents=True)  # an interface has no ids

    def plug(*devices):
        """Plug in devices, as "vendor:product:name:speed"; return the folder of their files."""
        for number, each in enumerate(devices):
            device, node = tmp_path / "usb" / f"1-{number}", tmp_path / "nodes" / "001" / f"{number:03}"
            for path in (device, node.parent):
                path.mkdir(parents=True, exist_ok=True)
            about = zip(("idVendor", "idProduct", "product", "speed"), each.split(":"), strict=False)
            for file, value in (*about, ("busnum", "1"), ("devnum", str(number))):
                (device / file).write_text(value + "\n")
            node.touch()
        return tmp_path / "nodes" / "001"

    return plug


def without(monkeypatch, *paths):
    """Remove the permission to open files, which root always has."""
    allowed = os.access
    monkeypatch.setattr(os, "access", lambda path, mode: path not in paths and allowed(path, mode))


def depth_sensors():
    return list(sensors._depth_sensors([*sensors._plugged()]))


SLOW = (
    *("Intel(R) RealSense(TM) 435, USB", False, "480 Mbit/s; it requires 5000"),
    "Use a USB 3 port and a USB 3 cable.",
)


@pytest.mark.parametrize(
    ("plugged", "findings"),
    [
        ([], [("depth sensors", None, "no known model on USB")]),
        (
            ["1d6b:0002", "045e:02ae", "045e:097d", "1d27:0601"],  # the first is a hub
            [
                ("Kinect v1 (Xbox 360)", True, "NODES/001, for freenect:"),
                ("Azure Kinect", None, "NODES/002, not supported; its own programs can send OSC"),
                ("Asus Xtion Pro Live", True, "NODES/003, for openni:"),
            ],
        ),
        (
            # the second is another device of the same maker
            ["8086:0b07:Intel(R) RealSense(TM) 435:480", "8086:0001:Hub:480", "2bc5:0800::5000"],
            [
                ("Intel(R) RealSense(TM) 435", True, "NODES/000, for realsense:"),
                SLOW,
                ("Orbbec sensor", True, "NODES/002, for orbbec:"),
            ],
        ),
    ],
)
def test_depth_sensors_are_recognised_by_usb_ids_and_listed_with_their_sources(usb, plugged, findings):
    nodes = str(usb(*plugged))
    assert depth_sensors() == [
        Finding(name, ok, detail.replace("NODES", nodes), *fix) for name, ok, detail, *fix in findings
    ]


@pytest.mark.parametrize(("kind", "package"), [("045e:02ae", "libfreenect0.5"), ("1d27:0600", "libopenni2-0")])
def test_a_sensor_that_may_not_be_opened_is_a_finding_with_its_udev_rules(usb, monkeypatch, kind, package):
    nodes = usb(kind)
    without(monkeypatch, nodes / "000")
    (finding,) = depth_sensors()
    assert (finding.ok, finding.detail) == (False, f"{nodes}/000: no permission")
    assert finding.fix == (
        f"Install the udev rules 60-{package}.rules from Debian's {package}, run udevadm control --reload, "
        "and plug the sensor in again."
    )


def test_a_camera_that_is_missing_or_without_permission_is_no_failure(tmp_path, monkeypatch):
    monkeypatch.setattr(sensors, "_CAMERAS", tmp_path)
    assert list(sensors._cameras()) == [Finding("cameras", None, "no /dev/video*")]
    monkeypatch.setattr(sensors, "_VIDEO", tmp_path / "names")
    for number in range(2):
        (tmp_path / f"video{number}").touch()
    name = tmp_path / "names" / "video0" / "name"
    name.parent.mkdir(parents=True)
    name.write_text("Integrated Camera\n")
    without(monkeypatch, tmp_path / "video1")
    fix = f"Add this user to the group {name.group()}, and log in again."
    assert list(sensors._cameras()) == [
        Finding(f"{tmp_path}/video0", True, "Integrated Camera, can be opened"),
        Finding(f"{tmp_path}/video1", None, "unnamed, no permission", fix),
    ]


def test_a_library_that_is_not_there_is_amiss_only_where_a_sensor_needs_it(usb, monkeypatch):
    monkeypatch.setattr(freenect, "LIBRARIES", ())
    monkeypatch.setattr(ctypes.util, "find_library", lambda _name: None)
    for module in ("pyrealsense2", "pyorbbecsdk", "mediapipe", "cv2"):
        monkeypatch.setitem(sys.modules, module, None)
    detail = "not installed; required by freenect:"
    fix = "Install it: apt install libfreenect0.5 on Debian and Ubuntu, brew install libfreenect on macOS."
    assert named(sensors.examine(), "libfreenect") == Finding("libfreenect", None, detail, fix)
    usb("045e:02ae", "8086:0b07:RealSense:5000", "2bc5:0800")
    findings = [*sensors.examine()]
    assert named(findings, "libfreenect") == Finding("libfreenect", False, detail, fix)
    libraries = ("librealsense", "Orbbec SDK", "MediaPipe", "OpenCV")
    assert [named(findings, library).ok for library in libraries] == [False, False, False, None]
    assert named(findings, "MediaPipe").fix == named(findings, "OpenCV").fix == INSTALL_FIX


@pytest.mark.parametrize(
    ("named", "ok", "detail"),
    [(False, None, "not installed; required by openni:"), (True, False, "no OpenNI2 library that starts (")],
)
def test_openni2_is_optional_unless_the_environment_names_its_folder(tmp_path, monkeypatch, named, ok, detail):
    monkeypatch.delenv(openni_library.REDIST_VARIABLE, raising=False)
    if named:
        monkeypatch.setenv(openni_library.REDIST_VARIABLE, str(tmp_path))
    monkeypatch.setattr(openni_library, "_path", lambda: str(tmp_path / "libOpenNI2.so.0"))
    monkeypatch.setattr(ctypes.util, "find_library", lambda _name: None)
    bindings = SimpleNamespace(
        loaded_dll_directory=None, OpenNIError=ArithmeticError, c_api=SimpleNamespace(load_dll=ctypes.CDLL)
    )
    (finding,) = sensors._library(
        "OpenNI 2", lambda name: openni_library._start(name, bindings), "openni:", needed=False
    )
    assert (finding.ok, finding.fix) == (ok, "Install it: apt install libopenni2-0 on Debian and Ubuntu.")
    assert finding.detail.startswith(detail)


@pytest.mark.parametrize(("nite", "ok"), [(None, False), ("libNiTE2.so", None)])
def test_mediapipe_is_needed_for_an_openni2_sensor_only_where_nite2_is_not(usb, monkeypatch, nite, ok):
    def mediapipe_is_not_here():
        raise NotInstalledError("MediaPipe", found="nothing", expected="it", fix="Install it.")

    monkeypatch.setattr(sensors, "load_mediapipe", mediapipe_is_not_here)
    monkeypatch.setattr(sensors.nite, "library_path", lambda: nite)
    usb("1d27:0601")
    assert named(sensors.examine(), "MediaPipe").ok is ok


def test_a_machine_without_usb_is_no_failure(monkeypatch):
    library = SimpleNamespace(freenect_init=lambda _context, _usb: -1)
    monkeypatch.setattr(freenect, "_load", lambda _where: library)
    assert named(sensors.examine(), "libfreenect") == Finding(
        "libfreenect", True, "installed; no USB on this machine (in a container, pass /dev/bus/usb through)"
    )


def test_nite2_is_looked_for_where_openni_looks_for_it(usb, tmp_path, monkeypatch):
    monkeypatch.setenv("NITE2_REDIST", str(tmp_path))
    assert sensors._nite() == Finding("NiTE 2", None, f"not in {tmp_path}, which NITE2_REDIST names")
    (tmp_path / "libNiTE2.so").touch()
    assert sensors._nite() == Finding("NiTE 2", True, f"{tmp_path}/libNiTE2.so")
    assert sensors._nite().detail == library_path()
    monkeypatch.delenv("NITE2_REDIST")
    monkeypatch.setattr(ctypes.util, "find_library", {}.get)
    assert sensors._nite() == Finding("NiTE 2", None, "not installed")
    assert library_path() is None


def test_libraries_that_are_there_list_the_sensors_that_they_find_by_the_names_of_their_sources(usb, monkeypatch):
    def give(module, **functions):
        for name, result in functions.items():
            monkeypatch.setattr(module, name, lambda *_, result=result: result)

    usb("045e:02ae")
    trouble = SourceError("openni:uri=b", found="a sensor that does not work (busy)", expected="one", fix="End it.")
    plugged = [Sensor("Xtion", "a", "17", None), Sensor("Xtion", "b", "", trouble), Sensor("Carmine", "c", "", None)]
    intel = {"name": "D435", "serial_number": "17", "firmware_version": "5.16.0.1", "usb_type_descriptor": "3.2"}
    about = {"name": "Femto", "serial_number": "A", "firmware_version": "1.2", "connection_type": "USB3.0"}
    femto = SimpleNamespace(**{f"get_{name}": lambda value=value: value for name, value in about.items()})
    femto.get_device_info = lambda: femto
    give(freenect, count_sensors=2)
    give(openni_library, load_openni2=None, list_sensors=plugged)
    give(sensors.realsense, load_realsense=None, plugged_in=[intel])
    monkeypatch.setattr(sensors.realsense, "information", lambda _library, device, name: device[name])
    give(sensors.orbbec, load_orbbec=None, plugged_in=[femto])
    give(sensors, load_mediapipe=None, version="0.10.21")
    expected = [
        Finding("libfreenect", True, "installed; 2 Kinect v1 plugged in"),
        Finding("OpenNI 2", True, "installed; 3 sensors plugged in"),
        Finding("openni:serial=17", True, "Xtion, also openni:uri=a"),
        Finding("openni:uri=b", None, "Xtion, a sensor that does not work (busy)", "End it."),
        Finding("openni:uri=c", True, "Carmine, which has no serial number"),
        Finding("librealsense", True, "installed; 1 sensor plugged in"),
        Finding("realsense:serial=17", True, "D435, firmware 5.16.0.1, USB 3.2"),
        Finding("Orbbec SDK", True, "installed; 1 sensor plugged in"),
        Finding("orbbec:serial=A", True, "Femto, firmware 1.2, USB3.0"),
        Finding("MediaPipe", True, "0.10.21"),
    ]
    findings = [*sensors.examine()]
    start = findings.index(expected[0])
    assert findings[start : start + len(expected)] == expected
