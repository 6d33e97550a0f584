"""Depth sensors, and recordings of them, through the OpenNI2 library.

``openni:`` is the first sensor that the library finds; ``openni:serial=…`` and ``openni:uri=…`` name one;
``openni:file=take.oni`` plays a recording, with ``&fast`` as fast as people can be found in it and with ``?loop`` again
and again. The library is the system's, or that in the folder that the environment variable OPENNI2_REDIST names. NiTE2
finds people in what a sensor shows, where it is installed and starts; otherwise, and in recordings, MediaPipe does.
"""

import ctypes
import ctypes.util
import logging
import math
import os
import re
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from capture.libraries import import_error, load_error
from capture.sensors.oni_file import check_plays, check_whole
from capture.sensors.source import SensorSource
from capture.trackers.mediapipe import MediaPipePose, library
from capture.trackers.nite import REDIST as NITE2_REDIST
from capture.trackers.nite import NiTE, library_path
from capture.trackers.picture import Device, Lens, Picture, Tracker
from puppetline.errors import SourceError, heading

REDIST = "OPENNI2_REDIST"
"""Names the folder of the library and of its drivers."""
RULES = "60-libopenni2-0.rules"
"""The udev rules that let users open sensors, of Debian's libopenni2-0."""

SAME_MOMENT = 0.02
"""Seconds between depth and colour of one picture."""
_IN_STEP = 0.001
OTHER_CLOCKS = 1.0
"""Seconds between them that say that each has a clock of its own."""

_NAMES = ("libOpenNI2.so", "libOpenNI2.so.0", "libOpenNI2.dylib", "OpenNI2.dll")
_SERIAL_NUMBER = 3  # of the properties of devices
_PATIENCE = 5.0  # seconds that one opening waits for another
_USB = re.compile(r"[0-9a-f]{4}/[0-9a-f]{4}@(\d+)/(\d+)")  # vendor, product, bus and device, of OpenNI2's own drivers
_STEP = 1 / 30  # seconds between the end of a recording and its beginning in a loop
_EXPECTED = "nothing, serial=NUMBER, uri=TEXT or file=NAME.oni behind openni:, a file with &fast or ?loop"

log = logging.getLogger(__name__)
_library = threading.Lock()  # for what changes the library's devices


@dataclass(frozen=True, slots=True)
class Place:
    """What a user says about where pictures come from.

    Attributes
    ----------
    kind : "any", "serial", "uri" or "file"
    value : str
        Of that kind, empty for any.
    fast, loop : bool
        How a file is played.
    """

    kind: Literal["any", "serial", "uri", "file"] = "any"
    value: str = ""
    fast: bool = False
    loop: bool = False


@dataclass(frozen=True, slots=True)
class Sensor:
    """A sensor that is plugged in.

    Attributes
    ----------
    name : str
        What it calls itself.
    uri, serial : str
        By which it can be chosen; the second may be unknown, and is empty then.
    trouble : SourceError or None
        Why it cannot be opened.
    """

    name: str
    uri: str
    serial: str
    trouble: SourceError | None


def open_openni(uri: str, rest: str, folder: Path) -> SensorSource:
    """Open a sensor or a recording and find people in what it shows.

    Parameters
    ----------
    uri, rest : str
        The whole, and what follows its scheme.
    folder : Path
        What files are relative to.

    Raises
    ------
    SourceError
        The text cannot be read, a library is missing, or the file is none that plays. What is wrong with a sensor, the
        source raises.
    """
    place = parse(uri, rest)
    openni2(uri)
    if place.kind == "file" or library_path() is None:
        library()
    if place.kind == "file":
        check_plays(uri, folder / place.value)
        file = OpenNIDevice(uri, place, folder)
        return SensorSource(uri, lambda: file, lambda _device: MediaPipePose(), recorded=True, fast=place.fast)
    return SensorSource(uri, lambda: OpenNIDevice(uri, place), _tracker)


def parse(uri: str, rest: str) -> Place:
    """Read the part of a URI after its colon.

    Raises
    ------
    SourceError
        It says something else than what this module's head allows.
    """
    where, *options = re.split("[&?]", rest)
    kind, _, value = where.partition("=")
    if not rest:
        return Place()
    if kind == "file" and value and set(options) <= {"fast", "loop"}:
        return Place("file", value, "fast" in options, "loop" in options)
    if kind in ("serial", "uri") and value and not options:
        return Place("serial" if kind == "serial" else "uri", value)
    raise SourceError(uri, found=repr(rest), expected=_EXPECTED, fix="openni: alone takes the first sensor there is.")


