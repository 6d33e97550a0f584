import pytest

from capture.network.address import Address, parse
from puppetline.errors import SourceError

PLACES = """
7000              127.0.0.1    7000
0                 127.0.0.1    0
0.0.0.0           0.0.0.0      7110
kiosk.local:7000  kiosk.local  7000
[::1]:7000        ::1          7000
[fe80::1%eth0]    fe80::1%eth0 7110
"""
REFUSED = """
65536 host:99999 ::1 ٧٠٠٠:1:2 7000?unit=mm 7000?units=mm&units=m
7000?units=inch 7000?mirrored=yes 7000?flip=w 7000?from=kiosk
"""


def test_a_place_is_a_port_a_host_or_both_and_options_follow():
    for rest, host, port in map(str.split, PLACES.strip().splitlines()):
        assert parse("osc", rest, 7110) == Address(host, int(port))
    everything = parse("osc", "7000?units=mm&mirrored=1&flip=xz&from=192.168.1.20", 7110)
    assert everything == Address("127.0.0.1", 7000, "mm", True, "xz", "192.168.1.20")
    assert parse("osc", "?mirrored=0", 7110) == Address("127.0.0.1", 7110, mirrored=False)


@pytest.mark.parametrize("rest", REFUSED.split())
def test_anything_else_is_refused_with_an_example(rest):
    with pytest.raises(SourceError) as caught:
        parse("osc", rest, 7110)
    field = next((name for name in ("units", "mirrored", "flip", "from") if rest.count(f"{name}=") == 1), "")
    assert caught.value.where == f"osc:{rest}" + (field and f", {field}")
    assert "osc:0.0.0.0:7110?from=192.168.1.20&units=mm" in caught.value.fix
