import difflib
import itertools
import stat
from functools import partial

import pytest

from engine_bridge.puppet.puppet import with_handle
from engine_bridge.puppet.puppet_document import PuppetDocument, with_puppet
from engine_bridge.puppet.puppet_file import loads
from puppetline.errors import PuppetError

from ..refusals import refused
from .test_puppet_file import WHOLE

TEXT = """# A dog that nods.
[character]
mesh = "dog.glb"    # beside this file

[[handle]]
name = "head"           # the nose, in truth
position = [0.0, 1.60, 0.2]
joint = "head"

# wags
[[handle]]
name = "tail"
position = [0.0, 0.9, -1.4]
axes  =  "xy"           # never forwards
joints = [
    "hand_right",       # the one
    "hand_left",        # and the other
]
gain = 1.5   # strong

[[handle]]
name = "rump"
position = [0.0, 0.9, -1.0]


[root]
joint = "hip_center"   # carries it

[solver]
iterations = 6
# the end
"""

INLINE = """root.joint = "head"
handle = [
    {name = "a", position = [0, 0, 0]},   # rests
    {name = "b", position = [1, 1, 1], joint = "head", gain = 2},
]
[character]
mesh = "dog.glb"
"""


def changed_lines(before, after):
    return [line for line in difflib.ndiff(before.splitlines(), after.splitlines()) if line[0] in "+-"]


read = partial(loads, where="dog.toml")


def rewritten(text, after):
    """Return the text of a file in which another puppet was written, and from which that is read."""
    written = with_puppet(text, read(text), after)
    assert read(written) == after
    return written


def edited(text, index, joints=(), axes="xyz", gain=1.0):
    return rewritten(text, with_handle(read(text), index, joints, axes, gain))


@pytest.mark.parametrize(
    ("index", "mapping", "lines"),
    [
        (0, {"joints": ("spine",)}, ['- joint = "head"', '+ joint = "spine"']),
        (0, {"joints": ("head", "spine")}, ['- joint = "head"', '+ joints = ["head", "spine"]']),
        (
            1,
            {"joints": ("hand_right", "hand_left"), "axes": "xyz", "gain": 1.0},
            [
                '- axes  =  "xy"           # never forwards',
                '+ axes  =  "xyz"           # never forwards',
                "- gain = 1.5   # strong",
                "+ gain = 1.0   # strong",
            ],
        ),
        (2, {"joints": ("head",), "axes": ""}, ['+ joint = "head"', '+ axes = ""']),
    ],
    ids=["another joint", "several", "in its place", "one that rested"],
)
def test_only_what_is_edited_changes(index, mapping, lines):
    assert sorted(changed_lines(TEXT, edited(TEXT, index, **mapping))) == sorted(lines)


def test_an_added_key_stands_above_the_comment_of_the_next_handle():
    assert 'joint = "head"\ngain = 2.0\n\n# wags\n[[handle]]' in edited(TEXT, 0, ("head",), gain=2.0)


def test_other_ways_to_write_toml_are_kept():
    written = edited(INLINE, 1, ("spine",), "xy", 0.5)
    assert changed_lines(INLINE, written) == [
        '-     {name = "b", position = [1, 1, 1], joint = "head", gain = 2},',
        '+     {name = "b", position = [1, 1, 1], joint = "spine", gain = 0.5, axes = "xy"},',
    ]
    windows = TEXT.replace("\n", "\r\n")
    assert edited(windows, 0, ("spine",), gain=2.0) == edited(TEXT, 0, ("spine",), gain=2.0).replace("\n", "\r\n")


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "dog.toml"
    path.write_bytes(TEXT.encode())
    path.chmod(0o640)
    return path


def test_saving_repeatedly_keeps_the_same_file(file, tmp_path):
    link = tmp_path / "link.toml"
    link.symlink_to(file)
    document = PuppetDocument(link)
    for gain in (2.0, 3.0):
        document.save(with_handle(document.puppet, 0, ("head",), "xyz", gain))
        assert file.read_text() == edited(TEXT, 0, ("head",), gain=gain)
        assert document.puppet == loads(file.read_text(), file)
    assert link.is_symlink()
    assert stat.S_IMODE(file.stat().st_mode) == 0o640
    assert sorted(tmp_path.iterdir()) == [file, link]


