"""Kinect v1 through libfreenect: the sources ``freenect:`` for the first one, ``freenect:1?face&hands`` for the second.

ctypes calls the installed library, so nothing has to be compiled.
"""

import ctypes
import logging
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from capture.libraries import NotInstalledError, load_error
from capture.sensors.depth_camera import DepthCamera, Kind, Selection, metres, open_depth_camera
from capture.sensors.source import SensorSource
from capture.trackers.picture import Lens
from puppetline import clock
from puppetline.errors import SourceError, heading

LENS = Lens(640, 480, 525.0)
"""Lens of the colour camera, to which depth is registered, with the usual focal length; sensors differ slightly."""

TICKS_PER_SECOND = 60_000_000
"""Rate of the sensor's clock, which overflows after 2³² ticks, 71.6 s."""

LIBRARIES = ("libfreenect.so.0.5", "libfreenect.so.0.7", "libfreenect.so.0", "libfreenect.dylib")
"""File names of the library on Debian, on other Linux systems, and on macOS."""
UDEV_RULES = "60-libfreenect0.5.rules"
"""File with the udev rules of Debian's libfreenect0.5, which let users open sensors."""

_CAMERA = 2  # freenect_device_flags: no motor, which some models lack
_MEDIUM, _RGB, _REGISTERED = 1, 0, 4  # freenect_resolution, freenect_video_format, freenect_depth_format
_ERRORS = 1  # freenect_loglevel: errors and fatal errors
_FRAME = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_uint32)
_LOG = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int, ctypes.c_char_p)

log = logging.getLogger(__name__)


class _Mode(ctypes.Structure):
    """The C structure freenect_frame_mode, of which only the size matters here."""

    _fields_ = (("words", ctypes.c_uint32 * 6),)


class _Interval(ctypes.Structure):
    """The C structure timeval."""

    _fields_ = (("seconds", ctypes.c_long), ("microseconds", ctypes.c_long))


def open_source(uri: str, rest: str, _folder: Path) -> SensorSource:
    """Open a Kinect v1 with MediaPipe as its tracker.

    Parameters
    ----------
    uri, rest : str
        The whole URI, and the part after its scheme: the number of the sensor, or nothing for the first.

    Raises
    ------
    SourceError
        The URI is wrong, or a library is missing. The source itself raises the errors of the sensor.
    """
    number, *options = re.split("[&?]", rest)
    if not re.fullmatch("[0-9]{0,2}", number) or not set(options) <= {"face", "hands"}:
        raise SourceError(
            uri,
            found=repr(rest),
            expected="the number of a Kinect v1",
            fix="Write freenect: for the first, freenect:1 for the second.",
        )
    _load(uri)
    selection = Selection(face="face" in options, hands="hands" in options)
    return open_depth_camera(uri, selection, lambda: FreenectDevice(uri, int(number or 0)))


def count_sensors(where: str) -> int | None:
    """Return the number of sensors on USB; None if the library has no access to USB, as in some containers.

    Raises
    ------
    SourceError
        About `where`: the library does not load.
    """
    library, context = _load(where), ctypes.c_void_p()
    if library.freenect_init(ctypes.byref(context), None) < 0:
        return None
    try:
        return max(0, library.freenect_num_devices(context))
    finally:
        library.freenect_shutdown(context)


