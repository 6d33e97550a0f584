"""Checks of sensors and cameras: what is plugged in, which source reads it, what prevents that.

A depth sensor that is plugged in is meant to be used, so the check fails if something that it requires is missing. A
camera may be built into the machine, so a missing permission to open it is no failure.
"""

import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from capture.libraries import NotInstalledError
from capture.sensors import freenect, openni_library, orbbec, realsense
from capture.sensors.camera import load_opencv
from capture.trackers import nite
from capture.trackers.mediapipe import load_mediapipe
from engine_bridge.inspection.finding import Finding
from puppetline.errors import SourceError


@dataclass(frozen=True)
class Kind:
    """A kind of depth sensor.

    Attributes
    ----------
    name : str
    scheme : str
        Scheme of the source that reads it; empty if there is none.
    package, rules : str
        Debian's package with the udev rules that let users open it, and the file of the rules; empty for neither.
    speed : int
        Speed of USB that it requires, in Mbit/s.
    """

    name: str
    scheme: str = ""
    package: str = ""
    rules: str = ""
    speed: int = 480


_ASTRA = Kind("Orbbec Astra", "openni:")
_OPENNI = "openni:", "libopenni2-0", openni_library.UDEV_RULES

KINDS: dict[str, Kind] = {
    "045e:02ae": Kind("Kinect v1 (Xbox 360)", "freenect:", "libfreenect0.5", freenect.UDEV_RULES),
    "045e:02bf": Kind("Kinect v1 for Windows", "freenect:", "libopenni2-0", openni_library.UDEV_RULES),
    "045e:02c4": Kind("Kinect v2"),
    "045e:02d8": Kind("Kinect v2"),
    "045e:097d": Kind("Azure Kinect"),
    "1d27:0600": Kind("Asus Xtion", *_OPENNI),
    "1d27:0601": Kind("Asus Xtion Pro Live", *_OPENNI),
    "1d27:0609": Kind("PrimeSense Carmine", *_OPENNI),
    "2bc5:0401": _ASTRA,
    "2bc5:0402": _ASTRA,
    "2bc5:0403": _ASTRA,
}
"""Known depth sensors by USB vendor and product."""

VENDORS = {"2bc5": Kind("Orbbec sensor", "orbbec:")}
"""Vendors of depth sensors only, for products that are not in `KINDS`."""

_REALSENSE_VENDOR = "8086", "RealSense"  # Intel makes much else, so the product's name counts too

_USB = Path("/sys/bus/usb/devices")
_NODES = Path("/dev/bus/usb")
_VIDEO = Path("/sys/class/video4linux")
_CAMERAS = Path("/dev")


def examine() -> Iterator[Finding]:
    """Check cameras, depth sensors, and the libraries that read them."""
    plugged = [*_plugged()]
    schemes = {kind.scheme for kind, _, _ in plugged}
    yield from _cameras()
    yield from _depth_sensors(plugged)
    yield from _library("libfreenect", _kinects, "freenect:", needed="freenect:" in schemes)
    yield from _library("OpenNI 2", _openni, "openni:", needed="openni:" in schemes)
    yield from _library("librealsense", _realsense, "realsense:", needed="realsense:" in schemes)
    yield from _library("Orbbec SDK", _orbbec, "orbbec:", needed="orbbec:" in schemes)
    tracks = bool({"freenect:", "orbbec:", "realsense:"} & schemes) or (
        "openni:" in schemes and nite.library_path() is None
    )
    yield from _library("MediaPipe", _mediapipe, "camera:, video: and depth sensors", needed=tracks)
    yield from _library("OpenCV", lambda _: str(load_opencv().__version__), "camera: and video:", needed=False)
    yield _nite()


def _cameras() -> Iterator[Finding]:
    if sys.platform == "win32":  # it has no device files
        return
    cameras = sorted(_CAMERAS.glob("video*"))
    if not cameras:
        yield Finding("cameras", None, "no /dev/video*")
    for camera in cameras:
        name = _read(_VIDEO / camera.name / "name") or "unnamed"
        may = os.access(camera, os.R_OK | os.W_OK)
        yield Finding(
            str(camera),
            True if may else None,
            f"{name}, can be opened" if may else f"{name}, no permission",
            "" if may else f"Add this user to the group {camera.group()}, and log in again.",
        )


def _plugged() -> Iterator[tuple[Kind, Path, str]]:
    """Return the depth sensors on USB, their device files, and their speeds in Mbit/s."""
    for device in sorted(_USB.glob("*")):
        vendor, product = _read(device / "idVendor"), _read(device / "product")
        kind = KINDS.get(f"{vendor}:{_read(device / 'idProduct')}") or VENDORS.get(vendor)
        if vendor == _REALSENSE_VENDOR[0] and _REALSENSE_VENDOR[1] in product:
            kind = Kind(product, "realsense:", speed=5000)
        if kind is not None:
            node = _NODES / f"{_read(device / 'busnum'):0>3}" / f"{_read(device / 'devnum'):0>3}"
            yield kind, node, _read(device / "speed")


