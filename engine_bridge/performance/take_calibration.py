"""Finds the calibration of a performer in a take.

The cue ``stage`` at the beginning of a take has the calibrations in use at that time, and each cue ``begin`` has one
that was made later.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from capture import body
from capture.clip import SkeletonClip
from capture.events import Cue
from engine_bridge.performance.calibration import Calibration

MAX_METRES = 100.0
"""Maximum coordinate of a calibration pose and maximum height of its sensor, in metres; beyond it, it is damaged."""

IN_VIEW_SECONDS = 1.0
"""Time before a calibration within which a performer must have been tracked to be its performer, in seconds."""


@dataclass(frozen=True)
class TakeCalibration:
    """A calibration with which a performer drove a character in a take.

    Attributes
    ----------
    time : float
        Time from which it was used, the clock of the clip; that of the clip's first frame for the first one.
    calibration : Calibration
    mirror : bool or None
        Whether the performer's left moved the character's right; None in takes of an earlier version.
    """

    time: float
    calibration: Calibration
    mirror: bool | None


@dataclass(frozen=True)
class _Made:
    """A calibration in a take, None if it is damaged; `user` is the performer according to the cues, if known."""

    time: float
    user: int | None
    opening: bool
    calibration: Calibration | None
    mirror: bool | None = None


def of_performer(
    clips: Sequence[SkeletonClip], clip: SkeletonClip
) -> tuple[tuple[TakeCalibration, ...], tuple[str, ...]]:
    """Return the calibrations with which a performer drove a character in a take, in their order.

    The first is the one in use when the performer's clip begins, otherwise the first that was made later. Switching the
    mirror repeats a calibration.

    Parameters
    ----------
    clips : sequence of SkeletonClip
        Performers of the recording.
    clip : SkeletonClip
        The chosen performer, one of them.

    Returns
    -------
    calibrations : tuple of TakeCalibration
        Empty if the take has none of the performer.
    notes : tuple of str
        Sentences for the user about the origin of the calibration, and about damaged calibrations.
    """
    made = list(_made(clip.cues))
    damaged = sum(each.calibration is None for each in made)
    notes = (_about_damaged(damaged),) if damaged else ()
    own = [each for each in made if each.calibration is not None and _owner(each, clips) == clip.user]
    if not own:
        return (), notes
    used = next((each for each in reversed(own) if each.opening or each.time <= clip.times[0]), own[0])
    when = "was in use when the take began" if used.opening else f"was made at {used.time - clip.times[0]:.2f} s"
    notes = (*notes, f"The performer's calibration pose is the one in the take, which {when}.")
    found = [TakeCalibration(clip.times[0], _of(used), used.mirror)]
    for each in own[own.index(used) + 1 :]:
        if not _same(found[-1], each):
            found.append(TakeCalibration(each.time, _of(each), each.mirror))
    if len(found) > 1:
        times = ", ".join(f"{each.time - clip.times[0]:.2f}" for each in found[1:])
        notes = (*notes, f"It was calibrated or mirrored again at {times} s.")
    return tuple(found), notes


def _of(made: _Made) -> Calibration:
    assert made.calibration is not None  # noqa: S101 - damaged ones have been sorted out
    return made.calibration


def _same(before: TakeCalibration, made: _Made) -> bool:
    """Tell whether a calibration repeats the one before, as after a change of the mapping."""
    return (before.calibration.to_json(), before.mirror) == (_of(made).to_json(), made.mirror)


def _made(cues: Sequence[Cue]) -> Iterator[_Made]:
    """Yield the calibrations of a take in its order, damaged ones without their values."""
    users: dict[str, int | None] = {}
    for cue in cues:
        character = cue.arguments.get("character")
        if cue.do == "stage":
            for name, state in _states(cue).items():
                users[name] = _number(state.get("user"))
                if state.get("calibration") is not None:
                    yield _Made(cue.time, users[name], True, *_valid(state["calibration"]))
        elif cue.do == "choose_user" and isinstance(character, str):
            users[character] = _number(cue.arguments.get("user"))
        elif cue.do == "begin":
            user = users.get(character) if isinstance(character, str) else None
            yield _Made(cue.time, user, False, *_valid(cue.arguments.get("calibration")))


def _states(cue: Cue) -> dict[str, dict[str, Any]]:
    """Return the states of the characters in a cue ``stage``."""
    states = cue.arguments.get("characters")
    if not isinstance(states, dict):
        return {}
    return {name: state for name, state in states.items() if isinstance(state, dict)}


def _valid(value: Any) -> tuple[Calibration | None, bool | None]:
    """Return the calibration of a cue and its mirroring; None if it is damaged."""
    try:
        found = Calibration.of_json(value)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError):
        return None, None
    mirror = value.get("mirror")
    extent = np.abs(np.append(found.rest, found.sensor.height))
    known = np.isfinite(found.rest).all(axis=1)
    if not known.any() or np.isinf(extent).any() or np.nanmax(extent) > MAX_METRES:
        return None, None
    is_body = max(body.bone_lengths(found.rest).values()) > 0
    return (found, mirror if isinstance(mirror, bool) else None) if is_body else (None, None)


def _number(user: Any) -> int | None:
    return user if type(user) is int else None


def _owner(made: _Made, clips: Sequence[SkeletonClip]) -> int | None:
    """Return the user number of a calibration's performer.

    It is the one in the cue at the beginning of the take, or the only one of the recording. Otherwise, it is the one
    according to the cues if in view, else the one whose pose is nearest to the calibration pose.
    """
    if made.opening or made.calibration is None:
        return made.user
    if len(clips) == 1:
        return clips[0].user
    distances = {}
    for clip in clips:
        recent = (made.time - IN_VIEW_SECONDS <= clip.times) & (clip.times <= made.time)
        apart = np.linalg.norm(clip.positions[recent] - made.calibration.rest, axis=-1)
        if np.isfinite(apart).any():
            distances[clip.user] = float(np.nanmedian(apart))
    if made.user in distances:
        return made.user
    return min(distances, key=distances.__getitem__, default=None)


def _about_damaged(count: int) -> str:
    if count == 1:
        return "A calibration in the take is damaged and was ignored."
    return f"{count} calibrations in the take are damaged and were ignored."
