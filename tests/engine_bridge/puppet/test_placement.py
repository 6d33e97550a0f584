import numpy as np

from engine_bridge.character.character import make_character
from engine_bridge.puppet.placement import check_handles, check_limbs
from puppetline.errors import PuppetError

from ...solver.shapes import sphere
from ..refusals import refused


def test_a_handle_off_the_mesh_is_refused_with_the_nearest_place_on_it(prepared_blob):
    first, second, *others = prepared_blob.puppet.handle
    off = [first, second.model_copy(update={"position": (50.0, 1.2, 0.0)}), *others]
    error = refused(PuppetError, check_handles, off, prepared_blob.mesh, "figure.toml")
    assert error.where == "figure.toml, [[handle]] 2 'right hand', position"
    nearest = np.array([float(number) for number in error.fix.split("[")[1].split("]")[0].split(",")])
    assert np.linalg.norm(prepared_blob.mesh.vertices - nearest, axis=1).min() < 0.05
    assert nearest[0] > 1.4


def test_a_limb_in_the_middle_of_a_fat_character_is_inside_it(limbed_figure):
    ball = make_character("ball", *sphere(3)).solver_mesh()
    core = limbed_figure.puppet.limb[0].model_copy(
        update={"points": ((0.0, -0.1, 0.0), (0.0, 0.0, 0.0), (0.0, 0.1, 0.0))}
    )
    check_limbs([core], ball, "ball.toml")
    beside = core.model_copy(update={"points": ((0.0, 0.0, 0.0), (0.0, 1.2, 0.0), (0.0, 1.9, 0.0))})
    error = refused(PuppetError, check_limbs, [core, beside], ball, "ball.toml")
    assert error.where == "ball.toml, [[limb]] 2 'trunk', points, 3"
