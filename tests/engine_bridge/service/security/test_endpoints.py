import os
import re
import stat

import pytest
import zmq
import zmq.auth
from zmq.utils.monitor import recv_monitor_message

from engine_bridge.service.security import endpoints as endpoints_module
from engine_bridge.service.security.credentials import make_curve_keys, make_token, read_token
from engine_bridge.service.security.endpoints import CurveTable, NetworkSettings, endpoints_of
from puppetline import toml_schema
from puppetline.errors import OutputError, ServiceError

from ...refusals import refused

TOKEN = "Zp3-sYd_0123456789"


def opened(**settings):
    return endpoints_of(NetworkSettings(**settings))


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


@pytest.mark.parametrize("host", ["127.255.255.254", "::1", "localhost"])
def test_a_loopback_address_needs_no_credentials(host):
    (endpoint,) = opened(host=host)
    assert endpoint.mechanism == "NULL"
    assert endpoint.stream.startswith(("tcp://127.", "tcp://[::1]"))
    assert endpoint.stream[-5:] == ":7400"
    assert endpoint.control[-5:] == ":7401"


OTHERS = ["*", "::", "192.168.0.7", "fe80::1", "::ffff:127.0.0.1"]
NO_HOSTS = ["no such host", "a" * 70, "127.0.0.1:80"]


@pytest.mark.parametrize("host", OTHERS + NO_HOSTS)
def test_any_other_address_needs_them_and_one_that_is_none_of_this_machine_is_refused(host):
    told = refused(ServiceError, opened, host=host)
    assert told.where == "[network], host"
    assert ("puppetline token FILE" in told.fix) == (host in OTHERS)


def test_a_name_counts_as_what_it_stands_for(monkeypatch):
    def resolve(*_, **__):
        return [(2, 1, 6, "", (address, 0))]  # as the test decides

    monkeypatch.setattr(endpoints_module.socket, "getaddrinfo", resolve)
    address = "192.168.0.7"
    refused(ServiceError, opened, host="stage.local")
    address = "127.0.1.1"
    assert opened(host="stage.local")[0].stream == "tcp://127.0.1.1:7400"


@pytest.mark.parametrize("host", ["0.0.0.0", "127.0.0.1"])
def test_a_token_locks_every_address(host, token_file):
    (endpoint,) = opened(host=host, token_file=token_file)
    token = read_token(token_file).encode()
    assert endpoint.mechanism == "PLAIN"
    assert endpoint.stream == f"tcp://{host}:7400"
    assert endpoint.admits([b"anybody", token])
    for wrong in ([], [token], [b"", b""], [b"", token[:-1]], [b"", token + b"x"], [token, b""], [b"", token, b""]):
        assert not endpoint.admits(wrong)


def test_the_token_may_come_from_the_environment_and_the_file_outdoes_it(monkeypatch, token_file):
    assert read_token(None) is None
    monkeypatch.setenv("PUPPETLINE_TOKEN", TOKEN)
    assert read_token(None) == TOKEN
    assert opened()[0].admits([b"", TOKEN.encode()])
    assert not opened(token_file=token_file)[0].admits([b"", TOKEN.encode()])


@pytest.mark.parametrize("token", ["", "a" * 15, "a" * 256, "with a space in it", "naïve-but-long-enough", "a\nb" * 9])
def test_a_weak_or_unsendable_token_is_refused_without_showing_it(monkeypatch, token):
    monkeypatch.setenv("PUPPETLINE_TOKEN", token)
    told = refused(ServiceError, opened)
    assert "PUPPETLINE_TOKEN" in told.where
    assert not token or token not in str(told)


@pytest.mark.parametrize("length", [16, 255])
def test_tokens_of_16_to_255_characters_are_taken(monkeypatch, length):
    monkeypatch.setenv("PUPPETLINE_TOKEN", "~" * length)
    assert opened()[0].admits([b"", b"~" * length])


@pytest.mark.parametrize("mode", ["640", "604", "620", "601"])
def test_a_token_that_others_can_read_is_refused_with_what_to_type(token_file, mode):
    token_file.chmod(int(mode, 8))
    told = refused(ServiceError, opened, token_file=token_file)
    assert mode in told.found
    assert told.fix == f"Type: chmod go-rwx {token_file}"


def test_files_that_are_none_are_refused_without_waiting(tmp_path):
    names = pipe, folder, *written, _ = [tmp_path / name for name in ("pipe", "folder", "long", "weak", "nothing")]
    os.mkfifo(pipe, 0o600)
    folder.mkdir()
    for path, text in zip(written, ("a" * 5000, "short"), strict=True):
        path.write_text(text)
        path.chmod(0o600)
    for path in names:
        assert refused(ServiceError, opened, token_file=path).where == str(path)


