import numpy as np
from numpy.testing import assert_allclose

from solver.motion.deformer import Deformer
from solver.motion.handle_motion import HandleMotions


def carried(model, motion):
    """Control variables (1, 4m, 3) that move everything by one affine map of the mesh's coordinates."""
    own = motion.copy()
    own[3] = (motion[3] + model.center @ motion[:3] - model.center) / float(model.diagonal)
    return np.tile(own, (len(model.rest_controls) // 4, 1))[None]


def test_a_stretched_surface_gives_the_rotation_without_the_stretch(creature, creature_model, creature_handles, turn):
    rotation = turn(4, 70)
    motion = np.vstack([np.diag([1.0, 1.5, 0.7]) @ rotation, [0.5, -1.0, 2.0]])
    found = HandleMotions(creature_model, creature, creature_handles).of(carried(creature_model, motion))
    assert_allclose(found[0, :, :3], np.tile(rotation, (len(creature_handles), 1, 1)), atol=1e-9)


def test_a_handle_is_moved_to_where_the_surface_is(creature, creature_model, creature_handles):
    deformer = Deformer(creature_model, creature, creature_handles)
    aims = deformer.handles + [0.1, 0.2, -0.1] * (np.arange(5) == 2)[:, None]
    R = deformer.solve(aims)
    motions = HandleMotions(creature_model, creature, creature_handles).of(R[None])[0]
    moved = np.einsum("hi,hij->hj", deformer.handles, motions[:, :3]) + motions[:, 3]
    surface = (creature_model.rows(creature, creature_handles) @ R) * creature_model.diagonal + creature_model.center
    assert_allclose(moved, surface, atol=1e-12)
