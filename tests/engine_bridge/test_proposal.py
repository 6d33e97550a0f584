import numpy as np
import pytest

from engine_bridge import puppet as puppet_file
from engine_bridge.convert import load_rig
from engine_bridge.gltf.character import load_character, make_character
from engine_bridge.proposal import new_puppet, propose
from engine_bridge.puppet import CharacterTable
from puppetline.errors import MeshError, PuppetError

HUMANOID = {
    "head": "head",
    "left arm": "hand_left",
    "right arm": "hand_right",
    "left foot": "foot_left",
    "right foot": "foot_right",
}
QUADRUPED = {
    "head": "head",
    "left hind foot": "foot_left",
    "right hind foot": "foot_right",
    "left forefoot": "hand_left",
    "right forefoot": "hand_right",
    "tail": "head",
}
DOG = [
    ((0.0, 1.0, -1.0), (0.0, 1.0, 1.0), 0.30),
    ((0.0, 1.0, 1.0), (0.0, 1.7, 1.5), 0.20),
    ((0.0, 1.7, 1.5), (0.0, 1.65, 1.8), 0.16),
    ((0.1, 1.0, 0.9), (0.3, -0.2, 1.0), 0.15),
    ((-0.1, 1.0, 0.9), (-0.3, -0.2, 0.95), 0.15),
    ((0.1, 1.0, -0.9), (0.3, -0.2, -0.9), 0.15),
    ((-0.1, 1.0, -0.9), (-0.3, -0.2, -0.95), 0.15),
    ((0.0, 1.0, -1.0), (0.0, 1.5, -1.9), 0.12),
]


def places(handles):
    return {handle.name: np.array(handle.position) for handle in handles}


def assert_on_the_right_sides(named, basis):
    for name, place in named.items():
        if name.startswith(("left", "right")):
            other = named[name.replace("left", "right") if name.startswith("left") else name.replace("right", "left")]
            assert ((place - other) @ basis[0] > 0) == name.startswith("left")


@pytest.mark.parametrize(("up", "front"), [("y", "z"), ("z", "-y"), ("x", "y")])
def test_a_figure_gets_head_hands_and_feet_on_its_own_sides(blob, up, front):
    table = CharacterTable(mesh="blob.glb", up=up, front=front)
    mesh = make_character("blob", blob.vertices.astype(float) @ table.basis, blob.faces).solver_mesh()
    handles = propose(mesh, table)
    assert {handle.name: handle.joint for handle in handles} == HUMANOID
    assert {handle.gain for handle in handles} == {1.0}
    named = places(handles)
    assert_on_the_right_sides(named, table.basis)
    upright = {name: place @ table.basis.T for name, place in named.items()}
    assert upright["left arm"][0] > 1.3
    assert upright["right arm"][0] < -1.3
    assert upright["head"][1] > 1.8
    assert max(upright["left foot"][1], upright["right foot"][1]) < -1.4


def test_a_quadruped_gets_four_feet_a_head_and_a_tail_that_swings_against_it(make_shape):
    shape = make_shape(DOG, 0.09)
    table = CharacterTable(mesh="dog.glb")
    handles = propose(make_character("dog", shape.vertices.astype(float), shape.faces).solver_mesh(), table)
    assert {handle.name: handle.joint for handle in handles} == QUADRUPED
    named = places(handles)
    assert_on_the_right_sides(named, table.basis)
    assert named["head"][2] > 1.7
    assert named["tail"][2] < -1.8
    assert min(named[f"{side} forefoot"][2] for side in ("left", "right")) > 0.5
    assert max(named[f"{side} hind foot"][2] for side in ("left", "right")) < -0.5
    assert {handle.name: handle.gain for handle in handles}["tail"] == -0.7


@pytest.mark.slow
def test_the_armadillo_and_the_dinosaur_get_the_handles_that_they_need(real_data):
    upright = CharacterTable(mesh="armadillo.obj")
    handles = propose(load_character(real_data / "mesh" / "armadillo.obj").solver_mesh(), upright)
    assert {handle.name: handle.joint for handle in handles} == {**HUMANOID, "tail": "head"}
    named = places(handles)
    assert_on_the_right_sides(named, upright.basis)
    assert named["tail"][2] < named["left foot"][2] < named["head"][2]

    facing_left = CharacterTable(mesh="dinosaur.obj", front="-x")
    handles = propose(load_character(real_data / "mesh" / "dinosaur_14k.obj").solver_mesh(), facing_left)
    assert {handle.name: handle.joint for handle in handles} == {**HUMANOID, "tail": "head"}
    named = places(handles)
    assert_on_the_right_sides(named, facing_left.basis)
    assert named["head"][0] < named["left foot"][0] < named["tail"][0]


