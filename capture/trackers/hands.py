"""Hands, their fingers and their channels from the 21 landmarks of each hand that MediaPipe finds.

The bend of a joint of a finger is the angle between the two bones that meet there; at a knuckle, one of them is
the palm's, from the wrist. A hand is open as far as its four fingers are straight, and points as far as the index
finger is straighter than the other three.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from capture.channels import FINGER_CHANNELS, FULL_BEND_DEGREES, SmoothedChannels
from capture.trackers.face import open_model, part_around

SIDES = ("left", "right")
"""The performer's hands, in the order of MediaPipe's landmarks of the body."""

STRAIGHT_DEGREES, BENT_DEGREES = 50.0, 220.0
"""Sum of the bends of a finger's joints that is straight, and that in a fist; MediaPipe bends straight fingers by up to
50 degrees."""

FLAT_DEGREES = np.array([[30.0, 20.0, 20.0], *[[15.0, 20.0, 15.0]] * 4])
"""(5, 3) bends of the joints of thumb to little finger in a flat hand, by MediaPipe."""

MAX_WRIST_SHARE = 0.5
"""Largest distance of a hand's wrist from that of the body, in lengths of the forearm; others are another hand's."""

SURE_SCORE = 0.95
"""Score from which MediaPipe's left or right counts; hands that are seen from the side have lower ones."""

CROP_SHARE = 1.6
"""Size of the part of the image around a hand, in lengths of the forearm; the palm is a third of it or more."""

SMOOTHING_SECONDS, LOST_SECONDS = 0.05, 0.15
"""Time constants of the channels' smoothing, and of their fall to 0 while a hand is not seen, in seconds."""

_WRIST, _KNUCKLES = 0, (5, 17)  # of a hand; the latter those of index and little finger
_BONES = np.array([[0, *range(first, first + 4)] for first in (1, 5, 9, 13, 17)])  # landmarks of each finger
_ELBOWS, _WRISTS, _LITTLE, _INDEX = (13, 14), (15, 16), (17, 18), (19, 20)  # landmarks of the body

Floats = NDArray[np.float64]

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Hand:
    """A hand in an image.

    Attributes
    ----------
    pixels : (2, 2) float64
        The wrist, and the middle of the knuckles of index and little finger.
    direction : (3,) float64
        From the former to the latter in metres; right and down in the image, and away.
    bends : (5, 3) float64
        `bends`.
    """

    pixels: Floats
    direction: Floats
    bends: Floats


def bends(landmarks: Floats) -> Floats:
    """Return the bends (5, 3) of the joints of thumb to little finger, in degrees, from landmarks (21, 3)."""
    bones = np.diff(landmarks[_BONES], axis=1)
    bones /= np.maximum(np.linalg.norm(bones, axis=-1, keepdims=True), 1e-9)
    return np.degrees(np.arccos(np.clip((bones[:, 1:] * bones[:, :-1]).sum(axis=-1), -1, 1)))


def straightness(bent: Floats) -> Floats:
    """Return how straight the fingers (4,) from index to little finger are, from 0 to 1, from `bends`."""
    return np.asarray(np.clip((BENT_DEGREES - bent[1:].sum(axis=1)) / (BENT_DEGREES - STRAIGHT_DEGREES), 0, 1))


class Hands:
    """Finds a performer's hands.

    Raises
    ------
    SourceError
        MediaPipe's models are missing.
    """

    def __init__(self) -> None:
        self._models: list[Any] = [open_model("hands", "Hands", max_num_hands=1, model_complexity=1) for _ in SIDES]
        self._others = False

    def find(self, color: NDArray[np.uint8], body: Floats, run: Callable[..., Any] = map) -> list[Hand | None]:
        """Return the left and the right hand; None for one that is not seen.

        Parameters
        ----------
        color : (height, width, 3) uint8
        body : (33, 2) float64
            MediaPipe's landmarks of the body, in pixels.
        run : callable
            Calls a function for each side, as ``map`` does; it may do so in two threads.
        """
        return list(run(lambda side: self._find(side, color, body), range(len(SIDES))))

    def close(self) -> None:
        """Release MediaPipe."""
        for model in self._models:
            model.close()

    def _find(self, side: int, color: NDArray[np.uint8], body: Floats) -> Hand | None:
        wrist, elbow = body[_WRISTS[side]], body[_ELBOWS[side]]
        knuckles = (body[_LITTLE[side]] + body[_INDEX[side]]) / 2
        forearm = max(float(np.linalg.norm(wrist - elbow)), float(np.linalg.norm(body[11] - body[12])) / 2)
        part, corner = part_around(color, (wrist + 2 * knuckles) / 3, CROP_SHARE * forearm)
        result = self._models[side].process(part)
        if result.multi_hand_world_landmarks is None:
            return None
        flat, space = (
            np.array([(point.x, point.y, point.z) for point in each[0].landmark])
            for each in (result.multi_hand_landmarks, result.multi_hand_world_landmarks)
        )
        pixels = np.array([flat[_WRIST], flat[list(_KNUCKLES)].mean(axis=0)])[:, :2] * len(part) + corner
        hand = result.multi_handedness[0].classification[0]
        if np.linalg.norm(pixels[0] - wrist) > MAX_WRIST_SHARE * forearm:
            first, self._others = not self._others, True
            if first:
                log.warning("more hands than the performer's are in view; those that do not end its arms are ignored")
            return None
        if hand.label.lower() == SIDES[side] and hand.score > SURE_SCORE:  # MediaPipe names hands as in a mirror
            return None
        direction = space[list(_KNUCKLES)].mean(axis=0) - space[_WRIST]
        return Hand(pixels, direction, bends(space))


class HandChannels:
    """Turns a performer's hands into channels."""

    def __init__(self) -> None:
        every = ("hand_open_left", "hand_open_right", "point_left", "point_right", *FINGER_CHANNELS)
        names = [[name for name in every if name.endswith(side)] for side in SIDES]
        self._channels = [SmoothedChannels(each, SMOOTHING_SECONDS, LOST_SECONDS) for each in names]
        self._seen = [False, False]

    def step(self, time: float, hands: list[Hand | None]) -> dict[str, float]:
        """Return the channels, at a time in seconds, of the hands that have been seen."""
        channels: dict[str, float] = {}
        for side, hand in enumerate(hands):
            measured = None if hand is None else _measures(hand)
            self._seen[side] = self._seen[side] or hand is not None
            values = self._channels[side].step(time, measured)
            channels |= values if self._seen[side] else {}
        return channels


def _measures(hand: Hand) -> Floats:
    """Return how far a hand is open, how far it points, and how far each joint of its fingers is bent."""
    straight = straightness(hand.bends)
    bent = np.clip((hand.bends - FLAT_DEGREES) / FULL_BEND_DEGREES, 0, 1)
    return np.array([straight.mean(), max(straight[0] - straight[1:].mean(), 0.0), *bent.ravel()])
