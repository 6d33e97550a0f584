import numpy as np
import pytest

from capture.skeleton import JOINT_INDEX, JOINTS
from engine_bridge.puppet import puppet_file
from engine_bridge.puppet.puppet import CharacterTable, HandleTable, Puppet, RetargetTable
from puppetline.errors import PuppetError

CHARACTER = '[character]\nmesh = "dog.glb"\n'
HANDLE = '[[handle]]\nname = "tail"\nposition = [0, 1, 2.5]\n'
PUPPET = CHARACTER + HANDLE


def limb(name, points, joints):
    return f"[[limb]]\nname = {name!r}\npoints = {points}\njoints = {joints}\n"


ARM = limb("arm", [[0, 0, 0], [1, 0, 0], [2, 0, 0]], ["shoulder_left", "elbow_left", ["wrist_left", "hand_left"]])


def test_mapping_averages_a_handles_joints_and_keeps_its_axes_and_gain():
    made = Puppet(
        character=CharacterTable(mesh="a"),
        handle=[
            HandleTable(name="one", position=(1, 2, 3), joint="head", axes="xz", gain=-0.5),
            HandleTable(name="two", position=(4, 5, 6), joints=["hand_left", "hand_right"]),
            HandleTable(name="still", position=(7, 8, 9)),
        ],
    )
    expected = np.zeros((3, 20))
    expected[0, JOINT_INDEX["head"]] = 1
    expected[1, [JOINT_INDEX["hand_left"], JOINT_INDEX["hand_right"]]] = 0.5
    np.testing.assert_array_equal(made.mapping.matrix, expected)
    np.testing.assert_array_equal(made.mapping.axes, [[True, False, True], [True] * 3, [True] * 3])
    np.testing.assert_array_equal(made.mapping.gain, [-0.5, 1, 1])
    np.testing.assert_array_equal(made.handle_positions, [[1, 2, 3], [4, 5, 6], [7, 8, 9]])


def test_limbs_hang_on_the_trunk_unless_they_say_otherwise():
    spine = limb("trunk", [[0, 0, 0], [0, 1, 0]], ["hip_center", "shoulder_center"])
    arm = limb("arm", [[0, 1, 0], [1, 1, 0]], ["shoulder_left", ["wrist_left", "hand_left"]])
    ring = (
        limb("ring", [[1, 1, 0], [2, 1, 0]], ["wrist_left", "hand_left"])
        + 'parent = "arm"\nfollow = "turn"\ngain = 2\n'
    )
    made = puppet_file.loads(CHARACTER + ring + arm + spine, "a")
    assert {each.name: each.parent for each in made.limbs} == {"ring": "arm", "arm": "trunk", "trunk": None}
    assert made.limbs[1].joints == ((4,), (6, 7))
    np.testing.assert_array_equal(made.limbs[0].points, [[1, 1, 0], [2, 1, 0]])
    assert (made.limbs[0].follow, made.limbs[0].gain, made.limbs[1].follow) == ("turn", 2.0, "direction")
    assert puppet_file.loads(CHARACTER + arm + HANDLE, "a").limbs[0].parent is None
    assert made.driven_by == ("hip_center", "shoulder_center", "shoulder_left", "wrist_left", "hand_left")


@pytest.mark.parametrize(("scale", "unit", "expected"), [("auto", 0.01, None), (1.5, 1.0, 1.5), (1.5, 0.01, 150.0)])
def test_a_scale_in_metres_becomes_mesh_units(scale, unit, expected):
    made = Puppet(
        character=CharacterTable(mesh="a", scale=unit),
        handle=[HandleTable(name="b", position=(0, 0, 0))],
        retarget=RetargetTable(scale=scale),
    )
    assert made.units_per_metre == expected


@pytest.mark.parametrize(
    ("up", "front", "left"),
    [("y", "z", [1, 0, 0]), ("z", "-y", [1, 0, 0]), ("z", "x", [0, 1, 0]), ("-y", "z", [-1, 0, 0])],
)
def test_the_characters_left_is_where_it_would_be_on_a_body(up, front, left):
    basis = CharacterTable(mesh="a", up=up, front=front).basis
    np.testing.assert_array_equal(basis[0], left)
    assert np.linalg.det(basis) == 1


