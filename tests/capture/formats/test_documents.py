"""Nested text of any kind becomes one kind of document."""

import re

import numpy as np
import pytest

from capture.formats import landmarks_json, read_log
from capture.formats._documents import is_document, load
from capture.skeleton import JOINT_INDEX, JOINTS, PARENTS
from puppetline.errors import SkeletonLogError

from .people import person

XML = """<?xml version="1.0"?>
<session rate="30"><frame at="0.5"><joint name="head">1 2</joint><joint name="hip"><x>-1e-3</x></joint><empty/></frame>
<frame at="0.6">text</frame></session>"""

POSES = person(5)


def content(tmp_path, text):
    path = tmp_path / "take"
    path.write_text(text)
    assert is_document(text.encode())
    return load(path)


def test_elements_are_dictionaries_of_attributes_and_children(tmp_path):
    frames = [{"at": 0.5, "joint": [{"name": "head"}, {"name": "hip", "x": -0.001}], "empty": ""}, {"at": 0.6}]
    assert content(tmp_path, XML) == {"session": {"rate": 30.0, "frame": frames}}


def test_lists_of_pairs_are_dictionaries(tmp_path):
    found = content(tmp_path, '0 12.5 async ((a (1 2.5 -3)) (b ((c "two words") (d e))))\n1 (x y)\n')
    assert found == [{"time": 12.5, "a": [1.0, 2.5, -3.0], "b": {"c": "two words", "d": "e"}}, [1.0, ["x", "y"]]]


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("<a><b></a>", "XML that cannot be read (mismatched tag"),
        ('<!DOCTYPE a [<!ENTITY b "b">]><a>&b;</a>', "a document type"),
        ("<a>" * 300, "more than 200 levels"),
        ("(a (b c)", None),
        ("((a (b c)))) d", "brackets that do not match"),
        ("(a " * 300 + ")" * 300, "brackets that do not match, or are too deep"),
    ],
)
def test_damaged_documents_are_errors(tmp_path, text, found):
    path = tmp_path / "take"
    path.write_text(text)
    if found is None:  # a line that ends early has what is whole
        assert load(path) == [[]]
        return
    with pytest.raises(SkeletonLogError, match=re.escape(found)):
        load(path)


def nested(joint, pose):
    """Return a joint, with those that hang on it, as YARP writes it."""
    children = " ".join(nested(child, pose) for child, parent in PARENTS.items() if parent == joint)
    place = " ".join(map(repr, pose[JOINT_INDEX[joint]].tolist()))
    return f"((child ({children})) (position ({place})) (status updated) (tag {joint}))"


FORMS = {
    "elements with attributes": lambda k, pose: (
        f'<frame time="{k / 25}">'
        + "".join(
            f'<Joint Type="{name}" X="{x!r}" Y="{y!r}" Z="{z!r}"/>'
            for name, (x, y, z) in zip(JOINTS, pose.tolist(), strict=True)
        )
        + "</frame>"
    ),
    "elements named like joints": lambda k, pose: (
        f"<Skeleton><time>{k / 25}</time>"
        + "".join(
            f"<{name}><angles><Qx>1</Qx></angles><positions><x>{x!r}</x><y>{y!r}</y><z>{z!r}</z></positions></{name}>"
            for name, (x, y, z) in zip(JOINTS, pose.tolist(), strict=True)
        )
        + "</Skeleton>"
    ),
    "lists": lambda k, pose: f"{k} {k / 25} async ((skeleton ({nested('hip_center', pose)})) (tag one))",
}


@pytest.mark.parametrize("form", FORMS)
def test_joints_are_found_at_any_depth(tmp_path, form):
    text = "\n".join(FORMS[form](k, pose) for k, pose in enumerate(POSES)) + "\n"
    path = tmp_path / "take"
    path.write_text(text if form == "lists" else f"<recording>{text}</recording>")
    assert landmarks_json.matches(path.read_bytes())
    [clip] = read_log(path)
    np.testing.assert_allclose(clip.positions, POSES, atol=1e-12)
    np.testing.assert_allclose(np.diff(clip.times), 1 / 25)


def test_xml_without_positions_is_named(tmp_path):
    path = tmp_path / "take"
    path.write_text('<markers><marker name="elbow" colour="red"/></markers>')
    with pytest.raises(SkeletonLogError, match="found XML with the keys markers, without positions in space"):
        read_log(path)
