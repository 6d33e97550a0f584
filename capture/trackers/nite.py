"""A tracker: NiTE2, PrimeSense's library, which finds several performers in the depth of an OpenNI2 sensor.

Neither Puppetline nor Debian includes NiTE2. It is loaded from the system's library path, or from the folder that the
environment variable NITE2_REDIST names. It reads the sensor through a depth stream of its own. Its 15 joints become 20
in `capture.formats.layouts`: its neck is the shoulder centre and its torso the spine. Hip centre, wrists and ankles are
interpolated between their neighbours, with the lowest confidence of these, inferred at most.

Its positions are millimetres: x to the right of the depth image, y up, z away. It assumes that performers face the
sensor like a mirror, as `capture.network.osceleton` does, so *left* is at the left of the image. Sides and x are
therefore exchanged, unless the sensor's images are mirrored already.
"""

import atexit
import ctypes
import ctypes.util
import logging
import os
import threading
from pathlib import Path
from typing import Any

import numpy as np

from capture.formats.layouts import NITE15, synthesise_missing, to_kinect20
from capture.skeleton import LOST, OPPOSITE, mirrored
from capture.trackers.picture import Person, Picture
from puppetline import clock
from puppetline.errors import SourceError

REDIST_VARIABLE = "NITE2_REDIST"
"""Name of the environment variable for the library's folder."""
TIMEOUT_SECONDS = 1.0
"""Maximum time to wait for the performers in an image, in seconds."""

_NAMES = ("libNiTE2.so", "libNiTE2.dylib", "NiTE2.dll")
_VISIBLE, _LEFT = 1, 4  # bits of a user's state
_CALIBRATED = 2  # state of a skeleton
_OTHER_STATES = {
    1: "is being calibrated: stand upright and face the sensor",
    3: "cannot be calibrated: the pose is wrong",
    4: "cannot be calibrated: the hands are not in view",
    5: "cannot be calibrated: the head is not in view",
    6: "cannot be calibrated: the legs are not in view",
    7: "cannot be calibrated: the torso is not in view",
}

log = logging.getLogger(__name__)
_started = False


