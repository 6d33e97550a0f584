import pytest

from engine_bridge.puppet import puppet_file
from puppetline.errors import PuppetError

from ..refusals import refused

CHARACTER = '[character]\nmesh = "dog.glb"\n'
HANDLE = '[[handle]]\nname = "tail"\nposition = [0, 1, 2.5]\n'
PUPPET = CHARACTER + HANDLE


def limb(name, points, *joints):
    """Return the table of a limb."""
    return f"[[limb]]\nname = {name!r}\npoints = {points}\njoints = {[*joints]}\n"


ARM = limb("arm", "[[0, 0, 0], [1, 0, 0], [2, 0, 0]]", "shoulder_left", "elbow_left", ["wrist_left", "hand_left"])


def test_limbs_hang_on_the_trunk_unless_they_say_otherwise():
    spine = limb("trunk", "[[0, 0, 0], [0, 1, 0]]", "hip_center", "shoulder_center")
    arm = limb("arm", "[[0, 1, 0], [1, 1, 0]]", "shoulder_left", ["wrist_left", "hand_left"])
    ring = limb("ring", "[[1, 1, 0], [2, 1, 0]]", "wrist_left", "hand_left") + 'parent = "arm"\n'
    made = puppet_file.loads(CHARACTER + ring + arm + spine, "a")
    assert {each.name: each.parent for each in made.limbs} == {"ring": "arm", "arm": "trunk", "trunk": None}
    assert made.limbs[1].joints == ((4,), (6, 7))
    assert puppet_file.loads(CHARACTER + arm + HANDLE, "a").limbs[0].parent is None
    assert made.driven_by == ("hip_center", "shoulder_center", "shoulder_left", "wrist_left", "hand_left")


MISTAKES = {
    "an unknown table": (PUPPET + "[smothing]\nalpha = 1\n", "smothing"),
    "an unknown key": (PUPPET + 'joit = "head"\n', "[[handle]] 1 'tail', joit"),
    "a joint like no other": (PUPPET + '[root]\njoint = "tentacle"\n', "[root], joint"),
    "joint and joints": (PUPPET + 'joint = "head"\njoints = ["head"]\n', "[[handle]] 1 'tail', joints"),
    "two handles of one name": (PUPPET + HANDLE, "[[handle]] 2 'tail', name"),
    "no limb and no handle": (CHARACTER, "the whole file"),
    "no position": (CHARACTER + '[[handle]]\nname = "a"\n', "[[handle]] 1 'a', position"),
    "up and front along one axis": (CHARACTER + 'up = "z"\nfront = "-z"\n' + HANDLE, "[character], front"),
    "a model that does not fit in memory": (PUPPET + "[solver]\nfields = 64\nisolines = 64\n", "[solver], isolines"),
    "a limb with one point": (CHARACTER + limb("arm", "[[0, 0, 0]]", "head"), "[[limb]] 1 'arm', points"),
    "points and joints of different length": (
        CHARACTER + limb("arm", "[[0, 0, 0], [1, 0, 0]]", "head"),
        "[[limb]] 1 'arm', joints",
    ),
    "a bone without length": (
        CHARACTER + limb("arm", "[[0, 0, 0], [1, 0, 0], [1, 0, 0]]", "head", "spine", "hand_left"),
        "[[limb]] 1 'arm', points, 3",
    ),
    "an unknown joint among several of a limb": (
        CHARACTER + limb("arm", "[[0, 0, 0], [1, 0, 0]]", "head", ["hand_left", "hip"]),
        "[[limb]] 1 'arm', joints, 2, 2",
    ),
    "two limbs of one name": (
        CHARACTER + ARM + limb("arm", "[[0, 5, 0], [1, 5, 0]]", "head", "spine"),
        "[[limb]] 2 'arm', name",
    ),
    "a parent that is not there": (
        CHARACTER + ARM + limb("head", "[[0, 5, 0], [1, 5, 0]]", "head", "spine") + 'parent = "body"\n',
        "[[limb]] 2 'head', parent",
    ),
    "limbs that hang on each other": (
        CHARACTER + ARM + 'parent = "b"\n' + limb("b", "[[0, 5, 0], [1, 5, 0]]", "head", "spine") + 'parent = "arm"\n',
        "[[limb]] 1 'arm', parent",
    ),
    "two limbs in one place": (
        CHARACTER + ARM + limb("wing", "[[0, 0, 0], [1, 0, 0]]", "head", "spine"),
        "[[limb]] 2 'wing', points",
    ),
    "a limb along a part of another": (
        CHARACTER + ARM + limb("wing", "[[3, 0, 0], [0.2, 0.01, 0]]", "head", "spine"),
        "[[limb]] 2 'wing', points",
    ),
    "a coordinate that is not a number": (
        CHARACTER + '[[handle]]\nname = "a"\nposition = [1, 2, nan]\n',
        "[[handle]] 1 'a', position, 3",
    ),
    "an unknown channel": (PUPPET + '[[morph]]\ntarget = "a"\nchannel = "loudness"\n', "[[morph]] 1, channel"),
    "a channel without a range": (PUPPET + '[[channel]]\nname = "smile"\nfull = 0.0\n', "[[channel]] 1 'smile', full"),
    "a channel that moves nothing": (PUPPET + 'channel = "voice"\n', "[[handle]] 1 'tail', moves"),
    "one table for a list of them": (CHARACTER + "[handle]\nx = 1\n", "handle"),
}


@pytest.mark.parametrize(("content", "place"), MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_is_named_with_its_table_and_key(content, place):
    assert refused(PuppetError, puppet_file.loads, content, "dog.toml").where == f"dog.toml, {place}"
