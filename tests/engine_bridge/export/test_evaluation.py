"""Positions in an animated file: those of the same file with its nodes posed, and interpolation by hand."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from engine_bridge.character.character import from_document
from engine_bridge.character.document_reader import load_document
from engine_bridge.character.evaluation import Evaluation

from ..character.conftest import CORNERS, SIDES
from .conftest import add_animation, posed


def test_every_export_is_at_any_time_where_its_posed_nodes_have_it(export):
    document, times = load_document(export.path), np.array([0.0, 0.51, 1.234, 9.0])
    parts = export.clip.motion.prepared.character.parts
    for time, found in zip(times, Evaluation(document, parts).positions(times), strict=True):
        shown = {(part.node, part.primitive): part for part in from_document(posed(document, time)).parts}
        expected = np.concatenate([shown[part.node, part.primitive].vertices for part in parts])
        assert_allclose(found, expected, rtol=0, atol=1e-6 * export.diagonal)


@pytest.mark.parametrize(
    ("interpolation", "values", "expected"),
    [
        ("STEP", [[1, 0, 0], [3, 0, 0]], [1, 1, 3]),
        ("LINEAR", [[1, 0, 0], [3, 0, 0]], [1, 1.5, 3]),
        # with the tangents 2 and 4 over two seconds: 1 + 2 t³ (3 − …), at t = 1/4 by the formula of the specification
        ("CUBICSPLINE", [[0, 0, 0], [1, 0, 0], [2, 0, 0], [4, 0, 0], [3, 0, 0], [0, 0, 0]], [1, 1.5, 3]),
    ],
)
def test_keys_are_interpolated_as_the_file_says(glb, tmp_path, interpolation, values, expected):
    node = glb.show(CORNERS, SIDES)
    add_animation(glb, "moves", node, "translation", [1, 3], values)
    glb.file.animations[0].samplers[0].interpolation = interpolation
    document = load_document(glb.save(tmp_path / "moving.glb"))
    found = Evaluation(document, from_document(document).parts).positions(np.array([0, 1.5, 4]))
    assert_allclose([*found], [CORNERS + np.array([x, 0, 0]) for x in expected], atol=1e-6)
