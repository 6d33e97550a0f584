"""Options of the commands that convert recordings, and the settings that follow from them."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from engine_bridge.cli import options
from engine_bridge.cli.options import Finite
from puppetline.errors import OutputError

if TYPE_CHECKING:
    from engine_bridge.performance.settings import Settings

_PART = (
    click.option("--user", type=int, help="User number of the performer.  [default: the one tracked longest]"),
    click.option(
        "--start",
        default=0.0,
        show_default=True,
        type=Finite(0),
        metavar="SECONDS",
        help="Time at which the clip begins.",
    ),
    click.option(
        "--stop", type=Finite(0), metavar="SECONDS", help="Time at which it ends.  [default: the recording's end]"
    ),
)
_READING = (
    click.option(
        "--rest-at",
        type=Finite(0),
        metavar="SECONDS",
        help="Time at which the performer's pose matches the character's rest pose.  [default: the calibration in a "
        "take, otherwise 0]",
    ),
    click.option("--fps", default=30.0, show_default=True, type=Finite(1, 240), help="Keyframes per second."),
    click.option(
        "--max-gap",
        default=0.4,
        show_default=True,
        type=Finite(0),
        metavar="SECONDS",
        help="Interpolate a joint over gaps up to this long; over longer gaps, hold its last position.",
    ),
    click.option(
        "--log-fps", type=Finite(0, min_open=True), metavar="FPS", help="Frame rate of a recording without timestamps."
    ),
    click.option("--log-up", type=click.Choice(["y", "z"]), help="Up axis of a recording.  [default: detected]"),
    click.option(
        "--log-unit",
        type=Finite(0, min_open=True),
        metavar="METRES",
        help="Length unit of a recording.  [default: detected]",
    ),
    click.option(
        "--joints",
        metavar="NAME",
        help="Order of the joints in a table or array without names, for example kinect_v2.  [default: detected]",
    ),
    click.option(
        "--columns",
        type=options.FILE,
        help='TOML file that names the columns of a table: Head = ["HX", "HY", "HZ"].  [default: by their names]',
    ),
    click.option("--as-person", is_flag=True, help="Read a four-legged skeleton as a person's."),
)
_WRITING = (
    click.option(
        "--as",
        "form",
        type=click.Choice(["rig", "morph", "frames"]),
        help="What is animated: named joints, of the skeleton in the character's file or of a new one; a few morph "
        "targets; or a morph target per keyframe, for short clips.  [default: rig if the puppet has limbs, otherwise "
        "morph]",
    ),
    click.option(
        "--tolerance",
        type=Finite(0, 1, min_open=True),
        help="Largest error of a vertex, as a fraction of the character's diagonal; for a rig, of its keyframes.  "
        "[default: 0.0005; for a rig 0.0001]",
    ),
    options.targets,
    options.keep_skin,
)

reading_options = options.together(_READING)
"""Adds the options for how a recording is read."""

settings_options = options.together((*_READING, *_WRITING))
"""Adds the options for how a recording is read and for what is written."""

clip_options = options.together((*_PART, *_READING, *_WRITING))
"""Adds all these, and the options for which part of a recording is converted."""


def reading_settings(**choices: Any) -> "Settings":
    """Return the settings of a recording that is read.

    Parameters
    ----------
    **choices
        Values of the options, and other fields of the settings.
    """
    from capture.formats.options import ReadOptions
    from engine_bridge.performance.settings import Settings

    read_options = ReadOptions(
        fps=choices.pop("log_fps"),
        up=choices.pop("log_up"),
        unit=choices.pop("log_unit"),
        joints=choices.pop("joints"),
        columns=choices.pop("columns"),
        as_person=choices.pop("as_person"),
    )
    return Settings(log=read_options, **choices)


def settings(**choices: Any) -> "Settings":
    """Return the settings of a conversion.

    Parameters
    ----------
    **choices
        Values of the options, and other fields of the settings.

    Raises
    ------
    click.UsageError
        Options that do not fit each other.
    """
    if choices["targets"] is not None:
        choices["form"] = choices["form"] or "morph"
        if choices["form"] != "morph":
            raise click.UsageError("--targets requires --as morph.")
    return reading_settings(**choices)


def refuse_without_puppet(**choices: Any) -> None:
    """Check that no option about a character is used.

    Raises
    ------
    click.UsageError
    """
    names = {"form": "as", "rest_at": "rest-at"}
    for option in ("form", "tolerance", "targets", "rest_at", "preview"):
        if choices.get(option):
            raise click.UsageError(f"--{names.get(option, option)} is about a character and requires --puppet.")
    if not choices.get("keep_skin", True):
        raise click.UsageError("--new-skin is about a character and requires --puppet.")


def check_output(output: Path, has_puppet: bool) -> None:
    """Check that the file is for an animation: no avatar, and with a puppet no animation without a character.

    Raises
    ------
    OutputError
    """
    ending = output.suffix.lower()
    if ending == ".vrm":
        raise OutputError(
            output,
            found="the ending '.vrm', of an avatar",
            expected="a file that contains an animation",
            fix=f"Write the animation as {output.stem}.vrma, without --puppet, and the avatar with puppetline rig.",
        )
    if has_puppet and ending in (".bvh", ".vrma"):
        raise OutputError(
            output,
            found=f"the ending {ending!r}, of an animation of the performer's own skeleton, and a puppet",
            expected="'.glb' for a character",
            fix=f"Omit --puppet, or call it {output.stem}.glb.",
        )
