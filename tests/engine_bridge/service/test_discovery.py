import socket
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import replace
from importlib.metadata import version
from unittest.mock import Mock, call

import pytest
import zeroconf
from zeroconf import ServiceInfo, ServiceStateChange

from engine_bridge.service import discovery
from engine_bridge.service.discovery import RETRY_SECONDS, TYPE, Announcement, Found, find

from ...waiting import wait_until

LOOPBACK = ["127.0.0.1"]


pytestmark = pytest.mark.usefixtures("multicast")


def wait_for(port, wanted=lambda _: True):
    """Look until a service at that port is as it is wanted."""

    def look():
        return next((found for found in find(0.25, LOOPBACK) if found.port == port and wanted(found)), None)

    return wait_until(look)


def test_an_engine_finds_the_service_what_plays_there_and_its_changes_until_its_end(free_port, until_end):
    port = free_port()
    announced = until_end(Announcement("127.0.0.1", port, port + 1, "CURVE", ["dog", "cat"]))
    found = wait_for(port)
    assert found.name.startswith(f"Puppetline on {socket.gethostname().partition('.')[0]}")
    said = (port, port + 1, "CURVE", ("dog", "cat"), version("puppetline"))
    assert found == Found(found.name, ("127.0.0.1",), *said)
    until_end(Announcement("127.0.0.1", port + 2, port + 3, "NULL", []))
    assert wait_for(port + 2).name != found.name
    names = [f"character_{k:03}" for k in range(64)]  # more than a record holds
    announced.rename(names)
    after = wait_for(port, lambda other: other.characters != found.characters)
    kept = len(after.characters)
    assert after == replace(found, characters=tuple(names[:kept]))
    assert len("characters=" + ",".join(names[:kept])) <= 255 < len("characters=" + ",".join(names[: kept + 1]))
    with ThreadPoolExecutor() as threads:
        threads.submit(find, 1.0, LOOPBACK)  # who looks meanwhile forgets it
        announced.close()
        announced._thread.join()
    assert port not in [found.port for found in find(0.5, LOOPBACK)]


def test_a_service_is_announced_at_its_own_addresses_alone_and_again_when_they_change(monkeypatch, given_clock):
    own, addresses, told = discovery._own_addresses(), ["192.0.2.1"], []
    assert own == LOOPBACK or not any(each.startswith("127.") for each in own)

    def network(interfaces):
        return Mock(register_service=lambda info, **_: told.append((interfaces, info.parsed_addresses())))

    monkeypatch.setattr(discovery, "_own_addresses", addresses.copy)
    monkeypatch.setattr(zeroconf, "Zeroconf", network)
    with closing(Announcement(*LOOPBACK, 7400, 7401, "NULL", ["dog"])):
        wait_until(lambda: told)
    with closing(Announcement("*", 7400, 7401, "NULL", ["dog"])):
        wait_until(lambda: len(told) == 2)
        addresses.append("192.0.2.2")
        wait_until(lambda: given_clock.advance(RETRY_SECONDS) or len(told) == 3)
    everywhere = zeroconf.InterfaceChoice.All
    assert told == [(LOOPBACK, LOOPBACK), (everywhere, addresses[:1]), (everywhere, addresses)]


def test_without_a_network_there_is_one_warning_and_it_is_tried_again(caplog, monkeypatch, given_clock):
    network = Mock(side_effect=OSError(19, "No such device"))
    monkeypatch.setattr(zeroconf, "Zeroconf", network)
    with closing(Announcement("192.0.2.77", 7400, 7401, "NULL", ["dog"])) as announcement:
        wait_until(lambda: given_clock.advance(RETRY_SECONDS) or network.call_count >= 3)
    announcement._thread.join()
    assert network.call_args_list[:3] == [call(["192.0.2.77"])] * 3
    assert caplog.messages == ["could not announce the service on the network: [Errno 19] No such device"]


def test_a_service_whose_addresses_did_not_arrive_is_left_out(monkeypatch):
    names = [f"{name}.{TYPE}" for name in ("late", "there")]

    def heard(network, of_type, handlers):
        for name in names:
            handlers[0](network, of_type, name, ServiceStateChange.Added)
        return Mock()

    class Known(ServiceInfo):
        def __init__(self, of_type, name):
            super().__init__(of_type, name, port=5, parsed_addresses=[] if name == names[0] else LOOPBACK)

        def load_from_cache(self, network):
            return network is not None

    monkeypatch.setattr(zeroconf, "Zeroconf", Mock())
    monkeypatch.setattr(zeroconf, "ServiceBrowser", heard)
    monkeypatch.setattr(zeroconf, "ServiceInfo", Known)
    assert [found.name for found in find(0.0, LOOPBACK)] == ["there"]


@pytest.mark.parametrize(
    ("properties", "control", "characters"),
    [
        ({}, None, ()),
        ({"control": "99999", "characters": b",a,\x00\xff,"}, None, ("a", "\x00\N{REPLACEMENT CHARACTER}")),
        ({"control": "٣", "characters": None}, None, ()),
        ({"control": "7401"}, 7401, ()),
    ],
)
def test_foreign_announcements_of_our_type_are_read_with_caution(properties, control, characters):
    info = ServiceInfo(TYPE, f"x.{TYPE}", port=5, properties=properties, parsed_addresses=LOOPBACK)
    found = discovery._found(info)
    assert found == replace(found, port=5, addresses=("127.0.0.1",), control=control, characters=characters)
