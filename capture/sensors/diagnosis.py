"""Why nothing moves: the problems that the report of a source shows, as text and as JSON."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from capture.sensors.source_report import PerformerReport, SourceReport
from capture.skeleton import JOINTS
from capture.trackers.picture import Picture

BLACK_BRIGHTNESS, DARK_BRIGHTNESS = 10.0, 40.0
"""Mean brightness, of 255, below which an image counts as black, and as dark."""
NO_DEPTH_SHARE, LITTLE_DEPTH_SHARE = 0.02, 0.25
"""Share of pixels with depth below which a sensor measures no depth, and little depth."""
MIN_DISTANCE_METRES, MAX_DISTANCE_METRES = 0.8, 4.5
"""Range in which depth sensors measure a performer well, in metres."""
MIN_FRAME_RATE = 12.0
"""Frame rate below which motion visibly stutters, in frames per second."""
FROZEN_FRAMES = 10
"""Number of frames with exactly the same pose that shows that the sender tracks no performer."""
MAX_INFERRED_JOINTS = 8
"""Number of inferred joints that is normal: senders of 15 joints leave out 5, and a side view hides some."""

STATUS_SECONDS = 2.0
"""Period that a status line describes, in seconds."""


@dataclass(frozen=True)
class Problem:
    """A reason why nothing moves, or why motion is poor.

    Attributes
    ----------
    what : str
        The problem, as a sentence.
    fix : str
        What to do, as a sentence; empty if `what` states it or nothing can be done.
    """

    what: str
    fix: str = ""


def diagnose(report: SourceReport) -> list[Problem]:
    """Return the problems that a report shows, the most important first."""
    found = [] if report.picture is None else list(_image_problems(report.picture))
    if not report.performers:
        return [*found, *_absence_problems(report)]
    for user, performer in sorted(report.performers.items()):
        found += _performer_problems(f"User {user}", performer, report)
    return [*found, _failure(report)] if report.failure else found


def describe(performer: PerformerReport) -> str:
    """Return one line about how well a performer is tracked."""
    rate = "" if performer.rate is None else f", {performer.rate:.0f} frames per second"
    tracked = f"{performer.tracked().sum()} of 20 joints tracked"
    return f"user {performer.newest.user}: {tracked}, {performer.distance:.2f} m away{rate}"


def status_line(report: SourceReport) -> str:
    """Return one line with the most important problem, what to do about it, and how well each performer is tracked.

    It may contain text of drivers and of the network, so unprintable characters, such as a terminal's control
    characters, become spaces.
    """
    problem = next(iter(diagnose(report)), Problem("No problems found."))
    performers = [describe(performer) for _, performer in sorted(report.performers.items())]
    line = " · ".join(text for text in (problem.what, problem.fix, *performers) if text)
    return "".join(character if character.isprintable() else " " for character in line)


def summary(report: SourceReport, problems: Sequence[Problem]) -> dict[str, Any]:
    """Return a report and its problems as plain values for JSON."""
    return {
        "source": report.source,
        "seconds": report.seconds,
        "received": report.received,
        "refused": report.refused,
        "picture": None if report.picture is None else _image_summary(report.picture),
        "performers": [
            {
                "user": user,
                "joints_seen": int(performer.tracked().sum()),
                "distance": performer.distance,
                "rate": performer.rate,
                "confidence": dict(zip(JOINTS, performer.newest.confidence.tolist(), strict=True)),
            }
            for user, performer in sorted(report.performers.items())
        ],
        "gone": sorted(report.gone),
        "sensor": None if report.sensor_tilt is None else asdict(report.sensor_tilt),
        "reasons": [asdict(problem) for problem in problems],
    }


def _image_summary(picture: Picture) -> dict[str, Any]:
    return {
        "width": picture.lens.width,
        "height": picture.lens.height,
        "brightness": None if picture.color is None else float(picture.color.mean()),
        "depth_known": None if picture.depth is None else float((picture.depth > 0).mean()),
    }


def _image_problems(picture: Picture) -> Iterator[Problem]:
    if picture.color is not None:
        brightness = float(picture.color.mean())
        if brightness < BLACK_BRIGHTNESS:
            yield Problem(
                "The image is black.", "Uncover the lens, switch on the light, and close other programs that use it."
            )
        elif brightness < DARK_BRIGHTNESS:
            yield Problem("The image is dark.", "Light the performer from the front.")
    if picture.depth is not None:
        share = float((picture.depth > 0).mean())
        if share < NO_DEPTH_SHARE:
            yield Problem(
                "The sensor measures no depth.",
                "Keep sunlight off, uncover the sensor's other windows, and stand at least 1 m away.",
            )
        elif share < LITTLE_DEPTH_SHARE:
            yield Problem(
                f"The sensor measures depth in {share:.0%} of the image.",
                "Keep sunlight off, and keep glass, mirrors and black cloth out of view.",
            )


def _failure(report: SourceReport) -> Problem:
    return Problem(report.failure, "The source is opened again twice per second." if report.retried else "")


def _absence_problems(report: SourceReport) -> Iterator[Problem]:
    if report.failure:
        yield _failure(report)
    elif report.refused:
        kinds = ", ".join(f"{reason} ({count} ×)" for reason, count in sorted(report.refused.items()))
        yield Problem(
            f"Packets arrived, but none were understood: {kinds}.",
            "Set the sender to one of the formats in docs/senders.md.",
        )
    elif not report.received and report.listens:
        yield Problem(
            f"No packet received for {report.silent:.0f} s.",
            "Start the sender, set it to this machine and port, and let UDP through the firewall.",
        )
    elif not report.received:
        yield Problem(f"No image received for {report.silent:.0f} s.", "Check the cable and the power supply.")
    elif report.listens:
        yield Problem("Packets arrive, but without a performer.", "Check that the sender's own window shows one.")
    else:
        yield Problem(
            "No performer is in view.",
            "Stand 1.5 to 3.5 m away and face the sensor, so that it sees you from head to foot.",
        )
    for user in sorted(report.gone):
        yield Problem(f"User {user} has left.")


def _performer_problems(name: str, performer: PerformerReport, report: SourceReport) -> Iterator[Problem]:
    known, picture = performer.known(), report.picture
    never = ~performer.ever_known
    if performer.still and performer.frames >= FROZEN_FRAMES:
        yield Problem(
            f"{name} does not move: {performer.frames} frames have exactly the same pose.",
            "Check whether the sender tracks a performer, or only shows a character at rest.",
        )
    if never.any() and report.listens:
        yield Problem(
            f"{name}: {never.sum()} of 20 joints never arrive: the sender sends {performer.ever_tracked.sum()}. "
            f"Missing: {_names(never)}.",
            "Set the sender to send the whole body, one position per joint, by the names in docs/senders.md.",
        )
    lost = ~known & (performer.ever_known | (not report.listens))
    if lost.any():
        yield Problem(f"{name}: lost joints: {_names(lost)}.", "Turn to the sensor, with nothing in between.")
    inferred = known & ~performer.tracked()
    if inferred.sum() > MAX_INFERRED_JOINTS:
        yield Problem(
            f"{name}: {inferred.sum()} of 20 joints are inferred: {_names(inferred)}.",
            "Face the sensor from 1.5 to 3.5 m away, from head to foot in its image and in good light.",
        )
    if picture is not None and (outside := known & ~_inside(performer, picture)).any():
        yield Problem(f"{name}: joints outside the image: {_names(outside)}.", "Step back, or tilt the sensor.")
    in_range = MIN_DISTANCE_METRES < performer.distance < MAX_DISTANCE_METRES
    if picture is not None and picture.depth is not None and not in_range:
        yield Problem(
            f"{name} is {performer.distance:.1f} m away.",
            f"Stay between {MIN_DISTANCE_METRES:g} and {MAX_DISTANCE_METRES:g} m from the sensor.",
        )
    if performer.rate is not None and performer.rate < MIN_FRAME_RATE:
        yield Problem(
            f"{name}: only {performer.rate:.0f} frames per second arrive.",
            "Give a camera more light, or reduce the load of this machine or the network.",
        )


def _inside(performer: PerformerReport, picture: Picture) -> NDArray[np.bool_]:
    """Return (20,) whether a joint is in front of the sensor and inside its image."""
    positions = performer.newest.positions
    in_front = positions[:, 2] > 0
    pixels = picture.lens.project(np.where(in_front[:, None], positions, 1.0))
    return in_front & (pixels >= 0).all(axis=1) & (pixels < [picture.lens.width, picture.lens.height]).all(axis=1)


def _names(joints: NDArray[np.bool_]) -> str:
    """Return the chosen joints in plain words: left hand, hip center."""
    named = [re.sub("(.+)_(left|right)", r"\2 \1", name).replace("_", " ") for name in JOINTS]
    return ", ".join(name for name, chosen in zip(named, joints, strict=True) if chosen)
