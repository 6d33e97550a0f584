"""The part of a URI after ``osc:`` or ``vmc:``: the address to listen on, and options that describe the sender.

The address is ``7110``, ``HOST``, ``HOST:PORT``, ``[::1]:PORT`` or empty. Options follow after ``?``, separated by
``&``.
"""

import ipaddress
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any
from urllib.parse import parse_qsl

from capture.network.dialect import UNITS, Units
from puppetline.errors import SourceError, at

LOOPBACK = "127.0.0.1"

ANY_SENDER = "any"

MAX_PORT = 65_535
FIX = "Use a URI such as osc:7110 or osc:0.0.0.0:7110?from=192.168.1.20&units=mm; docs/senders.md explains the options."

_HOST_AND_PORT = re.compile(r"(?P<only>\d{0,9})|(?P<host>\[[^\[\]]+\]|[^:\[\]]+)(:(?P<port>\d{1,9}))?", re.ASCII)


@dataclass(frozen=True, slots=True)
class Address:
    """The address to listen on, and the conversion of received skeletons.

    Attributes
    ----------
    host : str
    port : int
    units : str or None
        Units of coordinates; None to detect them by dialect and size.
    mirrored : bool or None
        Whether the sender mirrors performers; None for the program's default.
    flip : str
        Axes of sensor coordinates to negate, of "xyz".
    sender : str or None
        The only IP address whose packets are accepted, or `ANY_SENDER`; None, for loopback only, if not configured.
    """

    host: str
    port: int
    units: Units | None = None
    mirrored: bool | None = None
    flip: str = ""
    sender: str | None = None


def parse(scheme: str, rest: str, port: int) -> Address:
    """Parse the part of a URI after its colon.

    Parameters
    ----------
    scheme, rest : str
    port : int
        Default port.

    Raises
    ------
    SourceError
        The address is invalid, or an option is unknown, repeated or invalid.
    """
    uri = f"{scheme}:{rest}"
    address, _, query = rest.partition("?")
    match = _HOST_AND_PORT.fullmatch(address)
    if match is None or int(match["port"] or match["only"] or 0) > MAX_PORT:
        raise SourceError(
            uri, found=repr(address), expected=f"PORT, HOST or HOST:PORT, with a port up to {MAX_PORT}", fix=FIX
        )
    options = _options(uri, query)
    return Address(
        (match["host"] or LOOPBACK).strip("[]"),
        int(match["port"] or match["only"] or port),
        units=options.get("units"),
        mirrored=options.get("mirrored"),
        flip=options.get("flip", ""),
        sender=options.get("from"),
    )


def _options(uri: str, query: str) -> dict[str, Any]:
    options: dict[str, Any] = {}
    for key, value in parse_qsl(query, keep_blank_values=True):
        if key not in _OPTIONS or key in options:
            found = f"the option {key!r}" + (" for the second time" if key in options else "")
            raise SourceError(uri, found=found, expected=f"{', '.join(_OPTIONS)}, each at most once", fix=FIX)
        expected, read = _OPTIONS[key]
        try:
            options[key] = read(value)
        except (KeyError, ValueError):
            raise SourceError(at(uri, field=key), found=repr(value), expected=expected, fix=FIX) from None
    return options


def _axes(axes: str) -> str:
    if not set(axes) <= set("xyz"):
        raise ValueError(axes)
    return axes


def _sender(text: str) -> str:
    return text if text == ANY_SENDER else str(ipaddress.ip_address(text))


_OPTIONS: dict[str, tuple[str, Callable[[str], Any]]] = {
    "units": (", ".join(UNITS), {str(unit): unit for unit in UNITS}.__getitem__),
    "mirrored": ("0 or 1", {"0": False, "1": True}.__getitem__),
    "flip": ("axes of xyz", _axes),
    "from": (f"an IP address or {ANY_SENDER}", _sender),
}
"""Description of each option's values, and the function that parses them."""
