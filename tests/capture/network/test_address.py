import pytest

from capture.network.address import Address, parse
from puppetline.errors import SourceError


@pytest.mark.parametrize(
    ("rest", "host", "port"),
    [
        ("", "127.0.0.1", 7110),
        ("7000", "127.0.0.1", 7000),
        ("0", "127.0.0.1", 0),
        ("0.0.0.0", "0.0.0.0", 7110),
        ("0.0.0.0:7000", "0.0.0.0", 7000),
        ("kiosk.local:7000", "kiosk.local", 7000),
        ("[::1]:7000", "::1", 7000),
        ("[fe80::1%eth0]", "fe80::1%eth0", 7110),
    ],
)
def test_a_place_is_a_port_a_host_or_both(rest, host, port):
    assert parse("osc", rest, 7110) == Address(host, port)


def test_options_follow_the_place():
    parsed = parse("osc", "7000?units=mm&mirrored=1&flip=xz&from=192.168.1.20", 7110)
    assert parsed == Address("127.0.0.1", 7000, units="mm", mirrored=True, flip="xz", sender="192.168.1.20")
    assert parse("vmc", "?mirrored=0", 39539) == Address("127.0.0.1", 39539, mirrored=False)


@pytest.mark.parametrize(
    ("rest", "message"),
    [
        ("65536", r"^osc:65536: found '65536'; expected PORT, HOST or HOST:PORT, with a port up to 65535"),
        ("host:99999", "found 'host:99999'"),
        ("::1", "found '::1'"),
        ("٧٠٠٠:1:2", "expected PORT"),
        ("7000?unit=mm", "found the option 'unit'; expected units, mirrored, flip, from, each at most once"),
        ("7000?units=mm&units=m", "found the option 'units' for the second time"),
        ("7000?units=inch", r"osc:7000\?units=inch, units: found 'inch'; expected m, cm, mm, screen"),
        ("7000?mirrored=yes", "mirrored: found 'yes'; expected 0 or 1"),
        ("7000?flip=w", "flip: found 'w'; expected axes of xyz"),
        ("7000?from=kiosk", "from: found 'kiosk'; expected an IP address"),
    ],
)
def test_anything_else_is_refused_with_an_example(rest, message):
    with pytest.raises(SourceError, match=message) as caught:
        parse("osc", rest, 7110)
    assert "osc:0.0.0.0:7110?from=192.168.1.20&units=mm" in caught.value.fix
