import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from solver import kernels

FIELDS, ISOLINES, COUNT = 8, 10, 500


@pytest.fixture(scope="module")
def scene():
    """Rest positions, unit normals, ladders that reach both ends, field weights, controls: all float32 but weights."""
    rng = np.random.default_rng(0)
    rest = rng.normal(size=(COUNT, 3)).astype(np.float32)
    normals = rng.normal(size=(COUNT, 3))
    normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
    ladder = np.clip(rng.uniform(-1, ISOLINES, (COUNT, FIELDS)), 0, ISOLINES - 1).astype(np.float32)
    ladder[0], ladder[1] = 0, ISOLINES - 1
    ladder[2] = np.arange(FIELDS)
    weights = rng.dirichlet(np.ones(FIELDS))
    controls = (np.eye(3, 4) + 0.4 * rng.normal(size=(FIELDS * ISOLINES, 3, 4))).astype(np.float32)
    return rest, normals, ladder, weights, controls


def blended(ladder, weights, controls):
    """(n, 3, 4) float64: Σ_i w_i Σ_k max(0, 1 − |t_i − k|) T_ik."""
    hats = np.maximum(0, 1 - np.abs(ladder[:, :, None].astype(np.float64) - np.arange(ISOLINES)))
    per_isoline = (hats * weights[:, None]).reshape(len(ladder), -1)
    return np.einsum("nm,mrc->nrc", per_isoline, controls.astype(np.float64))


def vertices(scene, controls=None):
    rest, _, ladder, weights, own = scene
    out = np.empty_like(rest)
    transforms = kernels.weighted(own if controls is None else controls, weights)
    kernels.blend_vertices(rest, ladder, transforms, ISOLINES, out)
    return out


def normals_of(scene, controls=None):
    _, normals, ladder, weights, own = scene
    out = np.empty_like(normals)
    transforms = kernels.weighted(own if controls is None else controls, weights)
    kernels.blend_normals(normals, ladder, transforms, ISOLINES, out)
    return out


def rigid(turn, offset=(0.0, 0.0, 0.0)):
    transform = np.column_stack([turn, offset])
    return np.tile(transform, (FIELDS * ISOLINES, 1, 1)).astype(np.float32)


def test_vertices_are_the_weighted_blend_applied_to_rest(scene):
    rest, _, ladder, weights, controls = scene
    T = blended(ladder, weights, controls)
    expected = np.einsum("nrc,nc->nr", T[:, :, :3], rest) + T[:, :, 3]
    np.testing.assert_allclose(vertices(scene), expected, rtol=0, atol=1e-5 * np.abs(expected).max())


def test_normals_are_turned_by_the_cofactor_of_the_blended_linear_part(scene):
    _, normals, ladder, weights, controls = scene
    linear = blended(ladder, weights, controls)[:, :, :3]
    cofactor = np.linalg.det(linear)[:, None, None] * np.linalg.inv(linear).transpose(0, 2, 1)
    expected = np.einsum("nrc,nc->nr", cofactor, normals)
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(normals_of(scene), expected, rtol=0, atol=2e-5)


def test_deformed_normals_stay_perpendicular_to_deformed_tangents(scene):
    _, normals, ladder, weights, controls = scene
    linear = blended(ladder, weights, controls)[:, :, :3]
    tangents = np.cross(normals, np.roll(normals, 1, axis=0)).astype(np.float64)
    moved = np.einsum("nrc,nc->nr", linear, tangents)
    moved /= np.linalg.norm(moved, axis=1, keepdims=True)
    np.testing.assert_allclose(np.einsum("nc,nc->n", moved, normals_of(scene)), 0.0, atol=1e-4)


def test_rigid_motion_moves_vertices_and_turns_normals(scene):
    rest, normals = scene[:2]
    turn = Rotation.from_rotvec([0.5, -1.2, 0.8]).as_matrix()
    controls = rigid(turn, [1.0, 2.0, -3.0])
    np.testing.assert_allclose(vertices(scene, controls), rest @ turn.T + [1.0, 2.0, -3.0], atol=1e-5)
    np.testing.assert_allclose(normals_of(scene, controls), normals @ turn.T, atol=1e-5)


def test_a_mirror_image_keeps_normals_pointing_out(scene):
    """The cofactor of a reflection is its negative: outward normals of a mirrored, inside-out surface."""
    normals = scene[1]
    mirror = np.diag([-1.0, 1.0, 1.0])
    np.testing.assert_allclose(normals_of(scene, rigid(mirror)), normals @ -mirror, atol=1e-5)


def test_a_normal_of_a_surface_squashed_to_a_line_is_zero_and_not_nan(scene):
    np.testing.assert_array_equal(normals_of(scene, rigid(np.diag([1.0, 0.0, 0.0]))), 0.0)


