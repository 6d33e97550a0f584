"""A stand-in for Orbbec's SDK, which has no virtual device: the calls that `capture.sensors.orbbec` makes, and no more.

Depth is aligned already, in units of 0.25 mm if `scale` says so. Its names and return values are those of pyorbbecsdk2.
"""

import queue
from enum import Enum, IntEnum
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


class _List(list):
    def get_count(self):
        return len(self)

    def get_device_by_index(self, index):
        return self[index]

    get_stream_profile_by_index = get_device_by_index


class Context:
    set_logger_level = staticmethod(lambda _level: None)

    def query_devices(self):
        return _List(PLUGGED)


class _Frame:
    def __init__(self, pixels, moment, form, scale=1.0):
        self._pixels, self._moment, self._format, self._scale = pixels, moment, form, scale

    def get_data(self):
        return self._pixels.reshape(-1).view(np.uint8)

    def get_height(self):
        return self._pixels.shape[0]

    def get_width(self):
        return self._pixels.shape[1]

    def get_timestamp_us(self):
        return round(1e6 * self._moment)

    def get_depth_scale(self):
        return self._scale

    def get_format(self):
        return self._format


class _Frames:
    def __init__(self, depth, color):
        self._depth, self._color = depth, color

    def get_depth_frame(self):
        return self._depth

    def get_color_frame(self):
        return self._color

    def as_frame_set(self):
        return self


class _Profile:
    def __init__(self, width, height, fps, form):
        self._values = width, height, fps, form

    def as_video_stream_profile(self):
        return self

    def get_width(self):
        return self._values[0]

    def get_height(self):
        return self._values[1]

    def get_fps(self):
        return self._values[2]

    def get_format(self):
        return self._values[3]

    def get_intrinsic(self):
        return SimpleNamespace(width=640, height=480, fx=600.0, fy=600.0, cx=310.5, cy=250.5)

    def get_extrinsic_to(self, _profile):
        return SimpleNamespace(rot=np.eye(3, dtype=np.float32))


class _Accelerometer:
    def get_stream_profile_list(self):
        return _List([_Profile(0, 0, 0, None)])

    def start(self, _profile, callback):
        still = SimpleNamespace(get_x=lambda: 0.0, get_y=lambda: -9.81, get_z=lambda: 0.0)
        callback(SimpleNamespace(as_accel_frame=lambda: still))

    def stop(self):
        pass


class StandInSensor:
    """A sensor whose images a test shows."""

    def __init__(self, serial, usb="USB3.2", scale=0.25):
        self.serial, self._usb, self._scale = serial, usb, scale
        self.frames, self.streaming = queue.SimpleQueue(), False

    def get_device_info(self):
        name = f"Stand-in for an Orbbec {self.serial}"
        return SimpleNamespace(
            get_name=lambda: name, get_serial_number=lambda: self.serial, get_connection_type=lambda: self._usb
        )

    def get_sensor(self, _kind):
        return _Accelerometer()

    def show(self, depth, color, moment):
        """Deliver metres and RGB, or None, at a time of the sensor's clock, in seconds."""
        if depth is not None:
            depth = _Frame(np.rint(1000 / self._scale * depth).astype(np.uint16), moment, OBFormat.Y16, self._scale)
        if color is not None:
            color = _Frame(color, moment, OBFormat.RGB)
        self.frames.put(_Frames(depth, color))


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
        return _List([*(_Profile(*mode, form) for mode in modes), _Profile(640, 480, 30, OBFormat.MJPG)])

    def enable_frame_sync(self):
        pass

    def start(self, _config):
        if self._device.streaming:
            raise OBError("the device is in use")
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
