import numpy as np
import pytest

from capture import body
from capture.skeleton import JOINT_INDEX, to_character_axes
from engine_bridge.performance.grounding import legs_of, steps_of
from engine_bridge.puppet.puppet import Puppet, RootTable
from solver.motion.limbs import bones_of

HIP_HEIGHT = 0.6


def leg(name, kind, x, z):
    side = name.split()[0]
    joints = {"front": ("shoulder", "elbow", "wrist", "hand"), "hind": ("hip", "knee", "ankle", "foot")}[kind]
    points = [[x, HIP_HEIGHT, z], [x, 0.3, z + 0.05], [x, 0.05, z], [x, 0.0, z + 0.1]]
    return {"name": name, "points": points, "joints": [f"{joint}_{side}" for joint in joints], "follow": "turn"}


LEGS = [
    leg(f"{side} {kind} leg", kind, x, z) | {"stands": True}
    for kind, z in (("hind", -0.5), ("front", 0.5))
    for side, x in (("left", 0.15), ("right", -0.15))
]
TRUNK = {
    "name": "trunk",
    "points": [[0, HIP_HEIGHT, -0.5], [0, HIP_HEIGHT, 0], [0, HIP_HEIGHT, 0.5]],
    "joints": ["hip_center", "spine", "shoulder_center"],
    "follow": "turn",
}


def puppet(legs=LEGS, **tables):
    values = {"character": {"mesh": "any.glb"}, "limb": [TRUNK, *legs], "root": {}} | tables
    return Puppet.model_validate(values)


def steps(made, rest):
    return steps_of(made, bones_of(made.limbs), rest)


def test_all_legs_that_stand_step_and_the_animal_travels_in_proportion_to_the_height_of_its_hips(standing):
    lengths = body.bone_lengths(standing)
    metre = HIP_HEIGHT / (lengths["knee_left"] + lengths["ankle_left"])
    for legs, scale, expected in ((LEGS, "auto", metre), (LEGS[:2], 2.0, 2.0)):
        made = steps(puppet(legs, retarget={"scale": scale}), standing)
        assert made.metre == pytest.approx(expected)
        assert made.places.shape == (len(legs), 3)
    lying = [each | {"stands": False} for each in LEGS]
    for made in (puppet(lying), puppet(root=None), puppet(root={"feet": "free"})):
        assert steps(made, standing) is None


def test_a_raised_hand_lifts_the_front_leg_of_its_side(standing):
    made, up = steps(puppet(), standing), to_character_axes(standing)
    up[[JOINT_INDEX["hand_left"], JOINT_INDEX["hand_right"]], 1] = up[JOINT_INDEX["head"], 1] + 0.3, 0.8
    for number in range(20):
        made.step(number / 30, up, np.ones(20, dtype=np.float32), np.tile(np.eye(4, 3), (14, 1, 1)), np.zeros(3))
    lifted = np.isnan(made.places).any(axis=1).tolist()
    assert lifted == [each.name == "left front leg" for each in puppet().limbs if each.stands]


def test_two_legs_stand_on_the_floor_unless_the_puppet_says_otherwise(limbed_figure):
    puppet = limbed_figure.puppet
    left, right = (JOINT_INDEX[f"ankle_{side}"] for side in ("left", "right"))
    legs = [(leg.joint, leg.thigh, leg.shin, leg.foot) for leg in legs_of(puppet)]
    assert legs == [(left, 7, 8, -1), (right, 9, 10, -1)]
    turning = puppet.limb[-1].model_copy(update={"follow": "turn"})
    limbs = ({"limb": (*puppet.limb[:-1], *last)} for last in ((), (turning,)))
    for update in ({"root": RootTable(feet="free")}, {"root": None}, *limbs):
        assert legs_of(puppet.model_copy(update=update)) == ()