def openni2(where: str) -> Any:
    """Return the bindings, with the library loaded and its drivers started.

    Parameters
    ----------
    where : str
        Who asks, for the message.

    Raises
    ------
    SourceError
        The bindings or the library are not installed, or the library cannot start.
    """
    try:
        from openni import openni2 as bindings
    except ImportError as error:
        raise import_error("openni", error)(
            where, found=f"no OpenNI2 bindings ({error})", expected="them", fix="pip install 'puppetline[openni]'"
        ) from error
    if not bindings.is_initialized():
        with _alone(where):
            _load(where, bindings)
    return bindings


def devices(bindings: Any) -> list[str]:
    """Return the URIs of the sensors that are plugged in."""
    return [uri for uri, _ in _listed(bindings)]


def plugged_in(where: str) -> list[Sensor]:
    """Return the sensors that the library finds.

    Parameters
    ----------
    where : str
        Who asks, for the message.

    Raises
    ------
    SourceError
        There is no library.
    """
    bindings = openni2(where)
    with _alone(where):
        return [_looked_at(bindings, uri, name) for uri, name in _listed(bindings)]


class OpenNIDevice:
    """A sensor or a recording; implements `capture.trackers.picture.Device`.

    Depth is registered to colour and both are of the same moment, as far as the sensor can; the log says what it
    cannot.
    Pictures are as the sensor sees, not mirrored. A recording is given as fast as it is read.

    Parameters
    ----------
    name : str
        The URI of the source.
    place : Place
    folder : Path
        What files are relative to.

    Attributes
    ----------
    name : str
        What the sensor calls itself.

    Raises
    ------
    SourceError
        There is no such sensor, it is in use or may not be opened, or the recording is none.
    """

    def __init__(self, name: str, place: Place, folder: Path = Path()) -> None:
        self._uri = name
        self._oni = openni2(name)
        self._recorded = place.kind == "file"
        self._streams: list[Any] = []
        self._waiting: dict[Any, tuple[float, NDArray[Any]]] = {}  # the newest of each stream, not given yet
        self._left: dict[Any, int] = {}  # pictures of each stream of a recording that ends
        self._before = -math.inf  # the time of the last picture
        self._passed = 0.0  # seconds of the earlier passes of a loop
        with _alone(name), self._told():
            self._device = self._opened(place, folder)
            try:
                info = self._device.device_info
                self.name = _name(info)
                self._place = info.uri
                self._prepare(place)
            except BaseException:
                self.close()
                raise

    def read(self, timeout: float) -> Picture | None:
        """Wait for the next picture for at most so many seconds; None if none has come.

        Raises
        ------
        SourceError
            The sensor was unplugged, or the recording has ended.
        """
        until = time.monotonic() + timeout
        while True:
            if self._left and not any(self._left.values()):
                raise self._ended()
            with self._told():
                stream = self._oni.wait_for_any_stream(self._streams, max(0.0, until - time.monotonic()))
                if stream is not None:
                    self._take(stream)
            if stream is None:
                self._check_plug()
                return None
            picture = self._pair()
            if picture is not None:
                return picture

    def nite(self) -> NiTE:
        """Return NiTE2 tracking the people that this sensor sees; to be closed before the sensor.

        Raises
        ------
        SourceError
            It does not start.
        """
        with _alone(self._uri):
            return NiTE(self._device._handle, self._mirrored.get(self._depth, False))

    def close(self) -> None:
        """Stop the sensor and let go of it."""
        for handle in (*self._streams, self._device):
            with suppress(self._oni.OpenNIError):
                handle.close()

    def _opened(self, place: Place, folder: Path) -> Any:
        if place.kind == "file":
            check_whole(self._uri, folder / place.value)
            return _open(self._oni, os.fsencode(folder / place.value))
        there = devices(self._oni)
        if place.kind == "serial":
            for uri in there:
                with suppress(self._oni.OpenNIError):
                    device = _open(self._oni, uri.encode())
                    if _serial(device) == place.value:
                        return device
                    device.close()
        elif there and place.kind == "any":
            return _open(self._oni, there[0].encode())
        elif place.value in there:
            return _open(self._oni, place.value.encode())
        raise SourceError(
            self._uri,
            found=f"sensors {', '.join(there)}" if there else "no sensor",
            expected="one that is plugged in" if place.kind == "any" else f"one with the {place.kind} {place.value}",
            fix="Plug it in, with its power supply; puppetline doctor lists what is on USB.",
        )

    def _prepare(self, place: Place) -> None:
        """Make streams of what the sensor has, set them up and start them."""
        oni, device = self._oni, self._device
        self._depth, self._color = (
            device.create_stream(sensor) if device.has_sensor(sensor) else None
            for sensor in (oni.SENSOR_DEPTH, oni.SENSOR_COLOR)
        )
        self._streams = [stream for stream in (self._depth, self._color) if stream is not None]
        formats = {self._depth: oni.PIXEL_FORMAT_DEPTH_1_MM, self._color: oni.PIXEL_FORMAT_RGB888}
        if self._recorded:
            device.playback.set_speed(-1.0)
            device.playback.set_repeat_enabled(True)  # or closing it at its end can crash
            self._left = {} if place.loop else {s: s.get_number_of_frames() for s in self._streams}
        else:
            self._choose_mode(formats)
        modes = {stream: stream.video_mode for stream in self._streams}
        sizes = {(mode.resolutionX, mode.resolutionY) for mode in modes.values()}
        if len(sizes) != 1 or any(mode.pixelFormat != formats[stream] for stream, mode in modes.items()):
            raise SourceError(
                self._uri,
                found=f"pictures of {', '.join(f'{width}×{height}' for width, height in sorted(sizes)) or 'no kind'}",
                expected="depths in millimetres and colours as RGB, of one size",
                fix="Record it with such pictures." if self._recorded else "It cannot be used through OpenNI2.",
            )
        self._mirrored = {stream: self._is_mirrored(stream) for stream in self._streams}
        if len(self._streams) == 2:
            self._tell_registration() if self._recorded else self._join()
        self._lens = self._lens_of(self._streams[-1])
        for stream in self._streams:
            stream.start()

    def _choose_mode(self, formats: dict[Any, Any]) -> None:
        """Have all streams give pictures of one size, as near to 640×480 and 30 a second as there is."""
        modes = [
            {
                (mode.resolutionX, mode.resolutionY, mode.fps)
                for mode in stream.get_sensor_info().videoModes
                if mode.pixelFormat == formats[stream]
            }
            for stream in self._streams
        ]
        common = set.intersection(*modes) if modes else None
        if common:
            best = min(common, key=lambda mode: math.dist(mode, (640, 480, 30)))
            for stream in self._streams:
                stream.configure_mode(*best, formats[stream])

    def _is_mirrored(self, stream: Any) -> bool:
        """Have a stream not be mirrored; return whether it still is, as a recording that was made so."""
        if not self._recorded:
            with suppress(self._oni.OpenNIError):
                stream.set_mirroring_enabled(False)
        with suppress(self._oni.OpenNIError):
            return bool(stream.get_mirroring_enabled())
        return False

    def _join(self) -> None:
        """Have depth be where colour is, and when; the library does not tell whether a sensor can do the latter."""
        device, mode = self._device, self._oni.IMAGE_REGISTRATION_DEPTH_TO_COLOR
        if device.is_image_registration_mode_supported(mode):
            device.set_image_registration_mode(mode)
        else:
            said = "%s %s cannot register depth to colour, so depth is a little off"
            log.warning(said, heading(self._uri), self.name)
        device.set_depth_color_sync_enabled(True)

    def _tell_registration(self) -> None:
        """Say whether depth of a recording is where colour is; OpenNI2's own recorder does not write that down."""
        try:
            mode = self._device.get_image_registration_mode()
        except self._oni.OpenNIError:
            said = "%s the recording does not tell whether its depth is registered to colour, so it is taken to be"
            log.info(said, heading(self._uri))
        else:
            if mode != self._oni.IMAGE_REGISTRATION_DEPTH_TO_COLOR:
                log.warning("%s its depth was not registered to colour, so depth is a little off", heading(self._uri))

    def _lens_of(self, stream: Any) -> Lens:
        mode = stream.video_mode
        width, height = mode.resolutionX, mode.resolutionY
        return Lens(width, height, width / 2 / math.tan(stream.get_horizontal_fov() / 2))

    def _take(self, stream: Any) -> None:
        """Read a picture that is there."""
        frame = stream.read_frame()
        if self._left:
            self._left[stream] = stream.get_number_of_frames() - frame.frameIndex
        pixels = self._pixels(stream, frame)
        if pixels is not None:
            self._waiting[stream] = frame.timestamp * 1e-6, pixels
        frame.close()

    def _pixels(self, stream: Any, frame: Any) -> NDArray[Any] | None:
        """Return what a picture shows, as an array of its own; None if it is damaged, as in a recording."""
        kind = np.dtype(np.uint16 if stream is self._depth else (np.uint8, 3))
        size = frame.height, frame.width
        whole = frame.stride >= frame.width * kind.itemsize and frame.dataSize >= frame.height * frame.stride
        if size != (self._lens.height, self._lens.width) or not whole:
            return None
        rows = np.ctypeslib.as_array((ctypes.c_uint8 * frame.dataSize).from_address(frame.data))
        pixels = np.ndarray(size, kind, rows, strides=(frame.stride, kind.itemsize))
        return (pixels[:, ::-1] if self._mirrored[stream] else pixels).copy()

    def _pair(self) -> Picture | None:
        """Return what all streams show at one moment; forget what has no counterpart."""
        if len(self._waiting) < len(self._streams):
            return None
        moments = {stream: moment for stream, (moment, _) in self._waiting.items()}
        earliest = min(self._streams, key=moments.__getitem__)
        apart = max(moments.values()) - moments[earliest]
        if SAME_MOMENT < apart < OTHER_CLOCKS:
            del self._waiting[earliest]
            return None
        if self._before == -math.inf and apart > _IN_STEP:
            log.warning("%s %s takes depth and colour %.1f ms apart", heading(self._uri), self.name, 1000 * apart)
        moment = moments[self._streams[0]]
        if self._recorded and moment + self._passed <= self._before:  # it begins again
            if self._left:  # though its last picture, which is damaged, has never come
                raise self._ended()
            self._passed = self._before + _STEP - moment
        self._before = moment + self._passed
        depth, color = (self._waiting.pop(stream, (0.0, None))[1] for stream in (self._depth, self._color))
        return Picture(self._before, self._lens, color, depth)

    def _ended(self) -> SourceError:
        return SourceError(
            self._uri,
            found="the end of the recording",
            expected="more frames",
            fix="Add ?loop to play it in a loop.",
        )

    def _check_plug(self) -> None:
        if not self._recorded and self._place.decode(errors="replace") not in devices(self._oni):
            raise SourceError(
                self._uri,
                found=f"an unplugged sensor ({self.name})",
                expected="a sensor that stays plugged in",
                fix="Plug it in again; it is reopened automatically.",
            )

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Turn the library's errors into ours."""
        try:
            yield
        except self._oni.OpenNIError as error:
            raise self._failed(error) from error

    def _failed(self, error: Exception) -> SourceError:
        reason = _reason(error)
        if self._recorded:
            return SourceError(
                self._uri,
                found=f"a file that OpenNI2 does not play ({reason})",
                expected="a whole .oni recording",
                fix="Record it again.",
            )
        return _unusable(self._uri, devices(self._oni), reason)


