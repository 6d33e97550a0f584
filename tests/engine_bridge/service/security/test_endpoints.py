import os
import stat
from pathlib import Path

import pytest
import zmq
import zmq.auth
from zmq.utils.monitor import recv_monitor_message

from engine_bridge.service.security import endpoints as endpoints_module
from engine_bridge.service.security.credentials import make_curve_keys, make_token, read_token
from engine_bridge.service.security.endpoints import CurveTable, NetworkSettings, endpoints_of
from puppetline import toml_schema
from puppetline.errors import OutputError, ServiceError

TOKEN = "Zp3-sYd_0123456789"


@pytest.fixture(autouse=True)
def _no_token(monkeypatch):
    monkeypatch.delenv("PUPPETLINE_TOKEN", raising=False)


@pytest.fixture
def token_file(tmp_path):
    path = tmp_path / "token"
    make_token(path)
    return path


@pytest.fixture
def curve(tmp_path):
    """A service's key and a folder with one client's."""
    make_curve_keys(tmp_path / "service.key_secret")
    (tmp_path / "clients").mkdir(mode=0o700)
    make_curve_keys(tmp_path / "laptop.key_secret")
    (tmp_path / "laptop.key").rename(tmp_path / "clients" / "laptop.key")
    return CurveTable(port=7410, key_file=tmp_path / "service.key_secret", clients_folder=tmp_path / "clients")


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.0.2", "127.255.255.254", "::1", "localhost", "127.1"])
def test_a_loopback_address_needs_no_credentials(host):
    (endpoint,) = endpoints_of(NetworkSettings(host=host))
    assert endpoint.mechanism == "NULL"
    assert endpoint.stream.startswith(("tcp://127.", "tcp://[::1]"))
    assert endpoint.stream.endswith(":7400")
    assert endpoint.control.endswith(":7401")


@pytest.mark.parametrize("host", ["0.0.0.0", "*", "0", "::", "192.168.0.7", "8.8.8.8", "fe80::1", "::ffff:127.0.0.1"])
def test_any_other_address_needs_them(host):
    with pytest.raises(ServiceError, match="which other machines can reach, and no credentials") as told:
        endpoints_of(NetworkSettings(host=host))
    assert "puppetline token FILE" in told.value.fix


def test_a_name_counts_as_what_it_stands_for(monkeypatch):
    monkeypatch.setattr(
        endpoints_module.socket, "getaddrinfo", lambda *_, **__: [(2, 1, 6, "", ("192.168.0.7", 0))]
    )  # a resolver that the test decides on
    with pytest.raises(ServiceError, match=r"'stage\.local', which other machines can reach"):
        endpoints_of(NetworkSettings(host="stage.local"))
    monkeypatch.setattr(endpoints_module.socket, "getaddrinfo", lambda *_, **__: [(2, 1, 6, "", ("127.0.1.1", 0))])
    assert endpoints_of(NetworkSettings(host="stage.local"))[0].stream == "tcp://127.0.1.1:7400"


@pytest.mark.parametrize("host", ["no such host", "999.1.1.1", "a" * 70, "a..b", "127.0.0.1:80", "tcp://127.0.0.1"])
def test_a_host_that_is_no_address_of_this_machine_is_refused(host):
    with pytest.raises(ServiceError, match="has no IP address"):
        endpoints_of(NetworkSettings(host=host))


@pytest.mark.parametrize("host", ["0.0.0.0", "127.0.0.1"])
def test_a_token_locks_every_address(host, token_file):
    (endpoint,) = endpoints_of(NetworkSettings(host=host, token_file=token_file))
    token = token_file.read_bytes().strip()
    assert (endpoint.mechanism, endpoint.stream) == ("PLAIN", f"tcp://{host}:7400")
    assert endpoint.admits([b"anybody", token])
    assert not any(
        endpoint.admits(credentials)
        for credentials in (
            [],
            [token],
            [b"", b""],
            [b"", token[:-1]],
            [b"", token + b"x"],
            [token, b""],
            [b"", token, b""],
        )
    )


