"""The calibration of a performer and the retargeting that is computed from it."""

from concurrent.futures import Future
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

from engine_bridge.performance.performer_calibration import Calibration
from engine_bridge.performance.retargeting import Retargeting
from engine_bridge.puppet.puppet import Puppet


@dataclass(frozen=True)
class PreparedCalibration:
    """A calibration, and the retargeting that is computed from it.

    Attributes
    ----------
    calibration : Calibration
    mirror : bool
    asked : float
        Time at which it was requested.
    puppet : Puppet
        The character's puppet when it was requested, whose mapping the retargeting applies.
    working : Future
        Computes the retargeting, which takes a tenth of a second.
    """

    calibration: Calibration
    mirror: bool
    asked: float
    puppet: Puppet
    working: Future[Retargeting]

    def retargeting(self) -> Retargeting:
        """Return a retargeting without frames so far, once it is computed."""
        return deepcopy(self.working.result())

    def to_json(self) -> dict[str, Any]:
        """Return values of JSON's types, from which `CharacterPlayer.begin` prepares the same calibration."""
        return self.calibration.to_json() | {"mirror": self.mirror}
