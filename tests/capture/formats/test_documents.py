"""Nested text of any kind becomes one kind of document."""

import re

import pytest

from capture.formats import landmarks_json
from capture.formats._documents import is_document, load
from capture.skeleton import JOINT_INDEX, JOINTS, PARENTS
from puppetline.errors import SkeletonLogError

from .people import PERSON, assert_reads

XML = """<?xml version="1.0"?>
<session rate="30"><frame at="0.5"><joint name="head">1 2</joint><joint name="hip"><x>-1e-3</x></joint><empty/></frame>
<frame at="0.6">text</frame></session>"""


@pytest.fixture
def loaded(tmp_path):
    """Write text and load it as a document."""

    def written(text):
        (tmp_path / "take").write_text(text)
        return load(tmp_path / "take")

    return written


def test_elements_are_dictionaries_of_attributes_and_children(loaded):
    frames = [{"at": 0.5, "joint": [{"name": "head"}, {"name": "hip", "x": -0.001}], "empty": ""}, {"at": 0.6}]
    assert is_document(XML.encode())
    assert loaded(XML) == {"session": {"rate": 30.0, "frame": frames}}


def test_lists_of_pairs_are_dictionaries(loaded):
    found = loaded('0 12.5 async ((a (1 2.5 -3)) (b ((c "two words") (d e))))\n1 (x y)\n')
    assert found == [{"time": 12.5, "a": [1.0, 2.5, -3.0], "b": {"c": "two words", "d": "e"}}, [1.0, ["x", "y"]]]


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("<a><b></a>", "XML that cannot be read (mismatched tag"),
        ('<!DOCTYPE a [<!ENTITY b "b">]><a>&b;</a>', "a document type"),
        ("<a>" * 300, "more than 200 levels"),
        ("((a (b c)))) d", "brackets that do not match"),
        ("(a " * 300 + ")" * 300, "brackets that do not match, or are too deep"),
    ],
)
def test_damaged_documents_are_errors(loaded, text, found):
    with pytest.raises(SkeletonLogError, match=re.escape(found)):
        loaded(text)


def test_a_line_that_ends_early_has_what_is_whole(loaded):
    assert loaded("(a (b c)") == [[]]


def nested(joint, pose):
    """Return a joint, with those that hang on it, as YARP writes it."""
    children = " ".join(nested(child, pose) for child, parent in PARENTS.items() if parent == joint)
    place = " ".join(map(repr, pose[JOINT_INDEX[joint]].tolist()))
    return f"((child ({children})) (position ({place})) (status updated) (tag {joint}))"


def each(form, pose):
    """Return a form of the name and the place of each joint."""
    return "".join(form.format(name, *point) for name, point in zip(JOINTS, pose.tolist(), strict=True))


FORMS = {
    "elements with attributes": lambda time, pose: f'<frame time="{time}">{each(ATTRIBUTES, pose)}</frame>',
    "elements named like joints": lambda time, pose: f"<Skeleton><time>{time}</time>{each(ELEMENTS, pose)}</Skeleton>",
    "lists": lambda time, pose: f"{time} {time} async ((skeleton ({nested('hip_center', pose)})) (tag one))",
}
ATTRIBUTES = '<Joint Type="{}" X="{!r}" Y="{!r}" Z="{!r}"/>'
ELEMENTS = "<{0}><angles><Qx>1</Qx></angles><positions><x>{1!r}</x><y>{2!r}</y><z>{3!r}</z></positions></{0}>"


@pytest.mark.parametrize("form", FORMS)
def test_joints_are_found_at_any_depth(read, form):
    text = "\n".join(FORMS[form](k / 25, pose) for k, pose in enumerate(PERSON)) + "\n"
    text = text if form == "lists" else f"<recording>{text}</recording>"
    assert landmarks_json.matches(text.encode())
    [clip] = read(landmarks_json, text)
    assert_reads(clip, step=1 / 25, atol=1e-12)


def test_xml_without_positions_is_named(read):
    with pytest.raises(SkeletonLogError, match="found XML with the keys markers, without positions in space"):
        read(landmarks_json, '<markers><marker name="elbow" colour="red"/></markers>')
