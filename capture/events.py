"""What a live source gives: frames, and what happens between them.

All times are seconds on the clock of the source that gives them, and never go back. Of a live source that clock is
`time.monotonic`, of a replayed take it is the take's own, so that a take gives the very same events again.
"""

from dataclasses import dataclass, field
from typing import Any

from capture.skeleton import SkeletonFrame


@dataclass(frozen=True, slots=True)
class Lost:
    """The sender says that a performer has gone.

    Attributes
    ----------
    time : float
    user : int
    """

    time: float
    user: int


@dataclass(frozen=True, slots=True)
class Tick:
    """Time has passed and nothing came: what eases or waits goes on.

    Attributes
    ----------
    time : float
    """

    time: float


@dataclass(frozen=True, slots=True)
class Cue:
    """Something is to be done with performers or characters: somebody asks for it, or what was asked for is ready.

    Attributes
    ----------
    time : float
    do : str
        ``"calibrate"``, ``"mirror"``, ``"choose_user"``; ``"begin"`` to use a calibration from now on; ``"level"`` from
        a sensor that sees the floor: tilt and roll in degrees, height in metres; ``"stage"`` at the beginning of a
        take: who is there, who plays which character, and how they are calibrated.
    arguments : dict
        Of JSON's types.
    """

    time: float
    do: str
    arguments: dict[str, Any] = field(default_factory=dict)


Event = SkeletonFrame | Lost | Tick | Cue

TICK_SECONDS = 1 / 30
"""Seconds of silence after which a source gives a tick, and then another one."""
