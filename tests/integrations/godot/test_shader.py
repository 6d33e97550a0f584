"""Results of the real shader on a real renderer for the test vectors, read back from the graphics card."""

import base64
from copy import copy

import numpy as np
import pytest

from engine_bridge.service.protocol.header import Kind

from ...modules import load
from ...recorded import VECTORS, decoded, recorded
from ..surface import blended

ALIKE = 2e-6
"""Of the diagonal, and for normals and tangents: what numbers of f32, read in 24 bits, may differ."""

ROUNDED = 3e-4
"""What tangents may differ: in a mesh, Godot rounds them to 16 bits."""


@pytest.fixture(scope="module")
def follow():
    """The example client, which has the formulas of docs/protocol.md."""
    return load("examples/clients/follow.py")


@pytest.fixture(scope="module")
def scene(follow):
    return follow.read_scene(payload("scene").tobytes())


def payload(name, kind="u1"):
    return np.frombuffer(recorded(name)[128:], kind)


@pytest.fixture(scope="module")
def shaded(residents, screen, read_pixels, scene, tmp_path_factory):
    """Return what has been told of each moment, and its positions, normals and tangents."""
    pixels = tmp_path_factory.mktemp("shaded") / "pixels.bin"
    results = residents(screen=screen()).start("shade_vectors.gd", VECTORS, pixels).finish(600)
    moments = read_pixels(pixels, len(results), scene["vertices"], results[0]["box"])
    return [(told, *moment) for told, moment in zip(results, moments, strict=True)]


def expected(follow, scene, told):
    """Return positions and normals as NumPy has them."""
    first, second, share = told["moment"]
    if told["mode"] == "vertices16":  # shown is the frame before now
        return decoded(f"{int(first)}.vertices16")
    before, after = (payload(f"{int(number)}.controls", "<f4").astype(float) for number in (first, second))
    return follow.vertices("controls", scene, (0, 0, 0), ((1 - share) * before + share * after).astype(np.float32))


def test_positions_and_normals_are_those_of_the_protocol_and_bounds_hold_them(shaded, follow, scene):
    for told, positions, normals, _ in shaded:
        where, turned = expected(follow, scene, told)
        assert np.abs(positions - where).max() <= ALIKE * scene["diagonal"]
        assert np.abs(normals - turned).max() <= ALIKE
        low, high = np.array(told["bounds"])
        assert (low - positions.min(axis=0)).max() <= ALIKE * scene["diagonal"]
        assert (positions.max(axis=0) - high).max() <= ALIKE * scene["diagonal"]
    assert {told["mode"] for told, *_ in shaded} == {"controls", "vertices16"}


def test_a_voice_opens_the_mouth_on_the_graphics_card_and_off_it(
    residents, screen, read_pixels, spoken, spoken_files, tmp_path
):
    for kind in (Kind.CONTROLS, Kind.VERTICES16):
        scene, *frames = spoken_files(kind)
        for number, file in enumerate(frames):
            file.rename(tmp_path / f"{number}.{kind.word}.bin")
    scene.rename(tmp_path / "scene.bin")
    results = residents(screen=screen()).start("shade_vectors.gd", tmp_path, tmp_path / "pixels").finish(600)
    results = [told for told in results if told["mode"] == "controls"]
    character = spoken[0].character
    shaded = read_pixels(tmp_path / "pixels", 2 * len(results), len(character.rest), results[0]["box"])
    near = ALIKE * 5 * character.prepared.mesh.diagonal
    for told, (positions, normals, _) in zip(results, shaded, strict=False):
        where, turned = said(character, spoken, told["moment"])
        assert np.abs(positions - where).max() <= near
        assert np.abs(normals - turned).max() <= 1e-4
        low, high = np.array(told["bounds"])
        assert (low - where.min(axis=0)).max() <= near
        assert (where.max(axis=0) - high).max() <= near
        evaluated = np.frombuffer(base64.b64decode(told["evaluated"]), "<f4").reshape(-1, 3)
        assert np.abs(evaluated - where).max() <= near
        if told["moment"][0] == told["moment"][1]:  # patches lie between two frames, not on what is between their poses
            vertex, *place = told["top"]
            assert np.abs(place - where[int(vertex)]).max() <= near


def said(character, spoken, moment):
    """Positions and normals between two frames: transforms and weights are interpolated."""
    before, after = spoken[int(moment[0])], spoken[int(moment[1])]
    controls, weights = (
        (1 - moment[2]) * first + moment[2] * second
        for first, second in ((before.controls, after.controls), (before.targets_moved, after.targets_moved))
    )
    binding = copy(character.binding)
    binding.rest = binding.rest + np.tensordot(weights, character.displacements, 1)
    return binding.vertices_and_normals(controls.astype(np.float32))


def test_tangents_move_with_the_surface(shaded, follow, scene):
    """They are what has become of a little step along the surface."""
    worm, normals = decoded("scene"), scene["normals"].astype(float)
    tangents = follow.unit(np.cross([0.3, -0.5, 0.8], normals))
    a = follow.unit(np.cross(np.eye(3)[np.abs(scene["normals"]).argmin(axis=1)], normals))
    b = np.cross(normals, a)
    for told, _, turned, moved in shaded:
        if told["mode"] == "vertices16":
            expected = tangents - turned * (turned * tangents).sum(axis=1, keepdims=True)
        else:
            first, second, share = told["moment"]
            before, after = (payload(f"{int(number)}.controls", "<f4").astype(float) for number in (first, second))
            moves, steps = blended(worm, (1 - share) * before + share * after)
            x = np.pad(worm.arrays["positions"], [(0, 0), (0, 1)], constant_values=1)
            along = moves[..., :3] @ np.stack([a, b], axis=2)
            along += np.einsum("i,vixy,vy,via->vxa", worm.facts["weights"], steps, x, worm.arrays["slopes"])
            within = np.stack([(tangents * a).sum(axis=1), (tangents * b).sum(axis=1)], axis=1)
            expected = np.einsum("vxa,va->vx", along, within)
        assert np.abs(moved - follow.unit(expected)).max() <= ROUNDED
