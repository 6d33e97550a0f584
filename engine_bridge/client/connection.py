"""The socket of a client of the stream."""

import zmq

from engine_bridge.service.protocol.header import NAME
from engine_bridge.service.security.credentials import check_token
from engine_bridge.service.security.endpoints import keep_alive
from puppetline.errors import ServiceError

ADDRESS = "tcp://127.0.0.1:7400"

MAX_MESSAGE_BYTES = 1 << 30
"""Maximum size of a message; the connection to a sender of a larger one is closed."""


def with_scheme(address: str) -> str:
    """Return an address as ZeroMQ wants it; ``HOST:PORT`` is one of TCP."""
    return address if "://" in address else f"tcp://{address}"


def subscriber(context: "zmq.Context[zmq.Socket[bytes]]", address: str, token: str | None) -> "zmq.Socket[bytes]":
    """Return a socket that connects to the stream of a service, and connects again when the connection is lost.

    Parameters
    ----------
    context : zmq.Context
    address : str
    token : str or None

    Raises
    ------
    ServiceError
        The address or the token is invalid.
    """
    if token is not None:
        check_token(token, "the token")
    if not address.rpartition(":")[2].isdigit():
        raise _invalid(address, "no port at its end")
    socket = context.socket(zmq.SUB)
    socket.ipv6 = "[" in address
    socket.setsockopt(zmq.MAXMSGSIZE, MAX_MESSAGE_BYTES)
    socket.setsockopt(zmq.RECONNECT_IVL, 100)
    socket.setsockopt(zmq.RECONNECT_IVL_MAX, 1000)
    keep_alive(socket)
    if token is not None:
        socket.setsockopt_string(zmq.PLAIN_USERNAME, "puppetline")
        socket.setsockopt_string(zmq.PLAIN_PASSWORD, token)
    try:
        socket.connect(address)
    except zmq.ZMQError as error:
        raise _invalid(address, error.strerror) from error
    return socket


def check_name(where: str, name: str) -> None:
    """Refuse what is no name of a character.

    Raises
    ------
    ServiceError
    """
    if not NAME.fullmatch(name):
        fix = "Use a name that the service lists."
        raise ServiceError(where, found=repr(name), expected="a character's name", fix=fix)


def _invalid(address: str, why: str) -> ServiceError:
    return ServiceError(
        address,
        found=f"an invalid address ({why})",
        expected=f"an address such as {ADDRESS}",
        fix="Correct the address.",
    )
