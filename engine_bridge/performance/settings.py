"""What a user may choose for one conversion."""

from dataclasses import dataclass, field
from typing import Literal

from capture.formats.options import ReadOptions

Form = Literal["morph", "skin", "frames", "rig"]

TOLERANCE: dict[Form, float] = {"morph": 0.0005, "skin": 0.002, "frames": 0.0, "rig": 0.0}
"""Largest error as a fraction of the diagonal where the user does not say: a few rigid bones follow less closely."""


@dataclass(frozen=True)
class Settings:
    """What a user may choose for one conversion.

    Attributes
    ----------
    user : int or None
        The performer; None for the longest tracked.
    fps : float
        Keyframes a second.
    max_gap : float
        Seconds without a joint that are bridged; over longer gaps it is held.
    rest_at : float
        Second of the log at which the performer stands as the character does at rest.
    form : {"morph", "skin", "frames", "rig"}
        What the animation is made of: a few morph targets, bones, a morph target for each keyframe, or the joints of
        the file's own skeleton.
    tolerance : float or None
        Largest error of the animation against the solver, as a fraction of the diagonal; None for that of `TOLERANCE`.
    targets : int or None
        A limit to the number of morph targets, at least 2.
    bones : int or None
        The number of bones.
    log : ReadOptions
        What the log does not say itself.
    """

    user: int | None = None
    fps: float = 30.0
    max_gap: float = 0.4
    rest_at: float = 0.0
    form: Form = "morph"
    tolerance: float | None = None
    targets: int | None = None
    bones: int | None = None
    log: ReadOptions = field(default_factory=ReadOptions)

    @property
    def allowed(self) -> float:
        """The tolerance that holds."""
        return TOLERANCE[self.form] if self.tolerance is None else self.tolerance
