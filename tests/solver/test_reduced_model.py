import dataclasses
import logging

import igl
import numpy as np
import pytest
from scipy.sparse import csr_matrix

from puppetline.errors import MeshError
from solver import fields, reduced_model
from solver.mesh import SolverMesh, weld
from solver.reduced_model import ModelParameters, ReducedModel, build, cache_key, load, load_or_build, save

PARAMETERS = ModelParameters()


def same(a, b):
    for field in dataclasses.fields(ReducedModel):
        x, y = getattr(a, field.name), getattr(b, field.name)
        assert x.dtype == y.dtype
        np.testing.assert_array_equal(x, y)
    return True


@pytest.fixture(scope="module")
def dense(creature, creature_model):
    model = creature_model
    return reduced_model.position_matrix(
        model.to_model(creature.vertices), model.ladder.astype(np.float64), model.weights, model.isolines
    ).toarray()


# --- what it holds


def test_model_units_are_those_of_the_bounding_box(creature, creature_model):
    points = creature_model.to_model(creature.vertices)
    np.testing.assert_allclose(points.min(axis=0), -points.max(axis=0), atol=1e-12)
    assert np.linalg.norm(np.ptp(points, axis=0)) == pytest.approx(1.0)


@pytest.mark.parametrize(("count", "isolines"), [(8, 10), (3, 4), (1, 2)])
def test_shapes_follow_the_parameters(creature, count, isolines):
    model = build(creature, ModelParameters(count, isolines))
    m = count * isolines
    assert model.isolines == isolines
    assert model.weights.shape == (count,)
    assert model.ladder.shape == (len(creature.vertices), count)
    assert (model.A.shape, model.B.shape) == ((4 * m, 4 * m), (4 * m, 3 * m))
    assert model.rest_controls.shape == (4 * m, 3)
    assert 0 <= model.ladder.min() < model.ladder.max() == isolines - 1


def test_positions_are_the_blend_written_out(creature, creature_model, dense, naive_interpolation):
    rest = creature_model.to_model(creature.vertices)
    naive, _ = naive_interpolation(rest, creature_model.ladder, creature_model.weights, 10, np.zeros_like(rest))
    np.testing.assert_allclose(dense, naive, atol=1e-6)


def test_identity_transforms_give_the_rest_positions(creature, creature_model, dense):
    rest = creature_model.to_model(creature.vertices)
    np.testing.assert_allclose(dense @ creature_model.rest_controls, rest, atol=1e-12)


def test_any_affine_map_on_all_isolines_is_that_map(creature, creature_model, dense):
    affine = np.random.default_rng(0).normal(size=(4, 3))
    rest = creature_model.to_model(creature.vertices)
    expected = rest @ affine[:3] + affine[3]
    np.testing.assert_allclose(dense @ np.tile(affine, (80, 1)), expected, atol=1e-12)


def test_energy_matrices_are_those_of_the_dense_operators(creature, creature_model, naive_interpolation):
    rest = creature_model.to_model(creature.vertices)
    L, mass = fields.laplacian(SolverMesh(rest, creature.faces, creature.of_render))
    L = L.toarray()
    W, W_delta = naive_interpolation(rest, creature_model.ladder, creature_model.weights, 10, L @ rest)
    KW = np.diag(mass**-0.5) @ L @ W
    A, B = KW.T @ KW, KW.T @ np.diag(mass**-0.5) @ W_delta
    np.testing.assert_allclose(creature_model.A, A, atol=1e-6 * np.abs(A).max())
    np.testing.assert_allclose(creature_model.B, B, atol=1e-6 * np.abs(B).max())
    np.testing.assert_allclose(creature_model.gram, W.T @ W, atol=1e-6 * np.abs(W.T @ W).max())


def test_products_of_sparse_factors_do_not_depend_on_the_chunks(creature_model, dense, monkeypatch):
    W = csr_matrix(dense)
    monkeypatch.setattr(reduced_model, "GRAM_CHUNK", 37)
    np.testing.assert_allclose(reduced_model._product(W, W), dense.T @ dense, atol=1e-12)


def test_rigid_rotation_of_all_isolines_costs_no_energy(creature_model, turn):
    rotation = turn(0, 100)
    R = creature_model.rest_controls @ rotation + np.tile([[0.0] * 3] * 3 + [[0.3, -0.2, 0.5]], (80, 1))
    gradient = creature_model.A @ R - creature_model.B @ np.tile(rotation, (80, 1))
    assert np.abs(gradient).max() < 1e-9 * np.abs(creature_model.B).max()


# --- null space


def test_null_space_is_at_least_28_wide_and_moves_no_vertex(creature_model, dense):
    projector = creature_model.null_space
    np.testing.assert_allclose(projector, projector.T, atol=1e-12)
    np.testing.assert_allclose(projector @ projector, projector, atol=1e-9)
    nullity = round(np.trace(projector))
    assert nullity >= 4 * (8 - 1)
    assert np.abs(dense @ projector).max() < 1e-6
    assert np.linalg.matrix_rank(dense, tol=1e-7 * np.linalg.norm(dense, 2)) == 320 - nullity