def test_what_is_proposed_for_a_ball_lies_on_it_at_least(make_shape):
    shape = make_shape([((0.0, 0.0, 0.0), (0.0, 1e-6, 0.0), 1.0)], 0.2)
    mesh = make_character("ball", shape.vertices.astype(float), shape.faces).solver_mesh()
    handles = propose(mesh, CharacterTable(mesh="ball.glb"))
    assert handles
    np.testing.assert_allclose([np.linalg.norm(handle.position) for handle in handles], 1, atol=0.05)


def test_handles_and_maps_of_ones_own_take_the_place_of_those_proposed(blob_file, tmp_path):
    made = new_puppet(
        blob_file,
        tmp_path / "sub" / "made.toml",
        handles={"crown": "0,2.1,0.3", "paw": "1.5,1.3,0.1", "still": "0, -0.3, 0"},
        maps={"crown": "head", "paw": "hand_left,wrist_left"},
        mirror=True,
    )
    assert [(handle.name, handle.position, handle.driven_by) for handle in made.handle] == [
        ("crown", (0, 2.1, 0.3), ("head",)),
        ("paw", (1.5, 1.3, 0.1), ("hand_left", "wrist_left")),
        ("still", (0, -0.3, 0), ()),
    ]
    assert made.retarget.mirror
    assert (made.root.joint, made.root.axes) == ("hip_center", "xz")
    assert (tmp_path / "sub" / made.character.mesh).resolve() == blob_file.resolve()


def test_a_map_changes_a_proposed_handle_and_leaves_the_others(blob_file, tmp_path):
    made = new_puppet(blob_file, tmp_path / "a.toml", handles={}, maps={"head": "hand_left,hand_right"})
    assert {handle.name: handle.driven_by for handle in made.handle} == {
        **{name: (joint,) for name, joint in HUMANOID.items()},
        "head": ("hand_left", "hand_right"),
    }


def test_what_is_proposed_loads_and_lies_on_the_mesh(blob_file, tmp_path):
    path = tmp_path / "made.toml"
    puppet_file.dump(new_puppet(blob_file, path, handles={}, maps={}), path)
    rig = load_rig(path)
    for handle in rig.puppet.handle:
        assert np.linalg.norm(rig.mesh.vertices - handle.position, axis=1).min() < 1e-5


@pytest.mark.parametrize(
    ("handles", "maps", "where", "found", "fix"),
    [
        (
            {"paw": "1,2"},
            {},
            "the command line, --handle paw=1,2",
            "'1,2'",
            "Write it like --handle paw=0.1,1.5,0.2",
        ),
        (
            {"paw": "1,b,3"},
            {},
            "the command line, --handle paw=1,b,3",
            "'1,b,3'",
            "Write it like --handle paw=0.1,1.5,0.2",
        ),
        (
            {},
            {"nose": "head"},
            "the command line, --map nose=head",
            "no handle 'nose'",
            "Name one of these handles, or add it with --handle.",
        ),
        (
            {},
            {"head": "heat"},
            "the command line, [[handle]] 1 'head', joint",
            "'heat'",
            "Did you mean 'head'?",
        ),
        (
            {"paw": "1,nan,3"},
            {},
            "the command line, [[handle]] 1 'paw', position, 2",
            "nan",
            "Change the value of that key.",
        ),
    ],
)
def test_a_mistake_on_the_command_line_is_named(blob_file, tmp_path, handles, maps, where, found, fix):
    with pytest.raises(PuppetError) as error:
        new_puppet(blob_file, tmp_path / "a.toml", handles=handles, maps=maps)
    assert (error.value.where, error.value.found, error.value.fix) == (where, found, fix)


def test_a_handle_off_the_mesh_and_a_mesh_that_is_not_there_are_refused(blob_file, tmp_path):
    with pytest.raises(PuppetError, match="away from the surface"):
        new_puppet(blob_file, tmp_path / "a.toml", handles={"far": "30,0,0"}, maps={})
    with pytest.raises(MeshError, match="no such file"):
        new_puppet(tmp_path / "none.glb", tmp_path / "a.toml", handles={}, maps={})
    with pytest.raises(PuppetError, match="up and front along different axes"):
        new_puppet(blob_file, tmp_path / "a.toml", handles={}, maps={}, up="z")
