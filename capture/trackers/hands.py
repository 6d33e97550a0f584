"""Channels of hands from the 21 landmarks of each hand that MediaPipe finds.

A finger is straight if the distance from its knuckle to its tip equals the sum of its bones' lengths. A hand is open
as far as its four fingers are straight, and points as far as the index finger is straighter than the other three.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from capture.trackers.face import open_model, part_around

SIDES = ("left", "right")
"""The performer's hands, in the order of MediaPipe's landmarks of the body."""

BENT, STRAIGHT = 0.5, 0.92
"""Straightness of a finger in a fist, and of one that is stretched."""

CROP_SHARE = 1.6
"""Size of the part of the image around a hand, in lengths of the forearm; the palm is a third of it or more."""

SMOOTHING_SECONDS, LOST_SECONDS = 0.05, 0.15
"""Time constants of the channels' smoothing, and of their fall to 0 while a hand is not seen, in seconds."""

_KNUCKLES = (5, 9, 13, 17)  # of index to little finger; the next three landmarks are its other joints and its tip
_ELBOWS, _WRISTS, _LITTLE, _INDEX = (13, 14), (15, 16), (17, 18), (19, 20)  # landmarks of the body

Floats = NDArray[np.float64]


def straightness(landmarks: Floats) -> Floats:
    """Return how straight the fingers (4,) from index to little finger are, from 0 to 1, from landmarks (21, 3)."""
    fingers = landmarks[np.add.outer(_KNUCKLES, range(4))]
    bones = np.linalg.norm(np.diff(fingers, axis=1), axis=-1).sum(axis=1)
    straight = np.linalg.norm(fingers[:, 3] - fingers[:, 0], axis=-1) / np.maximum(bones, 1e-9)
    return np.asarray(np.clip((straight - BENT) / (STRAIGHT - BENT), 0, 1))


class HandChannels:
    """Finds a performer's hands and returns their channels.

    Raises
    ------
    SourceError
        MediaPipe's models are missing.
    """

    def __init__(self) -> None:
        self._models: list[Any] = [open_model("hands", "Hands", max_num_hands=1, model_complexity=0) for _ in SIDES]
        self._values, self._time = np.zeros((len(SIDES), 2)), 0.0
        self._seen = [False, False]

    def step(self, time: float, color: NDArray[np.uint8], body: Floats) -> dict[str, float]:
        """Return the channels of the hands that have been seen.

        Parameters
        ----------
        time : float
            Seconds.
        color : (height, width, 3) uint8
        body : (33, 2) float64
            MediaPipe's landmarks of the body, in pixels.
        """
        passed, self._time = max(time - self._time, 0.0), time
        channels = {}
        for side, name in enumerate(SIDES):
            target, seconds = np.zeros(2), LOST_SECONDS
            landmarks = self._find(side, color, body)
            if landmarks is not None:
                straight, seconds = straightness(landmarks), SMOOTHING_SECONDS
                target = np.array([straight.mean(), max(straight[0] - straight[1:].mean(), 0.0)])
                self._seen[side] = True
            self._values[side] += (target - self._values[side]) * (1 - np.exp(-passed / seconds))
            if self._seen[side]:
                channels[f"hand_open_{name}"], channels[f"point_{name}"] = self._values[side].tolist()
        return channels

    def close(self) -> None:
        """Release MediaPipe."""
        for model in self._models:
            model.close()

    def _find(self, side: int, color: NDArray[np.uint8], body: Floats) -> Floats | None:
        wrist, elbow = body[_WRISTS[side]], body[_ELBOWS[side]]
        knuckles = (body[_LITTLE[side]] + body[_INDEX[side]]) / 2
        size = CROP_SHARE * max(float(np.linalg.norm(wrist - elbow)), float(np.linalg.norm(body[11] - body[12])) / 2)
        result = self._models[side].process(part_around(color, (wrist + 2 * knuckles) / 3, size)[0])
        if result.multi_hand_world_landmarks is None:
            return None
        points = result.multi_hand_world_landmarks[0].landmark
        return np.array([(point.x, point.y, point.z) for point in points])
