"""Exported files in Blender, Babylon.js, Godot and assimp, compared with the solver; three.js is in `test_exports`."""

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from engine_bridge.character.character import from_document
from engine_bridge.character.document_reader import load_document

from .conftest import posed

pytestmark = pytest.mark.slow

PROGRAMS = ["Blender", "Babylon.js", "Godot", "assimp"]
CHARACTERS = {
    "textured": "rig",
    "several_primitives": "rig",
    "node_transforms": "frames",
    "shared_mesh": "morph",
    "own_targets": "morph",
    "skinned": "frames",
    "kaykit_Knight": None,
    "quaternius_Adventurer": "frames",
    "khronos_Fox": "morph",
}
"""Characters, and the form in which every program sees them; the last three are of others, and have no made rigs.

The knight takes minutes, and is seen in the full product only.
"""

REAL = list(CHARACTERS)[-3:]
CASES = [
    pytest.param(program, form, name, marks=[] if CHARACTERS[name] == form else pytest.mark.exhaustive)
    for program in PROGRAMS
    for form in ("morph", "frames", "rig")
    for name in CHARACTERS
    if form != "rig" or name not in REAL
]

FPS = 30
FRAMES = 31
"""Number of frames of one second."""
TIMES = 13
"""Number of times, two and a half frames apart: alternately at a keyframe and in the middle between two."""
ROUNDING = 2e-6
"""Maximum error of the programs, which use float32, as a fraction of the diagonal."""


@pytest.fixture(scope="module")
def second(record, dance, tmp_path_factory):
    """A recording of one second."""
    return record(tmp_path_factory.mktemp("second") / "one_second.log", dance(FRAMES))


@pytest.fixture(scope="module")
def file(export_of, second, limb_tables, tmp_path_factory):
    """Export a character, once for all tests; synthetic ones have a root, and limbs for a rig."""
    folder = tmp_path_factory.mktemp("exported")

    @cache
    def make(name, form):
        return export_of(folder, second, name, form, **({"handles": limb_tables} if form == "rig" else {}))

    return make


def allowed(program, made, expected):
    """Maximum distance of a vertex from its position in the file, in the character's units."""
    rounding = ROUNDING * made.diagonal
    if program == "Godot" and made.raw.file.skins:  # keeps each of at most four weights of a vertex in 16 bits
        rounding += 4 / 65535 * max(np.linalg.norm(positions, axis=2).max() for positions in expected.values())
    return rounding


def targets(made, node):
    """The names of the morph targets of a node's mesh."""
    return (made.raw.file.meshes[made.raw.file.nodes[node].mesh].extras or {}).get("targetNames") or []


def assert_plays_at_once(made, report, form):
    """Assert that Blender plays the recording without further ado, with one keyframe per frame."""
    assert report["fps"] == FPS
    assert report["actions"]["one_second"]["frames"] == [0, FRAMES - 1]
    active = [owner for owner in report["animated"] if owner["action"] is not None]
    assert {owner["action"] for owner in active} == {"one_second"}
    for owner in active:
        assert owner["slot"] == owner["object"]
        assert "one_second" in {track["name"] for track in owner["tracks"]}
    keyed = {owner["object"] for owner in active if owner["kind"] == "KEY"}
    for mesh in report["meshes"]:
        assert (mesh["name"] in keyed) == bool(form != "rig" or targets(made, mesh["node"]))
        for key in mesh["shape_keys"]:
            low, high = key["slider"]
            assert low <= key["asked"][0] <= key["asked"][1] <= high


@pytest.mark.parametrize(("program", "form", "name"), CASES)
def test_every_vertex_is_where_it_was_solved_to_be(program, form, name, file, player, players):
    run, made = player(program), file(name, form)
    shown = run(made.path, TIMES)
    assert_allclose(shown.times, np.arange(TIMES) * 2.5 / FPS, atol=1e-6)
    expected = players.solved(made.clip)(shown.times)
    rounding = allowed(program, made, expected)
    if form == "rig":  # between two keyframes bones turn, and do not go in straight lines
        document, between = load_document(made.path), np.arange(TIMES) % 2 == 1
        poses = [from_document(posed(document, time)).parts for time in shown.times]
        exact = {(p.node, p.primitive): np.array([each[k].vertices for each in poses]) for k, p in enumerate(poses[0])}
        assert players.farthest(shown.meshes, exact) <= rounding
        expected = {key: np.where(between[:, None, None], exact[key], expected[key]) for key in expected}
    assert players.farthest(shown.meshes, expected) <= made.summary.error * made.diagonal + rounding
    everything = np.concatenate(list(shown.meshes.values()), axis=1)
    moved = np.nanmax(np.linalg.norm(everything - everything[0], axis=2), axis=1)
    assert moved[1:].min() > 0.005 * made.diagonal
    if program == "Blender":
        assert_plays_at_once(made, shown.report, form)
