"""Options that several commands have, the types of their values, and the output that `--json` asks for."""

import json
import math
import shlex
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import reduce
from pathlib import Path
from typing import Any, TypeVar

import click

FILE = click.Path(path_type=Path)

Function = TypeVar("Function", bound=Callable[..., Any])


class Finite(click.FloatRange):
    """A finite number in a range; "nan" and "inf" are refused."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Read a number, or report why it is refused."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


def output(what: str, default: str | None = None) -> Callable[[Function], Function]:
    """Return the option for the file to write.

    Parameters
    ----------
    what : str
        What the file is, for the help text.
    default : str, optional
        Pattern of the name that the file gets otherwise, in the current folder; without it, the option is required.
    """
    if default is None:
        return click.option("-o", "--output", required=True, type=FILE, help=what)
    return click.option("-o", "--output", type=FILE, help=f"{what}  [default: {default}]")


def named(output: Path | None, default: str, force: bool) -> Path:
    """Return the file to write: the one that the user named, or a new one with a default name.

    Raises
    ------
    OutputError
        The user named none, and a file with the default name exists.
    """
    if output is not None:
        return output
    from puppetline.files import check_new

    if not force:
        check_new(Path(default), "Choose a name with -o, or replace it with --force.")
    return Path(default)


def quoted(path: Path) -> str:
    """Return a path as a shell takes it, for commands that are printed to be copied."""
    return shlex.quote(str(path))


def together(options: Sequence[Callable[[Function], Function]]) -> Callable[[Function], Function]:
    """Return the decorator that adds options to a command, in the order of the help text."""
    return lambda command: reduce(lambda function, option: option(function), reversed(options), command)


force = click.option("--force", is_flag=True, help="Replace an existing file that has the default name.")
as_json = click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
source = click.option("--source", required=True, metavar="URI", help="Source of skeletons, as in puppetline serve.")
targets = click.option(
    "--targets", type=click.IntRange(2), metavar="K", help="Maximum number of morph targets, whatever the error."
)
keep_skin = click.option(
    "--keep-skin/--new-skin",
    default=True,
    help="Keep the skeleton and weights of a file if they can move the limbs, or make new ones.  [default: keep]",
)


def show(result: object, as_json: bool, *lines: str) -> None:
    """Print a result, of dataclasses and plain values: as JSON, or as the lines that describe it."""
    click.echo(json.dumps(result, indent=2, default=asdict) if as_json else "\n".join(lines))
