"""Images of a sensor and the performers in them; the protocols of devices and trackers.

Positions are in sensor coordinates, as in `capture.skeleton`: y up, z away from the sensor, and the performer's right,
which is left in the image, at +x.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from capture.skeleton import SkeletonFrame


@dataclass(frozen=True, slots=True)
class Lens:
    """A pinhole camera.

    Attributes
    ----------
    width, height : int
        Size of the image, in pixels.
    focal : float
        Focal length, in pixels.
    offset : (float, float)
        Pixels by which the principal point is right of, and below, the middle of the image.
    """

    width: int
    height: int
    focal: float
    offset: tuple[float, float] = (0.0, 0.0)

    def unproject(self, pixels: NDArray[np.floating], depth: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the positions (…, 3), in metres, of pixels (…, 2), right and down, at depths in metres."""
        column, row = self._principal
        right, down = pixels[..., 0] - column, pixels[..., 1] - row
        return np.stack([-right * depth / self.focal, -down * depth / self.focal, depth], axis=-1)

    def project(self, positions: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the pixels (…, 2) of positions (…, 3), in metres, in front of the sensor."""
        right, down = -positions[..., 0], -positions[..., 1]
        scale = self.focal / positions[..., 2]
        column, row = self._principal
        return np.stack([right * scale + column, down * scale + row], axis=-1)

    @property
    def _principal(self) -> tuple[float, float]:
        return self.width / 2 + self.offset[0], self.height / 2 + self.offset[1]


@dataclass(frozen=True, slots=True)
class Picture:
    """One image of a sensor: colour, depth, or both.

    Attributes
    ----------
    time : float
        Time on the device's clock, in seconds.
    lens : Lens
        The lens of the colour camera, to which depth is registered.
    color : (height, width, 3) uint8 array or None
        RGB.
    measured : (height, width) float32 array, function that returns one, or None
        `depth`. Its function may take its time, and is called only for images that are tracked or shown.
    up : (3,) float64 array or None
        Upward direction in sensor coordinates, by the device's accelerometer.
    """

    time: float
    lens: Lens
    color: NDArray[np.uint8] | None
    measured: NDArray[np.float32] | Callable[[], NDArray[np.float32]] | None
    up: NDArray[np.float64] | None = None

    @property
    def depth(self) -> NDArray[np.float32] | None:
        """Metres along z, (height, width); 0 for unknown."""
        return self.measured() if callable(self.measured) else self.measured


@dataclass(frozen=True, slots=True)
class Person:
    """A performer in an image.

    Attributes
    ----------
    user : int
        User number; it stays the same while the tracker follows the performer.
    positions : (20, 3) float32 array
        Metres, in the order of `capture.skeleton.JOINTS`.
    confidence : (20,) float32 array
        From 0 (lost) to 1 (tracked), as in `capture.skeleton`.
    channels : mapping of str to float, optional
        Values of channels (`capture.channels`) from 0 to 1.
    orientations : (20, 4) float64, optional
        As in `capture.skeleton`.
    """

    user: int
    positions: NDArray[np.float32]
    confidence: NDArray[np.float32]
    channels: Mapping[str, float] | None = None
    orientations: NDArray[np.float64] | None = None

    def frame(self, time: float) -> SkeletonFrame:
        """Return the performer as a frame at a time in seconds."""
        return SkeletonFrame(
            time, self.user, self.positions.astype(np.float64), self.confidence, self.orientations, self.channels
        )


class Device(Protocol):
    """A source of images."""

    name: str

    def read(self, timeout: float) -> Picture | None:
        """Return the next image, or None if none arrives within `timeout` seconds.

        Raises
        ------
        SourceError
            The device can deliver no more images.
        """

    def close(self) -> None:
        """Release the device; closing again does nothing."""


class Tracker(Protocol):
    """Finds performers in one image after another."""

    name: str

    def track(self, picture: Picture) -> list[Person]:
        """Return the performers in an image; raise SourceError if that is impossible."""

    def close(self) -> None:
        """Release the tracker's resources; closing again does nothing."""
