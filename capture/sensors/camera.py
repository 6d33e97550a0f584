"""Cameras and videos through OpenCV: the sources ``camera:`` and ``video:``, colour without depth.

The forms are ``camera:0``, ``camera:/dev/video0`` and ``video:FILE``. Options follow ``?``, with ``&`` between them:
``height=1.75``, the performer's height in metres; ``fov=78``, the diagonal field of view in degrees, as in data sheets;
without a value ``face`` and ``hands``, which measure their channels, and for videos ``loop``.
"""

import math
import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl

from capture.libraries import UNLOADABLE, load_module
from capture.sensors.source import SensorSource
from capture.trackers.mediapipe import DEFAULT_HEIGHT_METRES, INSTALL_FIX, MediaPipePose, load_mediapipe
from capture.trackers.picture import Lens, Picture
from puppetline import clock
from puppetline.errors import RecordingEndError, SourceError, at

DEFAULT_FOV_DEGREES = 70.0
"""Default of the diagonal field of view, in degrees, between those of laptops and webcams."""

_FIX = "Write it like camera:0?height=1.75&fov=78 or video:dance.mp4?loop; docs/sensors.md explains the options."
_RANGES = {"height": (0.5, 2.5, "metres"), "fov": (20.0, 150.0, "degrees")}
_FLAGS = ("loop", "face", "hands")
_DEFAULT_FRAME_RATE = 30.0  # of a video that states none


@dataclass(frozen=True, slots=True)
class Options:
    """Options of a camera or video.

    Attributes
    ----------
    name : str
        Number, device file or video file.
    height : float
        The performer's height, in metres.
    fov : float
        Diagonal field of view, in degrees.
    loop : bool
        Whether a video begins again at its end.
    face, hands : bool
        Whether to measure the channels of the face and the hands.
    """

    name: str
    height: float = DEFAULT_HEIGHT_METRES
    fov: float = DEFAULT_FOV_DEGREES
    loop: bool = False
    face: bool = False
    hands: bool = False


def open_camera(uri: str, rest: str) -> SensorSource:
    """Open a camera with MediaPipe as its tracker.

    Parameters
    ----------
    uri, rest : str
        The whole URI, and the part after its scheme.

    Raises
    ------
    SourceError
        The URI is wrong, or a library is missing. The source itself raises the errors of the camera.
    """
    options = parse(uri, rest)
    if options.loop:
        raise SourceError(
            uri, found="the option 'loop'", expected="height and fov", fix="Remove it: a camera has no end."
        )
    load_opencv()
    load_mediapipe()
    return SensorSource(uri, lambda: Camera(uri, options), lambda _: _tracker(options))


def open_video(uri: str, rest: str, folder: Path) -> SensorSource:
    """Open a video file with MediaPipe as its tracker.

    Parameters
    ----------
    uri, rest : str
        The whole URI, and the part after its scheme.
    folder : Path
        Folder to which the file's path is relative.

    Raises
    ------
    SourceError
        The URI is wrong, a library is missing, or the file is not a video.
    """
    options = parse(uri, rest)
    load_mediapipe()
    video = Video(uri, folder / options.name, options)
    return SensorSource(uri, lambda: video, lambda _: _tracker(options), recorded=True)


def parse(uri: str, rest: str) -> Options:
    """Parse the part of a URI after its scheme.

    Raises
    ------
    SourceError
        An option is unknown, repeated or has a wrong value.
    """
    name, _, query = rest.partition("?")
    values: dict[str, Any] = {}
    for key, value in parse_qsl(query, keep_blank_values=True):
        if key in values or key not in (*_FLAGS, *_RANGES):
            found = f"the option {key!r}" + (" for the second time" if key in values else "")
            raise SourceError(uri, found=found, expected="height, fov, loop, face, hands, each at most once", fix=_FIX)
        values[key] = _number(uri, key, value) if key in _RANGES else _flag(uri, key, value)
    return Options(name or "0", **values)


class Camera:
    """A camera; implements `capture.trackers.picture.Device`.

    Parameters
    ----------
    uri : str
    options : Options
        `name` and `fov` are used.

    Raises
    ------
    SourceError
        The camera does not exist, this user may not use it, or OpenCV cannot open it.
    """

    def __init__(self, uri: str, options: Options) -> None:
        cv2 = load_opencv()
        self._uri, self._fov = uri, options.fov
        numbered = options.name.isdecimal()
        linux = sys.platform == "linux"
        if linux:
            _check(uri, Path(f"/dev/video{options.name}" if numbered else options.name))
        self._capture = cv2.VideoCapture(
            int(options.name) if numbered else options.name, cv2.CAP_V4L2 if linux else cv2.CAP_ANY
        )
        if not self._capture.isOpened():
            self._capture.release()
            raise SourceError(
                uri,
                found=f"a device that cannot be opened as a camera ({options.name})",
                expected="a camera that no other program uses",
                fix="Close the other program, or choose another device: of a camera's devices, only one has images.",
            )
        self.name = f"camera {options.name}"

    def read(self, timeout: float) -> Picture | None:  # noqa: ARG002 (the timeout is that of `load_opencv`)
        """Return the next image; raise SourceError if the camera was unplugged or another program uses it."""
        good, frame = self._capture.read()
        if not good:
            raise SourceError(
                self._uri,
                found=f"no image from {self.name}",
                expected="a camera that is plugged in and that no other program uses",
                fix="Close the other program, or plug the camera in again; the source then resumes automatically.",
            )
        return _picture(clock.now(), frame, self._fov)

    def close(self) -> None:
        """Release the camera."""
        self._capture.release()


