import numpy as np
import pytest

from solver.anatomy.extremities import _prominences, distances, surface_graph


def test_distances_run_along_the_surface_and_over_the_gaps(two_parts):
    """From the cube to the left hand, which is near to it, and to the right hand: around the body, not through it."""
    graph = surface_graph(two_parts)
    cube = len(two_parts.vertices) - 1
    away = distances(graph, cube)
    left, right = (int(np.argmax(two_parts.vertices[:-8, 0] * side)) for side in (1, -1))
    assert away[cube] == 0
    assert np.linalg.norm(two_parts.vertices[left] - two_parts.vertices[cube]) <= away[left] < 0.8
    assert away[right] > 1.05 * np.linalg.norm(two_parts.vertices[right] - two_parts.vertices[cube])
    near = distances(graph, cube, limit=0.8)
    np.testing.assert_array_equal(near, np.where(away <= 0.8, away, np.inf))


# --- prominences


def prominence(values, edges):
    values = np.array(values, dtype=float)
    lists = [sorted([b for a, b in edges if a == v] + [a for a, b in edges if b == v]) for v in range(len(values))]
    starts = np.cumsum([0] + [len(neighbours) for neighbours in lists])
    order = np.argsort(-values, kind="stable")
    return _prominences(values, order, starts, np.concatenate(lists).astype(np.int64)).tolist()


def path(count):
    return [(i, i + 1) for i in range(count - 1)]


def test_a_plateau_counts_once():
    assert np.count_nonzero(prominence([0, 5, 5, 0, 3], path(5))) == 2


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