def test_a_new_token_is_long_new_and_for_its_owner_only(tmp_path, token_file):
    make_token(tmp_path / "other")
    one, other = token_file.read_text().strip(), (tmp_path / "other").read_text().strip()
    assert one != other
    for token in (one, other):
        assert re.fullmatch("[0-9a-f]{64}", token)  # without a dash, with which an option of a program begins
    assert stat.S_IMODE(token_file.stat().st_mode) == 0o600
    refused(OutputError, make_token, token_file)
    assert read_token(token_file) == one
    assert {path.name for path in tmp_path.iterdir()} == {"token", "other"}


def test_keys_are_those_of_zmq_auth_and_are_not_replaced(tmp_path):
    secret, public = (tmp_path / name for name in ("service.key_secret", "service.key"))
    make_curve_keys(secret)
    key, private = zmq.auth.load_certificate(secret)
    assert zmq.curve_public(private) == key
    assert zmq.auth.load_certificate(public) == (key, None)
    assert stat.S_IMODE(secret.stat().st_mode) == 0o600
    refused(OutputError, make_curve_keys, tmp_path / "other.key")
    refused(OutputError, make_curve_keys, secret)
    for gone, other in ((secret, public), (public, secret)):
        content, kept = gone.read_bytes(), other.read_bytes()
        gone.unlink()
        refused(OutputError, make_curve_keys, secret)
        assert gone.exists() is False
        assert other.read_bytes() == kept
        gone.write_bytes(content)


def test_curve_is_a_door_of_its_own_beside_the_other_and_no_door_shows_its_secrets(curve, token_file):
    elsewhere = curve.model_copy(update={"host": "0.0.0.0"})
    for settings, doors in (
        ({"host": "0.0.0.0", "curve": curve}, {"CURVE": "0.0.0.0:7410"}),
        ({"curve": elsewhere}, {"NULL": "127.0.0.1:7400", "CURVE": "0.0.0.0:7410"}),
        ({"host": "::", "curve": curve, "token_file": token_file}, {"PLAIN": "[::]:7400", "CURVE": "[::]:7410"}),
    ):
        found = opened(**settings)
        assert {endpoint.mechanism: endpoint.stream.removeprefix("tcp://") for endpoint in found} == doors
        assert read_token(token_file) not in repr(found)
        assert "secret_key" not in repr(found)


def test_faulty_keys_are_refused_by_name(curve, tmp_path):
    def fix(path):
        error = refused(ServiceError, opened, curve=curve)
        assert error.where == str(path)
        return error.fix

    clients, service = curve.clients_folder, curve.key_file
    laptop = clients / "laptop.key"
    laptop.chmod(0o666)
    assert f"chmod go-w {laptop}" in fix(laptop)
    laptop.chmod(0o600)
    for content in (f'public-key = "{"%" * 40}"\n', ""):
        laptop.write_text(content)
        fix(laptop)
    laptop.unlink()
    fix(clients)  # without a key
    clients.chmod(0o777)
    assert "chmod go-w" in fix(clients)
    clients.rmdir()
    fix(clients)
    service.chmod(0o644)
    assert f"chmod go-rwx {service}" in fix(service)
    service.chmod(0o600)
    service.write_bytes((tmp_path / "service.key").read_bytes())
    fix(service)  # which holds the public one


@pytest.mark.parametrize(
    ("values", "where"),
    [
        ({"port": 65535}, "port"),
        ({"max_clients": 0}, "max_clients"),
        ({"token": TOKEN}, "token"),
        ({"curve": {"port": 7401, "key_file": "a", "clients_folder": "b"}}, "[curve], port"),
    ],
)
def test_settings_are_checked_in_words(values, where):
    told = refused(ServiceError, toml_schema.check, NetworkSettings, values, "service.toml", ServiceError)
    assert told.where == f"service.toml, {where}"
    assert TOKEN not in str(told)


def test_without_a_guard_no_client_is_accepted(context):
    """libzmq itself would accept every client of the mechanism NULL."""
    (endpoint,) = opened(port=0)
    stream, client = context.socket(zmq.XPUB), context.socket(zmq.SUB)
    endpoint.prepare(stream)
    stream.handshake_ivl = 200  # in milliseconds, instead of `HANDSHAKE_SECONDS`
    stream.bind(endpoint.stream)
    monitor = client.get_monitor_socket(zmq.EVENT_HANDSHAKE_SUCCEEDED | zmq.EVENT_DISCONNECTED)
    client.connect(stream.last_endpoint.decode())
    assert recv_monitor_message(monitor)["event"] == zmq.EVENT_DISCONNECTED
