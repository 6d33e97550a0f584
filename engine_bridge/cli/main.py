"""The command `puppetline`: finds the commands and reports their errors. Each command is imported when it is used."""

import logging
import os
import subprocess
from importlib import import_module
from pathlib import Path
from typing import Any

import click

import puppetline
from engine_bridge.cli.progress import interrupts
from puppetline.errors import PuppetlineError

COMMANDS = (
    "align",
    "animate",
    "bake",
    "batch",
    "bench",
    "clip",
    "convert",
    "demo",
    "doctor",
    "film",
    "inspect",
    "keys",
    "listen",
    "look",
    "new",
    "record",
    "rig",
    "serve",
    "shader-mesh",
    "studio",
    "token",
)
"""Names of the commands. Each is a function in a module of this package, both named like it, with "_" for "-"."""


class _Commands(click.Group):
    """Imports commands, and turns errors into one line on standard error and exit code 1."""

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        if cmd_name not in COMMANDS:
            return None
        function = cmd_name.replace("-", "_")
        command: click.Command = getattr(import_module(f"engine_bridge.cli.{function}"), function)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        # Path raises errors for some names
        if args[0] not in COMMANDS and (Path(args[0]).suffix or os.path.exists(args[0])):  # noqa: PTH110
            from engine_bridge.cli.suggestions import suggestions

            return suggestions.name, suggestions, args
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        try:
            with interrupts():
                return super().invoke(ctx)
        except PuppetlineError as error:
            click.echo(f"puppetline: {error}", err=True)
            ctx.exit(1)
        except (click.ClickException, click.exceptions.Exit):
            raise
        except KeyboardInterrupt:
            click.echo("puppetline: stopped", err=True)
            ctx.exit(1)
        except BrokenPipeError:  # the program that read the output has ended; click exits quietly
            raise
        except Exception as error:
            if os.environ.get("PUPPETLINE_DEBUG"):
                raise
            click.echo(
                f"puppetline: internal error: {type(error).__name__}: {error}. "
                "Please report it with the output of the same command under PUPPETLINE_DEBUG=1.",
                err=True,
            )
            ctx.exit(1)


def _commit() -> str:
    """Return the commit of a checkout, in brackets, and whether files have changed; "" if this is none."""
    root = Path(__file__).parents[2]
    if not (root / ".git").exists():  # it was installed, or this is a folder inside some other repository
        return ""
    describe = ["git", "-C", str(root), "describe", "--always", "--exclude=*", "--dirty=, changed"]
    try:
        result = subprocess.run(describe, capture_output=True, text=True, timeout=10)  # noqa: S603 - fixed arguments
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return f" (commit {result.stdout.strip()})" if result.returncode == 0 else ""


def _show_version(ctx: click.Context, _: click.Parameter, wanted: bool) -> None:
    if wanted and not ctx.resilient_parsing:
        click.echo(f"{ctx.info_name}, version {puppetline.__version__}{_commit()}")
        ctx.exit()


@click.group(
    cls=_Commands,
    commands={name: click.Command(name) for name in COMMANDS},  # names only: `get_command` imports the commands
    context_settings={"help_option_names": ["-h", "--help"]},
)
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_show_version,
    help="Show the version and exit.",
)
def main() -> None:
    """Animate any character mesh with a performer's skeleton.

    \b
    First commands:
      puppetline demo                     animate example characters
      puppetline studio                   animate your own, in a browser
      puppetline animate MESH RECORDING   animate a mesh with a recording
    """  # noqa: D301 - click wants the character
    logging.basicConfig(format="puppetline: %(message)s", level=logging.WARNING)
