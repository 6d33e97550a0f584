import tomllib

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from capture.skeleton import JOINT_INDEX, JOINTS
from engine_bridge.puppet import puppet
from engine_bridge.puppet.puppet import (
    CharacterTable,
    HandleTable,
    LimbTable,
    Puppet,
    RetargetTable,
    RootTable,
    SmoothingTable,
    SolverTable,
)
from puppetline.errors import PuppetError

CHARACTER = '[character]\nmesh = "dog.glb"\n'
HANDLE = '[[handle]]\nname = "tail"\nposition = [0, 1, 2.5]\n'
PUPPET = CHARACTER + HANDLE


def limb(name, points, joints):
    return f"[[limb]]\nname = {name!r}\npoints = {points}\njoints = {joints}\n"


ARM = limb("arm", [[0, 0, 0], [1, 0, 0], [2, 0, 0]], ["shoulder_left", "elbow_left", ["wrist_left", "hand_left"]])

finite = st.floats(-1e9, 1e9)
text = st.text(st.characters(codec="utf-8"), min_size=1, max_size=12)
joints = st.sampled_from(JOINTS)
axes = st.sampled_from(["", "x", "y", "z", "xy", "xz", "yz", "xyz"])
handles = st.builds(
    lambda driven, **rest: HandleTable(**rest, **driven),
    driven=st.one_of(
        st.just({}),
        joints.map(lambda name: {"joint": name}),
        st.lists(joints, min_size=1, max_size=4).map(lambda names: {"joints": names}),
    ),
    name=text,
    position=st.tuples(finite, finite, finite),
    axes=axes,
    gain=finite,
)
chains = st.integers(2, 4).flatmap(
    lambda k: st.tuples(
        st.lists(st.tuples(finite, finite, finite), min_size=k, max_size=k, unique=True),
        st.lists(joints | st.lists(joints, min_size=1, max_size=3), min_size=k, max_size=k),
    )
)
limbs = st.builds(
    lambda chain, **rest: LimbTable(points=chain[0], joints=chain[1], **rest),
    chain=chains,
    name=text,
    follow=st.sampled_from(["direction", "turn"]),
    gain=finite,
)
puppets = st.builds(
    Puppet,
    limb=st.lists(limbs, max_size=1),
    character=st.builds(
        lambda mesh, directions, scale: CharacterTable(mesh=mesh, up=directions[0], front=directions[1], scale=scale),
        text,
        st.tuples(*[st.sampled_from(["x", "-x", "y", "-y", "z", "-z"])] * 2).filter(lambda d: d[0][-1] != d[1][-1]),
        st.floats(1e-300, 1e9),
    ),
    handle=st.lists(handles, min_size=1, max_size=4, unique_by=lambda handle: handle.name),
    root=st.none() | st.builds(RootTable, joint=joints, axes=axes, turns=st.booleans()),
    retarget=st.builds(
        RetargetTable,
        mirror=st.booleans(),
        scale=st.just("auto") | st.floats(1e-300, 1e9),
        arm_space=st.floats(-90, 90),
    ),
    smoothing=st.builds(
        SmoothingTable,
        alpha=st.floats(0, 1, exclude_min=True),
        gamma=st.floats(0, 1),
        jitter_radius=st.floats(0, 1e9),
        max_deviation=st.floats(0, exclude_min=True),
        prediction=st.floats(0, 1e9),
    ),
    solver=st.builds(
        SolverTable,
        fields=st.integers(1, 64),
        isolines=st.integers(2, 10),
        iterations=st.integers(1, 1000),
        rotations=st.sampled_from(["clusters", "covariance", "triangles", None]),
    ),
)


@given(made=puppets)
@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_puppet_that_is_written_and_read_again_is_the_same(made, tmp_path):
    puppet.dump(made, tmp_path / "made.toml")
    assert puppet.load(tmp_path / "made.toml") == made


