"""Cameras and videos through OpenCV: the sources ``camera:`` and ``video:``, colour without depth.

``camera:0`` or ``camera:/dev/video0``, ``video:FILE``; then ``?`` and options with ``&`` between them: ``height=1.75``,
the performer's in metres; ``fov=78``, the field of view from corner to corner in degrees, as data sheets give it; of
videos ``loop``, which has no value.
"""

import math
import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any
from urllib.parse import parse_qsl

from capture.libraries import import_error
from capture.sensors.source import SensorSource
from capture.trackers.mediapipe import EXTRA, HEIGHT, MediaPipePose, library
from capture.trackers.picture import Lens, Picture
from puppetline.errors import SourceError, at

FIELD_OF_VIEW = 70.0
"""Degrees from corner to corner where nobody says it: between a laptop's camera and a usual webcam."""

FIX = "Write it like camera:0?height=1.75&fov=78 or video:dance.mp4?loop; docs/sensors.md explains the options."

_RANGES = {"height": (0.5, 2.5, "metres"), "fov": (20.0, 150.0, "degrees")}
_FRAME_RATE = 30.0  # of a video that does not say its own


@dataclass(frozen=True, slots=True)
class Options:
    """What a user says about a camera or video.

    Attributes
    ----------
    place : str
        Number, device or file.
    height : float
        The performer's, metres.
    fov : float
        Degrees from corner to corner.
    loop : bool
        Whether to begin again at the end.
    """

    place: str
    height: float = HEIGHT
    fov: float = FIELD_OF_VIEW
    loop: bool = False


def open_camera(uri: str, rest: str) -> SensorSource:
    """Open a camera and find a person in what it shows.

    Parameters
    ----------
    uri, rest : str
        The whole, and what follows its scheme.

    Raises
    ------
    SourceError
        The text cannot be read, or a library is missing. What is wrong with the camera is raised by the source.
    """
    options = parse(uri, rest)
    if options.loop:
        raise SourceError(uri, found="the option 'loop'", expected="height and fov", fix="A camera has no end.")
    opencv()
    library()
    return SensorSource(uri, lambda: Camera(uri, options), lambda _: MediaPipePose(options.height))


def open_video(uri: str, rest: str, folder: Path) -> SensorSource:
    """Open a video file and find a person in it.

    Parameters
    ----------
    uri, rest : str
        The whole, and what follows its scheme.
    folder : Path
        What the file is relative to.

    Raises
    ------
    SourceError
        The text cannot be read, a library is missing, or there is no such video.
    """
    options = parse(uri, rest)
    library()
    video = Video(uri, folder / options.place, options)
    return SensorSource(uri, lambda: video, lambda _: MediaPipePose(options.height), recorded=True)


def parse(uri: str, rest: str) -> Options:
    """Read the part of a URI after its colon.

    Raises
    ------
    SourceError
        An option is unknown, given twice or has no such value.
    """
    place, _, query = rest.partition("?")
    values: dict[str, Any] = {}
    for key, value in parse_qsl(query, keep_blank_values=True):
        if key in values or key not in ("loop", *_RANGES):
            found = f"the option {key!r}" + (" for the second time" if key in values else "")
            raise SourceError(uri, found=found, expected="height, fov, loop, each once at most", fix=FIX)
        values[key] = _number(uri, key, value) if key in _RANGES else _flag(uri, key, value)
    return Options(place or "0", **values)


class Camera:
    """A camera; implements `capture.trackers.picture.Device`.

    Parameters
    ----------
    uri : str
    options : Options
        Of these, the place and the field of view.

    Raises
    ------
    SourceError
        There is no such camera, this user may not use it, or OpenCV cannot open it.
    """

    def __init__(self, uri: str, options: Options) -> None:
        cv2 = opencv()
        self._uri, self._fov = uri, options.fov
        numbered = options.place.isdecimal()
        linux = sys.platform == "linux"
        if linux:
            _check(uri, Path(f"/dev/video{options.place}" if numbered else options.place))
        self._capture = cv2.VideoCapture(
            int(options.place) if numbered else options.place, cv2.CAP_V4L2 if linux else cv2.CAP_ANY
        )
        if not self._capture.isOpened():
            self._capture.release()
            raise SourceError(
                uri,
                found=f"a device that cannot be opened as a camera ({options.place})",
                expected="a camera that no other program is using",
                fix="Close the other program, or choose another device: some cameras create several, and only one "
                "delivers images.",
            )
        self.name = f"camera {options.place}"

    def read(self, timeout: float) -> Picture | None:  # noqa: ARG002 (OpenCV waits as `opencv` says)
        """Wait for the next picture.

        Raises
        ------
        SourceError
            None came: it was pulled out, or another program has it.
        """
        good, frame = self._capture.read()
        if not good:
            raise SourceError(
                self._uri,
                found=f"no image from {self.name}",
                expected="a camera that is plugged in and that no other program is using",
                fix="Close the other program, or plug the camera in again; it is reopened automatically.",
            )
        return _picture(time.monotonic(), frame, self._fov)

    def close(self) -> None:
        """Let go of the camera."""
        self._capture.release()


