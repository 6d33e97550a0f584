from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose, assert_array_equal

from engine_bridge.character.document_reader import load_document
from engine_bridge.export.bake import bake
from engine_bridge.export.live_basis import EXTRAS, REACH, UNLIMITED_REACH, LiveBasis
from engine_bridge.performance.prepared_character import load_prepared
from puppetline.errors import PuppetError

from ...fuzz.corpus import pack, unpack
from ..refusals import refused, refused_place
from .conftest import solved_places


@dataclass(frozen=True)
class Baked:
    """A baked file, with expected results in float64 from W and the file's accessors."""

    path: Path
    prepared: object
    targets: np.ndarray  # (n, 3, K) of the solver's vertices, mesh units

    def moved(self, R):
        """(n, 3) displacements of the solver's vertices, mesh units."""
        there, rest = solved_places(self.prepared, np.array([R, self.prepared.model.rest_controls]))
        return there - rest

    def left(self, R, weights):
        """Root mean square error of the targets, as a fraction of the diagonal."""
        away = self.moved(R) - self.targets @ weights.astype(np.float64)
        return np.sqrt((away**2).sum(axis=1).mean()) / self.prepared.mesh.diagonal


@pytest.fixture(scope="module")
def baked(take, blob_puppet, prepared_blob, tmp_path_factory):
    path = tmp_path_factory.mktemp("live basis") / "blob.morphs.glb"
    bake(blob_puppet, path, (take,), tolerance=1e-3)
    document = load_document(path)
    (primitive,) = document.gltf["meshes"][0]["primitives"]
    targets = np.stack([document.array(target["POSITION"]) for target in primitive["targets"]], axis=-1)
    of_solver = np.unique(prepared_blob.mesh.of_render, return_index=True)[1]
    return Baked(path, prepared_blob, targets[of_solver].astype(np.float64))


@pytest.fixture(scope="module")
def noise(baked):
    """Return a pose with random motion of a size."""
    random, rest = np.random.default_rng(3), baked.prepared.model.rest_controls
    return lambda size: rest + random.normal(scale=size, size=rest.shape)


@pytest.fixture(scope="module")
def basis(baked):
    return LiveBasis.load(baked.path, baked.prepared)


@pytest.fixture(scope="module")
def directions(baked):
    document = load_document(baked.path)
    kept = document.array(document.gltf["asset"]["extras"][EXTRAS]["directions"])
    return kept.reshape(-1, *baked.prepared.model.rest_controls.shape).astype(np.float64)


@pytest.fixture
def of_shape(glb, write_puppet, tmp_path):
    """Prepare a puppet of a surface."""

    def make(vertices, faces):
        glb.show(vertices, faces)
        mesh = glb.save(tmp_path / "other.glb")
        return load_prepared(write_puppet(tmp_path / "other.toml", mesh.name))

    return make


@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data(), reach=st.sampled_from([UNLIMITED_REACH, 1e9]))
def test_poses_come_back_up_to_where_the_limit_begins_and_no_pose_takes_a_weight_out_of_its_range(
    data, reach, baked, basis, directions
):
    """Each coordinate is limited separately, so that coordinates within the range do not change."""
    model = baked.prepared.model
    mixed = data.draw(arrays(np.float64, len(directions), elements=st.floats(-reach, reach)))
    R = model.rest_controls + np.tensordot(mixed, directions, axes=1)
    # and whatever moves no vertex changes nothing
    R += model.null_space @ data.draw(arrays(np.float64, (1, 3), elements=st.floats(-5, 5))).repeat(len(R), axis=0)
    weights, residual, limited = basis.project(R)
    assert weights.dtype == np.float32
    assert 0 <= weights.min() <= weights.max() <= 1
    coordinates = (2 * weights[:-1].astype(np.float64) - weights[-1]) * REACH
    size, room = np.abs(mixed), REACH - UNLIMITED_REACH
    held = UNLIMITED_REACH + room * np.tanh((size - UNLIMITED_REACH) / room)
    expected = np.sign(mixed) * np.where(size <= UNLIMITED_REACH, size, held)
    assert_allclose(coordinates, expected, atol=1e-5 + 1e-6 * size.max())
    assert limited == (size.max() > REACH) or size.max() == pytest.approx(REACH, rel=1e-5)
    if size.max() <= UNLIMITED_REACH:
        assert residual < 1e-6


