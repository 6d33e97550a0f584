import numpy as np
import pytest

from engine_bridge.character.character import make_character
from engine_bridge.pictures import puppet_diagram
from engine_bridge.pictures.view import View, project
from engine_bridge.puppet.puppet import CharacterTable, HandleTable, Puppet

SIZE = (420, 280)


@pytest.fixture
def pictures(monkeypatch):
    """The views that are drawn, at a small size."""
    seen = []
    monkeypatch.setattr(puppet_diagram, "SIZE", SIZE)
    monkeypatch.setattr(puppet_diagram, "write_contact_sheet", lambda images, *_rest: seen.extend(images))
    return seen


HANDLES = [
    ("head", (0.0, 2.1, 0.3), "head"),
    ("left hand", (1.55, 1.32, 0.1), "hand_left"),
    ("base", (0, -0.3, 0), None),
]


@pytest.mark.parametrize(("up", "front"), [("y", "z"), ("z", "-y")])
def test_each_handle_is_a_disc_of_its_colour_at_its_position(blob, pictures, tmp_path, up, front):
    table = CharacterTable(mesh="blob", up=up, front=front)
    handles = [
        HandleTable(name=name, position=tuple((np.array(place) @ table.basis).tolist()), joint=joint)
        for name, place, joint in HANDLES
    ]
    vertices = blob.vertices.astype(float)
    character = make_character("blob", vertices @ table.basis, blob.faces)
    puppet_diagram.draw(Puppet(character=table, handle=handles), character, tmp_path / "a.png", "blob")
    assert len(pictures) == len(puppet_diagram.VIEWS) == 2
    for picture, angles in zip(pictures, puppet_diagram.VIEWS.values(), strict=True):
        dots = project(np.array([place for _, place, _ in HANDLES]), View.around(np.float32(vertices), *angles), SIZE)
        for index, (x, y, _) in enumerate(dots):
            assert np.abs(picture[round(y), round(x)] - puppet_diagram._color(index, 3)).max() <= 3


def test_labels_do_not_overlap_and_are_inside():
    heights = np.array([100.0, 101, 102, 103, 540, 545, 550])
    placed = np.array(puppet_diagram._apart(heights))
    assert (np.diff(placed) >= puppet_diagram.LABEL_HEIGHT - 1e-9).all()
    assert placed.min() >= puppet_diagram.LABEL_HEIGHT / 2
    assert placed.max() <= puppet_diagram.SIZE[1] - puppet_diagram.LABEL_HEIGHT / 2
    np.testing.assert_array_equal(puppet_diagram._apart(np.array([100.0, 300.0])), [100, 300])
