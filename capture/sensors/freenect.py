"""Kinect v1 through libfreenect: ``freenect:`` is the first one, ``freenect:1`` the second.

The library is called by ctypes as it is installed: there is nothing to build.
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
from capture.trackers.mediapipe import MediaPipePose, library
from capture.trackers.picture import Lens, Picture
from puppetline.errors import SourceError, heading

LENS = Lens(640, 480, 525.0)
"""The colour camera's, which depth is registered to; what is usual, as each sensor differs by a few pixels."""

TICKS = 60_000_000
"""A second on the sensor's clock, which starts again after 2³² of them, 71.6 s."""
SAME_MOMENT = 0.02
"""Seconds between depth and colour of one picture: they come 30 times a second, each in its own time."""

LIBRARIES = ("libfreenect.so.0.5", "libfreenect.so.0.7", "libfreenect.so.0", "libfreenect.dylib")
"""Names that the library has on Debian, elsewhere on Linux, and on macOS."""
RULES = "60-libfreenect0.5.rules"

_CAMERA = 2  # of the parts of a Kinect: without its motor, which some models lack
_MEDIUM, _RGB, _REGISTERED = 1, 0, 4  # freenect_resolution, freenect_video_format, freenect_depth_format
_ERRORS = 1  # and what is worse: freenect_loglevel
_FRAME = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_uint32)
_LOG = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int, ctypes.c_char_p)

log = logging.getLogger(__name__)


class _Mode(ctypes.Structure):
    """A freenect_frame_mode."""

    _fields_ = (
        ("reserved", ctypes.c_uint32),
        ("resolution", ctypes.c_int),
        ("format", ctypes.c_int),
        ("bytes", ctypes.c_int32),
        ("width", ctypes.c_int16),
        ("height", ctypes.c_int16),
        ("data_bits_per_pixel", ctypes.c_int8),
        ("padding_bits_per_pixel", ctypes.c_int8),
        ("framerate", ctypes.c_int8),
        ("is_valid", ctypes.c_int8),
    )


class _Interval(ctypes.Structure):
    """A struct timeval."""

    _fields_ = (("seconds", ctypes.c_long), ("microseconds", ctypes.c_long))


def open_freenect(uri: str, rest: str) -> SensorSource:
    """Open a Kinect v1 and find a person in what it sees.

    Parameters
    ----------
    uri, rest : str
        The whole, and what follows its scheme: the number of the sensor, the first where it is empty.

    Raises
    ------
    SourceError
        The text is no number, or a library is missing. What is wrong with the sensor is raised by the source.
    """
    if not re.fullmatch("[0-9]{0,2}", rest):
        raise SourceError(
            uri,
            found=repr(rest),
            expected="the number of a Kinect v1",
            fix="Write freenect: for the first, freenect:1 for the second.",
        )
    _load(uri)
    library()
    return SensorSource(uri, lambda: FreenectDevice(uri, int(rest or 0)), lambda _: MediaPipePose())


def plugged_in(where: str) -> int | None:
    """Return how many sensors the library finds, or None if it cannot use USB, as in a container without it.

    Parameters
    ----------
    where : str
        Who asks, for the message.

    Raises
    ------
    SourceError
        There is no library.
    """
    library, context = _load(where), ctypes.c_void_p()
    if library.freenect_init(ctypes.byref(context), None) < 0:
        return None
    try:
        return max(0, library.freenect_num_devices(context))
    finally:
        library.freenect_shutdown(context)