class FreenectDevice(DepthCamera):
    """A Kinect v1. Only one thread may use it.

    Parameters
    ----------
    name : str
        URI of the source.
    index : int
        Number of the sensor, from 0, in the order of USB.

    Raises
    ------
    SourceError
        The library does not load, no such sensor is plugged in, permission is missing, or another program uses it.
    """

    def __init__(self, name: str, index: int = 0) -> None:
        super().__init__(name, Selection())
        self.name, self._lens = "Kinect v1", LENS
        self._library = _load(name)
        self._context, self._device = ctypes.c_void_p(), ctypes.c_void_p()
        self._ticks: int | None = None  # of the newest frame, without overflow
        self._received = False
        self._messages: list[str] = []
        # the library keeps no references to its callbacks
        self._callbacks = _FRAME(self._add_depth), _FRAME(self._add_color), _LOG(self._log)
        try:
            self._open(index)
        except SourceError:
            self.close()
            raise

    def close(self) -> None:
        """Stop the streams and release the sensor; closing again does nothing."""
        if self._device:
            self._library.freenect_stop_depth(self._device)
            self._library.freenect_stop_video(self._device)
            self._library.freenect_close_device(self._device)
        if self._context:
            self._library.freenect_shutdown(self._context)
        self._device, self._context = ctypes.c_void_p(), ctypes.c_void_p()

    def _open(self, index: int) -> None:
        library = self._library
        add_depth, add_color, log_message = self._callbacks
        if library.freenect_init(ctypes.byref(self._context), None) < 0:
            self._context = ctypes.c_void_p()  # an incomplete context must not be used
            raise self._unusable()
        library.freenect_set_log_level(self._context, _ERRORS)
        library.freenect_set_log_callback(self._context, log_message)
        library.freenect_select_subdevices(self._context, _CAMERA)
        if index >= (count := library.freenect_num_devices(self._context)):
            raise _not_plugged_in(self._uri, index, count)
        if library.freenect_open_device(self._context, ctypes.byref(self._device), index) < 0:
            self._device = ctypes.c_void_p()
            raise self._unusable()
        library.freenect_set_depth_callback(self._device, add_depth)
        library.freenect_set_video_callback(self._device, add_color)
        depth = library.freenect_find_depth_mode(_MEDIUM, _REGISTERED)
        color = library.freenect_find_video_mode(_MEDIUM, _RGB)
        if (
            library.freenect_set_depth_mode(self._device, depth) < 0
            or library.freenect_set_video_mode(self._device, color) < 0
            or library.freenect_start_depth(self._device) < 0
            or library.freenect_start_video(self._device) < 0
        ):
            raise self._unusable()

    def _receive(self, timeout: float) -> bool:
        """Process events; the library receives USB packets only then, and loses them between calls too far apart."""
        end, self._received = clock.now() + timeout, False
        while not self._received and (left := end - clock.now()) > 0:
            wait = _Interval(int(left), int(left % 1 * 1e6))
            if self._library.freenect_process_events_timeout(self._context, ctypes.byref(wait)) < 0:
                raise self._unplugged()
        return self._received

    def _add_depth(self, _device: int, data: int, ticks: int) -> None:
        depth = np.frombuffer(ctypes.string_at(data, LENS.width * LENS.height * 2), np.uint16)
        self._add_frame("depth", ticks, metres(depth.reshape(LENS.height, LENS.width)))

    def _add_color(self, _device: int, data: int, ticks: int) -> None:
        color = np.frombuffer(ctypes.string_at(data, LENS.width * LENS.height * 3), np.uint8)
        self._add_frame("color", ticks, color.reshape(LENS.height, LENS.width, 3))

    def _add_frame(self, kind: Kind, ticks: int, pixels: NDArray[Any]) -> None:
        if self._ticks is None:
            self._ticks = ticks
        # each stream can be slightly behind the other, so the difference may be negative
        self._ticks += (ticks - self._ticks + 2**31) % 2**32 - 2**31
        self._received = True
        self._add(kind, self._ticks / TICKS_PER_SECOND, pixels)

    def _log(self, _context: int, _level: int, message: bytes) -> None:
        text = message.decode(errors="replace").strip()
        log.debug("%s %s", heading(self._uri), text)
        self._messages = [*self._messages[-9:], text]

    def _reason(self) -> str:
        return f" (libfreenect: {self._messages[0]})" if self._messages else ""

    def _unplugged(self) -> SourceError:
        error = super()._unplugged()
        return SourceError(
            self._uri, found=f"an unplugged Kinect{self._reason()}", expected=error.expected, fix=error.fix
        )

    def _unusable(self) -> SourceError:
        """Return the error for a sensor that cannot be used; only the library's messages show the reason."""
        messages = " ".join(self._messages)
        if "open camera: -3" in messages or "LIBUSB_ERROR_ACCESS" in messages:
            return SourceError(
                self._uri,
                found="no permission to open the Kinect on USB",
                expected="a udev rule that grants it",
                fix=f'Install the package libfreenect0.5, which includes {UDEV_RULES}, or write SUBSYSTEM=="usb", '
                'ATTRS{idVendor}=="045e", ATTRS{idProduct}=="02ae", MODE="0666" (02bf for a Kinect for Windows) into '
                f"/etc/udev/rules.d/{UDEV_RULES}. Then call udevadm control --reload and plug the Kinect in again.",
            )
        if "open camera: -6" in messages or "LIBUSB_ERROR_BUSY" in messages:
            return SourceError(
                self._uri,
                found="a Kinect that another program uses",
                expected="a Kinect that no other program uses",
                fix="Close the other program; only one at a time can use the Kinect.",
            )
        return SourceError(
            self._uri,
            found=f"a Kinect that cannot be used{self._reason()}",
            expected="a Kinect that sends images",
            fix="Unplug it from USB and from its power supply, wait for a few seconds, and plug it in again.",
        )


def _load(name: str) -> Any:
    """Return the installed library; raise SourceError if it is not installed or does not load."""
    reasons = []
    for candidate in LIBRARIES:
        try:
            library = ctypes.CDLL(candidate)
        except OSError as error:
            reasons.append(str(error))
        else:
            library.freenect_find_depth_mode.restype = library.freenect_find_video_mode.restype = _Mode
            return library
    kind, found = load_error("freenect"), "no libfreenect on this machine"
    if kind is not NotInstalledError:
        found = f"a libfreenect that does not load ({'; '.join(reasons)})"
    raise kind(
        name,
        found=found,
        expected="libfreenect, which a Kinect v1 requires",
        fix="Install it: apt install libfreenect0.5 on Debian and Ubuntu, brew install libfreenect on macOS.",
    )


def _not_plugged_in(name: str, index: int, count: int) -> SourceError:
    if count <= 0:
        found, expected = "no Kinect v1 on USB", "a Kinect v1"
        fix = "Plug it in, and plug in its power supply too, because USB alone does not power the cameras."
    else:
        found, expected = f"the number {index} for {count} Kinect v1", f"a number below {count}"
        fix = "Write freenect: for the first, freenect:1 for the second."
    return SourceError(name, found=found, expected=expected, fix=fix)
