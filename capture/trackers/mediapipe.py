"""A tracker: MediaPipe's pose, which finds one performer in colour images, with depth or without.

MediaPipe follows one performer until it loses them, and then looks for another; of several, it chooses one. It
estimates 33 landmarks of the whole body, hidden parts included, and their visibility, which becomes the confidence of
the joints. Joints are means of landmarks:

=====================  =================================================================================
shoulders … wrists     the landmarks of that name, which MediaPipe places inside the body; likewise hips, knees, ankles
hands                  halfway between the knuckles of index and little finger
feet                   halfway between heel and toes
head                   halfway between the ears
hip_center             halfway between the hips
shoulder_center        from halfway between the shoulders, 0.15 of the way to the head: the root of the neck
spine                  0.17 of the way from hip_center to shoulder_center, as in `capture.formats.layouts`
=====================  =================================================================================

If faces or hands are measured, the head points up from the neck as the face does and has its orientation, and wrists
and hands are those of the landmarks of the hands.
"""

import logging
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from types import ModuleType
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from capture.libraries import UNLOADABLE, load_module
from capture.orientations import unknown
from capture.skeleton import JOINT_INDEX, JOINTS, TRACKED
from capture.trackers.face import FaceChannels, FaceMesh, HeadDirection, axes, measures, part_around
from capture.trackers.hands import SIDES, Floats, Hand, HandChannels, Hands
from capture.trackers.picture import Person, Picture
from capture.trackers.placing import BodyPlacer, warm_up
from puppetline.errors import SourceError

DEFAULT_HEIGHT_METRES = 1.70
"""Height of a performer if neither an option nor depth determines it, in metres."""

LOST_SECONDS = 0.5
"""Time without a body after which the next one gets a new user number, in seconds."""

BLACK_BRIGHTNESS = 10.0
"""Mean brightness, of 255, below which an image counts as black."""

INSTALL_FIX = (
    "Install OpenCV and MediaPipe: pip install 'puppetline[camera]'. On Debian, both require libgl1 and libglib2.0-0."
)

"""What to do if OpenCV or MediaPipe does not load."""

HEAD_CROP = 3.0
"""Size of the part of the image around a head, in extents of its landmarks, which are eyes, ears, nose and mouth."""

_LANDMARK_COUNT, _HEAD_LANDMARKS = 33, 11
_LEFT = {"shoulder": [11], "elbow": [13], "wrist": [15], "hand": [17, 19], "hip": [23], "knee": [25], "ankle": [27]}
_LEFT |= {"foot": [29, 31]}
_RIGHT = {joint: [landmark + 1 for landmark in landmarks] for joint, landmarks in _LEFT.items()}
_EYES, _EARS, _MOUTH = [2, 5], [7, 8], [9, 10]
_NECK, _SPINE = 0.15, 0.17
_HEAD, _NECK_JOINT = JOINT_INDEX["head"], JOINT_INDEX["shoulder_center"]

_TO_SENSOR = np.array([-1.0, -1.0, 1.0])  # MediaPipe's axes: x right in the image, y down, z away

log = logging.getLogger(__name__)


