import ipaddress

import pytest

from engine_bridge.service.security.web_access import WebAccess

STAGE = ("https://stage.example", "http://localhost:8000")


def access(address="127.0.0.1", host=None, origins=STAGE):
    return WebAccess(ipaddress.ip_address(address), host or address, origins)


@pytest.mark.parametrize(
    ("address", "host", "accepted"),
    [
        ("127.0.0.1", "127.0.0.1:7402", True),
        ("127.0.0.1", "127.0.0.1", True),
        ("127.0.0.1", "LocalHost:9000", True),  # a forwarded port
        ("127.0.0.1", "[::1]:7402", True),
        ("127.0.0.1", "stage.example", True),  # a proxy passes it on
        ("127.0.0.1", "10.0.0.7", False),
        ("127.0.0.1", "rebound.example:7402", False),
        ("127.0.0.1", "127.0.0.1.rebound.example", False),
        ("127.0.0.1", "user@rebound.example", False),
        ("127.0.0.1", "[", False),
        ("127.0.0.1", "", False),
        ("127.0.0.1", None, False),
        ("10.0.0.7", "10.0.0.7:7402", True),
        ("10.0.0.7", "10.0.0.8:7402", False),
        ("10.0.0.7", "127.0.0.1:7402", False),
        ("10.0.0.7", "localhost", True),  # the host of an origin
        ("0.0.0.0", "10.0.0.8:7402", True),
        ("0.0.0.0", "localhost:7402", True),
        ("0.0.0.0", "rebound.example", False),
        ("::1", "[::1]:7402", True),
        ("::", "[fe80::1]:7402", True),
    ],
)
def test_hosts_are_those_of_the_address_and_of_the_origins(address, host, accepted):
    assert access(address).refusal(host, None) == (None if accepted else "wrong host")


def test_the_name_by_which_the_address_was_given_is_a_host():
    assert access("10.0.0.7", "kiosk.local").refusal("kiosk.local:7402", None) is None
    assert access("10.0.0.7", "10.0.0.7").refusal("kiosk.local:7402", None) == "wrong host"


@pytest.mark.parametrize(
    ("origin", "accepted"),
    [
        (None, True),  # no browser
        ("http://127.0.0.1:7402", True),
        ("https://127.0.0.1:7402", True),
        ("https://stage.example", True),
        ("HTTPS://STAGE.EXAMPLE", True),
        ("http://localhost:8000", True),
        ("http://stage.example", False),
        ("https://stage.example:444", False),
        ("https://stage.example.rebound.example", False),
        ("http://localhost:7402", False),  # another origin than that of the host
        ("http://127.0.0.1", False),
        ("null", False),
        ("", False),
    ],
)
def test_origins_are_those_of_the_host_and_those_given(origin, accepted):
    assert access().refusal("127.0.0.1:7402", origin) == (None if accepted else "wrong origin")