class FreenectDevice:
    """A Kinect v1; implements `capture.trackers.picture.Device`. It is one thread's.

    Parameters
    ----------
    name : str
        The URI.
    index : int
        Which one, from 0, in the order in which USB lists them.

    Raises
    ------
    SourceError
        There is no library, no such sensor, no permission, or another program has it.
    """

    def __init__(self, name: str, index: int = 0) -> None:
        self.name = name
        self._library = _load(name)
        self._context, self._device = ctypes.c_void_p(), ctypes.c_void_p()
        self._pairs = _Pairs()
        self._picture: Picture | None = None
        self._complaints: list[str] = []
        # the library keeps no reference to what it calls
        self._callbacks = _FRAME(self._take_depth), _FRAME(self._take_color), _LOG(self._hear)
        try:
            self._open(index)
        except SourceError:
            self.close()
            raise

    def read(self, timeout: float) -> Picture | None:
        """Wait for the next picture for at most so many seconds; None if none has come.

        Depth is registered to colour; the time is that of depth on the sensor's clock. The library works only in here:
        USB packets are lost where this is not called all the time.

        Raises
        ------
        SourceError
            The sensor is gone.
        """
        end = time.monotonic() + timeout
        while self._picture is None and (left := end - time.monotonic()) > 0:
            wait = _Interval(int(left), int(left % 1 * 1e6))
            if self._library.freenect_process_events_timeout(self._context, ctypes.byref(wait)) < 0:
                raise self._gone()
        picture, self._picture = self._picture, None
        return picture

    def close(self) -> None:
        """Stop the streams and let go of the sensor; closing again does nothing."""
        if self._device:
            self._library.freenect_stop_depth(self._device)
            self._library.freenect_stop_video(self._device)
            self._library.freenect_close_device(self._device)
        if self._context:
            self._library.freenect_shutdown(self._context)
        self._device, self._context = ctypes.c_void_p(), ctypes.c_void_p()

    def _open(self, index: int) -> None:
        library = self._library
        take_depth, take_color, hear = self._callbacks
        if library.freenect_init(ctypes.byref(self._context), None) < 0:
            self._context = ctypes.c_void_p()  # of what was half made, nothing is to be used
            raise self._unusable()
        library.freenect_set_log_level(self._context, _ERRORS)
        library.freenect_set_log_callback(self._context, hear)
        library.freenect_select_subdevices(self._context, _CAMERA)
        count = library.freenect_num_devices(self._context)
        if index >= count:
            raise _absent(self.name, index, count)
        if library.freenect_open_device(self._context, ctypes.byref(self._device), index) < 0:
            self._device = ctypes.c_void_p()
            raise self._unusable()
        library.freenect_set_depth_callback(self._device, take_depth)
        library.freenect_set_video_callback(self._device, take_color)
        depth = library.freenect_find_depth_mode(_MEDIUM, _REGISTERED)
        color = library.freenect_find_video_mode(_MEDIUM, _RGB)
        if (
            library.freenect_set_depth_mode(self._device, depth) < 0
            or library.freenect_set_video_mode(self._device, color) < 0
            or library.freenect_start_depth(self._device) < 0
            or library.freenect_start_video(self._device) < 0
        ):
            raise self._unusable()

    def _take_depth(self, _device: int, data: int, ticks: int) -> None:
        depth = np.frombuffer(ctypes.string_at(data, LENS.width * LENS.height * 2), np.uint16)
        self._picture = self._pairs.add_depth(depth.reshape(LENS.height, LENS.width), ticks) or self._picture

    def _take_color(self, _device: int, data: int, ticks: int) -> None:
        color = np.frombuffer(ctypes.string_at(data, LENS.width * LENS.height * 3), np.uint8)
        self._picture = self._pairs.add_color(color.reshape(LENS.height, LENS.width, 3), ticks) or self._picture

    def _hear(self, _context: int, _level: int, message: bytes) -> None:
        text = message.decode(errors="replace").strip()
        log.debug("%s %s", heading(self.name), text)
        self._complaints = [*self._complaints[-9:], text]

    def _said(self) -> str:
        return f" (libfreenect: {self._complaints[0]})" if self._complaints else ""

    def _gone(self) -> SourceError:
        return SourceError(
            self.name,
            found=f"a disconnected Kinect{self._said()}",
            expected="one that stays plugged in",
            fix="Check its plug and its power supply.",
        )

    def _unusable(self) -> SourceError:
        """Tell why the sensor cannot be used by what the library said; it returns the same in each case."""
        said = " ".join(self._complaints)
        if "open camera: -3" in said or "LIBUSB_ERROR_ACCESS" in said:
            return _forbidden(self.name)
        if "open camera: -6" in said or "LIBUSB_ERROR_BUSY" in said:
            return SourceError(
                self.name,
                found="a Kinect that another program uses",
                expected="one that is free",
                fix="End the other program; one at a time can have it.",
            )
        return SourceError(
            self.name,
            found=f"a Kinect that cannot be used{self._said()}",
            expected="one that starts to send pictures",
            fix="Unplug it from USB and from its power supply, wait for a few seconds, and plug it in again.",
        )


