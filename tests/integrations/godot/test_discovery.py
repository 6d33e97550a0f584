"""Services are found by multicast DNS: the real announcement where multicast works, packets of its library anywhere."""

import base64
import random
import socket
import struct
from importlib.metadata import version

import pytest
from zeroconf import DNSIncoming, DNSOutgoing, ServiceInfo
from zeroconf.const import _CLASS_IN, _FLAGS_AA, _FLAGS_QR_RESPONSE, _TYPE_PTR

from engine_bridge.service import discovery
from engine_bridge.service.discovery import TYPE, Announcement


@pytest.fixture
def announce(free_port, until_end):
    """Announce a service on loopback, or everywhere, as the service does."""

    def start(*characters, host="127.0.0.1", mechanism="NULL"):
        port = free_port()
        return until_end(Announcement(host, port, port + 1, mechanism, characters)), port

    return start


def at(port):
    """Tell whether a service at a port has been found."""
    return lambda told: any(service["port"] == port for service in told["services"])


@pytest.mark.usefixtures("multicast")
@pytest.mark.slow
@pytest.mark.parametrize("host", ["127.0.0.1", "0.0.0.0"])
def test_a_service_is_found_and_one_that_disappears_is_noticed(start_godot, announce, host):
    announcement, port = announce("dog", "cat", host=host, mechanism="PLAIN")
    script = start_godot("discover.gd")
    [service] = [each for each in script.until(at(port))["services"] if each["port"] == port]
    announcement.close()
    _, other = announce("lion")
    script.until(lambda told: at(other)(told) and not at(port)(told))
    script.end()
    assert service.pop("name").startswith(f"Puppetline on {socket.gethostname().partition('.')[0]}")
    assert service.pop("host") in (["127.0.0.1"] if host == "127.0.0.1" else discovery._own_addresses())
    assert service == {
        "port": port,
        "control": port + 1,
        "characters": ["dog", "cat"],
        "mechanism": "PLAIN",
        "version": version("puppetline"),
    }


def answer(*services):
    """Return an answer to a question for services, as zeroconf writes it, names compressed."""
    out = DNSOutgoing(_FLAGS_QR_RESPONSE | _FLAGS_AA, multicast=False)
    for info in services:
        out.add_answer_at_time(info.dns_pointer(), 0)
    for info in services:
        for record in (info.dns_service(), info.dns_text(), *info.dns_addresses()):
            out.add_additional_answer(record)
    [packet] = out.packets()
    return packet


def info(name="Puppetline on stage", port=7400, addresses=("10.0.0.7", "192.168.1.2"), **properties):
    return ServiceInfo(
        TYPE,
        f"{name}.{TYPE}",
        port=port,
        properties=properties,
        server="stage.local.",
        parsed_addresses=list(addresses),
    )


@pytest.fixture
def read(start_godot, packed):
    """Have packets read, without a complaint; return the records of each, and the question that is asked."""

    def start(packets):
        script = start_godot("dns_packets.gd", packed(packets))
        *results, last = script.finish()
        assert [line for line in script.lines if "nicode" in line] == []
        return [result["records"] for result in results], base64.b64decode(last["question"])

    return start


def test_records_are_read_as_zeroconf_wrote_them_and_it_understands_the_question(read):
    services = (
        info(version="0.1.0", characters="dog,cat", control="7401", mechanism="NULL"),
        info("Zürich: Bühne 2", port=65535, addresses=["10.0.0.8"]),
    )
    [records], question = read([answer(*services)])
    incoming = DNSIncoming(question)
    assert incoming.valid
    assert incoming.is_query()
    [asked] = incoming.questions
    assert (asked.name, asked.type, asked.class_) == (TYPE, _TYPE_PTR, _CLASS_IN)
    names = [service.name.removesuffix(".") for service in services]
    assert [each["data"] for each in records if each["type"] == 12] == names
    assert {each["name"]: each["data"] for each in records if each["type"] == 33} == {
        name: {"port": service.port, "target": "stage.local"} for name, service in zip(names, services, strict=True)
    }
    texts = {each["name"]: each["data"] for each in records if each["type"] == 16}
    assert texts[names[0]] == ["version=0.1.0", "characters=dog,cat", "control=7401", "mechanism=NULL"]
    assert [each["data"] for each in records if each["type"] == 1] == ["10.0.0.7", "192.168.1.2", "10.0.0.8"]


def test_a_damaged_record_ends_the_packet(read):
    whole = answer(info(version="0.1.0", characters="dog"), info("another"))
    chance = random.Random(3)
    damaged = [whole[:length] for length in range(len(whole))]
    for _ in range(1000):
        packet = bytearray(whole)
        for _ in range(chance.randint(1, 4)):
            packet[chance.randrange(len(packet))] = chance.choice([0, 1, 12, 63, 64, 128, 192, 255])
        damaged.append(bytes(packet))
    header = struct.pack(">6H", 0, 0x8400, 0, 1, 0, 0)
    record = struct.pack(">HHIH", 12, 1, 120, 2) + b"\xc0\x0c"
    damaged += [
        header + b"\xc0\x0c" + record,  # a name that is itself
        header + b"\xc0\x20" + record + bytes(40),  # one that is further on
        header + b"\1a" * 200 + b"\0" + record,  # one without end
        struct.pack(">6H", 0, 0x8400, 65535, 65535, 65535, 65535) + bytes(9000),
        struct.pack(">6H", 0, 0x0000, 0, 1, 0, 0) + b"\0" + record,  # a question is no answer
    ]
    records, _ = read(damaged)
    whole_records, _ = read([whole])
    for length in range(len(whole)):
        assert records[length] == whole_records[0][: len(records[length])]  # what was whole, in its order
    assert [*records[-5:-2], records[-1]] == [[]] * 4
    assert len(records[-2]) <= 512


def test_texts_that_are_no_utf_8_are_left_out_without_a_word(read):
    good = answer(info("Zürich", version="0.1.0", characters="dog"))
    packets = [good.replace(b"version=0.1.0", b"version=0\xff\xfe00")]
    packets += [good.replace("ü".encode(), wrong) for wrong in (b"\xc3(", b"\xc0\xbc", b"\xc3\0")]
    texts, *names = ({record["type"]: record["data"] for record in records} for records in read(packets)[0])
    assert texts[16] == ["", "characters=dog"]
    assert [records[12] for records in names] == [f".{TYPE.removesuffix('.')}"] * 3


def test_announcements_become_services_that_expire(run_godot, packed):
    packets = [
        answer(info("one", version="0.1.0", characters="dog,cat", control="7401", mechanism="NULL")),
        answer(info("two", addresses=["10.0.0.8"], control="99999999999999999999")),
        answer(info("three", control="65536")),
        answer(info("four", port=0)),
    ]
    found, silent = run_godot("found_services.gd", packed(packets))
    assert [(each["name"], each["host"], each["control"]) for each in found["services"]] == [
        ("one", "10.0.0.7", 7401),
        ("three", "10.0.0.7", 0),
        ("two", "10.0.0.8", 0),
    ]
    assert silent == {"services": [], "remembered": 0}