class MediaPipePose:
    """Finds one performer; implements `capture.trackers.picture.Tracker`.

    Parameters
    ----------
    height : float
        The performer's height, in metres; it does not count for images with depth.
    face, hands : bool
        Whether to measure the performer's face and hands (`capture.channels`).

    Raises
    ------
    SourceError
        MediaPipe is not installed.
    """

    name = "MediaPipe pose"

    def __init__(self, height: float = DEFAULT_HEIGHT_METRES, *, face: bool = False, hands: bool = False) -> None:
        self._pose: Any = load_mediapipe().Pose(model_complexity=1)  # the package includes the model of this complexity
        self._workers = ThreadPoolExecutor(4)  # for depth, face and both hands
        warm_up()
        self._mesh = FaceMesh() if face else None
        self._face, self._head = FaceChannels(), HeadDirection()
        self._hands = Hands() if hands else None
        self._gestures = HandChannels()
        self._upside_down = False
        self._height = height
        self._placer: BodyPlacer | None = None
        self._person: Person | None = None
        self._users = 0
        self._last_found = -np.inf  # time of the last image with a performer
        self._absence = ""

    def track(self, picture: Picture) -> list[Person]:
        """Return the performer in an image, or an empty list.

        A performer who was found up to `LOST_SECONDS` ago is returned with every joint lost. An image without colours
        is a SourceError.
        """
        if picture.color is None:
            raise SourceError(
                self.name,
                found="an image without colours",
                expected="a colour image, with depth or without",
                fix="Use a sensor with a colour camera, or NiTE2.",
            )
        found = self._find(picture, picture.color)
        if found is not None:
            self._log_absence("")
            self._person, self._last_found = found, picture.time
            return [found]
        self._log_absence(_absence(picture.color))
        if self._person is None or picture.time - self._last_found > LOST_SECONDS:
            self._person = self._placer = None
            self._face, self._head = FaceChannels(), HeadDirection()
            return []
        return [Person(self._person.user, self._person.positions, np.zeros(len(JOINTS), np.float32))]

    def close(self) -> None:
        """Release MediaPipe."""
        if self._pose is not None:
            self._pose.close()
            self._pose = None
            self._workers.shutdown()
            for model in (self._mesh, self._hands):
                if model is not None:
                    model.close()

    def _find(self, picture: Picture, color: NDArray[np.uint8]) -> Person | None:
        depth = self._workers.submit(lambda: picture.depth)  # a sensor may align it meanwhile
        result = self._pose.process(color)
        if result.pose_landmarks is None or result.pose_world_landmarks is None:
            depth.result()  # it is not ready for others, or for the next image, before
            return None
        size = picture.lens.width, picture.lens.height
        seen = np.array([(mark.x, mark.y, mark.visibility) for mark in result.pose_landmarks.landmark])
        world = np.array([(mark.x, mark.y, mark.z) for mark in result.pose_world_landmarks.landmark])
        if self._placer is None:
            self._placer = BodyPlacer(self._height)
            self._users += 1
        body = seen[:, :2] * size
        pixels, posture = LANDMARK_WEIGHTS @ body, LANDMARK_WEIGHTS @ world * _TO_SENSOR
        confidence = (LANDMARK_WEIGHTS @ seen[:, 2]).astype(np.float32)
        head, face = body[:_HEAD_LANDMARKS], None
        if self._mesh is not None:
            part, corner = part_around(color, head.mean(axis=0), HEAD_CROP * float(np.ptp(head, axis=0).max()))
            face = None if self._is_upside_down(head) else self._workers.submit(self._mesh.find, part)
        hands = [] if self._hands is None else self._hands.find(color, body, self._workers.map)
        marks = None if face is None else face.result()
        _place_hands(hands, pixels, posture, confidence)
        placed = self._placer.place(picture.time, picture.lens, pixels, posture, confidence, depth.result())
        if placed is None:
            return None
        positions, confidence = placed
        channels = self._gestures.step(picture.time, hands) if hands else {}
        orientations = None
        if self._mesh is not None:
            channels |= self._face.step(picture.time, None if marks is None else measures(marks))
            if marks is not None:
                ray = picture.lens.unproject(corner + len(part) / 2, np.ones(()))
                orientations = self._turn_head(positions, axes(marks, ray))
        return Person(self._users, positions.astype(np.float32), confidence, channels or None, orientations)

    def _is_upside_down(self, head: NDArray[np.float64]) -> bool:
        """Return whether the mouth of a head's landmarks (11, 2) is above the eyes; log that once."""
        upside_down = bool(head[_MOUTH, 1].mean() < head[_EYES, 1].mean())
        if upside_down and not self._upside_down:
            log.warning("%s: the face is upside down and not measured: turn the camera or the video", self.name)
        self._upside_down = upside_down
        return upside_down

    def _turn_head(self, positions: NDArray[np.float64], face: NDArray[np.float64]) -> NDArray[np.float64]:
        """Move the head of (20, 3) positions to where the face points, and return its orientation (20, 4)."""
        positions[_HEAD] = positions[_NECK_JOINT] + self._head.turned(positions[_HEAD] - positions[_NECK_JOINT], face)
        orientations = unknown()
        orientations[_NECK_JOINT] = scipy.spatial.transform.Rotation.from_matrix(face).as_quat()[[3, 0, 1, 2]]
        return orientations

    def _log_absence(self, cause: str) -> None:
        if cause and cause != self._absence:
            log.warning("%s: %s", self.name, cause)
        self._absence = cause


def _place_hands(hands: Sequence[Hand | None], pixels: Floats, posture: Floats, sure: NDArray[np.float32]) -> None:
    """Put wrists and hands of a body's joints, (20, 2) pixels and (20, 3) metres, where the hands are."""
    for side, hand in zip(SIDES, hands, strict=False):
        if hand is not None:
            joints = [JOINT_INDEX[f"wrist_{side}"], JOINT_INDEX[f"hand_{side}"]]
            pixels[joints], sure[joints] = hand.pixels, TRACKED
            posture[joints[1]] = posture[joints[0]] + hand.direction * _TO_SENSOR


def load_mediapipe() -> ModuleType:
    """Return MediaPipe's pose module.

    Raises
    ------
    SourceError
        MediaPipe cannot be loaded.
    """
    name = "mediapipe.python.solutions.pose"
    return load_module(name, "MediaPipe", found=UNLOADABLE, expected="MediaPipe 0.10.21", fix=INSTALL_FIX)


def _absence(color: NDArray[np.uint8]) -> str:
    """Return why an image shows no performer."""
    if color[::8, ::8].mean() < BLACK_BRIGHTNESS:
        return "the image is black: uncover the lens, or switch on the light"
    return "no performer is in view, or too little of the body"


def _landmark_weights() -> NDArray[np.float64]:
    weights = np.zeros((len(JOINTS), _LANDMARK_COUNT))
    for side, limbs in (("left", _LEFT), ("right", _RIGHT)):
        for joint, landmarks in limbs.items():
            weights[JOINT_INDEX[f"{joint}_{side}"], landmarks] = 1 / len(landmarks)
    weights[JOINT_INDEX["head"], _EARS] = 0.5
    hips, shoulders = (
        (weights[JOINT_INDEX[f"{joint}_left"]] + weights[JOINT_INDEX[f"{joint}_right"]]) / 2
        for joint in ("hip", "shoulder")
    )
    neck = (1 - _NECK) * shoulders + _NECK * weights[JOINT_INDEX["head"]]
    weights[JOINT_INDEX["hip_center"]] = hips
    weights[JOINT_INDEX["shoulder_center"]] = neck
    weights[JOINT_INDEX["spine"]] = (1 - _SPINE) * hips + _SPINE * neck
    return weights


LANDMARK_WEIGHTS = _landmark_weights()
"""(20, 33) weights of MediaPipe's landmarks in the mean that is each joint."""