def test_only_what_differs_from_the_defaults_is_written():
    made = Puppet(
        character=CharacterTable(mesh="dog.glb"),
        handle=[HandleTable(name="tail", position=(0, 1, 2.5), joint="head")],
        retarget=RetargetTable(mirror=True),
    )
    assert tomllib.loads(puppet.dumps(made)) == {
        "character": {"mesh": "dog.glb"},
        "handle": [{"name": "tail", "position": [0.0, 1.0, 2.5], "joint": "head"}],
        "retarget": {"mirror": True},
    }


def test_a_root_is_written_out_as_it_stands_for_itself():
    made = Puppet(
        character=CharacterTable(mesh="a"), handle=[HandleTable(name="b", position=(0, 0, 0))], root=RootTable()
    )
    assert tomllib.loads(puppet.dumps(made))["root"] == {"joint": "hip_center", "axes": "xz"}


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
    made = puppet.loads(CHARACTER + ring + arm + spine, "a")
    assert {each.name: each.parent for each in made.limbs} == {"ring": "arm", "arm": "trunk", "trunk": None}
    assert made.limbs[1].joints == ((4,), (6, 7))
    np.testing.assert_array_equal(made.limbs[0].points, [[1, 1, 0], [2, 1, 0]])
    assert (made.limbs[0].follow, made.limbs[0].gain, made.limbs[1].follow) == ("turn", 2.0, "direction")
    assert puppet.loads(CHARACTER + arm + HANDLE, "a").limbs[0].parent is None
    assert made.driven_by == ("hip_center", "shoulder_center", "shoulder_left", "wrist_left", "hand_left")


@pytest.mark.parametrize(("scale", "unit", "expected"), [("auto", 0.01, None), (1.5, 1.0, 1.5), (1.5, 0.01, 150.0)])
def test_a_scale_in_metres_becomes_mesh_units(scale, unit, expected):
    made = Puppet(
        character=CharacterTable(mesh="a", scale=unit),
        handle=[HandleTable(name="b", position=(0, 0, 0))],
        retarget=RetargetTable(scale=scale),
    )
    assert made.units_a_metre == expected


@pytest.mark.parametrize(
    ("up", "front", "left"),
    [("y", "z", [1, 0, 0]), ("z", "-y", [1, 0, 0]), ("z", "x", [0, 1, 0]), ("-y", "z", [-1, 0, 0])],
)
def test_the_characters_left_is_where_it_would_be_on_a_body(up, front, left):
    basis = CharacterTable(mesh="a", up=up, front=front).basis
    np.testing.assert_array_equal(basis[0], left)
    assert np.linalg.det(basis) == 1


