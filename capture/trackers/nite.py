"""A tracker: NiTE2, PrimeSense's library, which finds several people in the depth of an OpenNI2 sensor.

It comes with neither Puppetline nor Debian, and only who has it can use it: as libNiTE2.so where the system looks for
libraries, or in the folder that the environment variable NITE2_REDIST names. It reads the sensor through a stream of
its own, next to the pictures. It gives 15 joints, which `capture.formats.layouts` makes 20 of: its neck is the
shoulder centre and its torso the spine; hip centre, wrists and ankles are put between their neighbours where recorded
bodies have them, with the confidence of the least certain neighbour, inferred at most.

Its millimetres are x to the right of the depth picture, y up and z away. It takes who it sees for somebody who faces
the sensor as a mirror, as `capture.network.osceleton` has it: *left* is at the left of the picture. So names and x are
exchanged, unless the sensor's pictures are mirrored already.
"""

import atexit
import ctypes
import ctypes.util
import logging
import os
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from capture.formats.layouts import NITE15, synthesise_missing, to_kinect20
from capture.skeleton import LOST, OPPOSITE, mirrored
from capture.trackers.picture import Person, Picture
from puppetline.errors import SourceError

REDIST = "NITE2_REDIST"
"""Names the folder of the library."""
PATIENCE = 1.0
"""Seconds that a picture's people are waited for."""

_NAMES = ("libNiTE2.so", "libNiTE2.dylib", "NiTE2.dll")
_VISIBLE, _GONE = 1, 4  # bits of a user's state
_CALIBRATED = 2  # of a skeleton's states
_STATES = {
    1: "is being calibrated: stand upright and face the sensor",
    3: "cannot be calibrated: not in the pose",
    4: "cannot be calibrated: the hands are not seen",
    5: "cannot be calibrated: the head is not seen",
    6: "cannot be calibrated: the legs are not seen",
    7: "cannot be calibrated: the torso is not seen",
}

log = logging.getLogger(__name__)
_started = False


class NiTE:
    """Finds people in what a sensor gives; implements `capture.trackers.picture.Tracker`.

    Only those whom NiTE2 has calibrated are people; the log says how far the others are. One is made at a time, as the
    library is not made for more.

    Parameters
    ----------
    device : pointer
        OpenNI2's handle of the sensor.
    flipped : bool
        Whether OpenNI2 gives its depth mirrored.

    Raises
    ------
    SourceError
        The library does not load, does not start, or cannot track what this sensor gives.
    """

    name = "NiTE2"

    def __init__(self, device: Any, flipped: bool) -> None:
        self._nite = _library()
        self._flipped = flipped
        self._people: list[Person] = []
        self._states: dict[int, int] = {}  # of the skeletons of those who are there
        self._time = -np.inf  # of the depth that they were found in
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
        """Return who is in a picture of the sensor, or in the one that NiTE2 has seen since.

        Who is out of sight, but not given up by NiTE2, has every joint lost.

        Raises
        ------
        SourceError
            NiTE2 fails, or does not come to this picture.
        """
        until = time.monotonic() + PATIENCE
        while self._time < picture.time:
            if not self._ready.wait(until - time.monotonic()):
                raise SourceError(
                    self.name,
                    found=f"no result from NiTE2 for {PATIENCE:g} s",
                    expected="a result for every depth image",
                    fix="Unplug the sensor and plug it in again, or set "
                    f"{REDIST} to an empty folder to track with MediaPipe.",
                )
            self._ready.clear()
            self._read()
        return self._people

    def close(self) -> None:
        """Let go of the sensor; closing again does nothing."""
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
        """Return somebody who is calibrated; have those who are new be so."""
        if user.state & _GONE:
            self._states.pop(user.id, None)
            return None
        if user.id not in self._states:
            self._call("niteStartSkeletonTracking", self._tracker, user.id)
        state = int(user.skeleton.state)
        if state in _STATES and state != self._states.get(user.id):
            log.info("%s: user %d %s", self.name, user.id, _STATES[state])
        self._states[user.id] = state
        if state != _CALIBRATED:
            return None
        joints = [(*_xyz(joint.position), joint.positionConfidence) for joint in user.skeleton.joints]
        numbers = np.array(joints)
        known = np.isfinite(numbers).all(axis=1) & bool(user.state & _VISIBLE)
        confidence = np.where(known, numbers[:, 3].clip(0, 1), LOST).astype(np.float32)
        positions, confidence = synthesise_missing(*to_kinect20(NITE15, numbers[:, :3] / 1000, confidence))
        if not self._flipped:
            positions, confidence = mirrored(positions), confidence[OPPOSITE]
        return Person(user.id, positions.astype(np.float32), confidence)

    def _call(self, name: str, *arguments: Any) -> None:
        _call(self._nite, name, *arguments)


class _Device(ctypes.Structure):
    """OpenNI2's class openni::Device, as its header lays it out, with nothing but the handle."""

    _fields_ = (
        ("playback", ctypes.c_void_p),
        ("handle", ctypes.c_void_p),
        ("rest", ctypes.c_uint8 * 2048),  # what the sensor is, which nobody but its owner asks for
    )


def library_path() -> str | None:
    """Return where NiTE2's library is, or a name that the system finds it by; None if it is not there."""
    folder = os.environ.get(REDIST)
    if folder is None:
        return ctypes.util.find_library("NiTE2")
    return next((str(path.absolute()) for name in _NAMES if (path := Path(folder) / name).is_file()), None)


def _library() -> Any:
    """Return the C functions, with the library started, once in a process."""
    global _started
    from openni import _nite2 as nite  # its other module changes the folder that this process works in

    if not nite._the_dll:
        try:
            nite.load_dll(library_path())
        except (OSError, AttributeError) as error:  # AttributeError: something else of that name
            raise SourceError(
                NiTE.name,
                found=f"a library that cannot be loaded ({error})",
                expected="NiTE 2.2 for this machine, and libOpenNI2.so, which it asks for",
                fix=f"Correct {REDIST}; Debian's libopenni2-dev has libOpenNI2.so.",
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
            found=f"an error in {name} (status {status})",
            expected="a library that tracks people in the depth images of this sensor",
            fix="Start Puppetline in a folder with NiTE2's data folder, NiTE2 with s.dat in it, or a link to it.",
        )


def _xyz(point: Any) -> tuple[float, float, float]:
    return point.x, point.y, point.z