class _Pairs:
    """Puts depth and colour of one moment together, and their times on a clock that goes on."""

    def __init__(self) -> None:
        self._moment: int | None = None  # of the newest, in ticks that do not start again
        self._depth: tuple[int, NDArray[np.uint16]] | None = None
        self._color: tuple[int, NDArray[np.uint8]] | None = None

    def add_depth(self, depth: NDArray[np.uint16], ticks: int) -> Picture | None:
        """Take (480, 640) millimetres; return a picture if its colour is there."""
        self._depth = self._unwrapped(ticks), depth
        return self._pair()

    def add_color(self, color: NDArray[np.uint8], ticks: int) -> Picture | None:
        """Take (480, 640, 3) red, green, blue; return a picture if its depth is there."""
        self._color = self._unwrapped(ticks), color
        return self._pair()

    def _unwrapped(self, ticks: int) -> int:
        if self._moment is None:
            self._moment = ticks
        # either stream can be a little behind the other
        ahead = (ticks - self._moment + 2**31) % 2**32 - 2**31
        self._moment += ahead
        return self._moment

    def _pair(self) -> Picture | None:
        if self._depth is None or self._color is None:
            return None
        (moment, depth), (other, color) = self._depth, self._color
        if abs(moment - other) > SAME_MOMENT * TICKS:
            return None
        self._depth = self._color = None
        return Picture(moment / TICKS, LENS, color, depth)


def _load(name: str) -> Any:
    """Return the installed library, its functions declared.

    Raises
    ------
    SourceError
        There is none, or it cannot be loaded.
    """
    reasons = []
    for candidate in LIBRARIES:
        try:
            return _declared(ctypes.CDLL(candidate))
        except OSError as error:
            reasons.append(str(error))
    kind, found = load_error("freenect"), "no libfreenect on this machine"
    if kind is not NotInstalledError:
        found = f"a libfreenect that does not load ({'; '.join(reasons)})"
    raise kind(
        name,
        found=found,
        expected="the library through which a Kinect v1 is read",
        fix="Install it: apt install libfreenect0.5 on Debian and Ubuntu, brew install libfreenect on macOS.",
    )


def _declared(library: ctypes.CDLL) -> ctypes.CDLL:
    pointer, integer, reference = ctypes.c_void_p, ctypes.c_int, ctypes.POINTER(ctypes.c_void_p)
    arguments: dict[str, list[Any]] = {
        "init": [reference, pointer],
        "set_log_level": [pointer, integer],
        "set_log_callback": [pointer, _LOG],
        "select_subdevices": [pointer, integer],
        "num_devices": [pointer],
        "open_device": [pointer, reference, integer],
        "find_depth_mode": [integer, integer],
        "find_video_mode": [integer, integer],
        "set_depth_mode": [pointer, _Mode],
        "set_video_mode": [pointer, _Mode],
        "set_depth_callback": [pointer, _FRAME],
        "set_video_callback": [pointer, _FRAME],
        "start_depth": [pointer],
        "start_video": [pointer],
        "process_events_timeout": [pointer, ctypes.POINTER(_Interval)],
        "stop_depth": [pointer],
        "stop_video": [pointer],
        "close_device": [pointer],
        "shutdown": [pointer],
    }
    for function, types in arguments.items():
        getattr(library, f"freenect_{function}").argtypes = types
    library.freenect_find_depth_mode.restype = library.freenect_find_video_mode.restype = _Mode
    return library


def _absent(name: str, index: int, count: int) -> SourceError:
    if count <= 0:
        return SourceError(
            name,
            found="no Kinect v1 on USB",
            expected="one",
            fix="Plug it in, into its power supply too: USB alone does not feed its cameras.",
        )
    return SourceError(
        name,
        found=f"{count} Kinect v1 and no number {index}",
        expected=f"a number below {count}",
        fix="They are counted from 0: freenect: is the first, freenect:1 the second.",
    )


def _forbidden(name: str) -> SourceError:
    return SourceError(
        name,
        found="no permission to open the Kinect on USB",
        expected="a udev rule that gives it",
        fix=f'The package libfreenect0.5 brings {RULES}; without it, write SUBSYSTEM=="usb", '
        'ATTRS{idVendor}=="045e", ATTRS{idProduct}=="02ae", MODE="0666" (02bf for a Kinect for Windows) into '
        f"/etc/udev/rules.d/{RULES}. Then call udevadm control --reload and plug the Kinect in again.",
    )
