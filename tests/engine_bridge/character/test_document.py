import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from engine_bridge.character import schema
from engine_bridge.character.document import Document
from puppetline.errors import MeshError, OutputError

from ..refusals import refused


@pytest.mark.parametrize(("code", "kind"), [(5120, np.int8), (5121, np.uint8), (5122, np.int16), (5123, np.uint16)])
def test_normalised_integers_become_the_floats_that_the_specification_says(code, kind):
    """f = max(c / the largest integer, -1)."""
    limits = np.iinfo(kind)
    stored = np.arange(limits.min, limits.max + 1)
    document = Document(schema.empty())
    accessor = {"bufferView": document.add_view(stored.astype(kind).tobytes()), "componentType": code}
    document.gltf["accessors"] = [accessor | {"count": len(stored), "type": "SCALAR", "normalized": True}]
    values = document.array(0)
    assert values.dtype == np.float32
    assert_allclose(values, np.maximum(stored / limits.max, -1), rtol=1e-7)


def test_saving_to_a_folder_that_is_not_there_is_an_output_error(tmp_path):
    refused(OutputError, Document(schema.empty()).save, tmp_path / "no" / "made.glb")


def sparse(base, rows, values, count=5):
    """A document with one sparse accessor."""
    document = Document(schema.empty())
    first, second, third = (document.add_view(array.tobytes()) for array in (base, rows, values))
    accessor = {"componentType": 5126, "count": count, "type": "VEC3"} | ({"bufferView": first} if base.size else {})
    accessor["sparse"] = {
        "count": len(rows),
        "indices": {"bufferView": second, "componentType": {1: 5121, 2: 5123, 4: 5125}[rows.itemsize]},
        "values": {"bufferView": third},
    }
    document.gltf["accessors"] = [accessor]
    return document


@pytest.mark.parametrize("kind", ["u1", "u2", "u4"])
@pytest.mark.parametrize("based", [True, False])
def test_sparse_values_stand_in_for_some_of_the_rest(kind, based):
    base = np.arange(15, dtype="f4").reshape(5, 3)
    changed = np.array([[9, 8, 7], [6, 5, 4]], "f4")
    document = sparse(base if based else base[:0], np.array([1, 4], kind), changed)
    expected = base * based
    expected[[1, 4]] = changed
    assert_array_equal(document.array(0), expected)


@pytest.mark.parametrize("count", [5, 10**12])  # the second would take all memory
def test_sparse_values_outside_the_array_and_zeros_without_end_are_refused(count):
    document = sparse(np.zeros((0, 3), "f4"), np.array([5], "u4"), np.ones((1, 3), "f4"), count)
    refused(MeshError, document.array, 0)
