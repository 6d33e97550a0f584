"""What a user may say about a log that the log does not say itself."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """Overrides for facts that some formats leave out; None means detect or use the format's own default.

    Attributes
    ----------
    fps : float or None
        Frames a second, for formats without a clock.
    up : "y", "z" or None
        The axis that points up, for formats that do not fix it (BVH).
    unit : float or None
        Metres in one unit of length, for formats that do not fix it (BVH).
    """

    fps: float | None = None
    up: Literal["y", "z"] | None = None
    unit: float | None = None
