import re

import numpy as np
import pytest

from engine_bridge import puppet as puppet_file
from engine_bridge.gltf.character import make_character
from engine_bridge.proposal import new_puppet, propose
from engine_bridge.puppet import CharacterTable
from engine_bridge.rig import load_rig
from puppetline.errors import MeshError, PuppetError
from solver import orientation
from solver.mesh import SolverMesh

HUMANOID = {
    "head": "head",
    "left hand": "hand_left",
    "right hand": "hand_right",
    "left foot": "foot_left",
    "right foot": "foot_right",
}
QUADRUPED = {
    "head": "head",
    "left hind foot": "foot_left",
    "right hind foot": "foot_right",
    "left front foot": "hand_left",
    "right front foot": "hand_right",
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
WINGED = [*DOG, ((0.1, 1.2, 0.4), (1.3, 2.4, 0.3), 0.12), ((-0.1, 1.2, 0.4), (-1.3, 2.4, 0.3), 0.12)]
MOUSE = [
    ((0.0, 0.9, 0.0), (0.0, 1.4, 0.0), 0.35),
    ((0.0, 2.2, 0.0), (0.0, 2.3, 0.0), 0.45),
    ((0.3, 2.4, 0.0), (0.95, 3.0, 0.0), 0.16),
    ((-0.3, 2.4, 0.0), (-0.95, 3.0, 0.0), 0.16),
    ((0.2, 1.4, 0.0), (1.1, 1.0, 0.1), 0.14),
    ((-0.2, 1.4, 0.0), (-1.1, 1.0, 0.1), 0.14),
    ((0.2, 0.9, 0.0), (0.35, -0.2, 0.1), 0.16),
    ((-0.2, 0.9, 0.0), (-0.35, -0.2, 0.1), 0.16),
    ((0.0, 0.8, -0.1), (0.0, 0.6, -1.6), 0.12),
]
"""Ears as long as its arms, and a tail."""
REAL = {
    "armadillo.obj": {**HUMANOID, "tail": "head"},
    "beast_32k_quads.obj": HUMANOID,
    "cheburashka.off": HUMANOID,
    "dinosaur_14k.obj": {**HUMANOID, "tail": "head"},
    "makehuman_base.obj": HUMANOID,
    "dog_10k.off": QUADRUPED,
    "cat_7k.obj": QUADRUPED,
    "spot_cow_uv.obj": QUADRUPED,
    "gltf/khronos_Fox.glb": QUADRUPED,
    "gltf/quaternius_Stegosaurus.glb": QUADRUPED,
    "gltf/quaternius_Frog.glb": {**{name: joint for name, joint in QUADRUPED.items() if name != "tail"}, "rump": None},
    "gltf/quaternius_Trex.glb": {**HUMANOID, "tail": "head"},
    "gltf/quaternius_George.glb": HUMANOID,
    "gltf/quaternius_Adventurer.glb": HUMANOID,
    "gltf/kaykit_Knight.glb": HUMANOID,
}


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
    assert upright["left hand"][0] > 1.3
    assert upright["right hand"][0] < -1.3
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
    assert min(named[f"{side} front foot"][2] for side in ("left", "right")) > 0.5
    assert max(named[f"{side} hind foot"][2] for side in ("left", "right")) < -0.5
    assert {handle.name: handle.gain for handle in handles}["tail"] == -0.7


@pytest.fixture
def solver_mesh(make_shape):
    def make(limbs, step=0.09):
        shape = make_shape(limbs, step)
        return make_character("made", shape.vertices.astype(float), shape.faces).solver_mesh()

    return make


def test_wings_follow_the_elbows(solver_mesh):
    handles = propose(solver_mesh(WINGED), CharacterTable(mesh="a"))
    assert {handle.name: handle.joint for handle in handles} == {
        **QUADRUPED,
        "left wing": "elbow_left",
        "right wing": "elbow_right",
    }
    named = places(handles)
    assert_on_the_right_sides(named, np.eye(3))
    assert min(named["left wing"][1], named["right wing"][1]) > 2.3


def test_without_a_tail_the_rump_is_held(solver_mesh):
    round_behind = [((0.0, 1.0, -0.8), (0.0, 1.0, 1.0), 0.30), *DOG[1:-1]]
    handles = propose(solver_mesh(round_behind), CharacterTable(mesh="a"))
    expected = {name: joint for name, joint in QUADRUPED.items() if name != "tail"}
    assert {handle.name: handle.joint for handle in handles} == {**expected, "rump": None}
    np.testing.assert_allclose(places(handles)["rump"], [0, 1, -1.1], atol=0.15)


def test_ears_are_no_arms_however_long(solver_mesh):
    handles = propose(solver_mesh(MOUSE), CharacterTable(mesh="a"))
    assert {handle.name: handle.joint for handle in handles} == {**HUMANOID, "tail": "head"}
    named = places(handles)
    assert max(named["left hand"][1], named["right hand"][1]) < 1.3
    assert abs(named["head"][0]) < 0.2
    assert named["tail"][2] < -1.5


@pytest.mark.parametrize("limbs", [DOG, WINGED, MOUSE], ids=["dog", "winged", "mouse"])
def test_in_the_mirror_image_left_and_right_are_swapped_exactly(solver_mesh, limbs):
    mesh = solver_mesh(limbs)
    image = SolverMesh(mesh.vertices * [-1, 1, 1], mesh.faces[:, ::-1], mesh.of_render)
    swapped = {"left": "right", "right": "left"}
    original = {(handle.name, handle.joint): handle.position for handle in propose(mesh, CharacterTable(mesh="a"))}
    mirrored = {(handle.name, handle.joint): handle.position for handle in propose(image, CharacterTable(mesh="a"))}
    assert {
        tuple(re.sub("left|right", lambda side: swapped[side[0]], text) for text in key): (-x, y, z)
        for key, (x, y, z) in original.items()
    } == mirrored


@pytest.mark.parametrize("limbs", [DOG, WINGED, MOUSE], ids=["dog", "winged", "mouse"])
@pytest.mark.parametrize(("up", "front"), [("z", "-y"), ("-x", "y"), ("-y", "-z")])
def test_a_character_that_is_turned_gets_the_same_handles_turned(solver_mesh, limbs, up, front):
    mesh, table = solver_mesh(limbs), CharacterTable(mesh="a", up=up, front=front)
    turned = SolverMesh(mesh.vertices @ table.basis, mesh.faces, mesh.of_render)
    expected = places(propose(mesh, CharacterTable(mesh="a")))
    found = places(propose(turned, table))
    assert list(found) == list(expected)
    for name, place in expected.items():
        np.testing.assert_allclose(found[name], place @ table.basis, atol=1e-5)


def test_parts_of_their_own_are_limbs_as_well(make_shape):
    """The dog cut into a body, a head, a tail and four legs that do not touch it."""
    pieces = [make_shape([limb], 0.06) for limb in ([*DOG[:1], *DOG[3:]])]
    shrunk = [piece.vertices * 1.0 for piece in pieces]
    shrunk.append(make_shape(DOG[1:3], 0.06).vertices)
    pieces.append(make_shape(DOG[1:3], 0.06))
    starts = np.cumsum([0, *map(len, shrunk)])
    faces = np.concatenate([piece.faces + start for piece, start in zip(pieces, starts, strict=False)])
    mesh = make_character("dog", np.concatenate(shrunk).astype(float), faces).solver_mesh()
    assert mesh.components.max() == 6
    handles = propose(mesh, CharacterTable(mesh="a"))
    assert {handle.name: handle.joint for handle in handles} == QUADRUPED


@pytest.mark.slow
@pytest.mark.parametrize("file", REAL)
def test_real_characters_get_the_handles_that_they_need(real_data, tmp_path, file):
    made = new_puppet(real_data / "mesh" / file, tmp_path / "a.toml").puppet
    assert {handle.name: handle.joint for handle in made.handle} == REAL[file]
    basis = made.character.basis
    named = places(made.handle)
    assert_on_the_right_sides(named, basis)
    upright = {name: place @ basis.T for name, place in named.items()}
    if "tail" in upright:
        assert upright["tail"][2] < upright["head"][2]
    feet = [place[1] for name, place in upright.items() if "foot" in name]
    others = [place[1] for name, place in upright.items() if "foot" not in name and name != "tail"]
    assert max(feet) < min(others)


def test_what_has_no_feet_gets_a_base_that_stays(solver_mesh):
    ball = propose(solver_mesh([((0.0, 0.0, 0.0), (0.0, 1e-6, 0.0), 1.0)], 0.2), CharacterTable(mesh="a"))
    np.testing.assert_allclose([np.linalg.norm(handle.position) for handle in ball], 1, atol=0.05)
    snowman = propose(
        solver_mesh([((0.0, 0.0, 0.0), (0.0, 0.1, 0.0), 1.0), ((0.0, 1.5, 0.0), (0.0, 1.6, 0.0), 0.6), *MOUSE[4:6]]),
        CharacterTable(mesh="a"),
    )
    hands = {"left hand": "hand_left", "right hand": "hand_right"}
    assert {handle.name: handle.joint for handle in snowman} == {"head": "head", **hands, "base": None}
    for handles in (ball, snowman):
        assert places(handles)["base"][1] < -0.9
        assert places(handles)["head"][1] > 0.5


def test_handles_and_maps_of_ones_own_take_the_place_of_those_proposed(blob_file, tmp_path):
    made = new_puppet(
        blob_file,
        tmp_path / "sub" / "made.toml",
        handles={"crown": "0,2.1,0.3", "paw": "1.5,1.3,0.1", "still": "0, -0.3, 0"},
        maps={"crown": "head", "paw": "hand_left,wrist_left"},
        mirror=True,
    ).puppet
    assert [(handle.name, handle.position, handle.driven_by) for handle in made.handle] == [
        ("crown", (0, 2.1, 0.3), ("head",)),
        ("paw", (1.5, 1.3, 0.1), ("hand_left", "wrist_left")),
        ("still", (0, -0.3, 0), ()),
    ]
    assert made.retarget.mirror
    assert (made.root.joint, made.root.axes) == ("hip_center", "xz")
    assert (tmp_path / "sub" / made.character.mesh).resolve() == blob_file.resolve()


def test_a_map_changes_a_proposed_handle_and_leaves_the_others(blob_file, tmp_path):
    made = new_puppet(blob_file, tmp_path / "a.toml", up="y", front="z", maps={"head": "hand_left,hand_right"}).puppet
    assert {handle.name: handle.driven_by for handle in made.handle} == {
        **{name: (joint,) for name, joint in HUMANOID.items()},
        "head": ("hand_left", "hand_right"),
    }


def test_what_is_proposed_loads_and_lies_on_the_mesh(blob_file, tmp_path):
    path = tmp_path / "made.toml"
    puppet_file.dump(new_puppet(blob_file, path).puppet, path)
    rig = load_rig(path)
    for handle in rig.puppet.handle:
        assert np.linalg.norm(rig.mesh.vertices - handle.position, axis=1).min() < 1e-5


def test_how_it_stands_is_proposed_by_its_shape_and_said(blob_file, tmp_path):
    made = new_puppet(blob_file, tmp_path / "a.toml")
    stands = orientation.propose(made.character.solver_mesh())
    table = made.puppet.character
    assert (table.up, table.front, table.scale) == (stands.up, stands.front, stands.scale) == ("y", table.front, 1.0)
    assert made.assumed == stands.reasons


def test_what_is_given_is_neither_proposed_nor_said(blob_file, tmp_path):
    made = new_puppet(blob_file, tmp_path / "a.toml", up="z", scale=0.01)
    assert (made.puppet.character.up, made.puppet.character.scale) == ("z", 0.01)
    assert len(made.assumed) == 1
    assert "front" in made.assumed[0]
    assert new_puppet(blob_file, tmp_path / "a.toml", up="z", front="x", scale=2.0).assumed == ()


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
        new_puppet(blob_file, tmp_path / "a.toml", handles={"far": "30,0,0"})
    with pytest.raises(MeshError, match="no such file"):
        new_puppet(tmp_path / "none.glb", tmp_path / "a.toml")
    with pytest.raises(PuppetError, match="up and front along different axes"):
        new_puppet(blob_file, tmp_path / "a.toml", up="z", front="-z")
