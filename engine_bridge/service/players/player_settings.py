"""Settings of a character's player."""

from dataclasses import dataclass

from engine_bridge.performance.easing import EASE_SECONDS
from engine_bridge.service.players.automatic_calibration import Calibrate


@dataclass(frozen=True)
class PlayerSettings:
    """Settings of how a character is calibrated and eased.

    Attributes
    ----------
    calibrate : {"still", "at_once", "command"}
    ease : float
        Duration of easing, in seconds.
    remember : float
        Time within which a returning performer resumes without a calibration, in seconds.
    tilt, height : float or None
        Tilt in degrees and height in metres of the sensor, see `SensorTilt`; None detects them.
    """

    calibrate: Calibrate = "still"
    ease: float = EASE_SECONDS
    remember: float = 30.0
    tilt: float | None = None
    height: float | None = None
