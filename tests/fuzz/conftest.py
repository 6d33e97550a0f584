"""Reading and writing of damaged character files, each of which is refused or remains the same.

``PUPPETLINE_FUZZ=20`` multiplies the number of damaged files by twenty; the first ones stay the same.
"""

import json
import math
import zlib

import numpy as np
import pytest

from engine_bridge.character.character import load_character
from engine_bridge.export.animation import Keyframes, animate
from engine_bridge.inspection.files import inspect
from puppetline.errors import MeshError, PuppetlineError

from ..effort import EFFORT
from ..oracles import assert_is_error_of, assert_is_sound_character
from .corpus import CORPUS, SIDE_FILES
from .damage import DAMAGE

REST_TAKE = Keyframes("still", np.float32([0, 1]), np.zeros((2, 1), np.float32), np.zeros((2, 3), np.float32))


def read_and_write(path):
    """Read and weld a character, write it with an animation that does not move it, and read it again.

    Fail unless both are the same.
    """
    character = load_character(path)
    assert_is_sound_character(character)
    mesh = character.solver_mesh()
    still = [(np.zeros((1, *part.vertices.shape), np.float32), None) for part in character.parts]
    made = path.with_name("made.glb")
    animate(character, REST_TAKE, still.__getitem__).save(made)
    try:
        again = load_character(made)
    except PuppetlineError as error:
        raise AssertionError("what was written cannot be read") from error
    np.testing.assert_array_equal(again.vertices, character.vertices)
    np.testing.assert_array_equal(again.triangles, character.triangles)
    np.testing.assert_array_equal(again.solver_mesh().vertices, mesh.vertices)
    return character


def try_damaged(path, kind, count, enough, process=read_and_write):
    """Apply one kind of damage to a file and process the result; return the number of each outcome.

    Repeat it `count` times or, with less effort, until each outcome has occurred `enough` times. With less effort, only
    the first one that can be read is inspected, which takes much longer than reading.
    """
    name, content, others = path.name, path.read_bytes(), list(CORPUS.values())
    outcomes = {"read": 0, "refused": 0}
    for number in range(math.ceil(count * max(1, EFFORT))):
        if number >= count * EFFORT and min(outcomes.values()) >= enough:
            break
        rng = np.random.default_rng([zlib.crc32(f"{name} {kind}".encode()), number])
        path.write_bytes(DAMAGE[kind](rng, content, others))
        try:
            process(path)
            if EFFORT >= 1 or not outcomes["read"]:
                json.dumps(inspect(path)).encode()
            outcomes["read"] += 1
        except PuppetlineError as error:
            assert_is_error_of(error, MeshError, path)
            outcomes["refused"] += 1
        except Exception as error:
            pytest.fail(f"{path} ({kind}, number {number}): {type(error).__name__}: {error}")
    return outcomes


@pytest.fixture
def folder(tmp_path):
    """Return a folder with the files that files of the corpus refer to."""
    for name, content in SIDE_FILES.items():
        (tmp_path / name).write_bytes(content)
    return tmp_path
