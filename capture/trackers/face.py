"""Channels of a face from the 468 landmarks of MediaPipe's face mesh.

Distances are between landmarks in three dimensions, so that turning the head changes them little:

- The eye aspect ratio (Soukupová and Čech, *Real-Time Eye Blink Detection using Facial Landmarks*, 2016) is
  (‖p2 − p6‖ + ‖p3 − p5‖) / (2 ‖p1 − p4‖), with corners p1, p4 and lids p2, p3, p5, p6.
- The opening of the mouth is the mean distance of three pairs of the inner lips, its width that of its corners, and the
  height of the brows that above the inner corners of the eyes. All three are divided by the distance of the eyes' outer
  corners. A smile is how far the corners of the mouth rise above the middle of its upper lip, divided likewise.

The channels are differences from the neutral face, which is the median of the first second in which the face is seen.

The head turns with the face: its axes are the line through the eyes and temples, and that from chin to forehead.
"""

from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from capture.channels import SmoothedChannels
from capture.libraries import load_module
from capture.sensor_pose import SensorPose
from puppetline.errors import SourceError

FACE_CHANNELS = ("mouth_open", "mouth_wide", "smile", "blink_left", "blink_right", "brow_up")
"""Channels of a face, in the order of every (6,) array."""

NEUTRAL_SECONDS = 1.0
"""Time over which the median is the neutral face, in seconds."""

RANGES = np.array([0.36, 0.08, 0.07, -0.62, -0.62, 0.06])
"""(6,) change from neutral at which each channel is 1; that of an eye is a share of its neutral aspect ratio."""

DEAD_SHARE = 0.15
"""Share of the range around neutral in which a channel is 0: landmarks tremble."""

SMOOTHING_SECONDS = 0.03
"""Time constant of the channels' smoothing, in seconds; a blink takes 0.1 s or more."""

LOST_SECONDS = 0.15
"""Time constant with which channels fall to 0 while the face is not seen, in seconds."""

MAX_TURN = 0.8
"""Sine of the angle between the face and the camera from which landmarks are guesses, about 53°."""

_EYES = ((362, 385, 387, 263, 373, 380), (33, 160, 158, 133, 153, 144))  # the performer's left and right
_LIPS = ((82, 87), (13, 14), (312, 317))
_MOUTH_CORNERS, _UPPER_LIP = (61, 291), 13
_OUTER_CORNERS, _INNER_CORNERS, _BROWS = (33, 263), (133, 362), (105, 334)
_FOREHEAD, _CHIN = 10, 152
_TEMPLES = (127, 356)

MIN_PART_PIXELS = 240
"""Size to which smaller images of heads are enlarged; landmarks in the small ones jump."""

MEAN_COUNT = 150.0
"""Number of images over which the direction from the neck to the head is averaged, about 5 s."""

Floats = NDArray[np.float64]


def measures(landmarks: Floats) -> Floats:
    """Return the measures (6,) of a face, in the order of `FACE_CHANNELS`, from landmarks (468, 3) in any unit."""
    eyes = _distance(landmarks, *_OUTER_CORNERS)
    ratios = [
        (_distance(landmarks, b, f) + _distance(landmarks, c, e)) / (2 * _distance(landmarks, a, d))
        for a, b, c, d, e, f in _EYES
    ]
    up = landmarks[_FOREHEAD] - landmarks[_CHIN]
    up = up / np.linalg.norm(up)
    lift = (landmarks[list(_MOUTH_CORNERS)].mean(axis=0) - landmarks[_UPPER_LIP]) @ up
    brows = (landmarks[list(_BROWS)].mean(axis=0) - landmarks[list(_INNER_CORNERS)].mean(axis=0)) @ up
    opening = np.mean([_distance(landmarks, *pair) for pair in _LIPS])
    width = _distance(landmarks, *_MOUTH_CORNERS)
    return np.array([opening / eyes, width / eyes, lift / eyes, *ratios, brows / eyes])


def turn(landmarks: Floats) -> float:
    """Return the sine of the angle by which a face (468, 3) is turned away from the camera."""
    across = landmarks[_OUTER_CORNERS[1]] - landmarks[_OUTER_CORNERS[0]]
    normal = np.cross(across, landmarks[_CHIN] - landmarks[_FOREHEAD])
    return float(np.hypot(normal[0], normal[1]) / np.linalg.norm(normal))


def axes(landmarks: Floats, ray: Floats) -> Floats:
    """Return the rotation (3, 3) of a head in sensor coordinates; it is the identity if the face looks at the sensor.

    Parameters
    ----------
    landmarks : (468, 3) float64
        Right, down and away in the image, in any unit.
    ray : (3,) float64
        Direction to the head in sensor coordinates; a face that looks straight into the image's middle does not look at
        the sensor if it is at the image's edge.
    """
    points = landmarks * [-1.0, -1.0, 1.0]
    right = points[_OUTER_CORNERS[0]] - points[_OUTER_CORNERS[1]] + points[_TEMPLES[0]] - points[_TEMPLES[1]]
    right /= np.linalg.norm(right)
    back = np.cross(right, points[_FOREHEAD] - points[_CHIN])
    back /= np.linalg.norm(back)
    tilt, aside = np.degrees([-np.arcsin(ray[1] / np.linalg.norm(ray)), np.arctan2(ray[0], ray[2])])
    to_head = SensorPose.of_degrees(float(tilt), float(aside), 0.0, np.zeros(3)).rotation
    return np.asarray(to_head @ np.column_stack([right, np.cross(back, right), back]))


