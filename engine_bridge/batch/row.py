"""A row of the manifest: one result, or the reason why there is none."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Row:
    """A result, or a recording or performer without one. Unknown values are None.

    Attributes
    ----------
    state : {"done", "failed"}
    output : str
        Path of the result relative to the folder of the batch; empty if it failed.
    log, puppet : str
        Absolute paths; no puppet for an animation of the performer.
    format : str or None
        Format of the recording.
    user : int or None
        User number of the performer.
    form : str or None
        Form of the animation: "morph", "frames" or "rig", or "bvh", "vrma" or "glb" for that of the
        performer; None for the one that suits the puppet.
    frames, seconds, keyframes
        Number of frames and duration of the clip, and number of keyframes in the file.
    targets, bones
        Numbers of morph targets and joints.
    error, rms, stretch_p1, stretch_p50, stretch_p99, parts_apart
        See `engine_bridge.export.convert.Summary`.
    bytes : int or None
        Size of the result.
    conversion_seconds : float
        Time that the conversion took.
    notes : tuple of str
        Sentences about the recording and the character.
    reason, message : str
        The part of the error message that says what was found, and the whole message; empty for a result.
    key : str
        Hash of all that determines the result; empty if the recording cannot be read.
    """

    state: Literal["done", "failed"]
    output: str
    log: str
    puppet: str
    format: str | None
    user: int | None
    form: str | None
    frames: int | None = None
    seconds: float | None = None
    keyframes: int | None = None
    targets: int | None = None
    bones: int | None = None
    error: float | None = None
    rms: float | None = None
    stretch_p1: float | None = None
    stretch_p50: float | None = None
    stretch_p99: float | None = None
    parts_apart: float | None = None
    bytes: int | None = None
    conversion_seconds: float = 0.0
    notes: tuple[str, ...] = ()
    reason: str = ""
    message: str = ""
    key: str = ""
