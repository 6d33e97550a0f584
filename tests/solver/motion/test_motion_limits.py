import numpy as np
import pytest
from numpy.testing import assert_allclose

from solver.motion.deformer import Deformer
from solver.motion.motion_limits import MAX_STRAIN, PROBE_DIAGONALS, WORST_EDGE_SHARE, limb_reach

from ..shapes import stretches


@pytest.fixture(scope="module")
def handles(figure):
    """Hands, feet and crown of the figure, mirror images of each other."""
    hand, foot = figure.vertices[np.argmax(figure.vertices @ [1, 0, 0])], np.array([0.66, -1.7, 0.1])
    return np.array([hand, hand * [-1, 1, 1], foot, foot * [-1, 1, 1], [0.0, 2.1, 0.2]])


@pytest.fixture(scope="module")
def reach(figure, figure_model, handles):
    """Reach of each handle as a separate limb."""
    return limb_reach(Deformer(figure_model, figure, handles), figure, np.eye(5))


def worst_strain(mesh, positions):
    """Mean strain of the worst hundredth of all edges."""
    stretched = stretches(mesh, positions)
    strains = np.sort(np.maximum(stretched, 1 / stretched))
    return strains[-max(1, int(WORST_EDGE_SHARE * len(strains))) :].mean()


def test_a_handle_at_its_reach_strains_the_character_to_the_limit(figure, figure_model, handles, surface, reach):
    deformer = Deformer(figure_model, figure, handles, iterations=30)
    for handle in (0, 2, 4):
        for axis in range(3):
            for side, sign in enumerate((-1, 1)):
                far = reach[handle, axis, side]
                if not PROBE_DIAGONALS[0] * figure.diagonal < far < PROBE_DIAGONALS[-1] * figure.diagonal:
                    continue
                strains = []
                for share in (0.6, 1.0):
                    deformer.reset()
                    targets = deformer.handles.copy()
                    targets[handle, axis] += sign * share * far
                    strains.append(worst_strain(figure, surface(figure_model, figure, deformer.solve(targets))))
                assert strains[1] == pytest.approx(MAX_STRAIN, rel=0.05)
                assert strains[0] < 0.95 * MAX_STRAIN


def test_a_character_that_is_moved_as_a_whole_reaches_as_far_as_is_tried(figure, figure_model, handles):
    found = limb_reach(Deformer(figure_model, figure, handles), figure, np.ones((1, 5)))
    assert_allclose(found, PROBE_DIAGONALS[-1] * figure.diagonal)


def test_a_limb_whose_handles_go_less_far_may_go_farther(figure, figure_model, handles, reach):
    found = limb_reach(Deformer(figure_model, figure, handles), figure, 0.8 * np.eye(5)[:1])
    inside = (found > PROBE_DIAGONALS[0] * figure.diagonal) & (found < PROBE_DIAGONALS[-1] * figure.diagonal)
    assert inside.any()
    assert_allclose(found[inside], reach[:1][inside] / 0.8, rtol=0.05)