def test_the_token_may_come_from_the_environment_and_the_file_outdoes_it(monkeypatch, token_file):
    monkeypatch.setenv("PUPPETLINE_TOKEN", TOKEN)
    (endpoint,) = endpoints_of(NetworkSettings())
    assert endpoint.admits([b"", TOKEN.encode()])
    (endpoint,) = endpoints_of(NetworkSettings(token_file=token_file))
    assert not endpoint.admits([b"", TOKEN.encode()])
    assert read_token(token_file) == token_file.read_text().strip()
    assert read_token(None) == TOKEN
    monkeypatch.delenv("PUPPETLINE_TOKEN")
    assert read_token(None) is None


@pytest.mark.parametrize(
    "token", ["", "short", "a" * 15, "a" * 256, "with a space in it", "naïve-but-long-enough", "a\nb" * 9]
)
def test_a_weak_or_unsendable_token_is_refused_without_showing_it(monkeypatch, tmp_path, token):
    monkeypatch.setenv("PUPPETLINE_TOKEN", token)
    with pytest.raises(ServiceError, match="PUPPETLINE_TOKEN") as from_environment:
        endpoints_of(NetworkSettings())
    path = tmp_path / "secret"
    path.write_text(token, encoding="utf-8")
    path.chmod(0o600)
    with pytest.raises(ServiceError, match="secret") as from_file:
        endpoints_of(NetworkSettings(token_file=path))
    assert not token or not any(token in str(told.value) for told in (from_environment, from_file))


@pytest.mark.parametrize("length", [16, 255])
def test_tokens_of_16_to_255_characters_are_taken(monkeypatch, length):
    monkeypatch.setenv("PUPPETLINE_TOKEN", "~" * length)
    assert endpoints_of(NetworkSettings())[0].admits([b"", b"~" * length])


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o660, 0o601, 0o644])
def test_a_token_that_others_can_read_is_refused_with_what_to_type(token_file, mode):
    token_file.chmod(mode)
    with pytest.raises(ServiceError, match=rf"mode \({mode:03o}\)") as told:
        endpoints_of(NetworkSettings(token_file=token_file))
    assert told.value.fix == f"Type: chmod go-rwx {token_file}"
    token_file.chmod(0o600)
    assert endpoints_of(NetworkSettings(token_file=token_file))


def test_files_that_are_none_are_refused_without_waiting(tmp_path):
    os.mkfifo(tmp_path / "pipe", 0o600)
    (tmp_path / "folder").mkdir()
    (tmp_path / "long").write_text("a" * 5000)
    (tmp_path / "long").chmod(0o600)
    for name in ("pipe", "folder", "long", "nothing"):
        with pytest.raises(ServiceError) as told:
            endpoints_of(NetworkSettings(token_file=Path(name)), tmp_path)
        assert told.value.where == str(tmp_path / name)


def test_a_new_token_is_long_new_and_for_its_owner_only(tmp_path):
    make_token(tmp_path / "one")
    make_token(tmp_path / "two")
    one, two = ((tmp_path / name).read_text().strip() for name in ("one", "two"))
    assert len(one) == len(two) == 43
    assert one != two
    assert stat.S_IMODE((tmp_path / "one").stat().st_mode) == 0o600
    with pytest.raises(OutputError, match="an existing file"):
        make_token(tmp_path / "one")
    assert (tmp_path / "one").read_text().strip() == one
    assert {path.name for path in tmp_path.iterdir()} == {"one", "two"}


def test_keys_are_those_of_zmq_auth(tmp_path):
    make_curve_keys(tmp_path / "service.key_secret")
    public, secret = zmq.auth.load_certificate(tmp_path / "service.key_secret")
    assert zmq.curve_public(secret) == public
    assert zmq.auth.load_certificate(tmp_path / "service.key") == (public, None)
    assert stat.S_IMODE((tmp_path / "service.key_secret").stat().st_mode) == 0o600
    with pytest.raises(OutputError, match=r"Call it other\.key_secret"):
        make_curve_keys(tmp_path / "other.key")


def test_keys_that_are_there_are_not_replaced(tmp_path):
    make_curve_keys(tmp_path / "service.key_secret")
    before = (tmp_path / "service.key_secret").read_bytes(), (tmp_path / "service.key").read_bytes()
    for gone in ("service.key", "service.key_secret"):
        with pytest.raises(OutputError):
            make_curve_keys(tmp_path / "service.key_secret")
        assert before == ((tmp_path / "service.key_secret").read_bytes(), (tmp_path / "service.key").read_bytes())
        kept = (tmp_path / gone).read_bytes()
        (tmp_path / gone).unlink()
        with pytest.raises(OutputError):
            make_curve_keys(tmp_path / "service.key_secret")
        assert not (tmp_path / gone).exists()
        (tmp_path / gone).write_bytes(kept)
        (tmp_path / gone).chmod(0o600)


