"""Orbbec sensors (Femto, Gemini, Astra 2) through Orbbec's SDK: ``orbbec:``, ``orbbec:serial=…``, ``orbbec:take.bag``.

The SDK's own recordings play with ``&fast`` as fast as tracking allows, with ``?loop`` in a loop.
"""

from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from capture.libraries import load_module
from capture.sensors import depth_camera
from capture.sensors.depth_camera import DepthCamera, Selection
from capture.sensors.source import SensorSource
from capture.trackers.picture import Lens
from puppetline.errors import SourceError

INSTALL_FIX = "Install it: pip install --no-deps pyorbbecsdk2"
"""What to do if the SDK is missing; it also works without its dependencies of 2 GB, which only its examples use."""


def open_source(uri: str, rest: str, folder: Path, record: Path | None = None) -> SensorSource:
    """Open a sensor or a recording with MediaPipe as its tracker.

    Parameters
    ----------
    uri, rest : str
        The whole URI, and the part after its scheme.
    folder : Path
        Folder to which paths are relative.
    record : Path, optional
        File ``.bag`` to which a sensor's images are recorded.

    Raises
    ------
    SourceError
        The URI is wrong, a library is missing, or the recording does not play. The source itself raises the errors of a
        sensor.
    """
    selection = depth_camera.parse(uri, rest)
    load_orbbec(uri)
    return depth_camera.open_depth_camera(uri, selection, lambda: OrbbecDevice(uri, selection, folder, record))


def load_orbbec(where: str) -> Any:
    """Return the SDK, which then logs nothing to files; raise SourceError about `where` if it does not load."""
    package = "the Python package pyorbbecsdk2"
    pyorbbecsdk = load_module("pyorbbecsdk", where, found="no Orbbec SDK", expected=package, fix=INSTALL_FIX)
    pyorbbecsdk.Context.set_logger_level(pyorbbecsdk.OBLogLevel.NONE)
    return pyorbbecsdk


def plugged_in(ob: Any) -> list[Any]:
    """Return the sensors that are plugged in, as devices of the SDK."""
    found = ob.Context().query_devices()
    return [found.get_device_by_index(k) for k in range(found.get_count())]


