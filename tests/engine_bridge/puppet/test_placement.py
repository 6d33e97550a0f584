import numpy as np
import pytest

from engine_bridge.character.character import make_character
from engine_bridge.performance.rig import make_rig
from engine_bridge.puppet.placement import check_handles, check_limbs
from puppetline.errors import PuppetError


def test_a_handle_off_the_mesh_is_refused_with_the_nearest_place_on_it(blob_rig):
    first, second, *others = blob_rig.puppet.handle
    off = [first, second.model_copy(update={"position": (50.0, 1.2, 0.0)}), *others]
    with pytest.raises(PuppetError) as error:
        check_handles(off, blob_rig.mesh, "figure.toml")
    refused = error.value
    assert refused.where == "figure.toml, [[handle]] 2 'right hand', position"
    assert refused.found.startswith("[50, 1.2, 0], which is 48.")
    low, high = blob_rig.mesh.vertices.min(axis=0), blob_rig.mesh.vertices.max(axis=0)
    spans = " to ".join("[" + ", ".join(f"{value:.4g}" for value in corner) + "]" for corner in (low, high))
    assert refused.expected == f"a point on the mesh, which spans {spans}"
    nearest = np.array([float(number) for number in refused.fix.split("[")[1].split("]")[0].split(",")])
    assert np.linalg.norm(blob_rig.mesh.vertices - nearest, axis=1).min() < 0.05
    assert nearest[0] > 1.4


def test_a_limb_outside_the_mesh_is_refused_and_one_deep_inside_is_not(blob_rig, limbed_rig):
    limb = limbed_rig.puppet.limb[2]
    check_limbs(limbed_rig.puppet.limb, limbed_rig.mesh, "figure.toml")
    out = limb.model_copy(update={"points": (*limb.points[:2], (1.4, 5.0, 0.1))})
    with pytest.raises(PuppetError) as error:
        check_limbs([limbed_rig.puppet.limb[0], out], blob_rig.mesh, "figure.toml")
    refused = error.value
    assert refused.where == "figure.toml, [[limb]] 2 'left arm', points, 3"
    assert refused.found.startswith("[1.4, 5, 0.1], which is 3.")
    assert refused.expected.startswith("a point inside the mesh, which spans")


def test_a_limb_in_the_middle_of_a_fat_character_is_inside_it(limbed_rig):
    ball = make_rig(limbed_rig.puppet, make_character("ball", *sphere()))
    core = limbed_rig.puppet.limb[0].model_copy(update={"points": ((0.0, -0.1, 0.0), (0.0, 0.0, 0.0), (0.0, 0.1, 0.0))})
    check_limbs([core], ball.mesh, "ball.toml")
    beside = core.model_copy(update={"points": ((0.0, 0.0, 0.0), (0.0, 1.2, 0.0), (0.0, 1.9, 0.0))})
    with pytest.raises(PuppetError, match="points, 3"):
        check_limbs([beside], ball.mesh, "ball.toml")


def sphere(count=16):
    """Vertices and triangles of a unit sphere that face outwards."""
    polar, around = np.meshgrid(np.linspace(0.01, np.pi - 0.01, count), np.arange(2 * count) * np.pi / count)
    points = np.stack([np.sin(polar) * np.cos(around), np.cos(polar), -np.sin(polar) * np.sin(around)], axis=-1)
    quads = []
    for i in range(2 * count):
        for j in range(count - 1):
            a, b = i * count + j, (i + 1) % (2 * count) * count + j
            quads += [(a, a + 1, b + 1), (a, b + 1, b)]
    return points.reshape(-1, 3), np.array(quads)
