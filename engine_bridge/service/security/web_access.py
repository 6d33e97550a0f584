"""Decides which requests a web server accepts, by the headers Host and Origin of browsers (docs/security.md).

A page of another site can make a browser connect to this machine. The browser then sends the site of the page (Origin)
and the name that it connected to (Host). If that site has made its own name point to this machine, Host has that name.
"""

import ipaddress
from collections.abc import Iterable
from urllib.parse import urlsplit

from engine_bridge.service.security.endpoints import IPAddress

SCHEMES = ("http", "https")
"""Schemes of pages that the server itself, or a proxy in front of it, delivers."""


class WebAccess:
    """Accepts requests from the server's own pages, from given origins, and from programs that are not browsers.

    Parameters
    ----------
    address : IPv4Address or IPv6Address
        The address that the server is bound to.
    host : str
        The host name or address in the settings.
    origins : iterable of str
        Origins of further pages, such as ``https://stage.example``; clients may connect to their hosts' names too,
        because a proxy may pass these on.
    """

    def __init__(self, address: IPAddress, host: str, origins: Iterable[str] = ()) -> None:
        self._address = address
        self._origins = frozenset(origin.lower() for origin in origins)
        self._names = {host.lower(), *(urlsplit(origin).hostname for origin in self._origins)}
        if address.is_loopback or address.is_unspecified:
            self._names.add("localhost")

    def refusal(self, host: str | None, origin: str | None) -> str | None:
        """Return why a request is refused; None if it is accepted.

        Parameters
        ----------
        host, origin : str or None
            The headers of the request.
        """
        if host is None or not self._is_served(_name(host)):
            return "wrong host"
        if origin is None or origin.lower() in self._origins:
            return None
        own = [f"{scheme}://{host}".lower() for scheme in SCHEMES]
        return None if origin.lower() in own else "wrong origin"

    def _is_served(self, name: str | None) -> bool:
        if name in self._names:
            return True
        try:
            address = ipaddress.ip_address(name or "")
        except ValueError:
            return False
        here = self._address
        return here.is_unspecified or address == here or (here.is_loopback and address.is_loopback)


def _name(host: str) -> str | None:
    """Return the name in a Host header, without the port; None if there is none."""
    try:
        return urlsplit(f"//{host}").hostname
    except ValueError:
        return None
