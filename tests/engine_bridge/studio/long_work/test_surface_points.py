import numpy as np
import pytest

from engine_bridge.studio.long_work.puppet_values import puppet_of
from engine_bridge.studio.long_work.surface_points import mirrored, snapped
from puppetline.errors import ServiceError


def test_the_middle_is_half_way_to_the_opposite_surface(limbed_rig):
    """The left arm of the figure is a capsule of radius 0.17 from (0.1, 1.1, 0) to (1.4, 1.3, 0.1)."""
    start, end = np.array([0.1, 1.1, 0.0]), np.array([1.4, 1.3, 0.1])
    for share in (0.4, 0.6, 0.8):
        on_axis = start + share * (end - start)
        found = snapped(limbed_rig.mesh, tuple(on_axis + np.array([0.0, 0.3, 0.0])))
        surface, centre = (
            np.linalg.norm(np.cross(np.array(found[key]) - start, end - start)) / np.linalg.norm(end - start)
            for key in ("surface", "centre")
        )
        assert surface == pytest.approx(0.17, abs=0.02)
        assert centre < 0.06
        assert found["radius"] == pytest.approx(0.17, abs=0.03)


def test_a_point_of_the_surface_stays(limbed_rig):
    for vertex in limbed_rig.mesh.vertices[::97]:
        assert np.allclose(snapped(limbed_rig.mesh, tuple(vertex))["surface"], vertex, atol=1e-9)


def limb(puppet, name):
    return next(limb for limb in puppet.limb if limb.name == name)


def test_the_other_side_replaces_the_limb_that_is_there_and_mirroring_twice_returns_the_points(limbed_rig):
    puppet, mesh = limbed_rig.puppet, limbed_rig.mesh
    limbs = tuple(each.model_copy(update={"nodes": ("Bone",)}) for each in puppet.limb)
    puppet = puppet.model_copy(update={"limb": limbs})
    made = puppet_of(mirrored(puppet, mesh, "left arm"), "blob.glb")
    assert [limb.name for limb in made.limb] == [limb.name for limb in puppet.limb]
    left, right = (limb(made, f"{side} arm") for side in ("left", "right"))
    middle = np.median(mesh.vertices[:, 0])
    assert np.allclose(np.array(right.points), np.array(left.points) * [-1, 1, 1] + [2 * middle, 0, 0], atol=1e-5)
    assert (left.nodes, right.nodes) == (("Bone",), None)
    assert right.joints == ("shoulder_right", "elbow_right", "wrist_right")
    assert made.limb[0] == puppet.limb[0]
    twice = puppet_of(mirrored(made, mesh, "right arm"), "blob.glb")
    assert np.allclose(limb(twice, "left arm").points, left.points, atol=1e-5)


def test_a_limb_of_one_side_gets_its_counterpart_after_it(limbed_rig):
    limbs = tuple(limb for limb in limbed_rig.puppet.limb if limb.name != "right arm")
    puppet = limbed_rig.puppet.model_copy(update={"limb": limbs})
    names = [limb["name"] for limb in mirrored(puppet, limbed_rig.mesh, "left arm")["limb"]]
    assert names[names.index("left arm") + 1] == "right arm"
    assert len(names) == len(limbs) + 1


@pytest.mark.parametrize(
    ("name", "found"), [("hump", "'hump', which names no side"), ("wing", "no limb or handle 'wing'")]
)
def test_a_limb_without_a_side_has_no_counterpart(limbed_rig, name, found):
    with pytest.raises(ServiceError) as error:
        mirrored(limbed_rig.puppet, limbed_rig.mesh, name)
    assert error.value.found == found