class OrbbecDevice(DepthCamera):
    """A sensor or a recording, with depth aligned to colour by the SDK.

    Parameters
    ----------
    uri : str
        URI of the source.
    selection : Selection
    folder : Path
        Folder to which paths are relative.
    record : Path, optional
        File ``.bag`` to which the sensor's images are recorded.

    Raises
    ------
    SourceError
        No such sensor is plugged in, it is in use or may not be opened, or the file is not a recording.
    """

    def __init__(self, uri: str, selection: Selection, folder: Path = Path(), record: Path | None = None) -> None:
        super().__init__(uri, selection, record)
        self._folder = folder
        self._ob = load_orbbec(uri)
        self._pipeline: Any = None
        self._recorder: Any = None
        self._device: Any = None
        self._accelerometer: Any = None
        try:
            self._start(selection, folder)
        except (RuntimeError, self._ob.OBError) as error:
            self.close()
            raise self._failure(error) from error
        except SourceError:
            self.close()
            raise

    def close(self) -> None:
        """Stop and release the sensor; closing again does nothing."""
        for each in (self._accelerometer, self._pipeline):
            if each is not None:
                with suppress(RuntimeError, self._ob.OBError):
                    each.stop()
        # the SDK finishes a recording when nothing refers to its recorder
        self._accelerometer = self._pipeline = self._recorder = self._device = None
        self._keep_recording()

    def _start(self, selection: Selection, folder: Path) -> None:
        ob = self._ob
        if selection.recorded:
            self._device = ob.PlaybackDevice(str(folder / selection.value))
        else:
            devices = {each.get_device_info().get_serial_number(): each for each in plugged_in(ob)}
            self._device = self._choose(devices, lambda each: str(each.get_device_info().get_connection_type()))
        if self._partial is not None:
            self._recorder = ob.RecordDevice(self._device, str(self._partial))
        about = self._device.get_device_info()
        self.name, self._serial = about.get_name(), about.get_serial_number()
        pipeline, config = ob.Pipeline(self._device), ob.Config()
        profile = self._enable(pipeline, config)
        config.set_frame_aggregate_output_mode(ob.OBFrameAggregateOutputMode.ANY_SITUATION)
        pipeline.enable_frame_sync()
        pipeline.start(config)
        self._pipeline = pipeline
        view = profile.get_intrinsic()
        offset = view.cx + 0.5 - view.width / 2, view.cy + 0.5 - view.height / 2
        self._lens = Lens(view.width, view.height, (view.fx + view.fy) / 2, offset)
        self._align = ob.AlignFilter(align_to_stream=ob.OBStreamType.COLOR_STREAM)
        with suppress(RuntimeError, ob.OBError):  # most sensors, and some recordings, have no accelerometer
            self._start_accelerometer(profile)

    def _enable(self, pipeline: Any, config: Any) -> Any:
        """Enable depth and colour in the modes closest to 640×480; return the profile of colour."""
        ob = self._ob
        chosen = None
        for sensor, form in ((ob.OBSensorType.DEPTH_SENSOR, ob.OBFormat.Y16), (ob.OBSensorType.COLOR_SENSOR, None)):
            found = pipeline.get_stream_profile_list(sensor)
            every = [found.get_stream_profile_by_index(k).as_video_stream_profile() for k in range(found.get_count())]
            wanted = form if self._recorded or form else ob.OBFormat.RGB
            some = {(p.get_width(), p.get_height(), p.get_fps()): p for p in every if wanted in (None, p.get_format())}
            best = depth_camera.best_mode([some])
            if best is None:
                found = f"{self.name} without {'depth' if form else 'colour'}"
                raise self._unusable_images(found, "a sensor or recording with depth and colour")
            chosen = some[best]
            config.enable_stream(chosen)
        return chosen

    def _start_accelerometer(self, color: Any) -> None:
        sensor = self._device.get_sensor(self._ob.OBSensorType.ACCEL_SENSOR)
        profile = sensor.get_stream_profile_list().get_stream_profile_by_index(0)
        to_image = np.array(profile.get_extrinsic_to(color).rot, np.float64).reshape(3, 3)

        def measured(frame: Any) -> None:
            force = frame.as_accel_frame()
            self._up = depth_camera.upward((force.get_x(), force.get_y(), force.get_z()), to_image)

        sensor.start(profile, measured)
        self._accelerometer = sensor

    def _receive(self, timeout: float) -> bool:
        stopped = self._ob.OBPlaybackStatus.STOPPED
        over = self._recorded and self._device.get_playback_status() == stopped  # the last frames may still come
        try:
            frames = self._pipeline.wait_for_frames(max(1, round(1000 * timeout)))
            if frames is not None:
                self._add_frames(frames)
        except (RuntimeError, self._ob.OBError) as error:
            raise self._failure(error) from error
        if over and frames is None:
            if not self._loop:
                raise self._ended()
            self.close()
            self._start(self._selection, self._folder)
        return frames is not None

    def _add_frames(self, frames: Any) -> None:
        if frames.get_depth_frame() is not None and frames.get_color_frame() is not None:
            frames = self._align.process(frames).as_frame_set()
        depth, color = frames.get_depth_frame(), frames.get_color_frame()
        if depth is not None:
            raw = np.frombuffer(depth.get_data(), np.uint16).reshape(depth.get_height(), depth.get_width())
            measured = depth_camera.metres(raw, depth.get_depth_scale() / 1000)
            self._add("depth", depth.get_timestamp_us() * 1e-6, measured)
        if color is not None:
            color = self._rgb(color)
            pixels = np.frombuffer(color.get_data(), np.uint8).reshape(color.get_height(), color.get_width(), 3)
            self._add("color", color.get_timestamp_us() * 1e-6, pixels.copy())

    def _rgb(self, color: Any) -> Any:
        """Return a frame as RGB; recordings have the format of the sensor."""
        ob, form = self._ob, color.get_format()
        if form == ob.OBFormat.RGB:
            return color
        kind = getattr(ob.OBConvertFormat, f"{form.name}_TO_RGB888", None)
        if kind is None:
            raise depth_camera.unplayable(self._uri, "Orbbec's SDK", f"colours as {form.name}", ".bag")
        convert = ob.FormatConvertFilter()
        convert.set_format_convert_format(kind)
        return convert.process(color).as_video_frame()

    def _is_plugged(self) -> bool:
        serials = [device.get_device_info().get_serial_number() for device in plugged_in(self._ob)]
        return self._serial in serials

    def _failure(self, error: Exception) -> SourceError:
        if self._recorded:
            return depth_camera.unplayable(self._uri, "Orbbec's SDK", str(error), ".bag")
        return SourceError(
            self._uri,
            found=f"an Orbbec sensor that cannot be used ({error})",
            expected="a sensor that this user may open and that no other program uses",
            fix="Close other programs, install the SDK's udev rules (99-obsensor-libusb.rules), and plug it in again.",
        )
