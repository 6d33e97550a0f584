"""The interface of an output, the part of the service that sends frames over one wire; `registry` lists the wires."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import zmq

from engine_bridge.puppet.puppet import Puppet
from engine_bridge.service.monitoring.status import OutputStatus, Status
from engine_bridge.service.protocol.frame import Frame
from engine_bridge.service.protocol.scene import StreamedCharacter
from engine_bridge.service.security.endpoints import Endpoint
from engine_bridge.service.security.guard import Guard
from puppetline.toml_schema import Table

Answer = Callable[[bytes, Callable[[bytes], None]], None]
"""Carries out a request and sends its reply."""


class Output(ABC):
    """Sends frames over one wire, to one target or to all clients that subscribe.

    The service's loop calls every method; none may wait. A wire without clients inherits those that do nothing.
    """

    @property
    def endpoints(self) -> Sequence[str]:
        """Addresses that clients connect to."""
        return ()

    @property
    def sockets(self) -> Sequence[Any]:
        """ZeroMQ sockets and file descriptors to poll for reading in the next turn of the loop."""
        return ()

    def handle(self, socket: Any) -> None:  # noqa: B027 - a wire without clients inherits it
        """Read what has arrived on one of the `sockets`."""

    def announce(self, characters: Sequence[StreamedCharacter]) -> None:  # noqa: B027
        """Replace the characters that clients can choose from; one whose scene has changed has another revision."""

    def report(self, status: Status) -> None:  # noqa: B027
        """Send the status of the service, once per second."""

    @abstractmethod
    def offer(self, frame: Frame) -> None:
        """Send a frame, now or when its time has come; the wire may replace it with a newer one until then."""

    def due(self) -> float:
        """Return when to call `send_due`, in seconds of `puppetline.clock`; infinity for never."""
        return math.inf

    def send_due(self) -> None:  # noqa: B027
        """Send everything whose time has come."""

    @property
    @abstractmethod
    def statistics(self) -> OutputStatus:
        """What has been sent so far."""

    @abstractmethod
    def close(self) -> None:
        """Close all sockets; closing again does nothing."""


@dataclass(frozen=True)
class Opening:
    """What the service provides to an output when it opens it.

    Attributes
    ----------
    characters : sequence of StreamedCharacter
    context : zmq.Context
    endpoints : sequence of Endpoint
        ZeroMQ addresses of [network].
    guard : Guard
        Authenticates ZeroMQ clients.
    answer : callable
        Carries out a request in JSON (docs/control.md); called with the request and with what sends its reply.
    """

    characters: Sequence[StreamedCharacter]
    context: "zmq.Context[zmq.Socket[bytes]]"
    endpoints: Sequence[Endpoint]
    guard: Guard
    answer: Answer


class OutputTable(Table):
    """A table of the service file that opens an output."""

    def check(self, place: tuple[str | int, ...], morphs: Mapping[str, bool]) -> None:
        """Check the table against the characters of the service file.

        Parameters
        ----------
        place : tuple
            Keys and indices of this table in the file, for `toml_schema.mistake`.
        morphs : mapping
            Names of all characters, and whether each has a file of morph targets.

        Raises
        ------
        PydanticCustomError
        """

    def check_puppet(self, name: str, puppet: Puppet, path: Path) -> None:
        """Check that a character's puppet, loaded from `path`, has what the output sends.

        Raises
        ------
        PuppetlineError
        """

    def open(self, opening: Opening) -> Output:
        """Open the output.

        Raises
        ------
        PuppetlineError, zmq.ZMQError
        """
        raise NotImplementedError