class NiTE:
    """Finds performers in the depth of a sensor; implements `capture.trackers.picture.Tracker`.

    Only performers whom NiTE2 has calibrated count; the log reports the progress of the others. The library does not
    support the creation of two trackers at the same time.

    Parameters
    ----------
    device : pointer
        OpenNI2's handle of the sensor.
    flipped : bool
        Whether OpenNI2 delivers mirrored depth.

    Raises
    ------
    SourceError
        The library does not load, does not start, or cannot track with this sensor.
    """

    name = "NiTE2"

    def __init__(self, device: Any, flipped: bool) -> None:
        self._nite = _library()
        self._flipped = flipped
        self._people: list[Person] = []
        self._states: dict[int, int] = {}  # skeleton states of the users in view
        self._time = -np.inf  # time of the depth image in which people were found
        self._ready = threading.Event()
        self._tracker: Any = self._nite.NiteUserTrackerHandle()
        sensor = _Device(None, ctypes.cast(device, ctypes.c_void_p))
        self._call("niteInitializeUserTrackerByDevice", ctypes.byref(sensor), ctypes.byref(self._tracker))
        self._callbacks = self._nite.NiteUserTrackerCallbacks(
            self._nite.OniGeneralCallback(lambda _cookie: self._ready.set())
        )
        try:
            self._call("niteRegisterUserTrackerCallbacks", self._tracker, ctypes.byref(self._callbacks), None)
        except SourceError:
            self.close()
            raise

    def track(self, picture: Picture) -> list[Person]:
        """Return the performers in an image of the sensor, or in a later one if NiTE2 is ahead.

        A performer who is out of view, but whom NiTE2 still follows, has every joint lost. It is a SourceError if NiTE2
        fails, or does not process the image in time.
        """
        until = clock.now() + TIMEOUT_SECONDS
        while self._time < picture.time:
            if not self._ready.wait(until - clock.now()):
                raise SourceError(
                    self.name,
                    found=f"no result from NiTE2 for {TIMEOUT_SECONDS:g} s",
                    expected="a result for every depth image",
                    fix="Unplug the sensor and plug it in again, or set "
                    f"{REDIST_VARIABLE} to an empty folder to track with MediaPipe.",
                )
            self._ready.clear()
            self._read()
        return self._people

    def close(self) -> None:
        """Release the sensor; closing again does nothing."""
        if self._tracker:
            self._nite._niteUnregisterUserTrackerCallbacks(self._tracker, ctypes.byref(self._callbacks))
            self._nite._niteShutdownUserTracker(self._tracker)
            self._tracker = None

    def _read(self) -> None:
        frame = ctypes.POINTER(self._nite.NiteUserTrackerFrame)()
        self._call("niteReadUserTrackerFrame", self._tracker, ctypes.byref(frame))
        try:
            self._time = frame[0].pDepthFrame[0].timestamp * 1e-6
            users = [frame[0].pUser[k] for k in range(frame[0].userCount)]
            self._people = [person for user in users if (person := self._person(user)) is not None]
        finally:
            self._nite._niteUserTrackerFrameRelease(self._tracker, frame)

    def _person(self, user: Any) -> Person | None:
        """Return a calibrated user; start the calibration of a new one."""
        if user.state & _LEFT:
            self._states.pop(user.id, None)
            return None
        if user.id not in self._states:
            self._call("niteStartSkeletonTracking", self._tracker, user.id)
        state = int(user.skeleton.state)
        if state in _OTHER_STATES and state != self._states.get(user.id):
            log.info("%s: user %d %s", self.name, user.id, _OTHER_STATES[state])
        self._states[user.id] = state
        if state != _CALIBRATED:
            return None
        joints = [(joint.position, joint.positionConfidence) for joint in user.skeleton.joints]
        numbers = np.array([(place.x, place.y, place.z, known) for place, known in joints])
        known = np.isfinite(numbers).all(axis=1) & bool(user.state & _VISIBLE)
        confidence = np.where(known, numbers[:, 3].clip(0, 1), LOST).astype(np.float32)
        positions, confidence = synthesise_missing(*to_kinect20(NITE15, numbers[:, :3] / 1000, confidence))
        if not self._flipped:
            positions, confidence = mirrored(positions), confidence[OPPOSITE]
        return Person(user.id, positions.astype(np.float32), confidence)

    def _call(self, name: str, *arguments: Any) -> None:
        _call(self._nite, name, *arguments)


class _Device(ctypes.Structure):
    """The layout of OpenNI2's class openni::Device, of which only the handle is used."""

    _fields_ = (
        ("playback", ctypes.c_void_p),
        ("handle", ctypes.c_void_p),
        ("rest", ctypes.c_uint8 * 2048),  # description of the sensor
    )


def library_path() -> str | None:
    """Return the path of NiTE2's library, or a name that the system finds; None if it is not installed."""
    folder = os.environ.get(REDIST_VARIABLE)
    if folder is None:
        return ctypes.util.find_library("NiTE2")
    return next((str(path.absolute()) for name in _NAMES if (path := Path(folder) / name).is_file()), None)


def _library() -> Any:
    """Return the C functions; start the library the first time."""
    global _started
    from openni import _nite2 as nite  # the module nite2 would change this process's working directory

    if not nite._the_dll:
        try:
            nite.load_dll(library_path())
        except (OSError, AttributeError) as error:  # AttributeError: another library of that name
            raise SourceError(
                NiTE.name,
                found=f"a library that cannot be loaded ({error})",
                expected="NiTE 2.2 for this machine, and libOpenNI2.so, which it loads",
                fix=f"Correct {REDIST_VARIABLE}, or install libOpenNI2.so: apt install libopenni2-dev on Debian.",
            ) from error
    if not _started:
        _call(nite, "niteInitialize")
        atexit.register(nite.niteShutdown)
        _started = True
    return nite


def _call(nite: Any, name: str, *arguments: Any) -> None:
    status = int(getattr(nite, f"_{name}")(*arguments))
    if status:
        raise SourceError(
            NiTE.name,
            found=f"the status {status} of {name}",
            expected="a tracker that works with this sensor",
            fix="Start Puppetline in a folder that contains NiTE2's data folder (NiTE2, with s.dat), or a link to it.",
        )
