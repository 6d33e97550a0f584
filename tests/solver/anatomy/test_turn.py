import numpy as np
import pytest

from solver.anatomy.axes import turned, unit_vector
from solver.anatomy.turn import turn_of

from ..shapes import body_of
from .test_limb_finding import ARM, DOG, FIGURE, LEG


def about(axis, degrees, limbs):
    """Limbs that are turned about an axis by which the figures of y up stand."""
    first = unit_vector("x" if axis[-1] != "x" else "y")
    left = turned(first, unit_vector(axis), degrees)
    basis = np.array([left, unit_vector(axis), np.cross(left, unit_vector(axis))])
    return [(start @ basis, end @ basis, radius) for start, end, radius in limbs]


@pytest.mark.parametrize("limbs", [FIGURE, DOG])
@pytest.mark.parametrize(("axis", "degrees"), [("y", 25), ("y", -38), ("-z", 15)])
def test_a_turn_is_found_by_the_sides_that_mirror_each_other(limbs, axis, degrees):
    ups = [axis] if axis.startswith("-") else ["z", axis]
    assert turn_of(body_of(about(axis, degrees, limbs), 0.06), ups) == (axis, pytest.approx(degrees, abs=1))


def test_a_body_along_its_axes_is_not_turned():
    for limbs in (FIGURE, DOG, about("z", 90, DOG)):
        assert turn_of(body_of(limbs, 0.06), ["y", "z"])[1] == 0


def test_a_body_without_two_sides_that_mirror_each_other_is_not_turned():
    assert turn_of(body_of([*DOG[:3], ARM[0], LEG[1]], 0.06), ["y"])[1] == 0
