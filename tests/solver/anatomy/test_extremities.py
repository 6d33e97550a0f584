import numpy as np
import pytest

from solver.anatomy.extremities import _prominences, distances, extremities, surface_graph
from solver.surface.mesh import SolverMesh, weld

from ..shapes import tube

FIGURE_ENDS = np.array([[1.58, 1.3, 0], [-1.58, 1.3, 0], [0.66, -1.7, 0.1], [-0.66, -1.7, 0.1], [0.0, 2.1, 0.2]])
CREATURE_ENDS = np.array([[-1.5, 0, 0], [1.05, 1.1, 0.25], [-1.0, 1.05, -0.45], [0.22, -1.28, 0.33]])


def assert_one_each(points, ends, within):
    distances = np.linalg.norm(points[:, None] - ends, axis=2)
    assert sorted(distances.argmin(axis=1)) == list(range(len(ends)))
    assert distances.min(axis=1).max() < within


def tips(mesh):
    return extremities(mesh, surface_graph(mesh)).vertices


def test_a_bent_creature_ends_in_both_tube_ends_horn_and_leg(creature):
    assert_one_each(creature.vertices[tips(creature)], CREATURE_ENDS, within=0.25)


def test_a_folded_limb_is_found_by_the_way_along_the_surface():
    """A flat spiral: in space its inner end lies in the middle of the shape, along the surface it is an end."""
    angles = np.linspace(0, 4.5 * np.pi, 200)
    middle = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(200)]) * (0.4 + 0.15 * angles[:, None])
    outward = middle / np.linalg.norm(middle, axis=1, keepdims=True)
    round_it = np.arange(6) * np.pi / 3
    ring = np.cos(round_it)[:, None] * outward[:, None] + np.sin(round_it)[:, None] * np.array([0.0, 0, 1])
    folded = weld((middle[:, None] + 0.1 * ring).reshape(-1, 3), tube(angles, 0.1, 6)[1])
    found = folded.vertices[tips(folded)]
    assert_one_each(found, middle[[0, -1]], within=0.2)


def test_the_fingers_of_a_hand_are_one_end(figure):
    """Three needles on the left hand: without them, and with them, the figure has five ends."""
    hand = int(np.argmax(figure.vertices @ [1, 0.2, 0]))
    ring = np.unique(figure.faces[(figure.faces == hand).any(axis=1)])
    outward = figure.vertices.copy()
    for finger in ring[::2]:
        outward[finger] += 0.4 * (outward[finger] - [1.2, 1.25, 0]) / np.linalg.norm(outward[finger] - [1.2, 1.25, 0])
    assert_one_each(outward[tips(SolverMesh(outward, figure.faces, figure.of_render))], FIGURE_ENDS, within=0.6)


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


def test_a_part_of_its_own_is_reached_over_bridges(two_parts):
    points = two_parts.vertices[tips(two_parts)]
    ends = FIGURE_ENDS.copy()
    ends[0] = [2.0, 1.4, 0.1]  # the cube beside the hand is what sticks out now
    assert_one_each(points, ends, within=0.35)


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
