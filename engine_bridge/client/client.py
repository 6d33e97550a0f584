"""A client of a running service: it follows characters, and sends requests."""

import math
import secrets
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, Self, get_args

import numpy as np
import zmq
from numpy.typing import NDArray

from engine_bridge.client.connection import ADDRESS, check_name, subscriber, with_scheme
from engine_bridge.service.control.control_socket import request
from engine_bridge.service.protocol.header import NO_USER, WireError, subscription
from engine_bridge.service.protocol.payloads import Received, decode
from engine_bridge.service.protocol.scene import DecodedScene
from engine_bridge.service.states import STATES
from puppetline import clock
from puppetline.errors import ServiceError

FrameKind = Literal["controls", "vertices", "vertices16", "morphs", "joints", "handles", "bones", "channels"]


@dataclass(frozen=True, eq=False)
class LiveFrame:
    """One character at one moment, as a service has sent it.

    Attributes
    ----------
    time : float
        Seconds, the clock of the service's source.
    sequence : int
        Number of the frame of the character. A larger step than 1 means that frames were not received; of joints and
        channels, also that a frame has none.
    state : str
        State of the character: one of `engine_bridge.service.states.STATES`.
    user : int or None
        The performer.
    root : (3,) float32
        Translation of the whole character, mesh file's coordinates.
    targets : (k,) float32
        Weights of the mesh's own morph targets, in the order of the scene's ``targets``.
    data : object
        For controls (m, 3, 4) float32, which include the root; for vertices, `positions` and `normals`, both (n, 3)
        float32; for morphs, `weights` (k,) float32 and `residual`; for joints (20, 4) float32, positions in metres and
        confidence; for handles (h, 3) float32; for bones (4j + 3t,) float32 (docs/protocol.md); for channels a dict.
        Arrays are read-only.
    """

    time: float
    sequence: int
    state: str
    user: int | None
    root: NDArray[np.float32]
    targets: NDArray[np.float32]
    data: Any


class Client:
    """A connection to a running service.

    It is a context manager; at the end of the block, the connection is closed.

    Parameters
    ----------
    address : str
        ``tcp://HOST:PORT`` or ``HOST:PORT`` of the stream.
    control : str, optional
        The same of the control socket, to which requests go; by default the port after that of the stream.
    token : str, optional
        Token of the service, if it requires one.
    timeout : float
        Time after which a service that sends nothing counts as absent, in seconds; infinity is allowed.

    Raises
    ------
    ServiceError
        The address is invalid.
    """

    def __init__(
        self, address: str = ADDRESS, *, control: str | None = None, token: str | None = None, timeout: float = 5.0
    ) -> None:
        self.address, self._token, self._timeout = with_scheme(address), token, timeout
        self._control = None if control is None else with_scheme(control)
        self._context = zmq.Context[zmq.Socket[bytes]]()
        try:
            self._stream().close(0)
        except BaseException:
            self.close()
            raise

    def characters(self) -> list[str]:
        """Return the names of the characters that are streamed.

        Raises
        ------
        ServiceError
            The service does not answer, or refuses the token.
        """
        (message,) = self._receive(["service/characters"], 1)
        return [each["name"] for each in message.body if isinstance(each, dict) and "name" in each]

    def scene(self, character: str) -> DecodedScene:
        """Return a character's mesh and what its frames refer to.

        Raises
        ------
        ServiceError
            The service does not answer, or has no such character.
        """
        check_name("the scene", character)
        (message,) = self._receive([f"{character}/scene/{secrets.token_hex(8)}"], 1)
        body: DecodedScene = message.body
        return body

    def follow(self, character: str, kind: FrameKind = "controls") -> Iterator[LiveFrame]:
        """Receive the frames of a character, as they arrive.

        A program that takes longer for a frame than the service loses frames, see `LiveFrame.sequence`.

        Parameters
        ----------
        character : str
        kind : str
            What to receive: see `LiveFrame.data`.

        Yields
        ------
        LiveFrame

        Raises
        ------
        ServiceError
            No frame has arrived for the timeout.
        """
        check_name("what is followed", character)
        if kind not in get_args(FrameKind):
            kinds = ", ".join(get_args(FrameKind))
            raise ServiceError("the kind", found=repr(kind), expected=f"one of {kinds}", fix="Correct it.")
        return self._frames(character, kind)

    def _frames(self, character: str, kind: FrameKind) -> Iterator[LiveFrame]:
        for message in self._receive([f"{character}/{kind}"], math.inf):
            header = message.header
            yield LiveFrame(
                time=header.time,
                sequence=header.sequence,
                state=STATES[header.state],
                user=None if header.user == NO_USER else header.user,
                root=np.array(header.root, np.float32),
                targets=message.targets,
                data=message.body,
            )

    def request(self, do: str, **arguments: Any) -> Any:
        """Send a request to the service's control socket and return the result (docs/control.md).

        Parameters
        ----------
        do : str
            Name of the request, for example ``"calibrate"``.
        **arguments
            Its arguments, for example ``character="dog"``.

        Raises
        ------
        ServiceError
            The service does not answer, or refuses the request.
        """
        stem, _, port = self.address.rpartition(":")
        return request(
            self._control or f"{stem}:{int(port) + 1}", do, token=self._token, timeout=self._timeout, **arguments
        )

    def close(self) -> None:
        """Close the connection; closing again does nothing."""
        self._context.destroy(linger=0)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<puppetline.Client of {self.address}>"

    def _stream(self, *topics: str) -> "zmq.Socket[bytes]":
        if self._context.closed:
            raise ServiceError(self.address, found="a closed client", expected="an open one", fix="Connect again.")
        socket = subscriber(self._context, self.address, self._token)
        for topic in topics:
            socket.subscribe(subscription(topic))
        return socket

    def _receive(self, topics: list[str], count: float) -> Iterator[Received]:
        """Yield messages of some topics, up to a number; those of later versions of the protocol are left out."""
        with self._stream(*topics) as socket:
            socket.setsockopt(zmq.LINGER, 0)
            while count > 0:
                if not clock.block(clock.now() + self._timeout, partial(_poll, socket)):
                    raise self._silence()
                try:
                    message = decode(socket.recv())
                except WireError:
                    continue
                if message.body is not None:
                    count -= 1
                    yield message

    def _silence(self) -> ServiceError:
        return ServiceError(
            self.address,
            found=f"no message within {self._timeout:g} s",
            expected="a running service that accepts this client and has this character",
            fix="Start one with puppetline serve, or check the address, the token and the name.",
        )


def _poll(socket: "zmq.Socket[bytes]", seconds: float) -> int:
    return socket.poll(None if math.isinf(seconds) else math.ceil(1000 * seconds))


connect = Client
"""Alias of `Client`, as in ``with connect(address) as live``."""
