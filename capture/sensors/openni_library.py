"""The OpenNI2 library: loading it, listing sensors and opening them.

The library is the system's, or that in the folder that the environment variable OPENNI2_REDIST names.
"""

import ctypes
import ctypes.util
import os
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from capture.libraries import load_error, load_module
from puppetline.errors import SourceError

REDIST_VARIABLE = "OPENNI2_REDIST"
"""Name of the environment variable for the folder of the library and its drivers."""
UDEV_RULES = "60-libopenni2-0.rules"
"""File with the udev rules of Debian's libopenni2-0, which let users open sensors."""
LOCK_SECONDS = 5.0
"""Maximum time to wait for another thread that is opening a sensor, in seconds."""

_NAMES = ("libOpenNI2.so", "libOpenNI2.so.0", "libOpenNI2.dylib", "OpenNI2.dll")
_SERIAL_NUMBER = 3  # id of a device's property
_USB = re.compile(r"[0-9a-f]{4}/[0-9a-f]{4}@(\d+)/(\d+)")  # vendor, product, bus and device, of OpenNI2's own drivers

_lock = threading.Lock()


@dataclass(frozen=True, slots=True)
class Sensor:
    """A sensor that is plugged in.

    Attributes
    ----------
    name : str
    uri : str
    serial : str
        Serial number; empty if unknown.
    error : SourceError or None
        Why the sensor cannot be opened.
    """

    name: str
    uri: str
    serial: str
    error: SourceError | None


def load_openni2(where: str) -> Any:
    """Return the Python bindings, with the library loaded and its drivers started.

    Raises
    ------
    SourceError
        About `where`: the bindings or the library are not installed, or the library does not start.
    """
    package, fix = "the Python package openni", "Install it: pip install 'puppetline[openni]'"
    bindings = load_module("openni.openni2", where, found="no OpenNI2 bindings", expected=package, fix=fix)
    if not bindings.is_initialized():
        with exclusive(where):
            _start(where, bindings)
    return bindings


def sensor_uris(bindings: Any) -> list[str]:
    """Return the OpenNI2 URIs of the sensors that are plugged in."""
    return [uri for uri, _ in _uris_and_names(bindings)]


def list_sensors(where: str) -> list[Sensor]:
    """Return the sensors that are plugged in; raise SourceError about `where` if the library does not load."""
    bindings = load_openni2(where)
    with exclusive(where):
        return [_examine(bindings, uri, name) for uri, name in _uris_and_names(bindings)]


def usb_device_file(uri: str) -> Path | None:
    """Return the device file of a sensor; None for sensors of other than OpenNI2's own drivers."""
    match = _USB.fullmatch(uri)
    return match and Path(f"/dev/bus/usb/{int(match[1]):03}/{int(match[2]):03}")


@contextmanager
def exclusive(where: str) -> Iterator[None]:
    """Keep other threads from opening and starting, because the library is not thread-safe; it may never return."""
    if not _lock.acquire(timeout=LOCK_SECONDS):
        raise SourceError(
            where,
            found=f"another sensor that OpenNI2 has been opening for more than {LOCK_SECONDS:g} s",
            expected="one opening at a time",
            fix="Unplug that sensor and plug it in again; if that fails, restart Puppetline.",
        )
    try:
        yield
    finally:
        _lock.release()


def open_device(bindings: Any, name: bytes) -> Any:
    """Open the device with an OpenNI2 URI, or the recording at a path.

    The bindings would also close a device that did not open. The library counts closings, would then treat the sensor
    as open the next time, and crash.
    """
    device = bindings.Device.__new__(bindings.Device)
    try:
        device.__init__(name)
    except bindings.OpenNIError:
        if not hasattr(device, "playback"):  # set after opening
            device._handle = None
        raise
    return device


def device_name(info: Any) -> str:
    """Return vendor and name of a device."""
    return " ".join(part.decode(errors="replace") for part in (info.vendor, info.name) if part)


def serial_number(device: Any) -> str:
    """Return the serial number of an open device; raises OpenNI2's error if it has none."""
    text = device.get_property(_SERIAL_NUMBER, ctypes.c_char * 256).value
    return text.decode(errors="replace")


def error_reason(error: Exception) -> str:
    """Return the text of an OpenNI2 error."""
    _, reason, _ = error.args
    return (reason.decode(errors="replace") if isinstance(reason, bytes) else reason) or "without a reason"


def unusable(where: str, uris: list[str], reason: str) -> SourceError:
    """Return the error for a sensor that does not work, one of `uris`; the library reports no details."""
    for node in filter(None, map(usb_device_file, uris)):
        if not os.access(node, os.R_OK | os.W_OK):
            return SourceError(
                where,
                found=f"a sensor at {node} that this user may not open",
                expected="permission to read and write there",
                fix=f"Install the udev rules {UDEV_RULES} (Debian: libopenni2-0), then plug the sensor in again.",
            )
    return SourceError(
        where,
        found=f"a sensor that does not work ({reason})",
        expected="a sensor that no other program uses",
        fix="Close other programs that may use it, or unplug it and plug it in again.",
    )


def _start(where: str, bindings: Any) -> None:
    """Start the library like bindings.initialize, which would change this process's working directory."""
    try:
        if bindings.loaded_dll_directory is None:
            path = _path()
            bindings.c_api.load_dll(path)
            bindings.loaded_dll_directory = str(Path(path).parent)
        bindings.initialize()
    except (OSError, bindings.OpenNIError) as error:
        # if the user names a folder, a missing library is an error and not an optional one
        kind = SourceError if REDIST_VARIABLE in os.environ else load_error("OpenNI2")
        raise kind(
            where,
            found=f"no OpenNI2 library that starts ({error})",
            expected=f"the system's library, or one in the folder that {REDIST_VARIABLE} names",
            fix="Install it: apt install libopenni2-0 on Debian and Ubuntu.",
        ) from error


def _path() -> str:
    """Return the library's path, or a name that the system finds."""
    folder = os.environ.get(REDIST_VARIABLE)
    if folder is None:
        return ctypes.util.find_library("OpenNI2") or "libOpenNI2.so.0"
    found = [path for name in _NAMES if (path := Path(folder) / name).is_file()]
    if not found:
        raise FileNotFoundError(f"none of {', '.join(_NAMES)} in {folder}")
    return str(found[0].absolute())


def _uris_and_names(bindings: Any) -> list[tuple[str, str]]:
    """Return URIs and names of the sensors; the library's list also has the recordings that are open."""
    infos, count = ctypes.POINTER(bindings.c_api.OniDeviceInfo)(), ctypes.c_int()
    bindings.c_api.oniGetDeviceList(ctypes.byref(infos), ctypes.byref(count))
    try:
        listed = [(infos[k].uri.decode(errors="replace"), device_name(infos[k])) for k in range(count.value)]
    finally:
        bindings.c_api.oniReleaseDeviceList(infos)
    return [(uri, name) for uri, name in listed if not Path(uri).is_file()]


def _examine(bindings: Any, uri: str, name: str) -> Sensor:
    try:
        device = open_device(bindings, uri.encode())
    except bindings.OpenNIError as error:
        return Sensor(name, uri, "", unusable(f"openni:uri={uri}", [uri], error_reason(error)))
    try:
        return Sensor(name, uri, serial_number(device), None)
    except bindings.OpenNIError:  # no serial number
        return Sensor(name, uri, "", None)
    finally:
        device.close()
