"""Options of the format readers, for facts that a recording does not state."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """Facts that some formats omit. None means that the reader detects the fact or uses the format's default.

    Attributes
    ----------
    fps : float or None
        Frames per second, for formats without a clock.
    up : "y", "z" or None
        The axis that points up, for formats that do not fix it.
    unit : float or None
        Metres per unit of length, for formats that do not fix it.
    joints : str or None
        Name of the order of joints (`capture.formats.joint_sets`), for tables and arrays without names.
    columns : Path or None
        A TOML file that names the columns of a table: ``Head = ["HX", "HY", "HZ"]``, ``time = "t"``.
    as_person : bool
        Whether a skeleton with four legs is read as a person's.
    animals : bool
        Whether a skeleton with four legs is read as an animal's, whose forelegs are arms; otherwise it is an error.
    """

    fps: float | None = None
    up: Literal["y", "z"] | None = None
    unit: float | None = None
    joints: str | None = None
    columns: Path | None = None
    as_person: bool = False
    animals: bool = False