@pytest.mark.parametrize("change", ["text", "comment", "gone", "folder"])
def test_a_file_changed_by_another_program_is_not_overwritten(file, change):
    document = PuppetDocument(file)
    file.unlink()
    if change == "folder":
        file.mkdir()
    elif change != "gone":
        file.write_text(TEXT.replace("1.60", "1.61") if change == "text" else TEXT + "# mine")
    was = file.read_bytes() if file.is_file() else None
    edit = with_handle(document.puppet, 0, (), "xyz", 1.0)
    assert refused(PuppetError, document.save, edit).where == str(file)
    assert (file.read_bytes() if file.is_file() else None) == was
    assert document.puppet == loads(TEXT, file)


def test_a_layout_that_cannot_be_edited_is_left_as_it_is(file):
    file.write_text(INLINE)
    document = PuppetDocument(file)
    another = document.puppet.handle[0].model_copy(update={"name": "c"})
    refused(
        PuppetError, document.save, document.puppet.model_copy(update={"handle": (*document.puppet.handle, another)})
    )
    assert file.read_text() == INLINE


LIMBED = """[character]
mesh = "dog.glb"

# the long one
[[limb]]
name = "neck"   # up
points = [[0.0, 1.0, 0.0], [0.0, 2.0, 0.0]]
joints = ["spine", "head"]

# wags
[[limb]]
name = "tail"
nodes = ["Tail"]
points = [[0.0, 1.0, -1.0], [0.0, 1.0, -2.0]]
joints = ["hip_center", "hand_left"]
parent = "neck"   # as it is
"""


def with_limbs(puppet, *limbs):
    return puppet.model_copy(update={"limb": limbs})


def test_a_renamed_limb_and_a_moved_point_keep_their_comments():
    before = read(LIMBED)
    neck, tail = before.limb
    moved = neck.model_copy(update={"name": "throat", "points": (neck.points[0], (0.0, 2.5, 0.0))})
    after = with_limbs(before, moved, tail.model_copy(update={"parent": "throat", "gain": 1.5, "nodes": None}))
    assert sorted(changed_lines(LIMBED, rewritten(LIMBED, after))) == [
        "+ gain = 1.5",
        '+ name = "throat"   # up',
        '+ parent = "throat"   # as it is',
        "+ points = [[0.0, 1.0, 0.0], [0.0, 2.5, 0.0]]",
        '- name = "neck"   # up',
        '- nodes = ["Tail"]',
        '- parent = "neck"   # as it is',
        "- points = [[0.0, 1.0, 0.0], [0.0, 2.0, 0.0]]",
    ]


def test_limbs_come_go_and_change_places():
    before = read(LIMBED)
    neck, tail = before.limb
    ear = neck.model_copy(update={"name": "ear", "points": ((1.0, 2.0, 0.0), (1.0, 3.0, 0.0)), "follow": "turn"})
    for limbs in ((neck, tail, ear), (tail.model_copy(update={"parent": None}),), (ear, tail, neck), (neck, ear, tail)):
        written = rewritten(LIMBED, with_limbs(before, *limbs))
        assert written.count("# as it is") == (tail in limbs)
        assert written.count("# up") == (neck in limbs)


MUCH = WHOLE.partition("[vrm]")[0]
"""All that an editor changes."""


TEXTS = [TEXT, LIMBED, MUCH, MUCH.replace("gain = 0.5", "gain = 0.7")]


@pytest.mark.parametrize(("text", "other"), list(itertools.product(TEXTS, repeat=2)))
def test_a_file_becomes_any_other_and_keeps_its_first_comment_and_all_if_nothing_differs(text, other):
    assert rewritten(text, read(other)).startswith(text if text == other else text.partition("\n")[0])
