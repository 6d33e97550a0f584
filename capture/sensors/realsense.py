"""Intel RealSense through librealsense: the sources ``realsense:``, ``realsense:serial=…`` and ``realsense:take.db3``.

Recordings (``.db3`` and ``.bag``) play with ``&fast`` as fast as tracking allows, with ``?loop`` in a loop. Exposure
and laser stay as they are unless the URI sets them: ``realsense:?exposure=8000&laser=150``.
"""

from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from capture.libraries import load_module
from capture.sensors import depth_camera
from capture.sensors.depth_camera import DepthCamera, Kind, Mode, Selection, parse
from capture.sensors.source import SensorSource
from capture.trackers.picture import Lens
from puppetline.errors import SourceError

SETTINGS = {"exposure": "microseconds", "laser": "milliwatts"}
"""Units of the settings that a URI may have."""


def open_source(uri: str, rest: str, folder: Path, record: Path | None = None) -> SensorSource:
    """Open a sensor or a recording with MediaPipe as its tracker.

    Parameters
    ----------
    uri, rest : str
        The whole URI, and the part after its scheme.
    folder : Path
        Folder to which paths are relative.
    record : Path, optional
        File ``.db3`` to which a sensor's images are recorded.

    Raises
    ------
    SourceError
        The URI is wrong, a library is missing, or the recording does not play. The source itself raises the errors of a
        sensor.
    """
    selection = parse(uri, rest, settings=SETTINGS)
    load_realsense(uri)
    return depth_camera.open_depth_camera(uri, selection, lambda: RealSenseDevice(uri, selection, folder, record))


def load_realsense(where: str) -> Any:
    """Return the library; raise SourceError about `where` if it is not installed or does not load."""
    return load_module(
        "pyrealsense2",
        where,
        found="no RealSense library",
        expected="the Python package pyrealsense2",
        fix="Install it: pip install 'puppetline[realsense]'",
    )


def plugged_in(rs: Any) -> list[Any]:
    """Return the sensors that are plugged in, as devices of the library."""
    return list(rs.context().query_devices())


def information(rs: Any, device: Any, name: str) -> str:
    """Return what a device states about itself, such as ``serial_number``; empty if nothing."""
    key = getattr(rs.camera_info, name)
    return str(device.get_info(key)) if device.supports(key) else ""


