"""Settings of a conversion."""

from dataclasses import dataclass, field, replace
from typing import Literal, Self

from capture.formats.options import ReadOptions
from engine_bridge.puppet.puppet import Puppet

Form = Literal["morph", "frames", "rig"]

PerformerFormat = Literal["bvh", "vrma", "glb"]
"""Formats of animations of performers themselves, which are the endings of their files."""

DEFAULT_TOLERANCES: dict[Form, float] = {"morph": 0.0005, "frames": 0.0, "rig": 0.0001}
"""Default tolerance of each form, as a fraction of the diagonal. That of a rig is for its keyframes: its
error beside the solver's surface follows from its weights."""


@dataclass(frozen=True)
class Settings:
    """Settings of one conversion.

    Attributes
    ----------
    user : int or None
        User number of the performer; None for the one that was tracked longest.
    fps : float
        Keyframes per second.
    max_gap : float
        Maximum time for which a lost joint is interpolated, in seconds; in longer gaps it is held.
    rest_at : float or None
        Time of the performer's calibration pose in the recording, in seconds; None for the calibration of a take or, if
        it has none of the performer, for the pose at the start.
    start, stop : float, float or None
        Part of the recording that is animated, in seconds; None for its end. The motion is computed for the whole
        recording, so that it is the same in the part.
    form : {"morph", "frames", "rig"} or None
        Form of the animation: a few morph targets, one morph target per keyframe, or named joints, which are
        those of the file's own skeleton if it can move the puppet's limbs, and otherwise of a new one. None for a rig
        if the puppet has limbs, else morph targets; see `for_puppet`.
    tolerance : float or None
        Maximum error of the animation relative to the solver, as a fraction of the diagonal; None for the default.
    targets : int or None
        Maximum number of morph targets, at least 2.
    keep_skin : bool
        Whether a file with a skeleton that can move the puppet's limbs keeps it.
    log : ReadOptions
        Properties of the recording that its file does not contain.
    """

    user: int | None = None
    fps: float = 30.0
    max_gap: float = 0.4
    rest_at: float | None = None
    start: float = 0.0
    stop: float | None = None
    form: Form | None = None
    tolerance: float | None = None
    targets: int | None = None
    keep_skin: bool = True
    log: ReadOptions = field(default_factory=ReadOptions)

    @property
    def max_error(self) -> float:
        """The tolerance, or the default one of the form."""
        return DEFAULT_TOLERANCES[self.form or "morph"] if self.tolerance is None else self.tolerance

    def for_puppet(self, puppet: Puppet) -> Self:
        """Return the settings with the form that suits a puppet, if they have none."""
        return self if self.form is not None else replace(self, form="rig" if puppet.limb else "morph")
