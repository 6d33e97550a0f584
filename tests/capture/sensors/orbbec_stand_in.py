"""A stand-in for Orbbec's SDK, which has no virtual device: the calls that `capture.sensors.orbbec` makes, and no more.

Depth is aligned already, in units of 0.25 mm if `scale` says so. Its names and return values are those of pyorbbecsdk2.
"""

import queue
from enum import Enum, IntEnum
from pathlib import Path
from types import SimpleNamespace

import numpy as np

OBFormat = Enum("OBFormat", "RGB Y16 MJPG GRAY")
OBSensorType = Enum("OBSensorType", "DEPTH_SENSOR COLOR_SENSOR ACCEL_SENSOR")
OBStreamType = Enum("OBStreamType", "COLOR_STREAM")
OBFrameAggregateOutputMode = Enum("OBFrameAggregateOutputMode", "ANY_SITUATION")
OBPlaybackStatus = Enum("OBPlaybackStatus", "PLAYING STOPPED")
OBLogLevel = IntEnum("OBLogLevel", "NONE")
OBConvertFormat = Enum("OBConvertFormat", "MJPG_TO_RGB888")
PLUGGED = []


class OBError(Exception):
    pass


class _Getters:
    """An object of the SDK: a function ``get_NAME`` returns each value."""

    def __init__(self, **values):
        for name, value in values.items():
            setattr(self, f"get_{name}", lambda value=value: value)

    def itself(self):
        return self

    as_frame_set = as_video_stream_profile = as_accel_frame = itself


class _List(list):
    def get_count(self):
        return len(self)

    get_device_by_index = get_stream_profile_by_index = list.__getitem__


class Context:
    set_logger_level = staticmethod(lambda _level: None)

    def query_devices(self):
        return _List(PLUGGED)


def _frame(pixels, moment, form, scale=1.0):
    height, width = pixels.shape[:2]
    data, time = pixels.reshape(-1).view(np.uint8), round(1e6 * moment)
    return _Getters(data=data, height=height, width=width, timestamp_us=time, depth_scale=scale, format=form)


def _profile(width, height, fps, form):
    lens = SimpleNamespace(width=640, height=480, fx=600.0, fy=600.0, cx=310.5, cy=250.5)
    profile = _Getters(width=width, height=height, fps=fps, format=form, intrinsic=lens)
    profile.get_extrinsic_to = lambda _profile: SimpleNamespace(rot=np.eye(3, dtype=np.float32))
    return profile


class _Accelerometer:
    def get_stream_profile_list(self):
        return _List([_profile(0, 0, 0, None)])

    def start(self, _profile, callback):
        callback(_Getters(x=0.0, y=-9.81, z=0.0))

    def stop(self):
        pass


class StandInSensor:
    """A sensor whose images a test shows."""

    def __init__(self, serial, usb="USB3.2", scale=0.25):
        self.serial, self._usb, self._scale, self.forbids = serial, usb, scale, False
        self.frames, self.streaming = queue.SimpleQueue(), False

    def get_device_info(self):
        name = f"Stand-in for an Orbbec {self.serial}"
        return _Getters(name=name, serial_number=self.serial, connection_type=self._usb)

    def get_sensor(self, _kind):
        return _Accelerometer()

    def show(self, depth, color, moment):
        """Deliver metres and RGB, or None, at a time of the sensor's clock, in seconds."""
        if depth is not None:
            depth = _frame(np.rint(1000 / self._scale * depth).astype(np.uint16), moment, OBFormat.Y16, self._scale)
        if color is not None:
            color = _frame(color, moment, OBFormat.RGB)
        self.frames.put(_Getters(depth_frame=depth, color_frame=color))


class PlaybackDevice(StandInSensor):
    """Plays the frames in `RECORDING`."""

    RECORDING = ()

    def __init__(self, file):
        if not file.endswith("take.bag"):
            raise RuntimeError(f"Error opening file: {file}")
        super().__init__("recorded")
        for images in self.RECORDING:
            self.show(*images)

    def get_playback_status(self):
        return OBPlaybackStatus.STOPPED if self.frames.empty() else OBPlaybackStatus.PLAYING


class RecordDevice:
    """Writes a file that `PlaybackDevice` accepts."""

    def __init__(self, _device, file):
        Path(file).write_bytes(b"images")


class Config:
    def enable_stream(self, profile):
        assert profile.get_width() == 640

    def set_frame_aggregate_output_mode(self, _mode):
        pass


class Pipeline:
    def __init__(self, device):
        self._device = device

    def get_stream_profile_list(self, sensor):
        form = OBFormat.Y16 if sensor is OBSensorType.DEPTH_SENSOR else OBFormat.RGB
        modes = (640, 480, 30), (1280, 720, 30), (640, 480, 5)
        return _List([*(_profile(*mode, form) for mode in modes), _profile(640, 480, 30, OBFormat.MJPG)])

    def enable_frame_sync(self):
        pass

    def start(self, _config):
        if self._device.streaming or self._device.forbids:
            raise OBError("the device is in use" if self._device.streaming else "openUsbDevice failed: Access denied")
        self._device.streaming = True

    def stop(self):
        self._device.streaming = False

    def wait_for_frames(self, milliseconds):
        try:
            return self._device.frames.get(timeout=milliseconds / 1000)
        except queue.Empty:
            return None


class AlignFilter:
    def __init__(self, align_to_stream):
        pass

    def process(self, frames):
        return frames