MISTAKES = {
    "an unknown table": (
        PUPPET + "[smothing]\nalpha = 1\n",
        "smothing",
        "the unknown key 'smothing'",
        "one of character, limb, handle, root, retarget, smoothing, solver",
        "Did you mean 'smoothing'?",
    ),
    "an unknown key": (
        PUPPET + 'joit = "head"\n',
        "[[handle]] 1 'tail', joit",
        "the unknown key 'joit'",
        "one of name, position, joint, joints, axes, gain",
        "Did you mean 'joint'?",
    ),
    "a key like no other": (
        PUPPET + "[retarget]\nqqq = 1\n",
        "[retarget], qqq",
        "the unknown key 'qqq'",
        "one of mirror, scale, arm_space, hands_meet",
        "Remove it.",
    ),
    "an unknown joint": (
        PUPPET + 'joint = "hand_lft"\n',
        "[[handle]] 1 'tail', joint",
        "'hand_lft'",
        "the name of a Kinect joint",
        "Did you mean 'hand_left'?",
    ),
    "an unknown joint among several": (
        PUPPET + 'joints = ["head", "hip_centre"]\n',
        "[[handle]] 1 'tail', joints, 2",
        "'hip_centre'",
        "the name of a Kinect joint",
        "Did you mean 'hip_center'?",
    ),
    "a joint like no other": (
        PUPPET + '[root]\njoint = "tentacle"\n',
        "[root], joint",
        "'tentacle'",
        "the name of a Kinect joint",
        f"Choose one of them: {', '.join(JOINTS)}.",
    ),
    "joint and joints": (
        PUPPET + 'joint = "head"\njoints = ["head"]\n',
        "[[handle]] 1 'tail', joints",
        "both joint and joints",
        "one of the two",
        "Leave one of them out.",
    ),
    "two handles of one name": (
        PUPPET + HANDLE,
        "[[handle]] 2 'tail', name",
        "'tail' again",
        "a name of its own for each handle",
        "Rename one of the two handles 'tail'.",
    ),
    "no list of joints": (
        PUPPET + "joints = []\n",
        "[[handle]] 1 'tail', joints",
        "[]",
        "a list that is not empty",
        "Change the value of that key.",
    ),
    "no limb and no handle": (
        CHARACTER,
        "the whole file",
        "neither a limb nor a handle",
        "at least one of them",
        "Add a table [[limb]] or [[handle]].",
    ),
    "an empty list of handles": (
        "handle = []\n" + CHARACTER,
        "the whole file",
        "neither a limb nor a handle",
        "at least one of them",
        "Add a table [[limb]] or [[handle]].",
    ),
    "no character": (HANDLE, "character", "nothing", "a value", "Add the table [character] there."),
    "no mesh": ("[character]\n" + HANDLE, "[character], mesh", "nothing", "a value", "Add the key 'mesh' there."),
    "no position": (
        CHARACTER + '[[handle]]\nname = "a"\n',
        "[[handle]] 1 'a', position",
        "nothing",
        "a value",
        "Add the key 'position' there.",
    ),
    "no name": (
        PUPPET + "[[handle]]\nposition = [0, 0, 0]\n",
        "[[handle]] 2, name",
        "nothing",
        "a value",
        "Add the key 'name' there.",
    ),
    "an empty name": (
        PUPPET.replace("tail", ""),
        "[[handle]] 1 '', name",
        "''",
        "a string that is not empty",
        "Change the value of that key.",
    ),
    "axes in another order": (
        PUPPET + 'axes = "zx"\n',
        "[[handle]] 1 'tail', axes",
        "'zx'",
        "'', 'x', 'y', 'z', 'xy', 'xz', 'yz' or 'xyz'",
        "Change the value of that key.",
    ),
    "up and front along one axis": (
        CHARACTER + 'up = "z"\nfront = "-z"\n' + HANDLE,
        "[character], front",
        "'-z', and up is 'z'",
        "up and front along different axes",
        "Give front another axis.",
    ),
    "no such direction": (
        CHARACTER + 'up = "up"\n' + HANDLE,
        "[character], up",
        "'up'",
        "'x', '-x', 'y', '-y', 'z' or '-z'",
        "Change the value of that key.",
    ),
    "two coordinates": (
        CHARACTER + '[[handle]]\nname = "a"\nposition = [1, 2]\n',
        "[[handle]] 1 'a', position",
        "[1, 2]",
        "three numbers",
        "Write it like [0.1, 1.5, 0.2].",
    ),
    "a coordinate that is not a number": (
        CHARACTER + '[[handle]]\nname = "a"\nposition = [1, 2, nan]\n',
        "[[handle]] 1 'a', position, 3",
        "nan",
        "a finite number",
        "Change the value of that key.",
    ),
    "a number in quotes": (
        PUPPET + 'gain = "2"\n',
        "[[handle]] 1 'tail', gain",
        "'2'",
        "a number",
        "Change the value of that key.",
    ),
    "true for a number": (
        PUPPET + "gain = true\n",
        "[[handle]] 1 'tail', gain",
        "True",
        "a number",
        "Change the value of that key.",
    ),
    "a text for a list": (
        PUPPET + 'joints = "head"\n',
        "[[handle]] 1 'tail', joints",
        "'head'",
        "a list",
        "Change the value of that key.",
    ),
    "a text for a table": (
        'character = "dog.glb"\n' + HANDLE,
        "character",
        "'dog.glb'",
        "a table",
        "Change the value of that key.",
    ),
    "one table for a list of them": (
        CHARACTER + "[handle]\nx = 1\n",
        "handle",
        "{'x': 1}",
        "a list",
        "Change the value of that key.",
    ),
    "texts for tables": (
        'handle = ["a"]\n' + CHARACTER,
        "[[handle]] 1",
        "'a'",
        "a table",
        "Change the value of that key.",
    ),
    "yes for true": (
        PUPPET + '[retarget]\nmirror = "yes"\n',
        "[retarget], mirror",
        "'yes'",
        "true or false, without quotes",
        "Change the value of that key.",
    ),
    "a character without a size": (
        CHARACTER + "scale = 0.0\n" + HANDLE,
        "[character], scale",
        "0.0",
        "a number greater than 0",
        "Change the value of that key.",
    ),
    "no scale": (
        PUPPET + "[retarget]\nscale = 0\n",
        "[retarget], scale",
        "0",
        "'auto' or a number greater than 0",
        "Change the value of that key.",
    ),
    "an endless scale": (
        PUPPET + "[retarget]\nscale = inf\n",
        "[retarget], scale",
        "inf",
        "'auto' or a finite number",
        "Change the value of that key.",
    ),
    "smoothing beyond 1": (
        PUPPET + "[smoothing]\nalpha = 1.5\n",
        "[smoothing], alpha",
        "1.5",
        "a number less than or equal to 1",
        "Change the value of that key.",
    ),
    "half a field": (
        PUPPET + "[solver]\nfields = 7.5\n",
        "[solver], fields",
        "7.5",
        "an integer",
        "Change the value of that key.",
    ),
    "a limb with one point": (
        CHARACTER + limb("arm", [[0, 0, 0]], ["head"]),
        "[[limb]] 1 'arm', points",
        "one point",
        "at least two points, from root to tip",
        "Add the point at the other end of the limb.",
    ),
    "points and joints of different length": (
        CHARACTER + limb("arm", [[0, 0, 0], [1, 0, 0]], ["head"]),
        "[[limb]] 1 'arm', joints",
        "1 joint for 2 points",
        "one joint for each point",
        "Give both lists the same length; several joints in brackets of their own are averaged.",
    ),
    "a bone without length": (
        CHARACTER + limb("arm", [[0, 0, 0], [1, 0, 0], [1, 0, 0]], ["head", "spine", "hand_left"]),
        "[[limb]] 1 'arm', points, 3",
        "[1, 0, 0], as the point before",
        "points apart from each other",
        "Remove one of the two, and its joint.",
    ),
    "an unknown joint of a limb": (
        CHARACTER + limb("arm", [[0, 0, 0], [1, 0, 0]], ["head", "hand_lft"]),
        "[[limb]] 1 'arm', joints, 2",
        "'hand_lft'",
        "the name of a Kinect joint",
        "Did you mean 'hand_left'?",
    ),
    "an unknown joint among several of a limb": (
        CHARACTER + limb("arm", [[0, 0, 0], [1, 0, 0]], ["head", ["hand_left", "hip"]]),
        "[[limb]] 1 'arm', joints, 2, 2",
        "'hip'",
        "the name of a Kinect joint",
        f"Choose one of them: {', '.join(JOINTS)}.",
    ),
    "another way to follow": (
        CHARACTER + limb("arm", [[0, 0, 0], [1, 0, 0]], ["head", "spine"]) + 'follow = "position"\n',
        "[[limb]] 1 'arm', follow",
        "'position'",
        "'direction' or 'turn'",
        "Change the value of that key.",
    ),
    "two limbs of one name": (
        CHARACTER + ARM + limb("arm", [[0, 5, 0], [1, 5, 0]], ["head", "spine"]),
        "[[limb]] 2 'arm', name",
        "'arm' again",
        "a name of its own for each limb",
        "Rename one of the two limbs 'arm'.",
    ),
    "a parent that is not there": (
        CHARACTER + ARM + limb("head", [[0, 5, 0], [1, 5, 0]], ["head", "spine"]) + 'parent = "body"\n',
        "[[limb]] 2 'head', parent",
        "'body', and there is no limb of that name",
        "the name of another limb: arm",
        "Correct the name, or leave parent out.",
    ),
    "limbs that hang on each other": (
        CHARACTER + ARM + 'parent = "b"\n' + limb("b", [[0, 5, 0], [1, 5, 0]], ["head", "spine"]) + 'parent = "arm"\n',
        "[[limb]] 1 'arm', parent",
        "a circle: 'arm' on 'b' on 'arm'",
        "limbs that hang on each other up to one that hangs on none",
        "Give one of them another parent, or none.",
    ),
    "a limb that hangs on itself": (
        CHARACTER + ARM + 'parent = "arm"\n',
        "[[limb]] 1 'arm', parent",
        "a circle: 'arm' on 'arm'",
        "limbs that hang on each other up to one that hangs on none",
        "Give one of them another parent, or none.",
    ),
    "two limbs in one place": (
        CHARACTER + ARM + limb("wing", [[0, 0, 0], [1, 0, 0]], ["head", "spine"]),
        "[[limb]] 2 'wing', points",
        "bones in the same place as those of the limb 'arm'",
        "limbs that lie apart and touch at most where one hangs on the other",
        "Remove one of the two limbs, or move its points.",
    ),
    "a limb along a part of another": (
        CHARACTER + ARM + limb("wing", [[3, 0, 0], [0.2, 0.01, 0]], ["head", "spine"]),
        "[[limb]] 2 'wing', points",
        "bones in the same place as those of the limb 'arm'",
        "limbs that lie apart and touch at most where one hangs on the other",
        "Remove one of the two limbs, or move its points.",
    ),
}


