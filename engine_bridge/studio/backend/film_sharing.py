"""Shares films of the studio with phones in the same network."""

import asyncio
import base64
import contextlib
import shutil
import socket
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

from engine_bridge.service.kiosk.clip import new_code
from engine_bridge.studio.long_work.worker import Worker
from engine_bridge.studio.messages.film import ShareReply
from engine_bridge.studio.project.workspace import Workspace
from engine_bridge.studio.screen.phone_address import phone_address
from engine_bridge.studio.screen.shared_films import FilmFolder, Films, free_listener, qr_code
from puppetline.errors import ServiceError

PORT = 7482
"""Port for phones, the next one after that of a kiosk's; if it is in use, any other."""

MAX_SHARED = 8
"""Number of films that are shared; the oldest ones are deleted."""

NOTE = "Save the film, or watch it while the studio is open."


Serve = Callable[[Films, socket.socket, str], Coroutine[Any, Any, None]]
"""Serves films to phones until it is cancelled, with a note on each page."""


class FilmSharing:
    """The films that phones can open. The port is open from the first film on that is shared.

    Parameters
    ----------
    workspace : Workspace
    worker : Worker
    serve : callable
        See `Serve`.
    """

    def __init__(self, workspace: Workspace, worker: Worker, serve: Serve) -> None:
        self._workspace, self._worker, self._serve = workspace, worker, serve
        self._films = FilmFolder(workspace.folder / "shared")
        self._port = 0
        self._serving: asyncio.Task[None] | None = None

    async def share(self, film: Path) -> ShareReply:
        """Let phones open a film.

        Raises
        ------
        ServiceError
            There is no network.
        """
        if phone_address(None, PORT) is None:
            raise ServiceError(
                "the network",
                found="no address that a phone reaches",
                expected="a network, such as a wireless one",
                fix="Connect this computer and the phone to the same network.",
            )
        path = self._films.path / f"{new_code()}.mp4"
        path.parent.mkdir(mode=0o700, exist_ok=True)
        for old in sorted(path.parent.glob("*.mp4"), key=lambda each: each.stat().st_mtime)[: 1 - MAX_SHARED]:
            for each in path.parent.glob(f"{old.stem}.*"):
                each.unlink()
        await asyncio.to_thread(shutil.copyfile, film, path)
        await self._worker.run("share_film", path)
        if self._serving is None or self._serving.done():
            listener = free_listener(PORT)
            self._port = listener.getsockname()[1]
            self._serving = asyncio.create_task(self._serve(self._films, listener, NOTE))
        address = f"{phone_address(None, self._port)}/{path.stem}"
        poster = self._workspace.offer(path.with_suffix(".jpg"), f"{film.stem}.jpg", "export")
        code = base64.b64encode(qr_code(address)).decode()
        return ShareReply(address=address, code=code, poster=poster.id, poster_name=poster.name)

    async def close(self) -> None:
        """Close the port."""
        if self._serving is not None:
            self._serving.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._serving