def test_weights_are_multiplied_into_rows_of_twelve():
    controls = np.arange(6 * 12, dtype=np.float32).reshape(6, 3, 4)
    found = kernels.weighted(controls, np.array([0.25, 0.75]))
    assert (found.shape, found.dtype) == ((6, 12), np.float32)
    np.testing.assert_array_equal(found[:3], 0.25 * controls[:3].reshape(3, 12))
    np.testing.assert_array_equal(found[3:], 0.75 * controls[3:].reshape(3, 12))


# --- histogram


def test_histogram_counts_each_edge_in_its_bin():
    positions = np.array([[0, 0, 0], [1, 0, 0], [1, 2, 0], [1, 2, 9]], dtype=np.float32)
    edges = np.array([[0, 1], [1, 2], [2, 3], [3, 0]], dtype=np.int32)
    rest_lengths = np.array([2.0, 1.0, 1.0, np.sqrt(86)], dtype=np.float32)  # stretch 0.5, 2, 9, 1
    histogram = np.zeros(10, dtype=np.int64)
    for _ in range(2):
        kernels.add_to_histogram(positions, edges, rest_lengths, 0.4, histogram)
    assert histogram.tolist() == [0, 2, 2, 0, 0, 2, 0, 0, 0, 2]


# --- prominences


def prominence(values, edges):
    values = np.array(values, dtype=float)
    lists = [sorted([b for a, b in edges if a == v] + [a for a, b in edges if b == v]) for v in range(len(values))]
    starts = np.cumsum([0] + [len(neighbours) for neighbours in lists])
    order = np.argsort(-values, kind="stable")
    return kernels.prominences(values, order, starts, np.concatenate(lists).astype(np.int64)).tolist()


def path(count):
    return [(i, i + 1) for i in range(count - 1)]


def test_prominence_on_a_ridge_by_hand():
    # summits 5, 4 and 7 with passes 2 and 1 between them
    assert prominence([0, 5, 2, 4, 1, 7, 3], path(7)) == [0, 4, 0, 2, 0, 7, 0]


def test_the_lower_of_two_summits_falls_to_the_pass_to_a_higher_one_and_not_to_the_nearest():
    # 6 | 5 | 3 | 4 | 1 | 9: the 4 meets the 6 at 3; the 6 meets the 9 at 1
    assert prominence([6, 5, 3, 4, 1, 9], path(6)) == [5, 0, 0, 1, 0, 8]


def test_a_ring_has_two_passes_and_the_higher_one_counts():
    assert prominence([8, 1, 6, 3], [*path(4), (3, 0)]) == [7, 0, 3, 0]


def test_a_monotone_function_has_one_summit():
    assert prominence([1, 2, 3, 4], path(4)) == [0, 0, 0, 3]


def test_a_plateau_counts_once():
    assert np.count_nonzero(prominence([0, 5, 5, 0, 3], path(5))) == 2


def test_three_basins_that_meet_at_one_vertex():
    assert prominence([9, 6, 4, 1], [(0, 3), (1, 3), (2, 3)]) == [8, 5, 3, 0]


def naive_prominence(values, edges):
    """Each summit: lower the water until a higher vertex comes into its island."""
    result = np.zeros(len(values))
    for v, height in enumerate(values):
        for level in sorted(set(values), reverse=True):
            if level > height:
                continue
            island, grown = {v}, True
            while grown:
                reached = {b for a, b in edges if a in island} | {a for a, b in edges if b in island}
                new = {u for u in reached if values[u] >= level} - island
                island, grown = island | new, bool(new)
            if max(values[u] for u in island) > height:
                result[v] = height - level
                break
        else:
            result[v] = height - min(values)
    return result


@pytest.mark.parametrize("seed", range(5))
def test_prominences_of_random_graphs_are_those_of_falling_water(seed):
    rng = np.random.default_rng(seed)
    values = rng.permutation(30).astype(float)
    edges = [*path(30), *map(tuple, rng.integers(0, 30, (15, 2)))]
    edges = [(a, b) for a, b in edges if a != b]
    np.testing.assert_allclose(prominence(values, edges), naive_prominence(values, edges))


def test_a_stretch_that_is_no_number_falls_into_the_last_bin():
    positions = np.array([[np.nan, 0, 0], [0, 0, 0], [np.inf, 0, 0]], dtype=np.float32)
    edges, rest = np.array([[0, 1], [1, 2]], dtype=np.int32), np.ones(2, dtype=np.float32)
    whole = np.zeros(12, dtype=np.int64)
    kernels.add_to_histogram(positions, edges, rest, 0.4, whole[:10])
    assert whole.tolist() == [0] * 9 + [2, 0, 0]