@pytest.mark.parametrize(("content", "field", "found", "expected", "fix"), MISTAKES.values(), ids=list(MISTAKES))
def test_a_mistake_is_named_with_its_table_and_key(tmp_path, content, field, found, expected, fix):
    path = tmp_path / "dog.toml"
    path.write_text(content)
    with pytest.raises(PuppetError) as error:
        puppet.load(path)
    told = error.value
    assert (told.where, told.found, told.expected, told.fix) == (f"{path}, {field}", found, expected, fix)


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (CHARACTER + "[[handle]]\nname = tail\n", 4),
        ('[character]\nmesh = "dog.glb\n', 2),
        (CHARACTER + 'mesh = "cat.glb"\n', 3),
        (PUPPET + CHARACTER, 6),
    ],
)
def test_a_syntax_error_is_named_with_its_line(tmp_path, content, line):
    path = tmp_path / "dog.toml"
    path.write_text(content)
    with pytest.raises(PuppetError, match=f"at line {line}, column") as error:
        puppet.load(path)
    assert (error.value.where, error.value.expected) == (str(path), "TOML")
    assert error.value.found.startswith("a syntax error: ")


def test_a_file_that_is_no_text_or_not_there_or_nested_without_end_is_refused(tmp_path):
    binary, deep = tmp_path / "binary.toml", tmp_path / "deep.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    deep.write_text("x = " + "[" * 50_000)
    for path, found in (
        (binary, "bytes that are not text"),
        (tmp_path / "none.toml", "a file that cannot be read (No such file or directory)"),
        (tmp_path, "a file that cannot be read (Is a directory)"),
    ):
        with pytest.raises(PuppetError) as error:
            puppet.load(path)
        assert (error.value.where, error.value.found) == (str(path), found)
    with pytest.raises(PuppetError, match="a syntax error"):
        puppet.load(deep)


def test_a_model_that_would_not_fit_in_memory_is_refused():
    values = {"character": {"mesh": "a"}, "handle": [{"name": "a", "position": [0, 0, 0]}]}
    with pytest.raises(PuppetError) as error:
        puppet.check({**values, "solver": {"fields": 64, "isolines": 64}}, "dog.toml")
    assert error.value.where == "dog.toml, [solver], isolines"
    assert error.value.found == "64 fields with 64 isolines each"


@pytest.mark.parametrize("key", ["gain", "position"])
def test_numbers_beyond_all_measure_are_refused(key):
    handle = {"name": "a", "position": [0, 0, 0], "gain": 1.0} | {key: 1e45 if key == "gain" else [0, 1e45, 0]}
    with pytest.raises(PuppetError) as error:
        puppet.check({"character": {"mesh": "a"}, "handle": [handle]}, "dog.toml")
    assert key in error.value.where
