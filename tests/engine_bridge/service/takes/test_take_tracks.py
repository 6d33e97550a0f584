import os
from types import SimpleNamespace

import pytest

from engine_bridge.performance.prepared_character import load_prepared
from engine_bridge.service.takes import take_tracks
from engine_bridge.service.takes.take_tracks import TakeTracks


@pytest.fixture
def player(make_player, blob_puppet):
    return make_player("dog", prepared=load_prepared(blob_puppet))


@pytest.fixture
def path(record_take, blob_puppet):
    return record_take(names=("dog",), puppet=blob_puppet)[0]


def test_motion_is_computed_again_only_after_the_take_or_the_character_has_changed(player, path, make_player):
    tracks = TakeTracks()
    first = tracks.of(player, path)
    assert tracks.of(player, path) is first
    assert tracks.of(player, path, "dog") is not first  # another part of the take, as far as anybody knows
    player.motion.idle = SimpleNamespace(at=lambda _: player.motion.at_rest)
    assert (second := tracks.of(player, path)) is not first
    player.motion.idle = None
    assert tracks.of(player, path) is first
    assert tracks.of(make_player("dog", prepared=player.character.prepared), path) not in (first, second)
    os.utime(path, (1, 1))
    assert tracks.of(player, path) is not first


def test_the_motion_that_was_asked_for_longest_ago_is_dropped_first(player, path, tmp_path, monkeypatch):
    paths = [path, *(tmp_path / f"other{number}.log" for number in range(2))]
    for other in paths[1:]:
        other.write_bytes(path.read_bytes())
    tracks = TakeTracks()
    first = tracks.of(player, path)
    monkeypatch.setattr(take_tracks, "KEPT_FRAMES", 2 * len(first.times))
    second = tracks.of(player, paths[1])
    assert tracks.of(player, path) is first
    tracks.of(player, paths[2])
    assert tracks.of(player, path) is first
    assert tracks.of(player, paths[1]) is not second