def _tracker(device: Device) -> Tracker:
    """Return what finds people in what a sensor shows, and say why it is not NiTE2."""
    if library_path() is None or not isinstance(device, OpenNIDevice):
        log.info("%s: no NiTE2 library (%s may name its folder), so MediaPipe finds people", device.name, NITE2_REDIST)
        return MediaPipePose()
    try:
        return device.nite()
    except SourceError as error:
        log.warning("%s: MediaPipe finds people, as NiTE2 does not start: %s", device.name, error)
        return MediaPipePose()


def usb_node(uri: str) -> Path | None:
    """Return the file by which a sensor of OpenNI2's own drivers is opened."""
    match = _USB.fullmatch(uri)
    return match and Path(f"/dev/bus/usb/{int(match[1]):03}/{int(match[2]):03}")


@contextmanager
def _alone(where: str) -> Iterator[None]:
    """Keep others from opening and starting; the library is not made for it, and may never return."""
    if not _library.acquire(timeout=_PATIENCE):
        raise SourceError(
            where,
            found=f"another sensor that OpenNI2 has been opening for more than {_PATIENCE:g} s",
            expected="a sensor that opens sooner",
            fix="Unplug that sensor and plug it in again; if that does not help, restart Puppetline.",
        )
    try:
        yield
    finally:
        _library.release()