class HeadDirection:
    """Turns the direction from a performer's neck to the head with the face.

    In the axes of the face, that direction is the mean of the directions at which the body's tracker saw the head.
    """

    def __init__(self) -> None:
        self._mean, self._count = np.zeros(3), 0.0

    def turned(self, bone: Floats, face: Floats) -> Floats:
        """Return the bone (3,) from neck to head, with the same length, as the face turns it.

        Parameters
        ----------
        bone : (3,) float64
            The same bone by the body's tracker, metres, sensor coordinates.
        face : (3, 3) float64
            `axes`.
        """
        length = float(np.linalg.norm(bone))
        self._count = min(self._count + 1, MEAN_COUNT)
        self._mean += (bone / length @ face - self._mean) / self._count
        return np.asarray(face @ self._mean * length / np.linalg.norm(self._mean))


class FaceChannels:
    """Turns measures of one performer's face into channels."""

    def __init__(self) -> None:
        self._first: list[Floats] = []
        self._began: float | None = None
        self._neutral: Floats | None = None
        self._channels = SmoothedChannels(FACE_CHANNELS, SMOOTHING_SECONDS, LOST_SECONDS)

    def step(self, time: float, measured: Floats | None) -> dict[str, float]:
        """Return the channels at a time in seconds; empty before the neutral face is known.

        Parameters
        ----------
        time : float
        measured : (6,) float64 or None
            `measures`; None if the face is not seen.
        """
        if measured is not None and self._neutral is None:
            self._began = time if self._began is None else self._began
            self._first.append(measured)
            if time - self._began >= NEUTRAL_SECONDS:
                self._neutral = np.median(self._first, axis=0)
        if self._neutral is None:
            return {}
        if measured is None:
            return self._channels.step(time, None)
        change = measured - self._neutral
        change[3:5] /= self._neutral[3:5]
        return self._channels.step(time, np.clip((change / RANGES - DEAD_SHARE) / (1 - DEAD_SHARE), 0, 1))


class FaceMesh:
    """MediaPipe's face mesh, on the part of an image around a head.

    Raises
    ------
    SourceError
        Its models are missing.
    """

    def __init__(self) -> None:
        self._mesh: Any = open_model("face_mesh", "FaceMesh", max_num_faces=1, refine_landmarks=True)

    def find(self, color: NDArray[np.uint8]) -> Floats | None:
        """Return landmarks (468, 3) in pixels, right, down and away; None without a face that looks at the camera."""
        height, width = color.shape[:2]
        result = self._mesh.process(enlarged(color, MIN_PART_PIXELS))
        if result.multi_face_landmarks is None:
            return None
        points = result.multi_face_landmarks[0].landmark[:468]
        found = np.array([(point.x * width, point.y * height, point.z * width) for point in points])
        upside_down = found[_CHIN, 1] < found[_FOREHEAD, 1]
        return None if upside_down or turn(found) > MAX_TURN else found

    def close(self) -> None:
        """Release MediaPipe."""
        self._mesh.close()


def open_model(module: str, name: str, **options: float) -> Any:
    """Open one of MediaPipe's solutions.

    Raises
    ------
    SourceError
        It or its models cannot be loaded.
    """
    where, found, expected = f"MediaPipe {module}", "a model that cannot be loaded", "MediaPipe 0.10.21 with its models"
    fix = "Install it again: pip install --force-reinstall mediapipe==0.10.21"
    solution = load_module(f"mediapipe.python.solutions.{module}", where, found=found, expected=expected, fix=fix)
    try:
        return getattr(solution, name)(**options)
    except (OSError, RuntimeError, ValueError) as error:
        raise SourceError(where, found=f"{found} ({error})", expected=expected, fix=fix) from error


def part_around(color: NDArray[np.uint8], centre: Floats, size: float) -> tuple[NDArray[np.uint8], Floats]:
    """Return a square part of an image, black outside of it, and the pixel (2,) of its upper left corner."""
    half = max(int(size / 2), 8)
    left, top = (int(value) - half for value in centre)
    part = np.zeros((2 * half, 2 * half, 3), np.uint8)
    height, width = color.shape[:2]
    rows = slice(max(top, 0), min(top + 2 * half, height))
    columns = slice(max(left, 0), min(left + 2 * half, width))
    if rows.start < rows.stop and columns.start < columns.stop:
        part[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left] = color[rows, columns]
    return part, np.array([left, top], np.float64)


def enlarged(part: NDArray[np.uint8], least: int) -> NDArray[np.uint8]:
    """Return an image of at least so many pixels of height, enlarged with cubic interpolation."""
    if len(part) >= least:
        return part
    cv2 = import_module("cv2")  # MediaPipe requires it
    return np.asarray(cv2.resize(part, None, fx=least / len(part), fy=least / len(part), interpolation=cv2.INTER_CUBIC))


def _distance(landmarks: Floats, one: int, other: int) -> float:
    return float(np.linalg.norm(landmarks[one] - landmarks[other]))
