"""What stands after ``osc:`` or ``vmc:``: where to listen, and what a user says about the sender.

``7110``, ``HOST``, ``HOST:PORT``, ``[::1]:PORT`` or nothing, then ``?`` and options with ``&`` between them.
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

ANYBODY = "any"

LAST_PORT = 65_535
FIX = "Write it as osc:7110 or osc:0.0.0.0:7110?from=192.168.1.20&units=mm; docs/senders.md explains the options."

_PLACE = re.compile(r"(?P<only>\d{0,9})|(?P<host>\[[^\[\]]+\]|[^:\[\]]+)(:(?P<port>\d{1,9}))?", re.ASCII)


@dataclass(frozen=True, slots=True)
class Address:
    """Where to listen, and how to take what comes.

    Attributes
    ----------
    host : str
    port : int
    units : str or None
        Of coordinates; None to tell by the dialect and the numbers.
    mirrored : bool or None
        Whether the sender shows performers in a mirror; None for what the program does as it comes.
    flip : str
        Axes of the sensor frame to negate, of "xyz".
    sender : str or None
        The one IP address that is heard, or `ANYBODY`; None where nothing was said, which does on loopback only.
    """

    host: str
    port: int
    units: Units | None = None
    mirrored: bool | None = None
    flip: str = ""
    sender: str | None = None


def parse(scheme: str, rest: str, port: int) -> Address:
    """Read the part of a URI after its colon.

    Parameters
    ----------
    scheme, rest : str
    port : int
        If none is given.

    Raises
    ------
    SourceError
        It is no place, or an option is unknown, given twice or has no such value.
    """
    uri = f"{scheme}:{rest}"
    place, _, query = rest.partition("?")
    match = _PLACE.fullmatch(place)
    if match is None or int(match["port"] or match["only"] or 0) > LAST_PORT:
        raise SourceError(
            uri, found=repr(place), expected=f"PORT, HOST or HOST:PORT, with a port up to {LAST_PORT}", fix=FIX
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
            raise SourceError(uri, found=found, expected=f"{', '.join(_OPTIONS)}, each once at most", fix=FIX)
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
    return text if text == ANYBODY else str(ipaddress.ip_address(text))


_OPTIONS: dict[str, tuple[str, Callable[[str], Any]]] = {
    "units": (", ".join(UNITS), {str(unit): unit for unit in UNITS}.__getitem__),
    "mirrored": ("0 or 1", {"0": False, "1": True}.__getitem__),
    "flip": ("axes out of xyz", _axes),
    "from": (f"an IP address or {ANYBODY}", _sender),
}
"""What each option may be, and how it is read."""
