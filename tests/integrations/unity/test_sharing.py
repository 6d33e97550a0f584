"""Followers of one service share its connection, and those of one character its scene."""

import numpy as np
import pytest

from .conftest import array


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


def test_each_follower_gets_the_values_that_were_sent_and_a_later_one_the_scene_that_is_here(follow, stage):
    stage.is_playing, scenes = True, set()
    for name, character, kind in (
        ("one", "blob", "vertices"),
        ("two", "-", "vertices"),
        ("three", "blob", "vertices16"),
    ):
        follow.tell(f"open {name} {stage.port} - {character} {kind}")
        said = follow.until(frames_of(name))
        scenes.add(said["scene"])
        sent = stage.sent[said["frame"]].vertices_and_normals[0]
        tolerance = 1e-4 * stage.diagonal if name == "three" else 0
        np.testing.assert_allclose(array(said["values"], columns=3)[: len(sent)], sent, rtol=0, atol=tolerance)
    follow.finish()
    assert (len(scenes), stage.scenes) == (1, 1)


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
