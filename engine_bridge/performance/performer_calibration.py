"""The calibration of a performer, and its conversion to and from JSON."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from capture import body
from capture.sensor_tilt import SensorTilt
from capture.skeleton import JOINT_INDEX, JOINTS


@dataclass(frozen=True)
class Calibration:
    """A performer's calibration pose, which corresponds to the character's rest pose.

    Attributes
    ----------
    rest : (20, 3) float64
        Joint positions in metres, sensor coordinates.
    sensor : SensorTilt
        Position of the sensor at that time.
    """

    rest: NDArray[np.float64]
    sensor: SensorTilt

    @property
    def height(self) -> float:
        """Height of the performer in metres."""
        return body.height(self.rest)

    @property
    def reach(self) -> float:
        """Distance from the performer's shoulders to the hands in metres, mean of both sides."""
        return float(body.reach(self.rest)[[JOINT_INDEX["hand_left"], JOINT_INDEX["hand_right"]]].mean())

    def to_json(self) -> dict[str, Any]:
        """Return values of JSON's types, from which `of_json` restores the calibration bit for bit."""
        return {"rest": rows_of(self.rest), "sensor": asdict(self.sensor)}

    @classmethod
    def of_json(cls, value: Mapping[str, Any]) -> "Calibration":
        """Restore a calibration from the values of `to_json`.

        Raises
        ------
        KeyError, TypeError, ValueError
            The values are not those of a calibration.
        """
        rest = places_of(value["rest"])
        if rest.shape != (len(JOINTS), 3):
            raise ValueError(f"a pose of shape {rest.shape}")
        return cls(rest, SensorTilt.of_json(value["sensor"]))


def rows_of(places: NDArray[np.float64]) -> list[list[float] | None]:
    """Return positions (n, 3) as lists for JSON; None for those that are not finite."""
    return [place.tolist() if np.isfinite(place).all() else None for place in places]


def places_of(places: Iterable[Sequence[float] | None]) -> NDArray[np.float64]:
    """Return the positions (n, 3) of a value of `rows_of`; NaN for None."""
    rows = [(np.nan,) * 3 if place is None else place for place in places]
    return np.array(rows, dtype=np.float64).reshape(-1, 3)
