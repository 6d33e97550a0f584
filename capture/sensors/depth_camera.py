"""What depth cameras share: how a URI selects one, pairs of depth and colour, times of recordings, and errors.

A kind of depth camera is a module with a subclass of `DepthCamera` and a function ``open_source``, and a row in
`capture.sources.registry`. Whatever uses a depth camera does not distinguish the kinds.
"""

import logging
import math
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from capture.sensors.source import SensorSource
from capture.source import SENSOR_RECORDINGS
from capture.trackers.mediapipe import MediaPipePose, load_mediapipe
from capture.trackers.picture import Device, Lens, Picture, Tracker
from puppetline import clock
from puppetline.errors import RecordingEndError, SourceError, at, heading

MAX_SKEW_SECONDS = 0.02
"""Largest difference between the times of depth and colour in one image, in seconds."""
MIN_CLOCK_OFFSET_SECONDS = 1.0
"""Smallest difference between the times of depth and colour that shows that each has its own clock, in seconds."""
MAX_ALONE_COUNT = 30
"""Number of images of one kind, without one of the other, after which a sensor counts as failed."""

RECORD_FIX = "Record it again, with depth and colour."
"""What to do if the images of a recording cannot be used."""

_SYNCHRONISED_SECONDS = 0.001  # difference between the times of depth and colour that is not worth a warning
_LOOP_STEP_SECONDS = 1 / 30  # time between the end of a recording and its beginning in a loop
_BEST_MODE = 640, 480, 30

Kind = Literal["depth", "color"]
Mode = tuple[int, int, int]
"""Width and height in pixels, and images per second."""

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Selection:
    """The sensor or recording that a URI selects.

    Attributes
    ----------
    kind : str
        ``"any"``, ``"file"``, or a property of a sensor, such as ``"serial"``.
    value : str
        Path, or value of the property; empty for any.
    fast, loop : bool
        How a recording is played.
    face, hands : bool
        Whether to measure the performer's face and hands.
    settings : mapping
        Numbers that the sensor is set to.
    """

    kind: str = "any"
    value: str = ""
    fast: bool = False
    loop: bool = False
    face: bool = False
    hands: bool = False
    settings: Mapping[str, float] = field(default_factory=dict)

    @property
    def recorded(self) -> bool:
        """Whether it is a recording."""
        return self.kind == "file"


def parse(
    uri: str, rest: str, properties: Collection[str] = ("serial",), settings: Mapping[str, str] | None = None
) -> Selection:
    """Parse the part of a URI after its scheme: nothing, ``serial=…``, or a file with ``&fast`` or ``?loop``.

    ``?face&hands`` may follow each.

    Parameters
    ----------
    uri, rest : str
        The whole URI, and the part after its scheme.
    properties : collection of str
        Properties that select a sensor.
    settings : mapping, optional
        Units of the settings of a sensor, by name.

    Raises
    ------
    SourceError
        The text has another form.
    """
    target, *every = re.split("[&?]", rest)
    face, hands = "face" in every, "hands" in every
    options = [option for option in every if option not in ("face", "hands")]
    kind, equals, value = target.partition("=")
    if not equals and target.endswith(SENSOR_RECORDINGS):
        kind, value = "file", target
    if kind == "file" and value and set(options) <= {"fast", "loop"}:
        return Selection("file", value, "fast" in options, "loop" in options, face, hands)
    units = settings or {}
    pairs = [option.partition("=") for option in options]
    if (not target or (kind in properties and value)) and all(name in units for name, _, _ in pairs):
        numbers = {name: _number(at(uri, field=name), text, units[name]) for name, _, text in pairs}
        return Selection(kind or "any", value, face=face, hands=hands, settings=numbers)
    forms = [*(f"{name}=TEXT" for name in properties), *(f"?{name}=NUMBER" for name in units)]
    scheme = uri.partition(":")[0]
    raise SourceError(
        uri,
        found=repr(rest),
        expected=f"nothing, {', '.join(forms)} or file=NAME after {scheme}:, a file with &fast or ?loop",
        fix=f"Write {scheme}: for the first sensor.",
    )


def open_depth_camera(
    uri: str,
    selection: Selection,
    open_device: Callable[[], Device],
    open_tracker: Callable[[Device], Tracker] | None = None,
) -> SensorSource:
    """Open a sensor or a recording with a tracker, MediaPipe by default.

    Raises
    ------
    SourceError
        MediaPipe is not installed, or the recording does not play. The source itself raises the errors of a sensor.
    """
    if open_tracker is None:
        load_mediapipe()
    open_tracker = open_tracker or (lambda _: MediaPipePose(face=selection.face, hands=selection.hands))
    if selection.recorded:
        file = open_device()
        return SensorSource(uri, lambda: file, open_tracker, recorded=True, fast=selection.fast)
    return SensorSource(uri, open_device, open_tracker)


