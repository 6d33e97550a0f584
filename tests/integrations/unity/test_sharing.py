"""Followers of one service share its connection, and those of one character its scene."""

import pytest


@pytest.fixture
def follow(start):
    """Start a program that follows as many characters as it is told."""
    return start("Sharing")


@pytest.fixture
def connections(figure):
    """The number of connections of the figure's service, this fixture's one not counted, in each new status."""
    client = figure.client("service/status")

    def until(wanted):
        client.until(lambda message: message.body["clients"]["connected"] - 1 == wanted)

    return until


def frames_of(name):
    return lambda said: said.get("name") == name and "frame" in said


def test_three_followers_take_one_connection_and_one_scene(follow, figure, connections):
    for name, kind in (("one", "controls"), ("two", "controls"), ("three", "vertices")):
        follow.tell(f"open {name} {figure.port} - blob {kind}")
    told = [follow.until(frames_of(name)) for name in ("one", "two", "three")]
    assert len({said["scene"] for said in told}) == 1
    connections(1)
    follow.tell("close one")
    follow.until(lambda said: "closed" in said)
    since = len(follow.said)
    follow.until(frames_of("two"), since)
    connections(1)
    follow.tell("close two")
    follow.tell("close three")
    connections(0)
    ended = follow.finish()
    closed = [said.get("closed") for said in ended].index("one")
    assert not any(frames_of("one")(said) for said in ended[closed:])


def test_other_tokens_and_other_addresses_are_other_connections(follow, figure, locked_figure, token_file):
    token = token_file.read_text()
    follow.tell(f"open right {locked_figure.port} {token} blob controls")
    follow.until(frames_of("right"))
    follow.tell(f"open wrong {locked_figure.port} wrong blob controls")
    follow.tell(f"open other {figure.port} - blob controls")
    refused = follow.until(lambda said: said.get("name") == "wrong" and said.get("state") == "Refused")
    assert "does not accept the token" in refused["reason"]
    since = len(follow.said)
    scenes = {name: follow.until(frames_of(name), since)["scene"] for name in ("right", "other")}
    assert scenes["right"] != scenes["other"]
    follow.tell("close wrong")
    follow.tell(f"open wrong {locked_figure.port} {token} blob controls")
    assert follow.until(frames_of("wrong"))["scene"] == scenes["right"]
    follow.finish()
