"""What stands after ``osc:`` or ``vmc:``: where to listen, and what a user says about the sender.

``7110``, ``HOST``, ``HOST:PORT``, ``[::1]:PORT`` or nothing, then ``?`` and options with ``&`` between them.
"""

import ipaddress
import re
from dataclasses import dataclass
from urllib.parse import parse_qsl

from capture.network.dialect import UNITS, Units
from puppetline.errors import SourceError, at

LOOPBACK = "127.0.0.1"

_PLACE = re.compile(r"(?P<host>\[[^\]]*\]|[^:\[\]]*?):?(?P<port>\d{1,5})?", re.ASCII)
_FIX = "Write it as osc:7110 or osc:0.0.0.0:7110?units=mm&mirrored=0; docs/senders.md lists the options."


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
        The one IP address that is heard; None for all.
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
    if match is None or int(match["port"] or 0) > 65535:
        raise SourceError(uri, found=repr(place), expected="PORT, HOST or HOST:PORT", fix=_FIX)
    host = match["host"].strip("[]") or LOOPBACK
    given: dict[str, str] = {}
    for key, value in parse_qsl(query, keep_blank_values=True):
        if key in given or key not in ("units", "mirrored", "flip", "from"):
            found = f"{key} twice" if key in given else f"the option {key!r}"
            raise SourceError(uri, found=found, expected="units, mirrored, flip or from, each once", fix=_FIX)
        given[key] = value
    return Address(
        host,
        port if match["port"] is None else int(match["port"]),
        units=_chosen(uri, given, "units", {unit: unit for unit in UNITS}),
        mirrored=_chosen(uri, given, "mirrored", {"0": False, "1": True}),
        flip=_axes(uri, given.get("flip", "")),
        sender=_sender(uri, given.get("from")),
    )


def _chosen[T](uri: str, given: dict[str, str], option: str, values: dict[str, T]) -> T | None:
    return None


def _axes(uri: str, axes: str) -> str:
    if not set(axes) <= set("xyz"):
        raise SourceError(at(uri, field="flip"), found=repr(axes), expected="some of xyz", fix=_FIX)
    return axes


def _sender(uri: str, sender: str | None) -> str | None:
    try:
        return None if sender is None else str(ipaddress.ip_address(sender))
    except ValueError:
        raise SourceError(at(uri, field="from"), found=repr(sender), expected="an IP address", fix=_FIX) from None