class Video:
    """A video file, with its own times; implements `capture.trackers.picture.Device`.

    Parameters
    ----------
    uri : str
    path : Path
    options : Options
        `fov` and `loop` are used.

    Raises
    ------
    SourceError
        The file does not exist, or has no images.
    """

    def __init__(self, uri: str, path: Path, options: Options) -> None:
        self._uri, self._fov, self._loop = uri, options.fov, options.loop
        if not path.is_file():
            raise SourceError(uri, found=f"no file {path}", expected="a video", fix="Correct the path.")
        cv2 = self._cv2 = load_opencv()
        self._capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
        self._period = 1 / (self._capture.get(cv2.CAP_PROP_FPS) or _DEFAULT_FRAME_RATE)
        self._start = self._last = 0.0  # times of the beginning of this pass and of its last image, in seconds
        self._next = self._decode()
        if self._next is None:
            self.close()
            raise SourceError(
                uri,
                found=f"no image in {path} ({path.stat().st_size} bytes)",
                expected="a video that FFmpeg reads, such as .mp4, .webm or .avi",
                fix="Check in a video player whether the file is intact, and convert it.",
            )
        self.name = f"the video {path.name}"

    def read(self, timeout: float) -> Picture | None:  # noqa: ARG002 (a file needs no waiting)
        """Return the next image; raise RecordingEndError at the end of the video."""
        picture = self._next
        if picture is None and self._loop:
            self._start = self._last + self._period
            self._capture.set(self._cv2.CAP_PROP_POS_FRAMES, 0)
            picture = self._decode()
        if picture is None:
            raise RecordingEndError(
                self._uri, found="the end of the video", expected="more images", fix="Add ?loop to play it in a loop."
            )
        self._next = self._decode()
        return picture

    def pictures(self) -> Iterator[Picture]:
        """Yield the images that are left, up to the end."""
        while self._next is not None:
            picture, self._next = self._next, self._decode()
            yield picture

    def close(self) -> None:
        """Close the file."""
        self._capture.release()

    def _decode(self) -> Picture | None:
        good, frame = self._capture.read()
        if not good:
            return None
        self._last = self._start + self._capture.get(self._cv2.CAP_PROP_POS_MSEC) / 1000
        return _picture(self._last, frame, self._fov)


def load_opencv() -> Any:
    """Return OpenCV.

    Raises
    ------
    SourceError
        OpenCV cannot be loaded.
    """
    # the timeout of a camera in seconds, which OpenCV reads when it is loaded; its default is 10
    os.environ.setdefault("OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT", "2")
    return load_module("cv2", "OpenCV", found=UNLOADABLE, expected="OpenCV 4", fix=INSTALL_FIX)


def _tracker(options: Options) -> MediaPipePose:
    return MediaPipePose(options.height, face=options.face, hands=options.hands)


def _picture(moment: float, frame: Any, fov: float) -> Picture:
    height, width = frame.shape[:2]
    focal = math.hypot(width, height) / 2 / math.tan(math.radians(fov) / 2)
    return Picture(moment, Lens(width, height, focal), load_opencv().cvtColor(frame, load_opencv().COLOR_BGR2RGB), None)


def _check(uri: str, device: Path) -> None:
    """Raise an error with the reason why a camera cannot be opened, which OpenCV does not report."""
    if sys.platform == "win32":  # it has no device files
        return
    if not device.exists():
        cameras = ", ".join(str(path) for path in sorted(Path("/dev").glob("video*"))) or "none is plugged in"
        raise SourceError(
            uri,
            found=f"no {device}",
            expected=f"an existing camera ({cameras})",
            fix="Plug it in; in a container or virtual machine, pass the device through.",
        )
    if not os.access(device, os.R_OK | os.W_OK):
        group = device.group()
        raise SourceError(
            uri,
            found=f"no permission for this user to use {device}",
            expected=f"permission to read and write it, which its group {group} has",
            fix=f"Run sudo usermod -aG {group} $USER and log in again, or add a udev rule for "
            'SUBSYSTEM=="video4linux" with TAG+="uaccess".',
        )


def _number(uri: str, key: str, text: str) -> float:
    least, most, unit = _RANGES[key]
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not least <= value <= most:
        raise SourceError(at(uri, field=key), found=repr(text), expected=f"{least:g} to {most:g} {unit}", fix=_FIX)
    return value


def _flag(uri: str, key: str, text: str) -> bool:
    if text:
        raise SourceError(at(uri, field=key), found=repr(text), expected="no value", fix=_FIX)
    return True
