"""Depth sensors, and recordings of them, through the OpenNI2 library: the sources ``openni:``.

``openni:`` is the first sensor that the library finds; ``openni:serial=…`` and ``openni:uri=…`` select one.
``openni:file=take.oni`` plays a recording: with ``&fast`` as fast as tracking allows, with ``?loop`` in a loop. For
sensors, NiTE2 is the tracker if it is installed and starts; otherwise, and for recordings, MediaPipe is.
"""

import ctypes
import logging
import math
import os
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from capture.sensors.oni_file import check_intact, check_plays
from capture.sensors.openni_library import (
    device_name,
    error_reason,
    exclusive,
    load_openni2,
    open_device,
    sensor_uris,
    serial_number,
    unusable,
)
from capture.sensors.source import SensorSource
from capture.trackers.mediapipe import MediaPipePose, load_mediapipe
from capture.trackers.nite import REDIST_VARIABLE as NITE2_REDIST
from capture.trackers.nite import NiTE, library_path
from capture.trackers.picture import Device, Lens, Picture, Tracker
from puppetline.errors import SourceError, heading

MAX_SKEW_SECONDS = 0.02
"""Largest difference between the times of depth and colour in one image, in seconds."""
MIN_CLOCK_OFFSET_SECONDS = 1.0
"""Smallest difference between the times of depth and colour that shows that each has its own clock, in seconds."""

_SYNCHRONISED_SECONDS = 0.001  # difference between the times of depth and colour that is not worth a warning
_LOOP_STEP_SECONDS = 1 / 30  # time between the end of a recording and its beginning in a loop
_EXPECTED = "nothing, serial=NUMBER, uri=TEXT or file=NAME.oni after openni:, a file with &fast or ?loop"

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Selection:
    """The sensor or recording that a URI selects.

    Attributes
    ----------
    kind : "any", "serial", "uri" or "file"
    value : str
        Serial number, OpenNI2 URI or path; empty for any.
    fast, loop : bool
        How a recording is played.
    """

    kind: Literal["any", "serial", "uri", "file"] = "any"
    value: str = ""
    fast: bool = False
    loop: bool = False


def open_openni(uri: str, rest: str, folder: Path) -> SensorSource:
    """Open a sensor or a recording with a tracker.

    Parameters
    ----------
    uri, rest : str
        The whole URI, and the part after its scheme.
    folder : Path
        Folder to which paths are relative.

    Raises
    ------
    SourceError
        The URI is wrong, a library is missing, or the recording does not play. The source itself raises the errors of a
        sensor.
    """
    selection = parse(uri, rest)
    load_openni2(uri)
    if selection.kind == "file" or library_path() is None:
        load_mediapipe()
    if selection.kind == "file":
        check_plays(uri, folder / selection.value)
        file = OpenNIDevice(uri, selection, folder)
        return SensorSource(uri, lambda: file, lambda _device: MediaPipePose(), recorded=True, fast=selection.fast)
    return SensorSource(uri, lambda: OpenNIDevice(uri, selection), _open_tracker)


def parse(uri: str, rest: str) -> Selection:
    """Parse the part of a URI after its scheme.

    Raises
    ------
    SourceError
        The text has another form than those in this module's docstring.
    """
    target, *options = re.split("[&?]", rest)
    kind, _, value = target.partition("=")
    if not rest:
        return Selection()
    if kind == "file" and value and set(options) <= {"fast", "loop"}:
        return Selection("file", value, "fast" in options, "loop" in options)
    if kind in ("serial", "uri") and value and not options:
        return Selection("serial" if kind == "serial" else "uri", value)
    raise SourceError(uri, found=repr(rest), expected=_EXPECTED, fix="Write openni: for the first sensor.")