def _load(where: str, bindings: Any) -> None:
    """Start the library: as bindings.initialize does, which changes the folder that this process works in."""
    try:
        if bindings.loaded_dll_directory is None:
            path = _path()
            bindings.c_api.load_dll(path)
            bindings.loaded_dll_directory = str(Path(path).parent)
        bindings.initialize()
    except (OSError, bindings.OpenNIError) as error:
        # a folder that the user names is meant to have it
        kind = SourceError if REDIST in os.environ else load_error("OpenNI2")
        raise kind(
            where,
            found=f"no OpenNI2 library that starts ({error})",
            expected=f"the system's library, or one in the folder that {REDIST} names",
            fix="Install it: apt install libopenni2-0 on Debian and Ubuntu.",
        ) from error


def _path() -> str:
    """Return the library's path, or a name that the system finds it by."""
    folder = os.environ.get(REDIST)
    if folder is None:
        return ctypes.util.find_library("OpenNI2") or "libOpenNI2.so.0"
    found = [path for name in _NAMES if (path := Path(folder) / name).is_file()]
    if not found:
        raise FileNotFoundError(f"none of {', '.join(_NAMES)} in {folder}")
    return str(found[0].absolute())


def _listed(bindings: Any) -> list[tuple[str, str]]:
    """Return the URIs and names of sensors; the library has files that are open among them."""
    infos, count = ctypes.POINTER(bindings.c_api.OniDeviceInfo)(), ctypes.c_int()
    bindings.c_api.oniGetDeviceList(ctypes.byref(infos), ctypes.byref(count))
    try:
        known = [(infos[k].uri.decode(errors="replace"), _name(infos[k])) for k in range(count.value)]
    finally:
        bindings.c_api.oniReleaseDeviceList(infos)
    return [(uri, name) for uri, name in known if not Path(uri).is_file()]


