import os

import pytest

from engine_bridge.studio.web.page_access import MAX_SESSIONS, Addresses, Tokens, check_exposure, page_headers
from puppetline.errors import ServiceError

from ...refusals import refused

OWNERS = "of-a-file-of-the-owner"


def test_a_one_time_token_is_exchanged_once_and_a_session_and_an_owners_token_are_accepted_again():
    tokens = Tokens(OWNERS)
    token = tokens.invite()
    session = tokens.enter(token)
    assert session != token
    assert tokens.is_session(session)
    assert not tokens.is_session(token)
    assert refused(ServiceError, tokens.enter, token).found == "a one-time token that was used before"
    assert tokens.enter(session) == session
    for wrong in ("", "x", "of-a-file-of-the-owneR", "\ud800", "a" * 100_000):
        assert refused(ServiceError, tokens.enter, wrong).found == "a wrong token"
        assert not tokens.is_session(wrong)
    for _ in range(2):
        assert tokens.is_session(tokens.enter(OWNERS))
    assert not any(secret in repr(vars(tokens)) for secret in (token, session, OWNERS))


def test_the_session_that_was_used_least_recently_ends_first():
    tokens = Tokens()
    sessions = [tokens.enter(tokens.invite()) for _ in range(MAX_SESSIONS)]
    assert tokens.is_session(sessions[0])
    tokens.enter(tokens.invite())
    assert [tokens.is_session(each) for each in sessions[:3]] == [True, False, True]


def test_windows_continue_after_a_restart_unless_the_owners_token_has_changed(tmp_path):
    file = tmp_path / "state" / "windows"
    for fixed in (None, OWNERS):
        before = Tokens(fixed, file)
        sessions = [before.enter(before.invite()) for _ in range(2)]
        after = Tokens(fixed, file)
        assert all(after.is_session(each) for each in sessions)
        assert [after.enter(each) for each in sessions] == sessions
        assert not any(secret in file.read_text() for secret in (*sessions, OWNERS))
        assert os.name == "nt" or file.stat().st_mode & 0o777 == 0o600
        assert not Tokens("another-token", file).is_session(sessions[0])
    file.write_text("not hexadecimal")
    assert not Tokens(OWNERS, file).is_session(sessions[0])


@pytest.mark.parametrize("host", ["0.0.0.0", "*"])
def test_other_machines_need_a_token(host):
    check_exposure(Addresses(host, 7480), 16 * "x")
    refused(ServiceError, check_exposure, Addresses(host, 7480), None)


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost"])
def test_this_machine_needs_none(host):
    check_exposure(Addresses(host, 7480), None)


def test_the_link_has_the_token_in_its_fragment():
    assert Addresses("127.0.0.1", 7480).link("abc") == "http://127.0.0.1:7480/#token=abc"
    assert Addresses("::1", 7480).link("abc") == "http://[::1]:7480/#token=abc"
    assert Addresses("*", 7480, ["https://studio.example"]).link("abc") == "https://studio.example/#token=abc"


@pytest.mark.parametrize("wrong", ["studio.example", "ftp://studio.example", "https://studio.example/page", "https://"])
def test_an_origin_is_the_beginning_of_an_address(wrong):
    refused(ServiceError, Addresses, "127.0.0.1", 7480, [wrong])


def test_the_page_may_load_only_what_the_studio_sends():
    policy = dict(each.split(" ", 1) for each in page_headers("127.0.0.1:7480")["Content-Security-Policy"].split("; "))
    assert policy["default-src"] == "'self'"
    assert policy["connect-src"] == "'self' blob: ws://127.0.0.1:7480 wss://127.0.0.1:7480"
    assert policy["frame-ancestors"] == policy["object-src"] == policy["base-uri"] == "'none'"
    assert "unsafe" not in str(policy)