class RealSenseDevice(DepthCamera):
    """A sensor or a recording, with depth aligned to colour by the library. A recording is read as fast as possible.

    Parameters
    ----------
    uri : str
        URI of the source.
    selection : Selection
    folder : Path
        Folder to which paths are relative.
    record : Path, optional
        File ``.db3`` to which the sensor's images are recorded.

    Raises
    ------
    SourceError
        No such sensor is plugged in, it is in use or may not be opened, or the file is not a recording.
    """

    def __init__(self, uri: str, selection: Selection, folder: Path = Path(), record: Path | None = None) -> None:
        super().__init__(uri, selection, record)
        self._rs = load_realsense(uri)
        self._started = False
        self._pipeline, self._config = self._rs.pipeline(), self._rs.config()
        self._profile: Any = None
        try:
            self._start(selection, folder)
        except RuntimeError as error:
            self.close()
            raise self._failure(error) from error
        except SourceError:
            self.close()
            raise

    def close(self) -> None:
        """Stop and release the sensor; closing again does nothing."""
        if self._started:
            self._started = False
            with suppress(RuntimeError):  # it may be unplugged
                self._pipeline.stop()
        # the library finishes a recording, and closes a file, when nothing refers to it
        self._pipeline = self._config = self._profile = None
        self._keep_recording()

    def _start(self, selection: Selection, folder: Path) -> None:
        rs = self._rs
        if selection.recorded:
            self._config.enable_device_from_file(str(folder / selection.value), selection.loop)
            device = self._config.resolve(rs.pipeline_wrapper(self._pipeline)).get_device()
            device.as_playback().set_real_time(False)
            device.as_playback().pause()  # otherwise it plays before all streams have started
        else:
            devices = {information(rs, each, "serial_number"): each for each in plugged_in(rs)}
            device = self._choose(devices, lambda each: information(rs, each, "usb_type_descriptor"))
            self._pipeline.set_device(device)
            self._enable(device)
            if self._partial is not None:
                self._config.enable_record_to_file(str(self._partial))
        self.name = information(rs, device, "name")
        self._serial = information(rs, device, "serial_number")
        for name, value in selection.settings.items():
            self._set(device, name, value)
        self._profile = self._pipeline.start(self._config)
        self._started = True
        if selection.recorded:
            self._profile.get_device().as_playback().resume()
        self._examine()

    def _enable(self, device: Any) -> None:
        """Enable depth and colour in one mode, and the accelerometer if there is one."""
        rs = self._rs
        profiles = [profile for sensor in device.query_sensors() for profile in sensor.get_stream_profiles()]
        formats = {rs.stream.depth: rs.format.z16, rs.stream.color: rs.format.rgb8}
        modes: dict[Any, list[Mode]] = {}
        for video in (each.as_video_stream_profile() for each in profiles if each.is_video_stream_profile()):
            if formats.get(video.stream_type()) == video.format():
                modes.setdefault(video.stream_type(), []).append((video.width(), video.height(), video.fps()))
        best = depth_camera.best_mode(modes.values())
        if best is not None:
            for stream in modes:
                self._config.enable_stream(stream, *best[:2], formats[stream], best[2])
        if any(profile.stream_type() == rs.stream.accel for profile in profiles):
            self._config.enable_stream(rs.stream.accel)

    def _set(self, device: Any, name: str, value: float) -> None:
        option = {"exposure": self._rs.option.exposure, "laser": self._rs.option.laser_power}[name]
        for sensor in device.query_sensors():
            if sensor.supports(option):
                sensor.set_option(option, value)
                return
        raise SourceError(
            self._uri, found=f"no {name} that {self.name} can change", expected="another setting", fix="Remove it."
        )

    def _examine(self) -> None:
        """Find streams, lens and axes of what was started."""
        rs = self._rs
        streams = {profile.stream_type(): profile for profile in self._profile.get_streams()}
        kinds: dict[Kind, Any] = {"depth": rs.stream.depth, "color": rs.stream.color}
        self._kinds = tuple(kind for kind, stream in kinds.items() if stream in streams)
        seen = streams.get(rs.stream.color) or streams.get(rs.stream.depth)
        if seen is None:
            raise self._unusable_images("neither depth nor colour", "a sensor or recording with images")
        view = seen.as_video_stream_profile().intrinsics
        # the library's pixels have their centres, and not their corners, at whole numbers
        offset = view.ppx + 0.5 - view.width / 2, view.ppy + 0.5 - view.height / 2
        self._lens = Lens(view.width, view.height, (view.fx + view.fy) / 2, offset)
        both = len(self._kinds) == 2
        # aligning would displace pixels of images that are aligned already, by rounding
        self._align = rs.align(rs.stream.color) if both and _differ(streams[rs.stream.depth], seen) else None
        self._to_image = np.eye(3)
        if rs.stream.accel in streams:
            with suppress(RuntimeError):  # some recordings do not have it; RealSense's axes are about the same
                columns = streams[rs.stream.accel].get_extrinsics_to(seen).rotation
                self._to_image = np.array(columns).reshape(3, 3).T

    def _receive(self, timeout: float) -> bool:
        over = self._recorded and not self._loop and self._at_end()  # before waiting: the last frames may still come
        try:
            there, frames = self._pipeline.try_wait_for_frames(max(1, round(1000 * timeout)))
            if there:
                self._add_frames(frames)
        except RuntimeError as error:
            raise self._failure(error) from error
        if over and not there:
            raise self._ended()
        return bool(there)

    def _add_frames(self, frames: Any) -> None:
        for frame in frames:
            if frame.is_motion_frame():
                force = frame.as_motion_frame().get_motion_data()
                self._up = depth_camera.upward((force.x, force.y, force.z), self._to_image)
        depth, color = frames.get_depth_frame(), frames.get_color_frame()
        # a frame is repeated if none of its stream arrived with the other's, so its own time counts
        if depth:
            aligned = cache(partial(self._aligned, frames))  # which takes time, while a tracker looks at the colours
            self._add("depth", depth.timestamp / 1000, aligned if self._align and color else aligned())
        if color:
            self._add("color", color.timestamp / 1000, np.array(color.get_data()))

    def _aligned(self, frames: Any) -> NDArray[np.float32]:
        """Return the depth of frames in metres, aligned to colour."""
        try:
            depth = (frames if self._align is None else self._align.process(frames)).get_depth_frame()
        except RuntimeError as error:
            found = f"images of {self.name} that librealsense could not align ({error})"
            fix = "Unplug the sensor and plug it in again."
            raise self._unusable_images(found, "depth that can be aligned to colour", fix) from error
        return depth_camera.metres(np.asanyarray(depth.get_data()), depth.get_units())

    def _at_end(self) -> bool:
        playback = self._profile.get_device().as_playback()
        return bool(playback.current_status() == self._rs.playback_status.stopped)

    def _is_plugged(self) -> bool:
        return self._serial in [information(self._rs, device, "serial_number") for device in plugged_in(self._rs)]

    def _failure(self, error: Exception) -> SourceError:
        reason = str(error).rpartition("Reason: ")[2].strip()
        if self._recorded:
            return depth_camera.unplayable(self._uri, "librealsense", reason, ".db3 or .bag")
        if any(sign in reason for sign in ("ermission", "ACCES")):  # RS2_USB_STATUS_ACCESS too
            return SourceError(
                self._uri,
                found=f"no permission to open the RealSense ({reason})",
                expected="a udev rule that grants it",
                fix='Write SUBSYSTEM=="usb", ATTRS{idVendor}=="8086", MODE="0666" into '
                "/etc/udev/rules.d/99-realsense.rules, call udevadm control --reload, and plug it in again.",
            )
        return SourceError(
            self._uri,
            found=f"a RealSense that cannot be used ({reason})",
            expected="a sensor that no other program uses",
            fix="Close other programs that may use it, or unplug it and plug it in again.",
        )


def _differ(depth: Any, color: Any) -> bool:
    """Return whether two streams have different lenses or places."""
    lenses = [str(each.as_video_stream_profile().intrinsics) for each in (depth, color)]
    place = depth.get_extrinsics_to(color)
    return lenses[0] != lenses[1] or any(place.translation) or place.rotation != [1, 0, 0, 0, 1, 0, 0, 0, 1]
