"""What a Puppet3D shows, in each of its modes, is what the solver has for the same frames of the real service."""

import json
import subprocess
import sys
from collections import namedtuple

import numpy as np
import pytest
from scipy.spatial import cKDTree

from engine_bridge.demo import CASTING, prepare
from engine_bridge.gltf.character import load_character
from engine_bridge.live.frame import StreamedCharacter
from engine_bridge.live.payloads import decode
from engine_bridge.live.wire import Kind
from engine_bridge.rig import load_rig

CONTROLS, VERTICES, MORPHS = range(3)
SAMPLES = 20
Shown = namedtuple("Shown", "told positions")
Seen = namedtuple("Seen", "header body")


@pytest.fixture
def show(start_godot, tmp_path):
    """Have Godot show a character of a service until it has told what it shows of some frames."""

    def run(service, count, samples=SAMPLES, allow=(), **settings):
        file = tmp_path / "shown.bin"
        settings["port"] = int(service.stream.rpartition(":")[2])
        asked = {"settings": settings, "samples": samples, "file": str(file)}
        results = start_godot("show_puppet.gd", json.dumps(asked)).finish(120, allow)
        told = [result for result in results if "sequence" in result]
        rest, positions = np.split(np.fromfile(file, "<f4").reshape(-1, 3), [-samples * count])
        return rest, [Shown(*each) for each in zip(told, np.split(positions, samples), strict=True)]

    return run


@pytest.fixture
def listening():
    """Collect, in the background of a test, what a service says of one kind: header and body by sequence number."""

    def collect(client):
        return {message.header.sequence: Seen(message.header, message.body) for message in client.pending()}

    return collect


def blended(shown, seen):
    """Return what is shown of one kind of message, between two frames."""
    first, second = (seen[shown.told[which]] for which in ("sequence", "next_sequence"))
    share = shown.told["share"]
    return (1 - share) * first.astype(float) + share * second.astype(float)


def solved(puppet):
    """Return what computes the character's positions from controls: the solver's own."""
    binding = StreamedCharacter("any", load_rig(puppet), 1).binding
    return lambda controls: binding.vertices_and_normals(controls.astype(np.float32))[0]


def assert_moves(positions, diagonal):
    """Make sure that it was worth looking at."""
    assert np.ptp(np.stack(positions), axis=0).max() > 0.03 * diagonal


def diagonal_of(puppet):
    return load_rig(puppet).mesh.diagonal


@pytest.fixture
def playing(serve):
    """Start the service with a puppet that somebody plays over and over."""

    def start(puppet, log, *more):
        return serve("--puppet", puppet, "--source", f"replay:{log}?loop", "--calibrate", "at_once", *more)

    return start


def check_controls_and_vertices(show, puppet, service, **settings):
    count, diagonal = len(load_rig(puppet).character.vertices), diagonal_of(puppet)
    client = service.client(f"{puppet.stem}/controls")
    evaluate = solved(puppet)
    for mode in (CONTROLS, VERTICES):
        _, shown = show(service, count, mode=mode, **settings)
        seen = {number: each.body for number, each in collected(client).items()}
        for each in shown:
            told = each.told if mode == CONTROLS else each.told | {"share": 0.0}
            expected = evaluate(blended(Shown(told, None), seen))
            assert np.abs(each.positions - expected).max() <= 1e-5 * diagonal
        assert_moves([each.positions for each in shown], diagonal)
        assert any(0.1 < each.told["share"] < 0.9 for each in shown)


def collected(client):
    return {message.header.sequence: Seen(message.header, message.body) for message in client.pending()}


def test_controls_and_vertices(show, playing, blob_puppet, take):
    check_controls_and_vertices(show, blob_puppet, playing(blob_puppet, take))