def test_null_space_holds_the_exchange_of_an_affine_map_between_fields(creature_model, dense):
    rng = np.random.default_rng(1)
    for first, second in ((0, 1), (2, 7)):
        affine = rng.normal(size=4)
        z = np.zeros((8, 10, 4))
        z[first], z[second] = affine / creature_model.weights[first], -affine / creature_model.weights[second]
        z = z.reshape(-1) / np.linalg.norm(z)
        assert np.abs(dense @ z).max() < 1e-12
        np.testing.assert_allclose(creature_model.null_space @ z, z, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["armadillo.obj", "dinosaur_14k.obj"])
def test_rank_on_real_meshes_is_292(real_mesh, name):
    assert round(np.trace(build(real_mesh(name)).null_space)) == 28


# --- rows of surface points


def test_rows_of_a_vertex_are_its_rows_of_the_blend(creature, creature_model, dense):
    chosen = [0, 17, 400]
    found = creature_model.rows(creature, creature.vertices[chosen])
    np.testing.assert_allclose(found, dense[chosen], atol=1e-9)


def test_rows_of_a_point_in_a_face_blend_those_of_its_corners(creature, creature_model, dense):
    face = creature.faces[123]
    point = np.array([0.2, 0.5, 0.3]) @ creature.vertices[face]
    found = creature_model.rows(creature, point[None])
    np.testing.assert_allclose(found[0], np.array([0.2, 0.5, 0.3]) @ dense[face], atol=1e-9)


# --- too small, and just large enough


def closed_strip(count):
    """A double cone with this many vertices round its equator."""
    angles = np.linspace(0, 2 * np.pi, count + 1)[:-1]
    ring = np.column_stack([np.cos(angles), 0.1 * np.sin(3 * angles), 0.7 * np.sin(angles)])
    vertices = np.concatenate([ring, [[0.1, 1, 0], [0, -1, 0.2]]])
    here, there = np.arange(count), (np.arange(count) + 1) % count
    top, bottom = np.full(count, count), np.full(count, count + 1)
    faces = np.concatenate([np.column_stack([here, there, bottom]), np.column_stack([there, here, top])])
    return SolverMesh(vertices, faces, np.arange(count + 2))


def test_a_mesh_with_too_few_vertices_is_refused():
    with pytest.raises(MeshError) as caught:
        build(closed_strip(17))
    assert caught.value.found == "19 vertices"
    assert "at least 20 for 8" in caught.value.expected
    assert "fewer fields" in caught.value.fix


@pytest.mark.parametrize(("count", "parameters"), [(18, ModelParameters()), (4, ModelParameters(fields=1))])
def test_the_smallest_mesh_allowed_reproduces_its_rest_pose(count, parameters, surface):
    mesh = closed_strip(count)
    model = build(mesh, parameters)
    np.testing.assert_allclose(surface(model, mesh, model.rest_controls), mesh.vertices, atol=1e-12)


# --- cache


@pytest.fixture(scope="module")
def small(creature_model):
    """A mesh and its model that are quick to build and to store."""
    mesh = closed_strip(40)
    parameters = ModelParameters(fields=2, isolines=3)
    return mesh, parameters, build(mesh, parameters)


def test_a_saved_model_is_the_same_when_loaded(creature_model, tmp_path):
    save(creature_model, tmp_path / "deep" / "model.npz", "key")
    assert same(load(tmp_path / "deep" / "model.npz", "key"), creature_model)
    assert [path.name for path in (tmp_path / "deep").iterdir()] == ["model.npz"]


def test_building_twice_gives_the_same_bits(small):
    mesh, parameters, model = small
    assert same(build(mesh, parameters), model)


def test_a_model_is_built_once_and_then_reused(small, tmp_path, monkeypatch):
    mesh, parameters, model = small
    first, reused = load_or_build(mesh, parameters, tmp_path / "cache")
    assert not reused
    monkeypatch.setattr(reduced_model, "build", None)  # a second call would fail
    second, reused = load_or_build(mesh, parameters, tmp_path / "cache")
    assert reused
    assert same(first, model)
    assert same(second, model)


def rebuilt(small, folder, caplog):
    """Load where the cache is bad: the right model, a warning that names the file, and a good cache afterwards."""
    mesh, parameters, model = small
    caplog.clear()
    with caplog.at_level(logging.WARNING):
        found, reused = load_or_build(mesh, parameters, folder)
    assert not reused
    assert same(found, model)
    assert len(caplog.records) == 1
    assert cache_key(mesh, parameters) in caplog.text
    assert "built anew" in caplog.text
    again, reused = load_or_build(mesh, parameters, folder)
    assert reused
    return same(again, model)


@pytest.fixture
def cached(small, tmp_path):
    mesh, parameters, _ = small
    load_or_build(mesh, parameters, tmp_path)
    return tmp_path / f"{cache_key(mesh, parameters)}.npz"


def test_a_truncated_cache_is_rebuilt(small, cached, caplog):
    whole = cached.read_bytes()
    for length in np.linspace(0, len(whole) - 1, 50).astype(int):
        cached.write_bytes(whole[:length])
        assert rebuilt(small, cached.parent, caplog)


