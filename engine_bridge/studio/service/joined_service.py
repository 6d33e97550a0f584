"""A service that runs elsewhere, and that the studio has joined."""

from engine_bridge.studio.messages.state import ServiceState
from engine_bridge.studio.service.service_link import ServiceLink
from engine_bridge.studio.service.service_process import Reached
from puppetline.errors import ServiceError


class JoinedService(ServiceLink):
    """A service at an address.

    Parameters
    ----------
    address : str
        ``HOST:PORT`` of the stream; the control socket has the next port.
    token : str or None

    Raises
    ------
    ServiceError
        The address is not of this form.
    """

    def __init__(self, address: str, token: str | None) -> None:
        host, _, port = address.removeprefix("tcp://").rpartition(":")
        if not host or not port.isdecimal() or not 0 < int(port) < 65535:
            raise ServiceError(
                "--service",
                found=repr(address),
                expected="HOST:PORT of the stream",
                fix="Write it like 127.0.0.1:7400; the control socket is at the next port.",
            )
        super().__init__()
        self.address = f"{host}:{port}"
        self._reached = Reached(f"tcp://{host}:{int(port) + 1}", f"tcp://{host}:{port}", token)

    @property
    def state(self) -> ServiceState:
        """State of the service: whether it answers, its control socket, and the problem if it does not answer."""
        running = bool(self.status)
        problem = "" if running else f"The service at {self.address} does not answer."
        return ServiceState(running=running, address=self._reached.control, problem=problem)

    @property
    def reached(self) -> Reached:
        """Its addresses and token."""
        return self._reached
