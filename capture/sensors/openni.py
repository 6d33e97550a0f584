"""Depth sensors, and recordings of them, through the OpenNI2 library: the sources ``openni:``.

``openni:`` is the first sensor that the library finds; ``openni:serial=…`` and ``openni:uri=…`` select one.
``openni:file=take.oni`` plays a recording: with ``&fast`` as fast as tracking allows, with ``?loop`` in a loop. For
sensors, NiTE2 is the tracker if it is installed and starts; otherwise, for recordings and with ``?face&hands``,
MediaPipe is.
"""

import ctypes
import logging
import math
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from capture.sensors import depth_camera, openni_library
from capture.sensors.depth_camera import DepthCamera, Kind, Selection
from capture.sensors.oni_file import check_intact, check_plays
from capture.sensors.source import SensorSource
from capture.trackers.mediapipe import MediaPipePose, load_mediapipe
from capture.trackers.nite import REDIST_VARIABLE as NITE2_REDIST
from capture.trackers.nite import NiTE, library_path
from capture.trackers.picture import Device, Lens, Tracker
from puppetline.errors import SourceError, heading

log = logging.getLogger(__name__)


def open_source(uri: str, rest: str, folder: Path) -> SensorSource:
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
    selection = depth_camera.parse(uri, rest, ("serial", "uri"))
    openni_library.load_openni2(uri)
    measures = selection.face or selection.hands  # which NiTE2 cannot
    if selection.recorded:
        check_plays(uri, folder / selection.value)
    elif library_path() is None:
        load_mediapipe()
    open_tracker = None if selection.recorded or measures else _open_tracker
    return depth_camera.open_depth_camera(uri, selection, lambda: OpenNIDevice(uri, selection, folder), open_tracker)


