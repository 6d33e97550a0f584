"""Nested text of any kind becomes one kind of document."""

import re

import pytest

from capture.formats import landmarks_json
from capture.formats._documents import load
from capture.skeleton import JOINT_INDEX, JOINTS, PARENTS
from puppetline.errors import SkeletonLogError

from .people import PERSON, assert_reads


@pytest.fixture
def loaded(tmp_path):
    """Write text and load it as a document."""

    def written(text):
        (tmp_path / "take").write_text(text)
        return load(tmp_path / "take")

    return written


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
    text = text if form == "lists" else f'<?xml version="1.0"?>\n<recording>{text}</recording>'
    assert landmarks_json.matches(text.encode())
    [clip] = read(landmarks_json, text)
    assert_reads(clip, step=1 / 25, atol=1e-12)


def test_xml_without_positions_is_named(read):
    with pytest.raises(SkeletonLogError, match="found XML with the keys markers, without positions in space"):
        read(landmarks_json, '<markers><marker name="elbow" colour="red"/></markers>')
