import pytest

from capture.network.address import Address, parse
from puppetline.errors import SourceError


@pytest.mark.parametrize(
    ("rest", "expected"),
    [
        ("", Address("127.0.0.1", 7110)),
        ("7000", Address("127.0.0.1", 7000)),
        ("0", Address("127.0.0.1", 0)),
        ("0.0.0.0", Address("0.0.0.0", 7110)),
        ("kiosk.local:7000", Address("kiosk.local", 7000)),
        ("[::1]:7000", Address("::1", 7000)),
        ("[fe80::1%eth0]", Address("fe80::1%eth0", 7110)),
        (
            "7000?units=mm&mirrored=1&flip=xz&from=192.168.1.20",
            Address("127.0.0.1", 7000, units="mm", mirrored=True, flip="xz", sender="192.168.1.20"),
        ),
        ("?mirrored=0", Address("127.0.0.1", 7110, mirrored=False)),
    ],
)
def test_a_place_is_a_port_a_host_or_both_and_options_follow(rest, expected):
    assert parse("osc", rest, 7110) == expected


@pytest.mark.parametrize(
    ("rest", "field"),
    [
        *((rest, "") for rest in ("65536", "host:99999", "::1", "٧٠٠٠:1:2", "7000?unit=mm", "7000?units=mm&units=m")),
        *(("7000?units=inch", "units"), ("7000?mirrored=yes", "mirrored"), ("7000?flip=w", "flip")),
        ("7000?from=kiosk", "from"),
    ],
)
def test_anything_else_is_refused_with_an_example(rest, field):
    with pytest.raises(SourceError) as caught:
        parse("osc", rest, 7110)
    assert caught.value.where == f"osc:{rest}" + (field and f", {field}")
    assert "osc:0.0.0.0:7110?from=192.168.1.20&units=mm" in caught.value.fix