class OpenNIDevice(DepthCamera):
    """A sensor or a recording.

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
        super().__init__(name, selection)
        self._oni = openni_library.load_openni2(name)
        self._streams: dict[Kind, Any] = {}
        self._left: dict[Kind, int] = {}  # number of frames left in each stream of a recording that ends
        with openni_library.exclusive(name), self._errors():
            self._device = self._open(selection, folder)
            try:
                info = self._device.device_info
                self.name = openni_library.device_name(info)
                self._device_uri = info.uri.decode(errors="replace")
                self._prepare()
            except BaseException:
                self.close()
                raise

    def nite(self) -> NiTE:
        """Return NiTE2 as a tracker, to be closed before the sensor; raise SourceError if it does not start."""
        with openni_library.exclusive(self._uri):
            return NiTE(self._device._handle, self._mirrored.get("depth", False))

    def close(self) -> None:
        """Stop and release the sensor; closing again does nothing."""
        for handle in (*self._streams.values(), self._device):
            with suppress(self._oni.OpenNIError):
                handle.close()

    def _open(self, selection: Selection, folder: Path) -> Any:
        if selection.recorded:
            check_intact(self._uri, folder / selection.value)
            return openni_library.open_device(self._oni, os.fsencode(folder / selection.value))
        plugged = openni_library.sensor_uris(self._oni)
        if selection.kind == "serial":
            for uri in plugged:
                with suppress(self._oni.OpenNIError):
                    device = openni_library.open_device(self._oni, uri.encode())
                    if openni_library.serial_number(device) == selection.value:
                        return device
                    device.close()
        elif plugged and selection.kind == "any":
            return openni_library.open_device(self._oni, plugged[0].encode())
        elif selection.value in plugged:
            return openni_library.open_device(self._oni, selection.value.encode())
        raise depth_camera.not_plugged_in(self._uri, selection, plugged)

    def _prepare(self) -> None:
        """Create the streams of the device, configure and start them."""
        oni, device = self._oni, self._device
        sensors: dict[Kind, Any] = {"depth": oni.SENSOR_DEPTH, "color": oni.SENSOR_COLOR}
        self._streams = {
            kind: device.create_stream(sensor) for kind, sensor in sensors.items() if device.has_sensor(sensor)
        }
        self._kinds = tuple(self._streams)
        formats: dict[Kind, Any] = {"depth": oni.PIXEL_FORMAT_DEPTH_1_MM, "color": oni.PIXEL_FORMAT_RGB888}
        if self._recorded:
            device.playback.set_speed(-1.0)
            device.playback.set_repeat_enabled(True)  # without it, closing at the end can crash
            if not self._loop:
                self._left = {kind: stream.get_number_of_frames() for kind, stream in self._streams.items()}
        else:
            self._choose_mode(formats)
        modes = {kind: stream.video_mode for kind, stream in self._streams.items()}
        sizes = {(mode.resolutionX, mode.resolutionY) for mode in modes.values()}
        if len(sizes) != 1 or any(mode.pixelFormat != formats[kind] for kind, mode in modes.items()):
            found = f"images of {', '.join(f'{width}×{height}' for width, height in sorted(sizes)) or 'no kind'}"
            raise self._unusable_images(found, "depth in millimetres and colours as RGB, of one size")
        self._mirrored = {kind: self._is_mirrored(stream) for kind, stream in self._streams.items()}
        if len(self._streams) == 2:
            self._log_registration() if self._recorded else self._register()
        self._lens = self._lens_of(self._streams[self._kinds[-1]])
        for stream in self._streams.values():
            stream.start()

    def _choose_mode(self, formats: dict[Kind, Any]) -> None:
        """Set all streams to one mode."""
        best = depth_camera.best_mode(
            {
                (mode.resolutionX, mode.resolutionY, mode.fps)
                for mode in stream.get_sensor_info().videoModes
                if mode.pixelFormat == formats[kind]
            }
            for kind, stream in self._streams.items()
        )
        if best:
            for kind, stream in self._streams.items():
                stream.configure_mode(*best, formats[kind])

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

    def _receive(self, timeout: float) -> bool:
        if self._left and not any(self._left.values()):
            raise self._ended()
        # OpenNI2 hands out the earliest frame: where a recording begins again, its first depth before its last colours
        streams = [stream for kind, stream in self._streams.items() if not (self._recorded and kind in self._waiting)]
        with self._errors():
            ready = self._oni.wait_for_any_stream(streams, timeout)
            if ready is not None:
                [kind] = [kind for kind, stream in self._streams.items() if stream is ready]
                self._read_frame(kind, ready)
        return ready is not None

    def _read_frame(self, kind: Kind, stream: Any) -> None:
        """Read a frame that is available."""
        frame = stream.read_frame()
        if self._left:
            self._left[kind] = stream.get_number_of_frames() - frame.frameIndex
        pixels = self._pixels(kind, frame)
        if pixels is not None:
            self._add(kind, frame.timestamp * 1e-6, pixels)
        frame.close()

    def _pixels(self, kind: Kind, frame: Any) -> NDArray[Any] | None:
        """Return metres or colours of a frame; None if the frame is damaged, as in a recording."""
        dtype = np.dtype(np.uint16 if kind == "depth" else (np.uint8, 3))
        size = frame.height, frame.width
        complete = frame.stride >= frame.width * dtype.itemsize and frame.dataSize >= frame.height * frame.stride
        if size != (self._lens.height, self._lens.width) or not complete:
            return None
        rows = np.ctypeslib.as_array((ctypes.c_uint8 * frame.dataSize).from_address(frame.data))
        pixels: NDArray[Any] = np.ndarray(size, dtype, rows, strides=(frame.stride, dtype.itemsize))
        pixels = pixels[:, ::-1] if self._mirrored[kind] else pixels
        return depth_camera.metres(pixels) if kind == "depth" else pixels.copy()

    def _is_plugged(self) -> bool:
        return self._device_uri in openni_library.sensor_uris(self._oni)

    @contextmanager
    def _errors(self) -> Iterator[None]:
        """Turn the library's errors into source errors."""
        try:
            yield
        except self._oni.OpenNIError as error:
            raise self._failure(error) from error

    def _failure(self, error: Exception) -> SourceError:
        reason = openni_library.error_reason(error)
        if self._recorded:
            return depth_camera.unplayable(self._uri, "OpenNI2", reason, ".oni")
        return openni_library.unusable(self._uri, openni_library.sensor_uris(self._oni), reason)


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