def _depth_sensors(plugged: list[tuple[Kind, Path, str]]) -> Iterator[Finding]:
    if not plugged:
        yield Finding("depth sensors", None, "no known model on USB")
    for kind, node, speed in plugged:
        if not kind.scheme:
            yield Finding(kind.name, None, f"{node}, not supported; its own programs can send OSC")
        elif os.access(node, os.R_OK | os.W_OK):
            yield Finding(kind.name, True, f"{node}, for {kind.scheme}")
            if speed.isdecimal() and int(speed) < kind.speed:
                yield Finding(
                    f"{kind.name}, USB",
                    False,
                    f"{speed} Mbit/s; it requires {kind.speed}",
                    "Use a USB 3 port and a USB 3 cable." if kind.speed > 480 else "Use a USB 2 port of its own.",
                )
        else:
            yield Finding(
                kind.name,
                False,
                f"{node}: no permission",
                (
                    f"Install the udev rules {kind.rules} from Debian's {kind.package}, "
                    if kind.rules
                    else "Install the udev rules of the maker's SDK, "
                )
                + "run udevadm control --reload, and plug the sensor in again.",
            )


def _library(name: str, look: Callable[[str], str | list[Finding]], use: str, *, needed: bool) -> Iterator[Finding]:
    """Report what `look` returns about an optional library, or why the library cannot be used.

    Parameters
    ----------
    name : str
    look : callable
        Loads the library and returns the detail, or the sensors that the library finds; raises a SourceError if it
        cannot be used.
    use : str
        Sources that require it.
    needed : bool
        Whether something that is plugged in requires it.
    """
    try:
        found = look(name)
    except NotInstalledError as error:
        yield Finding(name, False if needed else None, f"not installed; required by {use}", error.fix)
    except SourceError as error:
        yield Finding(name, False, error.found, error.fix)
    else:
        sensors = [] if isinstance(found, str) else found
        count = f"installed; {len(sensors) or 'no'} sensor{'s' * (len(sensors) > 1)} plugged in"
        yield Finding(name, True, found if isinstance(found, str) else count)
        yield from sensors


def _kinects(name: str) -> str:
    count = freenect.count_sensors(name)
    if count is None:
        return "installed; no USB on this machine (in a container, pass /dev/bus/usb through)"
    return f"installed; {count or 'no'} Kinect v1 plugged in"


def _openni(name: str) -> list[Finding]:
    """Return the sensors that OpenNI2 finds, by the URIs of their sources."""
    findings = []
    for sensor in openni_library.list_sensors(name):
        uri = f"openni:uri={sensor.uri}"
        if sensor.error is not None:
            findings.append(Finding(uri, None, f"{sensor.name}, {sensor.error.found}", sensor.error.fix))
        elif sensor.serial:
            findings.append(Finding(f"openni:serial={sensor.serial}", True, f"{sensor.name}, also {uri}"))
        else:
            findings.append(Finding(uri, True, f"{sensor.name}, which has no serial number"))
    return findings


def _realsense(where: str) -> list[Finding]:
    """Return the sensors that librealsense finds, by the URIs of their sources."""
    library = realsense.load_realsense(where)
    findings = []
    for device in realsense.plugged_in(library):
        name, serial, firmware, usb = (
            realsense.information(library, device, each)
            for each in ("name", "serial_number", "firmware_version", "usb_type_descriptor")
        )
        findings.append(Finding(f"realsense:serial={serial}", True, f"{name}, firmware {firmware}, USB {usb}"))
    return findings


def _orbbec(name: str) -> list[Finding]:
    """Return the sensors that Orbbec's SDK finds, by the URIs of their sources."""
    findings = []
    for device in orbbec.plugged_in(orbbec.load_orbbec(name)):
        about = device.get_device_info()
        detail = f"{about.get_name()}, firmware {about.get_firmware_version()}, {about.get_connection_type()}"
        findings.append(Finding(f"orbbec:serial={about.get_serial_number()}", True, detail))
    return findings


def _nite() -> Finding:
    found = nite.library_path()
    if found is not None:
        return Finding("NiTE 2", True, found)
    folder = os.environ.get(nite.REDIST_VARIABLE)
    missing = "not installed" if folder is None else f"not in {folder}, which {nite.REDIST_VARIABLE} names"
    return Finding("NiTE 2", None, missing)


def _mediapipe(_name: str) -> str:
    load_mediapipe()
    return version("mediapipe")


def _read(file: Path) -> str:
    try:
        return file.read_text(encoding="ascii").strip()
    except (OSError, UnicodeDecodeError):
        return ""