class OpenNIDevice:
    """A sensor or a recording; implements `capture.trackers.picture.Device`.

    Depth is registered to colour, both are synchronised, and images are not mirrored. The log lists what a sensor
    cannot do. A recording is read as fast as possible.

    Parameters
    ----------
    name : str
        URI of the source.
    selection : Selection
    folder : Path
        Folder to which paths are relative.

    Attributes
    ----------
    name : str
        Vendor and name of the sensor.

    Raises
    ------
    SourceError
        No such sensor is plugged in, it is in use or may not be opened, or the file is not a recording.
    """

    def __init__(self, name: str, selection: Selection, folder: Path = Path()) -> None:
        self._uri = name
        self._oni = load_openni2(name)
        self._recorded = selection.kind == "file"
        self._streams: list[Any] = []
        self._waiting: dict[Any, tuple[float, NDArray[Any]]] = {}  # newest time and pixels of each stream
        self._left: dict[Any, int] = {}  # number of frames left in each stream of a recording that ends
        self._last = -math.inf  # time of the last image
        self._passed = 0.0  # seconds of earlier passes of a loop
        with exclusive(name), self._errors():
            self._device = self._open(selection, folder)
            try:
                info = self._device.device_info
                self.name = device_name(info)
                self._device_uri = info.uri.decode(errors="replace")
                self._prepare(selection)
            except BaseException:
                self.close()
                raise

    def read(self, timeout: float) -> Picture | None:
        """Return the next image; raise SourceError if the sensor was unplugged or the recording has ended."""
        until = time.monotonic() + timeout
        while True:
            if self._left and not any(self._left.values()):
                raise self._ended()
            with self._errors():
                stream = self._oni.wait_for_any_stream(self._streams, max(0.0, until - time.monotonic()))
                if stream is not None:
                    self._read_frame(stream)
            if stream is None:
                self._check_plugged()
                return None
            picture = self._combine()
            if picture is not None:
                return picture

    def nite(self) -> NiTE:
        """Return NiTE2 as a tracker, to be closed before the sensor; raise SourceError if it does not start."""
        with exclusive(self._uri):
            return NiTE(self._device._handle, self._mirrored.get(self._depth, False))

    def close(self) -> None:
        """Stop and release the sensor; closing again does nothing."""
        for handle in (*self._streams, self._device):
            with suppress(self._oni.OpenNIError):
                handle.close()

    def _open(self, selection: Selection, folder: Path) -> Any:
        if selection.kind == "file":
            check_intact(self._uri, folder / selection.value)
            return open_device(self._oni, os.fsencode(folder / selection.value))
        plugged = sensor_uris(self._oni)
        if selection.kind == "serial":
            for uri in plugged:
                with suppress(self._oni.OpenNIError):
                    device = open_device(self._oni, uri.encode())
                    if serial_number(device) == selection.value:
                        return device
                    device.close()
        elif plugged and selection.kind == "any":
            return open_device(self._oni, plugged[0].encode())
        elif selection.value in plugged:
            return open_device(self._oni, selection.value.encode())
        wanted = "" if selection.kind == "any" else f" with the {selection.kind} {selection.value}"
        raise SourceError(
            self._uri,
            found=f"sensors {', '.join(plugged)}" if plugged else "no sensor",
            expected=f"a sensor{wanted}",
            fix="Plug it in, with its power supply; puppetline doctor lists what is on USB.",
        )

    def _prepare(self, selection: Selection) -> None:
        """Create the streams of the device, configure and start them."""
        oni, device = self._oni, self._device
        self._depth, self._color = (
            device.create_stream(sensor) if device.has_sensor(sensor) else None
            for sensor in (oni.SENSOR_DEPTH, oni.SENSOR_COLOR)
        )
        self._streams = [stream for stream in (self._depth, self._color) if stream is not None]
        formats = {self._depth: oni.PIXEL_FORMAT_DEPTH_1_MM, self._color: oni.PIXEL_FORMAT_RGB888}
        if self._recorded:
            device.playback.set_speed(-1.0)
            device.playback.set_repeat_enabled(True)  # without it, closing at the end can crash
            self._left = {} if selection.loop else {s: s.get_number_of_frames() for s in self._streams}
        else:
            self._choose_mode(formats)
        modes = {stream: stream.video_mode for stream in self._streams}
        sizes = {(mode.resolutionX, mode.resolutionY) for mode in modes.values()}
        if len(sizes) != 1 or any(mode.pixelFormat != formats[stream] for stream, mode in modes.items()):
            raise SourceError(
                self._uri,
                found=f"images of {', '.join(f'{width}×{height}' for width, height in sorted(sizes)) or 'no kind'}",
                expected="depth in millimetres and colours as RGB, of one size",
                fix="Record such images." if self._recorded else "Use another sensor.",
            )
        self._mirrored = {stream: self._is_mirrored(stream) for stream in self._streams}
        if len(self._streams) == 2:
            self._log_registration() if self._recorded else self._register()
        self._lens = self._lens_of(self._streams[-1])
        for stream in self._streams:
            stream.start()

    def _choose_mode(self, formats: dict[Any, Any]) -> None:
        """Set all streams to one size, as close as possible to 640×480 at 30 images per second."""
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
        """Turn mirroring off; return whether the stream is mirrored nevertheless, as a recording may be."""
        if not self._recorded:
            with suppress(self._oni.OpenNIError):
                stream.set_mirroring_enabled(False)
        with suppress(self._oni.OpenNIError):
            return bool(stream.get_mirroring_enabled())
        return False

    def _register(self) -> None:
        """Register depth to colour, and synchronise both; the library does not report whether the latter works."""
        device, mode = self._device, self._oni.IMAGE_REGISTRATION_DEPTH_TO_COLOR
        if device.is_image_registration_mode_supported(mode):
            device.set_image_registration_mode(mode)
        else:
            message = "%s %s cannot register depth to colour: depth is slightly displaced"
            log.warning(message, heading(self._uri), self.name)
        device.set_depth_color_sync_enabled(True)

    def _log_registration(self) -> None:
        """Log whether depth of a recording is registered to colour; OpenNI2's own recorder does not write that."""
        try:
            mode = self._device.get_image_registration_mode()
        except self._oni.OpenNIError:
            message = "%s the recording does not state whether depth is registered to colour: assuming that it is"
            log.info(message, heading(self._uri))
        else:
            if mode != self._oni.IMAGE_REGISTRATION_DEPTH_TO_COLOR:
                message = "%s the recording's depth is not registered to colour: depth is slightly displaced"
                log.warning(message, heading(self._uri))

    def _lens_of(self, stream: Any) -> Lens:
        mode = stream.video_mode
        width, height = mode.resolutionX, mode.resolutionY
        return Lens(width, height, width / 2 / math.tan(stream.get_horizontal_fov() / 2))

    def _read_frame(self, stream: Any) -> None:
        """Read a frame that is available."""
        frame = stream.read_frame()
        if self._left:
            self._left[stream] = stream.get_number_of_frames() - frame.frameIndex
        pixels = self._pixels(stream, frame)
        if pixels is not None:
            self._waiting[stream] = frame.timestamp * 1e-6, pixels
        frame.close()

    def _pixels(self, stream: Any, frame: Any) -> NDArray[Any] | None:
        """Return a copy of a frame's pixels; None if the frame is damaged, as in a recording."""
        kind = np.dtype(np.uint16 if stream is self._depth else (np.uint8, 3))
        size = frame.height, frame.width
        complete = frame.stride >= frame.width * kind.itemsize and frame.dataSize >= frame.height * frame.stride
        if size != (self._lens.height, self._lens.width) or not complete:
            return None
        rows = np.ctypeslib.as_array((ctypes.c_uint8 * frame.dataSize).from_address(frame.data))
        pixels = np.ndarray(size, kind, rows, strides=(frame.stride, kind.itemsize))
        return (pixels[:, ::-1] if self._mirrored[stream] else pixels).copy()

    def _combine(self) -> Picture | None:
        """Return an image of the newest frames of all streams; drop a frame without a counterpart."""
        if len(self._waiting) < len(self._streams):
            return None
        times = {stream: moment for stream, (moment, _) in self._waiting.items()}
        earliest = min(self._streams, key=times.__getitem__)
        skew = max(times.values()) - times[earliest]
        if MAX_SKEW_SECONDS < skew < MIN_CLOCK_OFFSET_SECONDS:
            del self._waiting[earliest]
            return None
        if self._last == -math.inf and skew > _SYNCHRONISED_SECONDS:
            message = "%s the times of depth and colour of %s differ by %.1f ms"
            log.warning(message, heading(self._uri), self.name, 1000 * skew)
        moment = times[self._streams[0]]
        if self._recorded and moment + self._passed <= self._last:  # the recording begins again
            if self._left:  # although its damaged last frame was skipped
                raise self._ended()
            self._passed = self._last + _LOOP_STEP_SECONDS - moment
        self._last = moment + self._passed
        depth, color = (self._waiting.pop(stream, (0.0, None))[1] for stream in (self._depth, self._color))
        return Picture(self._last, self._lens, color, depth)

    def _ended(self) -> SourceError:
        return SourceError(
            self._uri,
            found="the end of the recording",
            expected="more images",
            fix="Add ?loop to play it in a loop.",
        )

    def _check_plugged(self) -> None:
        if not self._recorded and self._device_uri not in sensor_uris(self._oni):
            raise SourceError(
                self._uri,
                found=f"an unplugged sensor ({self.name})",
                expected="a sensor that stays plugged in",
                fix="Plug it in again; the source then resumes automatically.",
            )

    @contextmanager
    def _errors(self) -> Iterator[None]:
        """Turn the library's errors into source errors."""
        try:
            yield
        except self._oni.OpenNIError as error:
            raise self._failure(error) from error

    def _failure(self, error: Exception) -> SourceError:
        reason = error_reason(error)
        if self._recorded:
            return SourceError(
                self._uri,
                found=f"a file that OpenNI2 does not play ({reason})",
                expected="an intact .oni recording",
                fix="Record it again.",
            )
        return unusable(self._uri, sensor_uris(self._oni), reason)


def _open_tracker(device: Device) -> Tracker:
    """Return the tracker for a sensor; log the reason if it is not NiTE2."""
    if library_path() is None or not isinstance(device, OpenNIDevice):
        log.info("%s: tracking with MediaPipe, because NiTE2 is not installed (or set %s)", device.name, NITE2_REDIST)
        return MediaPipePose()
    try:
        return device.nite()
    except SourceError as error:
        log.warning("%s: tracking with MediaPipe, because NiTE2 did not start: %s", device.name, error)
        return MediaPipePose()
