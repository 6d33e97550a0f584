"""A RealSense made of librealsense's own software device: depth, colour and an accelerometer."""

import numpy as np
import pyrealsense2 as rs

WIDTH, HEIGHT = 640, 480
BASELINE_METRES = 0.05
DEPTH_FOCAL, COLOR_FOCAL, COLOR_CENTER = 500.0, 600.0, (310.5, 250.5)


class VirtualRealSense:
    """A device whose images a test pushes; depth is already registered unless `apart`."""

    def __init__(self, serial, usb="3.2", apart=False, focal=COLOR_FOCAL, center=COLOR_CENTER):
        self.serial, self.number = serial, 0
        self.device = rs.software_device()
        for key, value in {
            "serial_number": serial,
            "name": f"Virtual RealSense {serial}",
            "usb_type_descriptor": usb,
            "firmware_version": "5.16.0.1",
        }.items():
            self.device.register_info(getattr(rs.camera_info, key), value)
        self._sensors = [self.device.add_sensor(name) for name in ("Stereo", "RGB", "Motion")]
        depth_lens = (DEPTH_FOCAL, (319.5, 239.5)) if apart else (focal, center)
        self._depth = self._video(0, rs.stream.depth, rs.format.z16, 2, *depth_lens)
        self._color = self._video(1, rs.stream.color, rs.format.rgb8, 3, focal, center)
        self._sensors[0].add_read_only_option(rs.option.depth_units, 0.001)
        power = rs.option_range()
        power.min, power.max, power.step, power.default = 0.0, 360.0, 30.0, 150.0
        self._sensors[0].add_option(rs.option.laser_power, power, True)
        motion = rs.motion_stream()
        motion.type, motion.index, motion.uid, motion.fps = rs.stream.accel, 0, 2, 200
        motion.fmt, motion.intrinsics = rs.format.motion_xyz32f, rs.motion_device_intrinsic()
        self._accel = self._sensors[2].add_motion_stream(motion)
        place = rs.extrinsics()
        place.rotation, place.translation = [1, 0, 0, 0, 1, 0, 0, 0, 1], [BASELINE_METRES * apart, 0, 0]
        self._depth.register_extrinsics_to(self._color, place)
        self._accel.register_extrinsics_to(self._color, place)
        self.device.create_matcher(rs.matchers.default)

    @property
    def laser(self):
        """Power of the laser, in millipower."""
        return self._sensors[0].get_option(rs.option.laser_power)

    def _video(self, uid, kind, form, size, focal, center):
        lens, stream = rs.intrinsics(), rs.video_stream()
        lens.width, lens.height, lens.fx, lens.fy, (lens.ppx, lens.ppy) = WIDTH, HEIGHT, focal, focal, center
        lens.model, lens.coeffs = rs.distortion.none, [0] * 5
        stream.type, stream.index, stream.uid, stream.width, stream.height = kind, 0, uid, WIDTH, HEIGHT
        stream.fps, stream.bpp, stream.fmt, stream.intrinsics = 30, size, form, lens
        return self._sensors[uid].add_video_stream(stream)

    def show(self, depth, color, moment, up=(0.0, -9.81, 0.0)):
        """Push metres, RGB (None for none of them) and an acceleration at a time of the sensor's clock, in seconds."""
        self.number += 1
        force = rs.vector()
        force.x, force.y, force.z = up
        frame = self._dated(rs.software_motion_frame(), self._accel.as_motion_stream_profile(), moment)
        frame.data = force
        self._sensors[2].on_motion_frame(frame)
        if depth is not None:
            self._push(0, self._depth, np.rint(1000 * depth).astype(np.uint16), 2, moment)
        if color is not None:
            self._push(1, self._color, np.ascontiguousarray(color), 3, moment)

    def _push(self, sensor, stream, pixels, size, moment):
        frame = self._dated(rs.software_video_frame(), stream.as_video_stream_profile(), moment)
        frame.pixels, frame.stride, frame.bpp = pixels, WIDTH * size, size
        if size == 2:
            frame.depth_units = 0.001
        self._sensors[sensor].on_video_frame(frame)

    def _dated(self, frame, profile, moment):
        frame.timestamp, frame.domain = 1000 * moment, rs.timestamp_domain.hardware_clock
        frame.frame_number, frame.profile = self.number, profile
        return frame
