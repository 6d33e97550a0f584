"""Legs that reach for a place, as plain Python functions."""

import numpy as np
import pytest

HIND = np.array([[0, 1.0, 0], [0, 0.62, 0.12], [0, 0.35, -0.14], [0, 0.06, 0.0]])  # hip, knee, hock, fetlock
SPIDER = np.array([[0.1, 0.5, 0], [0.4, 0.8, 0.1], [0.8, 0.7, 0.1], [1.0, 0.0, 0.1]])
STRAIGHT = np.array([[0, 1.0, 0], [0, 0.5, 0], [0, 0.0, 0]])
NEARLY_STRAIGHT = np.array([[0, 1.0, 0], [0, 0.5, -0.01], [0, 0.0, 0]])  # bent to the other side than it folds


@pytest.fixture(scope="module")
def reached(interpreted):
    """Return a function from a leg and the place for its ankle to where its joints are, and its motions."""
    chain = interpreted("solver.motion.leg_chain")

    def joints_and_motions(points, ankle, base=(1.0, 0.0, 0.0, 0.0), hip=None, towards=(0, 0, 1)):
        heads, tails = points[:-1].copy(), points[1:].copy()
        chains = chain.chains_of([list(range(len(heads)))], heads, tails, np.array([towards], dtype=float))
        motions = np.full((len(heads), 4, 3), np.nan)
        chain.stretch(chains, 0, motions, heads, base, tuple(points[0] if hip is None else hip), tuple(ankle))
        places = [heads[0] @ motions[0, :3] + motions[0, 3]]
        places += [tail @ T[:3] + T[3] for tail, T in zip(tails, motions, strict=True)]
        return np.array(places), motions

    return joints_and_motions


def bends(points):
    """Return the signed angle of each joint about the x axis."""
    ways = np.diff(points, axis=0)
    return np.arctan2(np.cross(ways[:-1], ways[1:])[:, 0], np.einsum("nx,nx->n", ways[:-1], ways[1:]))


@pytest.mark.parametrize("points", [HIND, SPIDER, STRAIGHT, NEARLY_STRAIGHT])
@pytest.mark.parametrize("way", [(0, 0, 0), (0, 0.1, 0), (0.02, 0.2, 0.15), (-0.03, 0.05, -0.2)])
def test_the_ankle_goes_where_it_should_and_the_bones_keep_their_lengths_and_at_rest_their_places(reached, points, way):
    places, motions = reached(points, points[-1] + way)

    assert np.allclose(places[-1], points[-1] + way, atol=1e-6)
    assert np.allclose(np.linalg.norm(np.diff(places, axis=0), axis=1), np.linalg.norm(np.diff(points, axis=0), axis=1))
    assert np.allclose(motions[:, :3] @ motions[:, :3].transpose(0, 2, 1), np.eye(3), atol=1e-12)
    assert any(way) or np.allclose(motions, np.eye(4, 3), atol=1e-12)


def test_a_leg_that_does_not_reach_is_straight_and_points_to_the_ankle(reached):
    places, _ = reached(HIND, [0, -1.0, 1.0])

    length = np.linalg.norm(np.diff(HIND, axis=0), axis=1).sum()
    way = np.array([0, -2.0, 1.0]) / np.sqrt(5)
    assert np.allclose(places[-1], HIND[0] + length * way, atol=1e-6)


def test_knee_and_hock_fold_together(reached):
    places, _ = reached(HIND, [0, 0.3, 0])

    more = np.abs(bends(places)) - np.abs(bends(HIND))
    assert np.allclose(more / np.abs(bends(HIND)), more[0] / np.abs(bends(HIND)[0]), rtol=1e-6)
    assert more[0] > 0


@pytest.mark.parametrize("towards", [(0, 0, 1), (0, 0, -1), (1, 0, 0)])
def test_the_knee_of_a_straight_leg_bends_towards_its_side(reached, towards):
    places, _ = reached(STRAIGHT, [0, 0.2, 0], towards=towards)

    knee = places[1] - [0, 0.6, 0]
    assert np.allclose(knee / np.linalg.norm(knee), towards, atol=1e-6)


def test_a_leg_turned_and_moved_as_a_whole_is_the_same_leg(reached):
    angle = 0.7
    turn = np.array([[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]])  # for rows
    ankle, hip = np.array([0.05, 0.2, 0.1]), np.array([1.0, 2.0, 3.0])
    base = (np.cos(angle / 2), 0.0, np.sin(angle / 2), 0.0)

    here, _ = reached(HIND, ankle)
    there, _ = reached(HIND, (ankle - HIND[0]) @ turn + hip, base, hip)

    assert np.allclose(there, (here - HIND[0]) @ turn + hip, atol=1e-6)
