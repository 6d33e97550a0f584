"""What damaged character files must go through or be refused on.

``PUPPETLINE_FUZZ=20`` damages twenty times as many files as otherwise, the same ones first.
"""

import json
import math
import signal
import zlib
from contextlib import contextmanager

import numpy as np
import pytest

from engine_bridge.character.character import load_character
from engine_bridge.cli.inspection import inspect
from engine_bridge.export.animation import Keyframes, animate
from puppetline.errors import PuppetlineError

from ..effort import EFFORT
from .corpus import BESIDE, CORPUS
from .damage import DAMAGES, of_kind

STILL = Keyframes("still", np.float32([0, 1]), np.zeros((2, 1), np.float32), np.zeros((2, 3), np.float32))


def go_all_the_way(path):
    """Read a file, look at it, weld it, animate it without moving it, write it, and read that again.

    What was written must hold the same character.
    """
    character = load_character(path)
    colors = character.colors
    assert colors is None or colors.shape == character.vertices.shape
    mesh = character.solver_mesh()
    json.dumps(inspect(path)).encode()
    still = [(np.zeros((1, *part.vertices.shape), np.float32), None) for part in character.parts]
    made = path.with_name("made.glb")
    animate(character, STILL, still.__getitem__).save(made)
    try:
        again = load_character(made)
    except PuppetlineError as error:
        raise AssertionError("what was written cannot be read") from error
    np.testing.assert_array_equal(again.vertices, character.vertices)
    np.testing.assert_array_equal(again.triangles, character.triangles)
    np.testing.assert_array_equal(again.solver_mesh().vertices, mesh.vertices)
    return character


@contextmanager
def no_hang(seconds=120):
    """Turn a road without end into a failure."""

    def stop(number, frame):
        raise TimeoutError(f"no end after {seconds} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


@pytest.fixture(scope="session")
def go():
    return go_all_the_way


@pytest.fixture(scope="session")
def try_damaged():
    """Damage a file in one way, the same each time, and take each on a road; count what came of it.

    This is done `count` times, or with less effort until each outcome has come about `enough` times.
    """

    def run(path, kind, count, enough, road=go_all_the_way):
        name, content, others = path.name, path.read_bytes(), list(CORPUS.values())
        outcomes = {"read": 0, "refused": 0}
        for number in range(math.ceil(count * max(1, EFFORT))):
            if number >= count * EFFORT and min(outcomes.values()) >= enough:
                break
            rng = np.random.default_rng([zlib.crc32(f"{name} {kind}".encode()), number])
            path.write_bytes(DAMAGES[kind](rng, content, others))
            try:
                with no_hang():
                    road(path)
                outcomes["read"] += 1
            except PuppetlineError:
                outcomes["refused"] += 1
            except Exception as error:
                pytest.fail(f"{path} ({kind}, number {number}): {type(error).__name__}: {error}")
        return outcomes

    return run


@pytest.fixture
def folder(tmp_path):
    """A folder with all that the files of the corpus name."""
    for name, content in BESIDE.items():
        (tmp_path / name).write_bytes(content)
    return tmp_path


@pytest.fixture(params=CORPUS)
def whole(request, folder):
    """Each file of the corpus, undamaged."""
    (folder / request.param).write_bytes(CORPUS[request.param])
    return folder / request.param


@pytest.fixture(params=[(name, kind) for name in CORPUS for kind in of_kind(name)], ids="-".join)
def corpus_and_kind(request, folder):
    """Each file of the corpus with each way to damage it."""
    name, kind = request.param
    (folder / name).write_bytes(CORPUS[name])
    return folder / name, kind
