import numpy as np
import pytest

from solver.surface.mesh import weld


@pytest.fixture(scope="module")
def solver_mesh(march_capsules):
    """Make the surface of some capsules: solver_mesh(limbs, step)."""

    def make(limbs, step=0.035):
        ends = np.array([end for limb in limbs for end in limb[:2]])
        reach = max(limb[2] for limb in limbs) + 2 * step + 0.0013  # no vertex of the grid on a limb's axis
        return weld(*march_capsules(limbs, ends.min(axis=0) - reach, ends.max(axis=0) + reach, step))

    return make
