"""The service that the studio starts."""

from pathlib import Path
from typing import Any

from engine_bridge.studio.messages.state import ServiceState
from engine_bridge.studio.service.service_link import ServiceLink
from engine_bridge.studio.service.service_process import Reached, ServiceProcess
from puppetline.errors import ServiceError


class OwnService(ServiceLink):
    """A service that the studio starts.

    Parameters
    ----------
    folder : Path
        Folder of the service file.
    token : str
        Token in the file ``token`` there.
    """

    def __init__(self, folder: Path, token: str) -> None:
        super().__init__()
        self._process = ServiceProcess(folder / "service.toml", token, lambda: self._watcher())
        self._stages: list[dict[str, Any]] = []

    @property
    def state(self) -> ServiceState:
        """State of the service."""
        return self._process.state

    @property
    def reached(self) -> Reached | None:
        """Its addresses and token; None while it does not run."""
        return self._process.reached

    async def get_ready(self) -> None:
        """Let the service start sooner when the first character is opened."""
        await self._process.get_ready()

    async def play(self, stages: list[dict[str, Any]]) -> None:
        """Run the service with these stages, which are tables [[stage]]; end it if there are none.

        Raises
        ------
        ServiceError
            The service cannot start or reload with them.
        """
        self._stages = stages
        if not stages:
            await self._process.stop()
            return
        self._process.write(stages)
        if self._process.reached is not None:
            await self.request("reload")
            return
        await self._process.start()
        if self._process.reached is None:
            problem = self.state.problem or "no reply"
            await self._process.stop()
            raise ServiceError(
                "the service",
                found=f"a service that did not start: {problem}",
                expected="a running service",
                fix="Choose another source, or close this character.",
            )

    async def close(self) -> None:
        """End the service."""
        await super().close()
        await self._process.stop()

    def _absence(self) -> ServiceError:
        if self._stages:
            return super()._absence()
        return ServiceError(
            "the service", found="no character", expected="an open character", fix="Open a character first."
        )