class DepthCamera(ABC):
    """A sensor or a recording with depth, colour, or both; implements `capture.trackers.picture.Device`.

    A subclass passes the frames that it receives to `_add`. It sets `name`, `_lens` and, if a stream is missing,
    `_kinds`.

    Parameters
    ----------
    uri : str
        URI of the source.
    selection : Selection
    record : Path, optional
        File to which the sensor's images are recorded, if the subclass records to `_partial`.

    Attributes
    ----------
    name : str
        Name of the sensor.
    """

    def __init__(self, uri: str, selection: Selection, record: Path | None = None) -> None:
        self.name = uri
        self._uri, self._selection, self._recorded = uri, selection, selection.recorded
        self._record = record
        self._partial = None if record is None else record.with_name(f".{record.stem}.part{record.suffix}")
        self._kinds: tuple[Kind, ...] = ("depth", "color")
        self._lens = Lens(1, 1, 1.0)
        self._up: NDArray[np.float64] | None = None
        self._loop = selection.loop
        self._waiting: dict[Kind, tuple[float, Any]] = {}  # newest time and pixels
        self._seen: dict[Kind, tuple[float, float]] = {}  # times of the first and the newest frame
        self._passes = dict.fromkeys(self._kinds, 0)  # how often a recording has begun again since the last image
        self._alone = 0  # frames since the last image
        self._last = -math.inf  # time of the last image
        self._passed = 0.0  # seconds of earlier passes of a loop

    def read(self, timeout: float) -> Picture | None:
        """Return the next image; raise SourceError if the sensor was unplugged or the recording has ended."""
        until = clock.now() + timeout
        while (picture := self._pair()) is None:
            if not self._receive(max(0.0, until - clock.now())):
                if not self._recorded and not self._is_plugged():
                    raise self._unplugged()
                return None
        return picture

    @abstractmethod
    def close(self) -> None:
        """Stop and release the sensor; closing again does nothing."""

    @abstractmethod
    def _receive(self, timeout: float) -> bool:
        """Wait for frames and add them; return whether there were any. Errors end the sensor or recording."""

    def _choose(self, devices: Mapping[str, Any], usb: Callable[[Any], str]) -> Any:
        """Return the selected one of the devices by serial number; log a USB port that is too slow.

        Parameters
        ----------
        devices : mapping
        usb : callable
            Returns the version of USB by which a device is connected, such as ``3.2`` or ``USB3.2``.
        """
        kind, value = self._selection.kind, self._selection.value
        serial = value if kind == "serial" else next(iter(devices), "") if kind == "any" else ""
        if serial not in devices:
            raise not_plugged_in(self._uri, self._selection, list(devices))
        version = usb(devices[serial]).removeprefix("USB")
        if version.startswith(("1", "2")):
            message = "%s connected by USB %s, which is too slow for all images: use a USB 3 port and cable"
            log.warning(message, heading(self._uri), version)
        return devices[serial]

    def _keep_recording(self) -> None:
        """Give a complete recording its name."""
        if self._record is not None and self._partial is not None and self._partial.exists():
            self._partial.replace(self._record)

    def _is_plugged(self) -> bool:
        """Return whether the sensor, which delivers nothing, is plugged in."""
        return True

    def _add(self, kind: Kind, moment: float, pixels: NDArray[Any] | Callable[[], NDArray[np.float32]]) -> None:
        """Add depth in metres (`Picture.measured`), or colours, at a time on the sensor's clock, in seconds."""
        first, newest = self._seen.get(kind, (moment, moment))
        if self._recorded and moment <= first < newest:
            self._passes[kind] += 1
        self._seen[kind] = first, moment
        self._waiting[kind] = moment, pixels
        self._alone += 1

    def _pair(self) -> Picture | None:
        """Return an image of the newest depth and colours; drop a frame without a counterpart."""
        if len(self._waiting) < len(self._kinds):
            self._check_alone()
            return None
        times = {kind: moment for kind, (moment, _) in self._waiting.items()}
        earliest = min(times, key=lambda kind: (self._passes[kind], times[kind]))
        skew = max(times.values()) - min(times.values())
        are_of_two_passes = len({self._passes[kind] for kind in times}) > 1
        if are_of_two_passes or MAX_SKEW_SECONDS < skew < MIN_CLOCK_OFFSET_SECONDS:
            del self._waiting[earliest]
            self._check_alone()
            return None
        if self._last == -math.inf and skew > _SYNCHRONISED_SECONDS:
            message = "%s the times of depth and colour of %s differ by %.1f ms"
            log.warning(message, heading(self._uri), self.name, 1000 * skew)
        moment = times[self._kinds[0]]
        if self._recorded and moment + self._passed <= self._last:  # the recording begins again
            if not self._loop:  # although its damaged last frame was skipped
                raise self._ended()
            self._passed = self._last + _LOOP_STEP_SECONDS - moment
        self._last, self._alone = moment + self._passed, 0
        self._passes = dict.fromkeys(self._kinds, 0)
        depth, color = (self._waiting.pop(kind, (0.0, None))[1] for kind in ("depth", "color"))
        return Picture(self._last, self._lens, color, depth, self._up)

    def _check_alone(self) -> None:
        """Raise an error if one kind of frames does not arrive."""
        if self._alone < MAX_ALONE_COUNT or (self._recorded and self._last > -math.inf):
            return
        there = "depth" if "depth" in self._waiting else "colour"
        found = f"{there} without {'colour' if there == 'depth' else 'depth'} from {self.name}"
        fix = "Plug it into a USB port of its own, with the cable that came with it; then plug it in again."
        raise self._unusable_images(found, "both kinds of images, at the same time", fix)

    def _unusable_images(self, found: str, expected: str, fix: str = "Use another sensor.") -> SourceError:
        """Return the error for images that cannot be used; the fix is that for a sensor."""
        return SourceError(self._uri, found=found, expected=expected, fix=RECORD_FIX if self._recorded else fix)

    def _ended(self) -> SourceError:
        return RecordingEndError(
            self._uri, found="the end of the recording", expected="more images", fix="Add ?loop to play it in a loop."
        )

    def _unplugged(self) -> SourceError:
        return SourceError(
            self._uri,
            found=f"an unplugged sensor ({self.name})",
            expected="a sensor that stays plugged in",
            fix="Check its cable and its power supply; when it is plugged in, the source resumes automatically.",
        )


