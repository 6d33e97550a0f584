"""Skeletal animations with fewer keyframes, compared with the plain ones."""

import numpy as np
import pytest

from engine_bridge.character.character import from_document
from engine_bridge.character.document_reader import load_document
from engine_bridge.export.motion_thinning import thin_motion

from .conftest import posed

TIMES = np.arange(115) / 60
"""At the 58 keyframes and in the middles between two."""


def shown(document):
    """Positions (115, n, 3) of the vertices."""
    return np.array([from_document(posed(document, time)).vertices for time in TIMES])


def hang_on_a_joint(gltf):
    """Let the figure hang on a joint, without its skin."""
    tops = gltf["scenes"][0]["nodes"]
    figure = next(node for node in tops if "skin" in gltf["nodes"][node])
    tops.remove(figure)
    del gltf["nodes"][figure]["skin"]
    gltf["nodes"][gltf["skins"][0]["joints"][1]]["children"] = [figure]


@pytest.mark.parametrize("rigid", [False, True])
def test_every_vertex_is_within_the_error_and_the_error_within_the_tolerance(exported, rigid):
    export = exported("textured", "rig")
    document, tolerance = load_document(export.path), 0.003 * export.diagonal
    if rigid:
        hang_on_a_joint(document.gltf)
    before = shown(document)
    keyframes, error = thin_motion(document, tolerance)
    away = np.linalg.norm(shown(document) - before, axis=2).max(axis=1)
    assert away[::2].max() <= error + 1e-6 * export.diagonal
    assert away.max() <= 1.05 * error + 1e-6 * export.diagonal
    assert error <= tolerance
    assert keyframes == len(document.array(document.gltf["animations"][0]["samplers"][0]["input"]))
    assert keyframes < 58


def test_a_still_animation_keeps_its_ends_and_another_without_tolerance_everything(exported):
    document = load_document(exported("textured", "rig").path)
    assert thin_motion(document.copy(), 0)[0] == 58
    for sampler in document.gltf["animations"][0]["samplers"]:
        keys = document.array(sampler["output"])
        document.replace(sampler["output"], np.repeat(keys[:1], len(keys), axis=0))
    keyframes, error = thin_motion(document, 0.001)
    assert keyframes == 2
    assert error == pytest.approx(0, abs=1e-6)