@pytest.mark.parametrize("size", [0, 1e-4, 0.01, 1.0])
def test_the_residual_is_that_of_all_vertices_and_no_other_weights_are_nearer(baked, basis, noise, size):
    """The reference is a least-squares fit of the targets in the file over all vertices."""
    rest, targets = baked.prepared.model.rest_controls, baked.targets.reshape(-1, len(basis.names))
    R = noise(size)
    before = R.copy()
    projection = basis.project(R)
    assert projection.residual == pytest.approx(baked.left(R, projection.weights), rel=1e-4, abs=1e-12)
    assert_array_equal(R, before)
    if size == 0:
        assert_allclose(projection.weights, 0, atol=1e-12)
        return
    best = np.linalg.lstsq(targets, baked.moved(R).ravel(), rcond=1e-5)[0]
    range_of = 4 * REACH * np.ptp(best)  # no coordinate is farther than 1
    within = rest + (R - rest) / range_of
    assert basis.project(within).residual == pytest.approx(baked.left(within, best / range_of), rel=1e-4)


def test_float32_poses_and_those_that_do_not_lie_in_one_piece_are_the_same(basis, noise):
    R = noise(1.0)
    for same, other in ((R, np.asfortranarray(R)), (R.astype(np.float32), R.astype(np.float32).astype(np.float64))):
        assert_array_equal(basis.project(same).weights, basis.project(other).weights)
        assert basis.project(same).residual == basis.project(other).residual
    for wrong in (R[:-4], R[:, :2], R.ravel()):
        with pytest.raises(ValueError, match="control variables"):
            basis.project(wrong)


def test_the_same_surface_with_its_vertices_in_another_order_gets_the_same_weights(baked, basis, blob, noise, of_shape):
    """A basis belongs to a shape, and fits any mesh of it on any computer."""
    order = np.random.default_rng(1).permutation(len(blob.vertices))
    faces = np.random.default_rng(2).permutation(np.argsort(order)[blob.faces])
    prepared = of_shape(blob.vertices[order], faces)
    assert not np.array_equal(prepared.model.isoline_coordinates, baked.prepared.model.isoline_coordinates)
    R = noise(0.02)
    other = LiveBasis.load(baked.path, prepared).project(R)
    assert_allclose(other.weights, basis.project(R).weights, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("change", [[1.0, 1.02, 1.0], [1.01, 1.01, 1.01], [-1.0, 1.0, 1.0]])
def test_a_basis_for_another_mesh_is_refused(baked, blob, of_shape, change):
    """The mesh is 2 % taller, 1 % larger, or mirrored."""
    faces = blob.faces if np.prod(change) > 0 else blob.faces[:, ::-1]
    refused_place(
        PuppetError, baked.path, LiveBasis.load, baked.path, of_shape(blob.vertices * np.float32(change), faces)
    )


@pytest.mark.parametrize(
    "changed",
    [
        *({"directions": value} for value in (-1, 1.5, 0, 2)),  # the last are the mesh's positions and indices
        *({"reach": value} for value in (0.0, "far", None)),
        *({"lengths": change} for change in (lambda own: own[:-1], lambda own: own[::-1], None)),
        *({"lengths": lambda own, length=length: [length] * len(own)} for length in (0.0, 1e308)),
        *([], None),
    ],
)
def test_damaged_or_missing_extras_are_refused_with_the_command_that_mends_them(baked, tmp_path, changed):
    gltf, binary = unpack(baked.path.read_bytes())
    carried, extras = gltf["asset"]["extras"][EXTRAS], changed
    if changed:
        extras = carried | {key: value(carried[key]) if callable(value) else value for key, value in changed.items()}
        extras = {key: value for key, value in extras.items() if value is not None}
    gltf["asset"]["extras"] = {} if changed is None else {EXTRAS: extras}
    path = tmp_path / "a.glb"
    path.write_bytes(pack(gltf, binary))
    assert "puppetline bake" in refused(PuppetError, LiveBasis.load, path, baked.prepared).fix