def metres(raw: NDArray[np.uint16], unit: float = 0.001) -> NDArray[np.float32]:
    """Return depth in metres, from numbers of a unit in metres."""
    return np.multiply(raw, np.float32(unit), dtype=np.float32)


def upward(acceleration: Sequence[float], rotation: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the upward direction in sensor coordinates; None if the sensor is being moved.

    Parameters
    ----------
    acceleration : sequence of three float
        What the accelerometer measures, in m/s²; at rest, 9.8 upwards.
    rotation : (3, 3) float64
        From the accelerometer's axes to those of the image: right, down and away.
    """
    image = rotation @ np.asarray(acceleration, np.float64)
    length = float(np.linalg.norm(image))
    return image * [-1, -1, 1] / length if abs(length - _GRAVITY) < _MAX_ACCELERATION else None


_GRAVITY, _MAX_ACCELERATION = 9.81, 0.5  # m/s², and the largest difference of a sensor at rest


def best_mode(modes: Iterable[Collection[Mode]]) -> Mode | None:
    """Return the mode that all streams have and that is closest to 640×480 at 30 images per second."""
    every = [set(each) for each in modes]
    return min(set.intersection(*every), key=lambda mode: math.dist(mode, _BEST_MODE), default=None) if every else None


def not_plugged_in(uri: str, selection: Selection, plugged: Sequence[str]) -> SourceError:
    """Return the error for a sensor that is not among those that are plugged in."""
    wanted = "" if selection.kind == "any" else f" with the {selection.kind} {selection.value}"
    return SourceError(
        uri,
        found=f"sensors {', '.join(plugged)}" if plugged else "no sensor",
        expected=f"a sensor{wanted}",
        fix="Plug it in, with its power supply; puppetline doctor lists what is on USB.",
    )


def unplayable(uri: str, library: str, reason: str, recording: str) -> SourceError:
    """Return the error for a recording that a library does not play."""
    return SourceError(
        uri,
        found=f"a file that {library} does not play ({reason})",
        expected=f"an intact {recording} recording",
        fix="Record it again.",
    )


def _number(where: str, text: str, unit: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 <= value < math.inf:
        fix = "Remove it, to leave the sensor as it is."
        raise SourceError(where, found=repr(text), expected=f"a number of {unit}", fix=fix)
    return value
