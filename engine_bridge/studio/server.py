"""Starts and stops the studio."""

import asyncio
import contextlib
import logging
import os
import signal
import socket
import tempfile
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path

import platformdirs
from aiohttp import web

from engine_bridge.service.security.credentials import make_token, read_token
from engine_bridge.studio.backend.backend import Backend
from engine_bridge.studio.backend.joined_studio import JoinedStudio
from engine_bridge.studio.project.workspace import Workspace
from engine_bridge.studio.screen.kiosk import VisitorsKiosk
from engine_bridge.studio.screen.screen_key import ScreenKey
from engine_bridge.studio.service.joined_service import JoinedService
from engine_bridge.studio.service.own_service import OwnService
from engine_bridge.studio.web.page_access import Addresses, Tokens, check_exposure
from engine_bridge.studio.web.phone_app import serve_films, serve_phones
from engine_bridge.studio.web.web_app import PAGE, Access, make_app
from puppetline.errors import ServiceError

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class StudioSettings:
    """Settings of the studio.

    Attributes
    ----------
    folder : Path
        Folder of the workspace.
    host : str
    port : int
        0 for any free port.
    origins : tuple of str
        Further addresses that lead to the studio.
    token_file : Path or None
        Token for pages, required if other machines can connect.
    first : Path or None
        Puppet file or mesh to open at the start.
    page : Path
        Folder of the built page.
    service : str or None
        ``HOST:PORT`` of a service to join, instead of starting one.
    service_token : str or None
        Token of that service.
    sound : str or None
        Microphone, or .wav, that the studio's own service hears from the start.
    kiosk : Path or None
        Service file of the service to join, whose ``[kiosk]`` has a screen.
    """

    folder: Path
    host: str = "127.0.0.1"
    port: int = 7480
    origins: tuple[str, ...] = ()
    token_file: Path | None = None
    first: Path | None = None
    page: Path = PAGE
    service: str | None = None
    service_token: str | None = field(default=None, repr=False)
    sound: str | None = None
    kiosk: Path | None = None

    @property
    def windows(self) -> Path | None:
        """File with the hashes of the tokens of open windows; none for a free port, which is another one each time."""
        return self._kept("windows")

    @property
    def screen_key(self) -> Path | None:
        """File with the key of screens; none for a free port."""
        return self._kept("screen-key")

    def _kept(self, name: str) -> Path | None:
        if self.service is None:
            return self.folder / name
        return platformdirs.user_state_path("puppetline") / f"{name}-{self.port}" if self.port else None


def studio_folder() -> Path:
    """Return the folder of this user's workspace."""
    return platformdirs.user_data_path("puppetline") / "studio"


@dataclass(frozen=True)
class Served:
    """A studio that is served.

    Attributes
    ----------
    studio : Backend
    port : int
    link : callable
        Makes a link with a new one-time token.
    screen : str
        Address of the screen: of the kiosk, or of the characters on a transparent ground.
    phones : str or None
        Address for visitors' phones; None without a kiosk or network.
    """

    studio: Backend
    port: int
    link: Callable[[], str]
    screen: str
    phones: str | None


@asynccontextmanager
async def served(settings: StudioSettings, entered: Callable[[], None] = lambda: None) -> AsyncIterator[Served]:
    """Serve the studio until the block ends.

    Parameters
    ----------
    settings : StudioSettings
    entered : callable
        Called when a one-time token was used.

    Raises
    ------
    PuppetlineError
        A setting is refused, the folder cannot be written, or the port is in use.
    """
    fixed = None if settings.token_file is None else read_token(settings.token_file)
    check_exposure(Addresses(settings.host, settings.port, settings.origins), fixed)
    tokens = Tokens(fixed, settings.windows)
    kiosk = None if settings.kiosk is None else VisitorsKiosk.of_service_file(settings.kiosk)
    async with contextlib.AsyncExitStack() as stack:
        links: list[Callable[[], str]] = []
        own = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="puppetline-")))
        studio = _backend(settings, own, {} if kiosk is None else kiosk.puppets, lambda: links[0]())
        screens = ScreenKey(settings.screen_key or own / "screen-key")
        stack.push_async_callback(studio.close)
        listener = _bound(Addresses(settings.host, settings.port).bound, settings.port)
        port = listener.getsockname()[1]
        addresses = Addresses(settings.host, port, settings.origins)
        links.append(lambda: addresses.link(tokens.invite()))
        app = make_app(studio, Access(addresses, tokens, screens, entered), settings.page, kiosk)
        runner = web.AppRunner(app, access_log=None, shutdown_timeout=1.0)
        await runner.setup()
        stack.push_async_callback(runner.cleanup)
        await web.SockSite(runner, listener).start()
        opening = asyncio.create_task(studio.begin(settings.first))
        stack.callback(opening.cancel)
        if kiosk is not None and kiosk.table.phone_port:
            stack.callback(asyncio.create_task(serve_phones(kiosk)).cancel)
        path = "/stage?transparent" if kiosk is None else "/kiosk"
        screen = f"{addresses.first}{path}#key={screens.text}"
        yield Served(studio, port, links[0], screen, None if kiosk is None else kiosk.phone_address)


async def run(settings: StudioSettings, started: Callable[[Served], None], entered: Callable[[], None]) -> None:
    """Serve the studio until SIGINT or SIGTERM."""
    stop = asyncio.Event()
    with _signals_call(stop.set):
        async with served(settings, entered) as studio:
            started(studio)
            await stop.wait()


@contextlib.contextmanager
def _signals_call(do: Callable[[], object]) -> Iterator[None]:
    """Call a function in the event loop after SIGINT, SIGTERM or SIGBREAK; Windows has no `loop.add_signal_handler`."""
    loop = asyncio.get_running_loop()
    with contextlib.ExitStack() as undo:
        for name in ("SIGINT", "SIGTERM", "SIGBREAK"):
            number = getattr(signal, name, None)  # only Windows has the last one
            if number is None:
                continue
            before = signal.signal(number, lambda *_: loop.call_soon_threadsafe(do))
            undo.callback(signal.signal, number, before)
        yield


def _backend(settings: StudioSettings, own: Path, puppets: dict[str, Path], invite: Callable[[], str]) -> Backend:
    if settings.service is None:
        from engine_bridge.studio.backend.studio import Studio  # importing it takes a while, and a kiosk waits

        workspace = Workspace(settings.folder)
        service = OwnService(workspace.folder, _service_token(workspace.folder))
        return Studio(workspace, service, invite, serve_films, settings.sound)
    joined = JoinedService(settings.service, settings.service_token)
    return JoinedStudio(Workspace(own), joined, invite, puppets)  # another studio may use the folder


def _service_token(folder: Path) -> str:
    """Write a new token for the service that the studio starts, and return it."""
    path = folder / "token"
    path.unlink(missing_ok=True)
    make_token(path)
    return str(read_token(path))


def _bound(address: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    try:
        return socket.create_server((address, port), family=family)
    except OSError as error:
        raise ServiceError(
            "--port",
            found=f"the port {port}, which cannot be used ({os.strerror(error.errno or 0)})",
            expected="a port that no other program uses",
            fix="Close the other program, or choose another port.",
        ) from error
