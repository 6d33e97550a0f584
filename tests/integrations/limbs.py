"""Foreign skeletons point their limbs as the service's joints do, whatever their rest pose and axes.

The tests of a client derive a class from `Limbs`, and give it the fixture `drive`.
"""

import numpy as np
import pytest

from engine_bridge.service.protocol.header import Kind
from engine_bridge.service.protocol.payloads import encode

from .foreign_skeleton import CHARACTER_CREATOR, FOREIGN, MIXAMO, VROID, foreign, hips_place, worst_angle

NUMBERED = [bone | {"name": f"b{number}"} for number, bone in enumerate(foreign())]


def values_of(frame):
    """Return the numbers of a frame of bones."""
    return np.frombuffer(encode(Kind.BONES, frame, 0)[128:], dtype="<f4")


class Limbs:
    """`drive` takes numbers of a frame, bones and names of bones by joint; it returns bones' places and driven ones."""

    @pytest.mark.parametrize("names", [MIXAMO, VROID, CHARACTER_CREATOR])
    def test_limbs_of_an_a_posed_skeleton_with_other_axes_point_as_those_of_the_service(
        self, drive, posed_human, names
    ):
        places, driven = drive(values_of(posed_human), foreign(names))
        places = dict(zip(FOREIGN, places, strict=True))
        assert driven["leftUpperArm"] == names[3]
        assert worst_angle(places, posed_human) < 0.1
        np.testing.assert_allclose(places["Hips"], hips_place(posed_human), atol=1e-4)

    def test_a_map_names_bones_that_are_not_recognised(self, drive, posed_human):
        driven = drive(values_of(posed_human), NUMBERED, leftUpperArm="b3", nose="b1")[1]
        assert driven == {"leftUpperArm": "b3"}
