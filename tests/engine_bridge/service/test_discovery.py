import logging
import socket
import sys
from contextlib import closing
from importlib.metadata import version

import pytest
import zeroconf
from zeroconf import ServiceInfo

from engine_bridge.service import discovery
from engine_bridge.service.discovery import RETRY_SECONDS, TYPE, Announcement, Found, find

from ...waiting import wait_until

LOOPBACK = ["127.0.0.1"]


pytestmark = pytest.mark.usefixtures("multicast")


def wait_for(port, wanted=lambda found: True, tries=40):
    """Look until a service at that port is as it is wanted."""
    for _ in range(tries):
        for found in find(0.25, LOOPBACK):
            if found.port == port and wanted(found):
                return found
    raise AssertionError("it is not found")


@pytest.fixture
def port():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        yield free.getsockname()[1]


def test_an_engine_finds_the_service_what_plays_there_and_its_changes_until_its_end(port, until_end):
    announced = until_end(Announcement("127.0.0.1", port, port + 1, "CURVE", ["dog", "cat"]))
    found = wait_for(port)
    assert found.name.startswith(f"Puppetline on {socket.gethostname().partition('.')[0]}")
    said = (port, port + 1, "CURVE", ("dog", "cat"), version("puppetline"))
    assert found == Found(found.name, ("127.0.0.1",), *said)
    until_end(Announcement("127.0.0.1", port + 2, port + 3, "NULL", []))
    assert wait_for(port + 2).name != found.name
    announced.rename(["dog", "dragon"])
    after = wait_for(port, lambda other: other.characters != found.characters)
    assert (after.name, after.characters) == (found.name, ("dog", "dragon"))
    announced.close()
    announced._thread.join()
    assert [found for found in find(0.5, LOOPBACK) if found.port == port] == []


def heard_at(address, host, port):
    """Announce at a host; tell whether it was heard on the network of one of this machine's addresses."""
    multicast_all = 49  # Linux: otherwise a socket hears what any other socket has joined
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        listener.setsockopt(socket.IPPROTO_IP, multicast_all, 0)
        listener.bind(("224.0.0.251", 5353))
        membership = socket.inet_aton("224.0.0.251") + socket.inet_aton(address)
        listener.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
        listener.settimeout(0.1)
        announcement = Announcement(host, port, port + 1, "NULL", [f"only{port}"])
        try:
            wait_for(port)
            while True:
                if f"only{port}".encode() in listener.recv(9000):
                    return True
        except TimeoutError:
            return False
        finally:
            announcement.close()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="which network a packet came from is Linux's to say")
def test_a_service_on_loopback_is_announced_only_there(port):
    elsewhere = discovery._own_addresses()[0]
    if elsewhere == "127.0.0.1":
        pytest.skip("this machine has no other address")
    assert not heard_at(elsewhere, "127.0.0.1", port)
    assert heard_at(elsewhere, "*", port)


def test_without_a_network_there_is_one_warning_and_it_is_tried_again(caplog, monkeypatch, given_clock):
    attempts = []

    def no_network(interfaces):
        attempts.append(interfaces)
        raise OSError(19, "No such device")

    monkeypatch.setattr(zeroconf, "Zeroconf", no_network)
    with caplog.at_level(logging.WARNING):
        announcement = Announcement("192.0.2.77", 7400, 7401, "NULL", ["dog"])
        wait_until(lambda: given_clock.advance(RETRY_SECONDS) or len(attempts) >= 3)
        announcement.close()
        announcement._thread.join()
    assert attempts[:3] == [["192.0.2.77"]] * 3
    assert caplog.messages == ["could not announce the service on the network: [Errno 19] No such device"]


def test_a_network_that_comes_up_later_is_noticed(monkeypatch, port):
    addresses = ["127.0.0.1"]
    monkeypatch.setattr(discovery, "_own_addresses", lambda: list(addresses))
    monkeypatch.setattr(discovery, "RETRY_SECONDS", 0.05)
    with closing(Announcement("*", port, port + 1, "NULL", ["dog"])):
        assert wait_for(port).addresses == ("127.0.0.1",)
        addresses.insert(0, "127.0.0.2")
        wait_for(port, lambda found: "127.0.0.2" in found.addresses)


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
    assert (found.control, found.port, found.addresses) == (control, 5, ("127.0.0.1",))
    assert found.characters == characters


def test_more_characters_than_a_record_holds_are_cut_between_names():
    names = [f"character_{k:03}" for k in range(64)]
    joined = discovery._as_many_as_fit(names)
    kept = joined.split(",")
    assert kept == names[: len(kept)]
    assert len(f"characters={joined}") <= 255 < len(f"characters={joined},{names[len(kept)]}")