ANY_JOINT = f"expected the name of a Kinect joint. Choose one of these: {', '.join(JOINTS)}."
MISTAKES = {
    "an unknown table": (
        PUPPET + "[smothing]\nalpha = 1\n",
        "smothing: found the unknown key 'smothing'; expected one of character, limb, handle, morph, channel, root, "
        "retarget, smoothing, solver, vrm. Did you mean 'smoothing'?",
    ),
    "an unknown key": (
        PUPPET + 'joit = "head"\n',
        "[[handle]] 1 'tail', joit: found the unknown key 'joit'; expected one of name, position, joint, joints, "
        "axes, gain, channel, moves. Did you mean 'joint'?",
    ),
    "an unknown joint": (
        PUPPET + 'joint = "hand_lft"\n',
        "[[handle]] 1 'tail', joint: found 'hand_lft'; expected the name of a Kinect joint. Did you mean 'hand_left'?",
    ),
    "a joint like no other": (PUPPET + '[root]\njoint = "tentacle"\n', f"[root], joint: found 'tentacle'; {ANY_JOINT}"),
    "joint and joints": (
        PUPPET + 'joint = "head"\njoints = ["head"]\n',
        "[[handle]] 1 'tail', joints: found both joint and joints; expected either joint or joints. Remove one of "
        "the keys.",
    ),
    "two handles of one name": (
        PUPPET + HANDLE,
        "[[handle]] 2 'tail', name: found a second handle named 'tail'; expected a different name for each handle. "
        "Rename one of the two handles 'tail'.",
    ),
    "no limb and no handle": (
        CHARACTER,
        "the whole file: found neither a limb nor a handle; expected at least one limb or handle. Add a table "
        "[[limb]] or [[handle]].",
    ),
    "no character": (HANDLE, "character: found nothing; expected a value. Add the table [character] there."),
    "no position": (
        CHARACTER + '[[handle]]\nname = "a"\n',
        "[[handle]] 1 'a', position: found nothing; expected a value. Add the key 'position' there.",
    ),
    "up and front along one axis": (
        CHARACTER + 'up = "z"\nfront = "-z"\n' + HANDLE,
        "[character], front: found front '-z' with up 'z'; expected up and front along different axes. Choose "
        "another axis for front.",
    ),
    "two coordinates": (
        CHARACTER + '[[handle]]\nname = "a"\nposition = [1, 2]\n',
        "[[handle]] 1 'a', position: found [1, 2]; expected three numbers. Write it like [0.1, 1.5, 0.2].",
    ),
    "a model that does not fit in memory": (
        PUPPET + "[solver]\nfields = 64\nisolines = 64\n",
        "[solver], isolines: found 64 fields with 64 isolines each; expected at most 640 isolines in total. Lower "
        "one of the two numbers; 8 fields of 10 isolines suit most characters.",
    ),
    "a limb with one point": (
        CHARACTER + limb("arm", [[0, 0, 0]], ["head"]),
        "[[limb]] 1 'arm', points: found one point; expected at least two points, from root to tip. Add the point at "
        "the other end of the limb.",
    ),
    "points and joints of different length": (
        CHARACTER + limb("arm", [[0, 0, 0], [1, 0, 0]], ["head"]),
        "[[limb]] 1 'arm', joints: found 1 joint for 2 points; expected one joint for each point. Give both lists "
        "the same length. To average several joints, put them in brackets.",
    ),
    "a bone without length": (
        CHARACTER + limb("arm", [[0, 0, 0], [1, 0, 0], [1, 0, 0]], ["head", "spine", "hand_left"]),
        "[[limb]] 1 'arm', points, 3: found [1, 0, 0], which equals the point before it; expected a point that "
        "differs from the one before it. Remove one of the two points and its joint.",
    ),
    "an unknown joint among several of a limb": (
        CHARACTER + limb("arm", [[0, 0, 0], [1, 0, 0]], ["head", ["hand_left", "hip"]]),
        f"[[limb]] 1 'arm', joints, 2, 2: found 'hip'; {ANY_JOINT}",
    ),
    "two limbs of one name": (
        CHARACTER + ARM + limb("arm", [[0, 5, 0], [1, 5, 0]], ["head", "spine"]),
        "[[limb]] 2 'arm', name: found a second limb named 'arm'; expected a different name for each limb. Rename "
        "one of the two limbs 'arm'.",
    ),
    "a parent that is not there": (
        CHARACTER + ARM + limb("head", [[0, 5, 0], [1, 5, 0]], ["head", "spine"]) + 'parent = "body"\n',
        "[[limb]] 2 'head', parent: found 'body', which is not the name of a limb; expected the name of another "
        "limb: arm. Correct the name, or remove the key parent.",
    ),
    "limbs that hang on each other": (
        CHARACTER + ARM + 'parent = "b"\n' + limb("b", [[0, 5, 0], [1, 5, 0]], ["head", "spine"]) + 'parent = "arm"\n',
        "[[limb]] 1 'arm', parent: found a cycle of parents: 'arm', 'b', 'arm'; expected parents that lead to a limb "
        "without a parent. Change or remove the parent of one of these limbs.",
    ),
    "two limbs in one place": (
        CHARACTER + ARM + limb("wing", [[0, 0, 0], [1, 0, 0]], ["head", "spine"]),
        "[[limb]] 2 'wing', points: found a bone that overlaps a bone of the limb 'arm'; expected limbs that touch "
        "only where one joins the other. Remove one of the two limbs, or move its points.",
    ),
    "a limb along a part of another": (
        CHARACTER + ARM + limb("wing", [[3, 0, 0], [0.2, 0.01, 0]], ["head", "spine"]),
        "[[limb]] 2 'wing', points: found a bone that overlaps a bone of the limb 'arm'; expected limbs that touch "
        "only where one joins the other. Remove one of the two limbs, or move its points.",
    ),
}