class Video:
    """A video file, whose times are those in it; implements `capture.trackers.picture.Device`.

    Parameters
    ----------
    uri : str
    path : Path
    options : Options
        Of these, the field of view and whether to loop.

    Raises
    ------
    SourceError
        There is no such file, or it holds no pictures.
    """

    def __init__(self, uri: str, path: Path, options: Options) -> None:
        self._uri, self._fov, self._loop = uri, options.fov, options.loop
        if not path.is_file():
            raise SourceError(uri, found=f"no file {path}", expected="a video", fix="Correct the file's name.")
        cv2 = opencv()
        self._start = cv2.CAP_PROP_POS_FRAMES, 0
        self._moment = cv2.CAP_PROP_POS_MSEC
        self._capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
        self._period = 1 / (self._capture.get(cv2.CAP_PROP_FPS) or _FRAME_RATE)
        self._begun = self._last = 0.0  # seconds: when this round began, and its latest picture
        self._next = self._decode()
        if self._next is None:
            self.close()
            raise SourceError(
                uri,
                found=f"no picture in {path}, {path.stat().st_size} bytes",
                expected="a video that FFmpeg reads, such as .mp4, .webm or .avi",
                fix="Play the file elsewhere to see whether it is whole, and convert it.",
            )
        self.name = f"the video {path.name}"

    def read(self, timeout: float) -> Picture | None:  # noqa: ARG002 (a file never lets wait)
        """Return the next picture.

        Raises
        ------
        SourceError
            The video has ended.
        """
        picture = self._next
        if picture is None and self._loop:
            self._begun = self._last + self._period
            self._capture.set(*self._start)
            picture = self._decode()
        if picture is None:
            raise SourceError(
                self._uri,
                found="the end of the video",
                expected="more of it",
                fix="Put ?loop behind the file's name to play it again and again.",
            )
        self._next = self._decode()
        return picture

    def close(self) -> None:
        """Close the file."""
        self._capture.release()

    def _decode(self) -> Picture | None:
        good, frame = self._capture.read()
        if not good:
            return None
        self._last = self._begun + self._capture.get(self._moment) / 1000
        return _picture(self._last, frame, self._fov)


def opencv() -> ModuleType:
    """Return OpenCV.

    Raises
    ------
    SourceError
        It cannot be loaded.
    """
    # A camera that hangs is waited for at most so many seconds, not OpenCV's ten: read when OpenCV is loaded.
    os.environ.setdefault("OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT", "2")
    try:
        import cv2
    except (ImportError, OSError) as error:  # OSError: a library that it needs is missing
        raise import_error("cv2", error)(
            "OpenCV", found=f"a library that cannot be loaded ({error})", expected="OpenCV 4", fix=EXTRA
        ) from error
    return cv2


def _picture(moment: float, frame: Any, fov: float) -> Picture:
    height, width = frame.shape[:2]
    focal = math.hypot(width, height) / 2 / math.tan(math.radians(fov) / 2)
    return Picture(moment, Lens(width, height, focal), opencv().cvtColor(frame, opencv().COLOR_BGR2RGB), None)


def _check(uri: str, device: Path) -> None:
    """Find out before OpenCV, which does not say it, why a camera cannot be opened."""
    if not device.exists():
        there = ", ".join(str(path) for path in sorted(Path("/dev").glob("video*"))) or "none at all"
        raise SourceError(
            uri,
            found=f"no {device}",
            expected=f"a camera that is there: {there}",
            fix="Plug it in; in a container or virtual machine, pass the device through.",
        )
    if not os.access(device, os.R_OK | os.W_OK):
        group = device.group()
        raise SourceError(
            uri,
            found=f"no permission to use {device}",
            expected=f"permission to read and write it, which its group {group} has",
            fix=f'sudo usermod -aG {group} $USER, and log in again; or a udev rule for SUBSYSTEM=="video4linux" with '
            'TAG+="uaccess".',
        )


def _number(uri: str, key: str, text: str) -> float:
    least, most, unit = _RANGES[key]
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not least <= value <= most:
        raise SourceError(at(uri, field=key), found=repr(text), expected=f"{least:g} to {most:g} {unit}", fix=FIX)
    return value


def _flag(uri: str, key: str, text: str) -> bool:
    if text:
        raise SourceError(at(uri, field=key), found=repr(text), expected="no value", fix=FIX)
    return True
