"""The address by which visitors' phones reach this machine."""

import ipaddress
import socket

import psutil

OTHER_MACHINE = "192.0.2.1"
"""An address of no machine (RFC 5737): the system chooses the interface of the default route for it."""

VIRTUAL = ("docker", "br-", "veth", "virbr", "vmnet", "vboxnet", "podman", "cni", "tun", "tap", "wg")
"""Beginnings of the names of interfaces that no phone reaches."""


def phone_address(given: str | None, port: int) -> str | None:
    """Return the beginning of the addresses that phones open, such as ``http://192.168.1.5:7481``.

    Parameters
    ----------
    given : str or None
        Address in the settings; it takes precedence.
    port : int

    Returns
    -------
    str or None
        None without a network.
    """
    if given is not None:
        return given
    host = _of_default_route() or _of_interfaces()
    return None if host is None else f"http://{host}:{port}"


def _of_default_route() -> str | None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((OTHER_MACHINE, 9))  # sends nothing
        except OSError:
            return None
        host: str = probe.getsockname()[0]
    return None if ipaddress.ip_address(host).is_loopback else host


def _of_interfaces() -> str | None:
    """Return the first address of an interface that is up: of a network without a way out, such as a hotspot."""
    up = {name for name, state in psutil.net_if_stats().items() if state.isup and not name.startswith(VIRTUAL)}
    found = [
        each.address
        for name, addresses in psutil.net_if_addrs().items()
        if name in up
        for each in addresses
        if each.family == socket.AF_INET and not ipaddress.ip_address(each.address).is_loopback
    ]
    return next(iter(found), None)