def test_no_flipped_byte_of_a_cache_gives_another_model(small, cached, caplog):
    mesh, parameters, model = small
    whole = cached.read_bytes()
    rng = np.random.default_rng(0)
    places = np.unique(np.r_[np.arange(0, 130, 7), rng.integers(0, len(whole), 60), len(whole) - np.arange(1, 150, 9)])
    rebuilds = 0
    for place in map(int, places):
        cached.write_bytes(whole[:place] + bytes([whole[place] ^ 0xFF]) + whole[place + 1 :])
        with caplog.at_level(logging.WARNING):
            found, reused = load_or_build(mesh, parameters, cached.parent)
        assert same(found, model)
        rebuilds += not reused
    assert rebuilds > len(places) / 2  # the others hit what a zip archive does not need, such as dates


@pytest.mark.parametrize(
    "content", [b"", b"not an archive", b"PK\x03\x04" + bytes(100), b"\x93NUMPY\x01\x00" + bytes(80)]
)
def test_a_file_that_is_no_archive_is_rebuilt(small, cached, caplog, content):
    cached.write_bytes(content)
    assert rebuilt(small, cached.parent, caplog)


def test_a_single_array_and_an_archive_without_the_arrays_are_rebuilt(small, cached, caplog):
    with cached.open("wb") as file:
        np.save(file, np.arange(5))
    assert rebuilt(small, cached.parent, caplog)
    with cached.open("wb") as file:
        np.savez(file, key=np.array(cached.stem))
    assert rebuilt(small, cached.parent, caplog)


def test_pickled_objects_are_not_loaded(small, cached, caplog):
    class Trap:
        def __reduce__(self):
            return (pytest.fail, ("the cache ran code",))

    with cached.open("wb") as file:
        np.savez(file, key=np.array(cached.stem), center=np.array([Trap()], dtype=object))
    assert rebuilt(small, cached.parent, caplog)


def test_the_model_of_another_mesh_under_this_name_is_rebuilt(small, cached, caplog):
    other = closed_strip(44)
    save(build(other, small[1]), cached, cache_key(other, small[1]))
    assert rebuilt(small, cached.parent, caplog)


def test_a_cache_of_another_version_is_not_used(small, cached, monkeypatch):
    mesh, parameters, model = small
    monkeypatch.setattr(reduced_model, "CACHE_VERSION", reduced_model.CACHE_VERSION + 1)
    found, reused = load_or_build(mesh, parameters, cached.parent)
    assert not reused
    assert same(found, model)
    assert len(list(cached.parent.iterdir())) == 2


def test_a_folder_that_cannot_be_written_costs_a_warning_only(small, tmp_path, caplog):
    mesh, parameters, model = small
    (tmp_path / "file").write_text("in the way")
    with caplog.at_level(logging.WARNING):
        found, reused = load_or_build(mesh, parameters, tmp_path / "file" / "cache")
    assert not reused
    assert same(found, model)
    assert "not kept" in caplog.text


def test_a_full_disk_leaves_no_half_file(small, tmp_path, monkeypatch, caplog):
    mesh, parameters, model = small

    def fill(file, **arrays):
        file.write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez", fill)
    found, reused = load_or_build(mesh, parameters, tmp_path)
    assert not reused
    assert same(found, model)
    assert list(tmp_path.iterdir()) == []
    assert "No space left" in caplog.text


def test_cache_key_is_equal_for_equal_input_only(small):
    mesh, parameters, _ = small
    keys = {cache_key(mesh, parameters)}
    copy = SolverMesh(mesh.vertices.copy(), np.asfortranarray(mesh.faces), mesh.of_render[:3])
    assert cache_key(copy, ModelParameters(fields=2, isolines=3)) in keys
    vertices, faces = mesh.vertices.copy(), mesh.faces.copy()
    vertices[7, 1] = np.nextafter(vertices[7, 1], 9)
    faces[3] = faces[3][[1, 2, 0]]
    keys |= {
        cache_key(SolverMesh(vertices, mesh.faces, mesh.of_render), parameters),
        cache_key(SolverMesh(mesh.vertices, faces, mesh.of_render), parameters),
        cache_key(mesh, ModelParameters(fields=3, isolines=3)),
        cache_key(mesh, ModelParameters(fields=2, isolines=4)),
    }
    assert len(keys) == 5


def test_parts_a_world_apart_still_have_a_model_that_keeps_the_rest_pose():
    ball, faces = igl.icosahedron()
    ball, faces = igl.upsample(ball, faces, 2)
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    apart = np.concatenate([ball + step for step in 1e4 * np.arange(5)])
    mesh = weld(apart, np.concatenate([faces + number * len(ball) for number in range(5)]))
    model = build(mesh)
    rest = model.to_model(mesh.vertices)
    W = reduced_model.position_matrix(rest, model.ladder.astype(np.float64), model.weights, model.isolines)
    np.testing.assert_allclose(W @ model.rest_controls, rest, atol=1e-12)
