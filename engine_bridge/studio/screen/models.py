"""Files with the materials of a service's characters, which a process of low priority makes beside the page."""

import asyncio
import contextlib
import logging
import sys
from pathlib import Path

from puppetline.child_process import bound_to_parent, lower_priority

LOW_PRIORITY = 10
"""Niceness of the process."""

log = logging.getLogger(__name__)


class Models:
    """Models of characters; a screen draws with plain materials until they are made.

    Parameters
    ----------
    puppets : dict of str to Path
        Puppet files of characters by their names.
    folder : Path
        Folder for the models.

    Attributes
    ----------
    made : dict of str to Path
        The models that there are, by the names of the characters.
    """

    def __init__(self, puppets: dict[str, Path], folder: Path) -> None:
        self._puppets, self._folder = puppets, folder
        self.made: dict[str, Path] = {}
        self._maker = asyncio.create_task(self._make())

    async def close(self) -> None:
        """End the process."""
        self._maker.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self._maker

    async def _make(self) -> None:
        for name, puppet in self._puppets.items():
            path = self._folder / f"{name}.glb"
            try:
                code, errors = await _run("shader-mesh", str(puppet), "-o", str(path))
            except OSError as error:
                code, errors = None, str(error)
            if code == 0:
                self.made[name] = path
            else:
                log.warning("%s is drawn without its materials: %s", name, errors.strip()[-500:])


async def _run(*command: str) -> tuple[int, str]:
    """Run a command of `puppetline`; return its exit code and its errors. The process ends when this is cancelled."""
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-P", "-m", "puppetline", *command),
        stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.PIPE,
        **bound_to_parent(),
    )
    try:
        lower_priority(process.pid, LOW_PRIORITY)
        assert process.stderr is not None  # noqa: S101 - a pipe was asked for
        errors = await process.stderr.read()
        return await process.wait(), errors.decode(errors="replace")
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
