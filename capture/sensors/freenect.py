"""Kinect v1 through libfreenect: the sources ``freenect:`` for the first one, ``freenect:1`` for the second.

ctypes calls the installed library, so nothing has to be compiled.
"""

import ctypes
import logging
import re
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from capture.libraries import NotInstalledError, load_error
from capture.sensors.source import SensorSource
from capture.trackers.mediapipe import MediaPipePose, load_mediapipe
from capture.trackers.picture import Lens, Picture
from puppetline.errors import SourceError, heading

LENS = Lens(640, 480, 525.0)
"""Lens of the colour camera, to which depth is registered, with the usual focal length; sensors differ slightly."""

TICKS_PER_SECOND = 60_000_000
"""Rate of the sensor's clock, which overflows after 2³² ticks, 71.6 s."""
MAX_SKEW_SECONDS = 0.02
"""Largest difference between the times of depth and colour in one image, in seconds."""

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


def open_freenect(uri: str, rest: str) -> SensorSource:
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
    if not re.fullmatch("[0-9]{0,2}", rest):
        raise SourceError(
            uri,
            found=repr(rest),
            expected="the number of a Kinect v1",
            fix="Write freenect: for the first, freenect:1 for the second.",
        )
    _load(uri)
    load_mediapipe()
    return SensorSource(uri, lambda: FreenectDevice(uri, int(rest or 0)), lambda _: MediaPipePose())


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


class FreenectDevice:
    """A Kinect v1; implements `capture.trackers.picture.Device`. Only one thread may use it.

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
        self.name = name
        self._library = _load(name)
        self._context, self._device = ctypes.c_void_p(), ctypes.c_void_p()
        self._pairs = _Pairs()
        self._picture: Picture | None = None
        self._messages: list[str] = []
        # the library keeps no references to its callbacks
        self._callbacks = _FRAME(self._add_depth), _FRAME(self._add_color), _LOG(self._log)
        try:
            self._open(index)
        except SourceError:
            self.close()
            raise

    def read(self, timeout: float) -> Picture | None:
        """Return the next image, with the time of its depth; raise SourceError if the sensor was unplugged.

        The library receives USB packets only during calls, and loses them between calls that are too far apart.
        """
        end = time.monotonic() + timeout
        while self._picture is None and (left := end - time.monotonic()) > 0:
            wait = _Interval(int(left), int(left % 1 * 1e6))
            if self._library.freenect_process_events_timeout(self._context, ctypes.byref(wait)) < 0:
                raise self._unplugged()
        picture, self._picture = self._picture, None
        return picture

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
        count = library.freenect_num_devices(self._context)
        if index >= count:
            raise _not_plugged_in(self.name, index, count)
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

    def _add_depth(self, _device: int, data: int, ticks: int) -> None:
        depth = np.frombuffer(ctypes.string_at(data, LENS.width * LENS.height * 2), np.uint16)
        self._picture = self._pairs.add_depth(depth.reshape(LENS.height, LENS.width), ticks) or self._picture

    def _add_color(self, _device: int, data: int, ticks: int) -> None:
        color = np.frombuffer(ctypes.string_at(data, LENS.width * LENS.height * 3), np.uint8)
        self._picture = self._pairs.add_color(color.reshape(LENS.height, LENS.width, 3), ticks) or self._picture

    def _log(self, _context: int, _level: int, message: bytes) -> None:
        text = message.decode(errors="replace").strip()
        log.debug("%s %s", heading(self.name), text)
        self._messages = [*self._messages[-9:], text]

    def _reason(self) -> str:
        return f" (libfreenect: {self._messages[0]})" if self._messages else ""

    def _unplugged(self) -> SourceError:
        return SourceError(
            self.name,
            found=f"an unplugged Kinect{self._reason()}",
            expected="a Kinect that stays plugged in",
            fix="Check its plug and its power supply.",
        )

    def _unusable(self) -> SourceError:
        """Return the error for a sensor that cannot be used; only the library's messages show the reason."""
        messages = " ".join(self._messages)
        if "open camera: -3" in messages or "LIBUSB_ERROR_ACCESS" in messages:
            return _no_permission(self.name)
        if "open camera: -6" in messages or "LIBUSB_ERROR_BUSY" in messages:
            return SourceError(
                self.name,
                found="a Kinect that another program uses",
                expected="a Kinect that no other program uses",
                fix="Close the other program; only one at a time can use the Kinect.",
            )
        return SourceError(
            self.name,
            found=f"a Kinect that cannot be used{self._reason()}",
            expected="a Kinect that sends images",
            fix="Unplug it from USB and from its power supply, wait for a few seconds, and plug it in again.",
        )


class _Pairs:
    """Combines depth and colour of the same time into images, with times that do not overflow."""

    def __init__(self) -> None:
        self._ticks: int | None = None  # of the newest frame, without overflow
        self._depth: tuple[int, NDArray[np.uint16]] | None = None
        self._color: tuple[int, NDArray[np.uint8]] | None = None

    def add_depth(self, depth: NDArray[np.uint16], ticks: int) -> Picture | None:
        """Add (480, 640) millimetres; return an image if its colour has arrived."""
        self._depth = self._unwrapped(ticks), depth
        return self._pair()

    def add_color(self, color: NDArray[np.uint8], ticks: int) -> Picture | None:
        """Add (480, 640, 3) RGB; return an image if its depth has arrived."""
        self._color = self._unwrapped(ticks), color
        return self._pair()

    def _unwrapped(self, ticks: int) -> int:
        if self._ticks is None:
            self._ticks = ticks
        # each stream can be slightly behind the other, so the difference may be negative
        self._ticks += (ticks - self._ticks + 2**31) % 2**32 - 2**31
        return self._ticks

    def _pair(self) -> Picture | None:
        if self._depth is None or self._color is None:
            return None
        (depth_ticks, depth), (color_ticks, color) = self._depth, self._color
        if abs(depth_ticks - color_ticks) > MAX_SKEW_SECONDS * TICKS_PER_SECOND:
            return None
        self._depth = self._color = None
        return Picture(depth_ticks / TICKS_PER_SECOND, LENS, color, depth)


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
        return SourceError(
            name,
            found="no Kinect v1 on USB",
            expected="a Kinect v1",
            fix="Plug it in, and plug in its power supply too, because USB alone does not power the cameras.",
        )
    return SourceError(
        name,
        found=f"the number {index} for {count} Kinect v1",
        expected=f"a number below {count}",
        fix="Write freenect: for the first, freenect:1 for the second.",
    )


def _no_permission(name: str) -> SourceError:
    return SourceError(
        name,
        found="no permission to open the Kinect on USB",
        expected="a udev rule that grants it",
        fix=f'Install the package libfreenect0.5, which includes {UDEV_RULES}, or write SUBSYSTEM=="usb", '
        'ATTRS{idVendor}=="045e", ATTRS{idProduct}=="02ae", MODE="0666" (02bf for a Kinect for Windows) into '
        f"/etc/udev/rules.d/{UDEV_RULES}. Then call udevadm control --reload and plug the Kinect in again.",
    )