def test_curve_is_a_door_of_its_own_beside_the_other(curve, token_file):
    network = NetworkSettings(host="0.0.0.0", curve=curve)
    assert [(endpoint.mechanism, endpoint.stream, endpoint.control) for endpoint in endpoints_of(network)] == [
        ("CURVE", "tcp://0.0.0.0:7410", "tcp://0.0.0.0:7411")
    ]
    elsewhere = curve.model_copy(update={"host": "0.0.0.0"})
    assert [(endpoint.mechanism, endpoint.stream) for endpoint in endpoints_of(NetworkSettings(curve=elsewhere))] == [
        ("NULL", "tcp://127.0.0.1:7400"),
        ("CURVE", "tcp://0.0.0.0:7410"),
    ]
    both = NetworkSettings(host="::", curve=curve, token_file=token_file)
    assert [(endpoint.mechanism, endpoint.stream) for endpoint in endpoints_of(both)] == [
        ("PLAIN", "tcp://[::]:7400"),
        ("CURVE", "tcp://[::]:7410"),
    ]


def test_faulty_keys_are_refused_by_name(curve, tmp_path):
    def refused(name):
        with pytest.raises(ServiceError) as told:
            endpoints_of(NetworkSettings(curve=curve))
        assert told.value.where == str(tmp_path / name)
        return str(told.value)

    laptop, service = tmp_path / "clients" / "laptop.key", tmp_path / "service.key_secret"
    laptop.chmod(0o666)
    assert f"chmod go-w {laptop}" in refused("clients/laptop.key")
    laptop.write_text('public-key = "%%%%%%%%%%%%%%%%%%%%%%%%%%%%%%%%%%%%%%%%"\n')
    laptop.chmod(0o600)
    assert "no valid public key" in refused("clients/laptop.key")
    laptop.write_text("")
    assert "no public key" in refused("clients/laptop.key")
    laptop.unlink()
    assert "no file *.key in it" in refused("clients")
    (tmp_path / "clients").chmod(0o777)
    assert "chmod go-w" in refused("clients")
    (tmp_path / "clients").rmdir()
    refused("clients")
    service.chmod(0o644)
    assert f"chmod go-rwx {service}" in refused("service.key_secret")
    service.chmod(0o600)
    service.write_bytes((tmp_path / "service.key").read_bytes())
    assert "no secret key" in refused("service.key_secret")


@pytest.mark.parametrize(
    ("values", "where"),
    [
        ({"port": 65535}, "port"),
        ({"port": "7400"}, "port"),
        ({"host": ""}, "host"),
        ({"max_clients": 0}, "max_clients"),
        ({"token": TOKEN}, "token"),
        ({"curve": {"port": 7401, "key_file": "a", "clients_folder": "b"}}, "[curve], port"),
    ],
)
def test_settings_are_checked_in_words(values, where):
    with pytest.raises(ServiceError) as told:
        toml_schema.check(NetworkSettings, values, "service.toml", ServiceError)
    assert told.value.where == f"service.toml, {where}"
    assert TOKEN not in str(told.value)


def test_a_door_does_not_show_its_secrets(curve, token_file):
    shown = repr(endpoints_of(NetworkSettings(curve=curve, token_file=token_file)))
    assert token_file.read_text().strip() not in shown
    assert "secret_key" not in shown


def test_without_a_guard_no_client_is_accepted():
    """libzmq itself would accept every client of the mechanism NULL."""
    (endpoint,) = endpoints_of(NetworkSettings(port=0))
    context = zmq.Context()
    try:
        stream = context.socket(zmq.XPUB)
        endpoint.prepare(stream)
        stream.handshake_ivl = 200  # in milliseconds, instead of `HANDSHAKE_SECONDS`
        stream.bind(endpoint.stream)
        client = context.socket(zmq.SUB)
        monitor = client.get_monitor_socket(zmq.EVENT_HANDSHAKE_SUCCEEDED | zmq.EVENT_DISCONNECTED)
        client.connect(stream.last_endpoint.decode())
        assert monitor.poll(10_000)
        assert recv_monitor_message(monitor)["event"] == zmq.EVENT_DISCONNECTED
    finally:
        context.destroy(0)
