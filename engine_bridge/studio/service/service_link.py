"""The studio's connection to a service: its reports, and requests to it."""

import asyncio
import contextlib
from collections.abc import Callable
from typing import Any

from engine_bridge.studio.messages.state import ServiceState
from engine_bridge.studio.service.control_link import ControlLink
from engine_bridge.studio.service.service_process import Reached
from puppetline.errors import PuppetlineError, ServiceError

POLL_SECONDS = 0.5
"""Interval at which the service is asked for its status, in seconds."""

DESCRIBE_SECONDS = 2.0
"""Maximum time for the status, in seconds; a service that takes longer counts as not running."""


class ServiceLink:
    """A service, started by the studio or elsewhere: its reports, and requests to it."""

    def __init__(self) -> None:
        self._described: dict[str, Any] = {}  # the last reply to `describe`, of the service `_linked`
        self._watcher: Callable[[], None] = lambda: None
        self._link: ControlLink | None = None
        self._linked: Reached | None = None
        self._poller = asyncio.create_task(self._poll())

    @property
    def state(self) -> ServiceState:
        """State of the service."""
        raise NotImplementedError

    @property
    def reached(self) -> Reached | None:
        """Its addresses and token; None while it does not run."""
        raise NotImplementedError

    @property
    def described(self) -> dict[str, dict[str, Any]]:
        """The service's facts of each character, by name (docs/control.md, `describe`); empty while it does not run."""
        return {each["name"]: each for each in self._present.get("characters", [])}

    @property
    def status(self) -> dict[str, Any]:
        """Its status; empty while it does not run."""
        status: dict[str, Any] = self._present.get("status", {})
        return status

    @property
    def _present(self) -> dict[str, Any]:
        """What the service said of itself, unless another has taken its place since."""
        return self._described if self._linked is self.reached else {}

    def watch(self, watcher: Callable[[], None]) -> None:
        """Call a function when something has changed."""
        self._watcher = watcher

    async def request(self, do: str, **arguments: Any) -> Any:
        """Send a request of docs/control.md.

        Raises
        ------
        ServiceError
            The service's own error, or it does not run.
        """
        link = await self._connected()
        if link is None:
            raise self._absence()
        return await link.request(do, **arguments)

    async def close(self) -> None:
        """End the connection."""
        self._poller.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self._poller
        if self._link is not None:
            await self._link.close()

    async def refresh(self) -> None:
        """Ask for the service's status now."""
        described: dict[str, Any] = {}
        link = await self._connected()
        if link is not None:
            with contextlib.suppress(PuppetlineError):
                described = await link.request("describe", timeout=DESCRIBE_SECONDS)
        if link is self._link and described != self._described:
            self._described = described
            self._watcher()

    def _absence(self) -> ServiceError:
        """Return the error for a request without a service."""
        return ServiceError(
            "the service",
            found="a service that is not running",
            expected="a running service",
            fix="Try again in a second.",
        )

    async def _connected(self) -> ControlLink | None:
        """Return a connection to the service that runs now."""
        reached = self.reached
        if reached is not self._linked:
            old, self._link, self._linked = self._link, None, reached
            self._described = {}
            if reached is not None:
                self._link = ControlLink(reached.control, reached.token)
            if old is not None:
                await old.close()
        return self._link

    async def _poll(self) -> None:
        while True:
            await self.refresh()
            await asyncio.sleep(POLL_SECONDS)
