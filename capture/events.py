"""Events of a source: frames, and the events between them.

All times are seconds on the clock of the source and never decrease. The clock of a live source is `puppetline.clock`. A
take has its own clock, so a replay yields exactly the recorded events.
"""

from dataclasses import dataclass, field
from typing import Any

from capture.skeleton import SkeletonFrame


@dataclass(frozen=True, slots=True)
class Lost:
    """The sender reports that a performer has left.

    `again` is true at the end of a recording that begins again: the performer probably returns at once, elsewhere.
    """

    time: float
    user: int
    again: bool = False


@dataclass(frozen=True, slots=True)
class Tick:
    """Time has passed without another event; easing and waiting continue."""

    time: float


@dataclass(frozen=True, slots=True)
class Cue:
    """A command for performers or characters, or the result of one that is now available.

    Attributes
    ----------
    time : float
    do : str
        ``"calibrate"``, ``"mirror"`` or ``"choose_user"``; ``"begin"`` to start using a calibration; ``"level"`` from a
        sensor that detects the floor, with tilt and roll in degrees and height in metres; ``"stage"`` at the beginning
        of a take, with the performers, their characters and their calibrations; ``"sound"`` with the file of the sound
        that is recorded beside a take, and the time of its first sample.
    arguments : dict
        Values of JSON types.
    """

    time: float
    do: str
    arguments: dict[str, Any] = field(default_factory=dict)


Event = SkeletonFrame | Lost | Tick | Cue

TICK_SECONDS = 1 / 30
"""Time without an event after which a source emits a tick; it repeats."""
