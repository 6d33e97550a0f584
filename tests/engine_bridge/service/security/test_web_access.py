import ipaddress

import pytest

from engine_bridge.service.security.web_access import WebAccess

STAGE = ("https://stage.example", "http://localhost:8000")


def access(address="127.0.0.1", host=None, origins=STAGE):
    return WebAccess(ipaddress.ip_address(address), host or address, origins)


HOSTS = """
127.0.0.1  accepts  127.0.0.1:7402 127.0.0.1 LocalHost:9000 [::1]:7402 stage.example
127.0.0.1  refuses  10.0.0.7 rebound.example:7402 127.0.0.1.rebound.example user@rebound.example [
10.0.0.7   accepts  10.0.0.7:7402 localhost
10.0.0.7   refuses  10.0.0.8:7402 127.0.0.1:7402
0.0.0.0    accepts  10.0.0.8:7402 localhost:7402
0.0.0.0    refuses  rebound.example
::1        accepts  [::1]:7402
::         accepts  [fe80::1]:7402
"""
"""A port may be forwarded, a proxy passes stage.example on, and localhost is the host of an origin."""


@pytest.mark.parametrize("line", HOSTS.strip().splitlines())
def test_hosts_are_those_of_the_address_and_of_the_origins(line):
    address, does, *hosts = line.split()
    if does == "refuses":
        hosts += ["", None]
    assert {access(address).refusal(host, None) for host in hosts} == {None if does == "accepts" else "wrong host"}


def test_the_name_by_which_the_address_was_given_is_a_host():
    assert access("10.0.0.7", "kiosk.local").refusal("kiosk.local:7402", None) is None
    assert access("10.0.0.7", "10.0.0.7").refusal("kiosk.local:7402", None) == "wrong host"


def test_origins_are_those_of_the_host_and_those_given():
    accepted = "http://127.0.0.1:7402 https://127.0.0.1:7402 https://stage.example HTTPS://STAGE.EXAMPLE"
    refused = "http://stage.example https://stage.example:444 https://stage.example.rebound.example null"
    refused += " http://localhost:7402 http://127.0.0.1"  # other origins than that of the host
    expected = dict.fromkeys([None, "http://localhost:8000", *accepted.split()])  # without a browser there is none
    expected |= dict.fromkeys(["", *refused.split()], "wrong origin")
    assert {origin: access().refusal("127.0.0.1:7402", origin) for origin in expected} == expected
