"""A tracker: MediaPipe's pose, which finds one person in colour pictures, with depth or without.

MediaPipe follows one person until it loses them, then looks for another one; who that is when several are in view is
its choice. It guesses 33 landmarks of the whole body, hidden parts too, and says how visible each is, which becomes the
confidence of the joints. They are made of landmarks like this:

=====================  =================================================================================
shoulders … wrists     the landmarks of that name, which MediaPipe places within the body; so hips, knees, ankles
hands                  halfway between the knuckles of index and little finger
feet                   halfway between heel and toes
head                   halfway between the ears
hip_center             halfway between the hips
shoulder_center        from halfway between the shoulders, 0.15 of the way to the head: the root of the neck
spine                  0.17 of the way from hip_center to shoulder_center, as in `capture.formats.layouts`
=====================  =================================================================================
"""

import logging
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from capture.libraries import import_error
from capture.skeleton import JOINT_INDEX, JOINTS
from capture.trackers.picture import Person, Picture
from capture.trackers.placing import Placing, rehearse
from puppetline.errors import SourceError

HEIGHT = 1.70
"""Metres; a performer's height where nobody says it and no depth tells."""

GONE = 0.5
"""Seconds without a body after which whoever is seen next is somebody else."""

DARK = 10.0
"""Mean brightness, of 255, below which nobody can be seen."""

EXTRA = "pip install 'puppetline[camera]' brings OpenCV and MediaPipe; Debian needs libgl1 and libglib2.0-0 for them."

_LANDMARKS = 33
_LEFT = {"shoulder": [11], "elbow": [13], "wrist": [15], "hand": [17, 19], "hip": [23], "knee": [25], "ankle": [27]}
_LEFT |= {"foot": [29, 31]}
_RIGHT = {joint: [landmark + 1 for landmark in landmarks] for joint, landmarks in _LEFT.items()}
_EARS = [7, 8]
_NECK, _SPINE = 0.15, 0.17

_TO_SENSOR = np.array([-1.0, -1.0, 1.0])  # MediaPipe's world: x right in the picture, y down, z away

log = logging.getLogger(__name__)


class MediaPipePose:
    """Finds one person; implements `capture.trackers.picture.Tracker`.

    Parameters
    ----------
    height : float
        The performer's, metres. Where a picture has depth, that decides.

    Raises
    ------
    SourceError
        MediaPipe is not installed.
    """

    name = "MediaPipe pose"

    def __init__(self, height: float = HEIGHT) -> None:
        self._pose: Any = library().Pose(model_complexity=1)  # the one whose model comes with it
        rehearse()
        self._height = height
        self._placing: Placing | None = None
        self._person: Person | None = None
        self._users = 0
        self._seen = -np.inf  # the time of the last picture with somebody
        self._state = ""

    def track(self, picture: Picture) -> list[Person]:
        """Return who is in a picture: one person, or nobody.

        Somebody who was there a moment ago still is, with every joint lost.

        Raises
        ------
        SourceError
            The picture has no colours.
        """
        if picture.color is None:
            raise SourceError(
                self.name,
                found="a picture without colours",
                expected="colour, with depth or without",
                fix="Use a sensor with a colour camera, or a tracker of depth.",
            )
        found = self._find(picture)
        if found is not None:
            self._say("")
            self._person, self._seen = found, picture.time
            return [found]
        self._say(_nobody(picture.color))
        if self._person is None or picture.time - self._seen > GONE:
            self._person = self._placing = None
            return []
        return [Person(self._person.user, self._person.positions, np.zeros(len(JOINTS), np.float32))]

    def close(self) -> None:
        """Let go of MediaPipe."""
        if self._pose is not None:
            self._pose.close()
            self._pose = None

    def _find(self, picture: Picture) -> Person | None:
        result = self._pose.process(picture.color)
        if result.pose_landmarks is None or result.pose_world_landmarks is None:
            return None
        size = picture.lens.width, picture.lens.height
        seen = np.array([(mark.x, mark.y, mark.visibility) for mark in result.pose_landmarks.landmark])
        world = np.array([(mark.x, mark.y, mark.z) for mark in result.pose_world_landmarks.landmark])
        if self._placing is None:
            self._placing = Placing(self._height)
            self._users += 1
        placed = self._placing.place(
            picture.time,
            picture.lens,
            MIXTURE @ (seen[:, :2] * size),
            MIXTURE @ world * _TO_SENSOR,
            (MIXTURE @ seen[:, 2]).astype(np.float32),
            picture.depth,
        )
        return None if placed is None else Person(self._users, placed[0].astype(np.float32), placed[1])

    def _say(self, state: str) -> None:
        if state and state != self._state:
            log.warning("%s: %s", self.name, state)
        self._state = state


def library() -> ModuleType:
    """Return MediaPipe's module of poses.

    Raises
    ------
    SourceError
        It cannot be loaded.
    """
    try:
        from mediapipe.python.solutions import pose
    except (ImportError, OSError) as error:  # OSError: a library that it needs is missing
        raise import_error("mediapipe", error)(
            "MediaPipe", found=f"a library that cannot be loaded ({error})", expected="MediaPipe 0.10.21", fix=EXTRA
        ) from error
    return pose


def _nobody(color: NDArray[np.uint8]) -> str:
    """Say why nobody moves."""
    if color[::8, ::8].mean() < DARK:
        return "the picture is black: is there a cover before the lens, or no light?"
    return "nobody is in view, or too little of them"


def _mixture() -> NDArray[np.float64]:
    mixture = np.zeros((len(JOINTS), _LANDMARKS))
    for side, limbs in (("left", _LEFT), ("right", _RIGHT)):
        for joint, landmarks in limbs.items():
            mixture[JOINT_INDEX[f"{joint}_{side}"], landmarks] = 1 / len(landmarks)
    mixture[JOINT_INDEX["head"], _EARS] = 0.5
    hips, shoulders = (
        (mixture[JOINT_INDEX[f"{joint}_left"]] + mixture[JOINT_INDEX[f"{joint}_right"]]) / 2
        for joint in ("hip", "shoulder")
    )
    neck = (1 - _NECK) * shoulders + _NECK * mixture[JOINT_INDEX["head"]]
    mixture[JOINT_INDEX["hip_center"]] = hips
    mixture[JOINT_INDEX["shoulder_center"]] = neck
    mixture[JOINT_INDEX["spine"]] = (1 - _SPINE) * hips + _SPINE * neck
    return mixture


MIXTURE = _mixture()
"""(20, 33): each joint as a weighted mean of MediaPipe's landmarks."""
