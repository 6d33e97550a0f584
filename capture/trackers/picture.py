"""What a sensor gives and what a tracker makes of it: pictures, and the people in them.

Positions are in the frame of `capture.skeleton`: y up, z away from the sensor, the performer's right at +x, which is
left in the picture.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Lens:
    """A pinhole camera.

    Attributes
    ----------
    width, height : int
        Of the picture, pixels.
    focal : float
        Pixels.
    """

    width: int
    height: int
    focal: float

    def unproject(self, pixels: NDArray[np.floating], depth: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the positions (…, 3) of pixels (…, 2), counted right and down, at depths in metres."""
        right, down = pixels[..., 0] - self.width / 2, pixels[..., 1] - self.height / 2
        return np.stack([-right * depth / self.focal, -down * depth / self.focal, depth], axis=-1)

    def project(self, positions: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the pixels (…, 2) of positions (…, 3) in metres, which lie before the sensor."""
        right, down = -positions[..., 0], -positions[..., 1]
        scale = self.focal / positions[..., 2]
        return np.stack([right * scale + self.width / 2, down * scale + self.height / 2], axis=-1)


@dataclass(frozen=True, slots=True)
class Picture:
    """What a sensor sees at one moment.

    Attributes
    ----------
    time : float
        Seconds on the device's clock.
    lens : Lens
        Of colour, and of the depth that is registered to it.
    color : (height, width, 3) uint8 array or None
        Red, green, blue.
    depth : (height, width) uint16 array or None
        Millimetres along z; 0 where it is not known.
    """

    time: float
    lens: Lens
    color: NDArray[np.uint8] | None
    depth: NDArray[np.uint16] | None


@dataclass(frozen=True, slots=True)
class Person:
    """Somebody in a picture.

    Attributes
    ----------
    user : int
        The same as long as the tracker takes it for the same person.
    positions : (20, 3) float32 array
        Metres, `capture.skeleton.JOINTS`.
    confidence : (20,) float32 array
        As in `capture.skeleton`.
    """

    user: int
    positions: NDArray[np.float32]
    confidence: NDArray[np.float32]


class Device(Protocol):
    """Gives pictures."""

    name: str

    def read(self, timeout: float) -> Picture | None:
        """Wait for the next picture for at most so many seconds; None if none has come.

        Raises
        ------
        SourceError
            It can give no more.
        """

    def close(self) -> None:
        """Let go of the device; closing again does nothing."""


class Tracker(Protocol):
    """Finds people in pictures, one after the other."""

    name: str

    def track(self, picture: Picture) -> list[Person]:
        """Return who is in a picture."""

    def close(self) -> None:
        """Let go of what it holds; closing again does nothing."""