def _open(bindings: Any, name: bytes) -> Any:
    """Open a device.

    What cannot be opened is not closed either, as the bindings would: the library counts closings, takes the sensor for
    open the next time, and crashes.
    """
    device = bindings.Device.__new__(bindings.Device)
    try:
        device.__init__(name)
    except bindings.OpenNIError:
        if not hasattr(device, "playback"):  # which comes after opening
            device._handle = None
        raise
    return device


def _name(info: Any) -> str:
    return " ".join(part.decode(errors="replace") for part in (info.vendor, info.name) if part)


def _looked_at(bindings: Any, uri: str, name: str) -> Sensor:
    try:
        device = _open(bindings, uri.encode())
    except bindings.OpenNIError as error:
        return Sensor(name, uri, "", _unusable(f"openni:uri={uri}", [uri], _reason(error)))
    try:
        return Sensor(name, uri, _serial(device), None)
    except bindings.OpenNIError:  # it has none
        return Sensor(name, uri, "", None)
    finally:
        device.close()


def _reason(error: Exception) -> str:
    """Return what the library said."""
    _, said, _ = error.args
    return (said.decode(errors="replace") if isinstance(said, bytes) else said) or "without a reason"


def _unusable(where: str, uris: list[str], reason: str) -> SourceError:
    """Tell why a sensor does not work, which is one of those: the library says no more than that."""
    for node in filter(None, map(usb_node, uris)):
        if not os.access(node, os.R_OK | os.W_OK):
            return SourceError(
                where,
                found=f"a sensor at {node} that this user may not open",
                expected="permission to read and write there",
                fix=f"Install the udev rules {RULES} (Debian: libopenni2-0), then plug the sensor in again.",
            )
    return SourceError(
        where,
        found=f"a sensor that does not work ({reason})",
        expected="one that no other program uses",
        fix="End other programs that may use it, or plug it out and in again.",
    )


def _serial(device: Any) -> str:
    text = device.get_property(_SERIAL_NUMBER, ctypes.c_char * 256).value
    return text.decode(errors="replace")