CHANGE = "Change the value of that key."
WRONG_VALUES = {
    "a gain beyond all measure": (
        PUPPET + "gain = 1e45\n",
        "[[handle]] 1 'tail', gain: found 1e+45; expected a number less than or equal to 1000000000.",
    ),
    "no list of joints": (
        PUPPET + "joints = []\n",
        "[[handle]] 1 'tail', joints: found []; expected a list that is not empty.",
    ),
    "an empty name": (
        PUPPET.replace("tail", ""),
        "[[handle]] 1 '', name: found ''; expected a string that is not empty.",
    ),
    "axes in another order": (
        PUPPET + 'axes = "zx"\n',
        "[[handle]] 1 'tail', axes: found 'zx'; expected '', 'x', 'y', 'z', 'xy', 'xz', 'yz' or 'xyz'.",
    ),
    "a coordinate that is not a number": (
        CHARACTER + '[[handle]]\nname = "a"\nposition = [1, 2, nan]\n',
        "[[handle]] 1 'a', position, 3: found nan; expected a finite number.",
    ),
    "a number in quotes": (PUPPET + 'gain = "2"\n', "[[handle]] 1 'tail', gain: found '2'; expected a number."),
    "one table for a list of them": (CHARACTER + "[handle]\nx = 1\n", "handle: found {'x': 1}; expected a list."),
    "texts for tables": ('handle = ["a"]\n' + CHARACTER, "[[handle]] 1: found 'a'; expected a table."),
    "yes for true": (
        PUPPET + '[retarget]\nmirror = "yes"\n',
        "[retarget], mirror: found 'yes'; expected true or false, without quotes.",
    ),
    "an endless scale": (
        PUPPET + "[retarget]\nscale = inf\n",
        "[retarget], scale: found inf; expected 'auto' or a finite number.",
    ),
    "half a field": (PUPPET + "[solver]\nfields = 7.5\n", "[solver], fields: found 7.5; expected an integer."),
}


@pytest.mark.parametrize(
    ("content", "message"),
    [*MISTAKES.values(), *((content, f"{message} {CHANGE}") for content, message in WRONG_VALUES.values())],
    ids=[*MISTAKES, *WRONG_VALUES],
)
def test_a_mistake_is_named_with_its_table_and_key(content, message):
    with pytest.raises(PuppetError) as error:
        puppet_file.loads(content, "dog.toml")
    assert str(error.value) == f"dog.toml, {message}"
