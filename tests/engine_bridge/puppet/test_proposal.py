import re

import numpy as np
import pytest

from engine_bridge.character.character import make_character
from engine_bridge.performance.rig import load_rig
from engine_bridge.puppet import puppet as puppet_file
from engine_bridge.puppet.proposal import limb_tables, new_puppet, propose_handles
from engine_bridge.puppet.puppet import CharacterTable
from puppetline.errors import MeshError, PuppetError
from solver.anatomy import orientation
from solver.anatomy.limb_chain import LimbChain, Limbs
from solver.surface.mesh import SolverMesh

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
PERSON = {
    "trunk": "direction",
    "head": "direction",
    "left arm": "direction",
    "right arm": "direction",
    "left leg": "direction",
    "right leg": "direction",
}
TURNING = dict.fromkeys(PERSON, "turn")
FOUR_LEGGED = dict.fromkeys(
    ["trunk", "head", "left front leg", "right front leg", "left hind leg", "right hind leg"], "turn"
)
TAIL, NECK, WINGS = {"tail": "turn"}, {"neck": "turn"}, {"left wing": "turn", "right wing": "turn"}
REAL = {
    "beast_32k_quads.obj": {**PERSON, "head": "turn"},
    "cheburashka.off": PERSON,
    "homer_6k.obj": PERSON,
    "human_crane_10k.obj": PERSON,
    "makehuman_base.obj": PERSON,
    "armadillo.obj": {**PERSON, **NECK, "head": "turn", **TAIL},
    "dinosaur_14k.obj": {**TURNING, **TAIL},
    "dog_10k.off": {**FOUR_LEGGED, **NECK, **TAIL},
    "cat_7k.obj": {**FOUR_LEGGED, **NECK, **TAIL},
    "spot_cow_uv.obj": {**FOUR_LEGGED, **NECK},
    "feline_winged_genus2.obj": {**FOUR_LEGGED, **NECK, **WINGS},
    "gltf/kenney/character.glb": PERSON,
    "gltf/khronos_Fox.glb": {**FOUR_LEGGED, **TAIL},
    "gltf/quaternius_Fox.glb": {**FOUR_LEGGED, **NECK, **TAIL},
    "gltf/quaternius_Stegosaurus.glb": {**FOUR_LEGGED, **NECK, **TAIL},
    "gltf/quaternius_Frog.glb": FOUR_LEGGED,
    "gltf/quaternius_Trex.glb": {**TURNING, **TAIL},
    "gltf/quaternius_George.glb": PERSON,
    "gltf/quaternius_Adventurer.glb": PERSON,
    "gltf/quaternius_Witch.glb": PERSON,
    "gltf/kaykit_Knight.glb": PERSON,
}
"""How each limb of a real character follows."""


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
    handles = propose_handles(mesh, table)
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
    handles = propose_handles(make_character("dog", shape.vertices.astype(float), shape.faces).solver_mesh(), table)
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
    handles = propose_handles(solver_mesh(WINGED), CharacterTable(mesh="a"))
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
    handles = propose_handles(solver_mesh(round_behind), CharacterTable(mesh="a"))
    expected = {name: joint for name, joint in QUADRUPED.items() if name != "tail"}
    assert {handle.name: handle.joint for handle in handles} == {**expected, "rump": None}
    np.testing.assert_allclose(places(handles)["rump"], [0, 1, -1.1], atol=0.15)


def test_ears_are_no_arms_however_long(solver_mesh):
    handles = propose_handles(solver_mesh(MOUSE), CharacterTable(mesh="a"))
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
    original = {
        (handle.name, handle.joint): handle.position for handle in propose_handles(mesh, CharacterTable(mesh="a"))
    }
    mirrored = {
        (handle.name, handle.joint): handle.position for handle in propose_handles(image, CharacterTable(mesh="a"))
    }
    assert {
        tuple(re.sub("left|right", lambda side: swapped[side[0]], text) for text in key): (-x, y, z)
        for key, (x, y, z) in original.items()
    } == mirrored


@pytest.mark.parametrize("limbs", [DOG, WINGED, MOUSE], ids=["dog", "winged", "mouse"])
@pytest.mark.parametrize(("up", "front"), [("z", "-y"), ("-x", "y"), ("-y", "-z")])
def test_a_character_that_is_turned_gets_the_same_handles_turned(solver_mesh, limbs, up, front):
    mesh, table = solver_mesh(limbs), CharacterTable(mesh="a", up=up, front=front)
    turned = SolverMesh(mesh.vertices @ table.basis, mesh.faces, mesh.of_render)
    expected = places(propose_handles(mesh, CharacterTable(mesh="a")))
    found = places(propose_handles(turned, table))
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
    handles = propose_handles(mesh, CharacterTable(mesh="a"))
    assert {handle.name: handle.joint for handle in handles} == QUADRUPED


@pytest.mark.slow
@pytest.mark.parametrize("file", REAL)
def test_real_characters_get_the_limbs_that_they_have(real_data, tmp_path, file):
    made = new_puppet(real_data / "mesh" / file, tmp_path / "a.toml").puppet
    assert {limb.name: limb.follow for limb in made.limb} == REAL[file]
    assert made.handle == ()
    basis = made.character.basis
    upright = {limb.name: np.array(limb.points) @ basis.T for limb in made.limb}
    assert_on_the_right_sides({name: points.mean(axis=0) @ basis for name, points in upright.items()}, basis)
    feet = [points[-1, 1] for name, points in upright.items() if "leg" in name]
    assert max(feet) < min(points[0, 1] for name, points in upright.items() if name != "tail")
    if "tail" in upright:
        assert upright["tail"][-1, 2] < upright["tail"][0, 2] < upright["head"][-1, 2]


ARM = tuple((f"{joint}_left",) for joint in ("shoulder", "elbow", "wrist", "hand"))
LEG = tuple((f"{joint}_left",) for joint in ("hip", "knee", "ankle", "foot"))


def chains(**named):
    points = {name.replace("_", " "): np.array(points, dtype=float) for name, points in named.items()}
    return Limbs(tuple(LimbChain(name, each) for name, each in points.items()))


UPRIGHT = {
    "trunk": [(0, 1, 0), (0, 1.2, 0), (0, 1.4, 0)],
    "head": [(0, 1.4, 0), (0, 1.7, 0)],
    "left_arm": [(0.2, 1.4, 0), (0.5, 1.4, 0), (0.8, 1.4, 0), (0.9, 1.4, 0)],
    "right_arm": [(-0.2, 1.4, 0), (-0.5, 1.4, 0), (-0.8, 1.4, 0), (-0.9, 1.4, 0)],
    "left_leg": [(0.1, 1, 0), (0.1, 0.5, 0), (0.1, 0.1, 0), (0.1, 0, 0.2)],
    "right_leg": [(-0.1, 1, 0), (-0.1, 0.5, 0), (-0.1, 0.1, 0), (-0.1, 0, 0.2)],
}


def test_a_persons_limbs_point_where_the_performers_do():
    tables = {limb.name: limb for limb in limb_tables(chains(**UPRIGHT), CharacterTable(mesh="a"))}
    assert {name: limb.follow for name, limb in tables.items()} == PERSON
    assert tables["left arm"].driven_by == ARM
    assert tables["left leg"].driven_by == LEG
    assert tables["trunk"].driven_by == (("hip_center",), ("spine",), ("shoulder_center",))
    assert tables["head"].driven_by == (("shoulder_center",), ("head",))
    assert tables["right arm"].points == tuple(map(tuple, UPRIGHT["right_arm"]))
    assert {limb.gain for limb in tables.values()} == {1.0}
    assert {limb.parent for limb in tables.values()} == {None}


@pytest.mark.parametrize(
    ("changed", "turning"),
    [
        ({"trunk": [(0, 1, -1), (0, 1.1, -0.5), (0, 1.2, 0)]}, set(PERSON)),
        ({"head": [(0, 1.4, 0), (0, 1.5, 0.3)]}, {"head"}),
        ({"left_leg": [(0.1, 1, 0), (0.1, 0.6, 0.5), (0.1, 0.1, 0), (0.1, 0, 0.2)]}, set()),
    ],
    ids=["lying", "looking forward", "crouching"],
)
def test_what_is_built_otherwise_turns(changed, turning):
    tables = limb_tables(chains(**{**UPRIGHT, **changed}), CharacterTable(mesh="a"))
    assert {limb.name for limb in tables if limb.follow == "turn"} == turning


def test_arms_drive_front_legs_and_wings_and_the_head_drives_neck_and_tail():
    limbs = chains(
        trunk=[(0, 1, -1), (0, 1, 0), (0, 1, 1)],
        neck=[(0, 1, 1), (0, 1.2, 1.2), (0, 1.4, 1.4)],
        head=[(0, 1.4, 1.4), (0, 1.4, 1.8)],
        left_front_leg=[(0.2, 1, 1), (0.2, 0.5, 1), (0.2, 0.1, 1), (0.2, 0, 1.1)],
        left_hind_leg=[(0.2, 1, -1), (0.2, 0.5, -1), (0.2, 0.1, -1), (0.2, 0, -0.9)],
        left_wing=[(0.2, 1.2, 0), (0.5, 1.5, 0), (0.8, 1.8, 0), (1, 2, 0)],
        tail=[(0, 1, -1), (0, 1, -1.2), (0, 1, -1.4), (0, 1, -1.6)],
    )
    tables = {limb.name: limb for limb in limb_tables(limbs, CharacterTable(mesh="a"))}
    assert {limb.follow for limb in tables.values()} == {"turn"}
    assert tables["left front leg"].driven_by == tables["left wing"].driven_by == ARM
    assert tables["left hind leg"].driven_by == LEG
    gains = {name: limb.gain for name, limb in tables.items() if limb.gain != 1}
    assert gains == {"neck": 0.5, "tail": -0.7, "left wing": 0.5}
    assert {name: limb.parent for name, limb in tables.items() if limb.parent} == {"head": "neck"}
    assert tables["neck"].driven_by == (("shoulder_center",), ("shoulder_center", "head"), ("head",))
    assert tables["tail"].driven_by == (("hip_center",), ("shoulder_center",), ("shoulder_center", "head"), ("head",))


def test_a_trunk_and_a_head_alone_are_no_limbs():
    alone = chains(trunk=UPRIGHT["trunk"], head=UPRIGHT["head"])
    assert limb_tables(alone, CharacterTable(mesh="a")) == []


def test_what_has_no_limbs_gets_handles(make_shape, tmp_path):
    ball = make_shape([((0.0, 0.0, 0.0), (0.0, 1e-6, 0.0), 1.0)], 0.2)
    make_character("ball", ball.vertices.astype(float), ball.faces).document.save(tmp_path / "ball.glb")
    made = new_puppet(tmp_path / "ball.glb", tmp_path / "a.toml")
    assert made.puppet.limb == ()
    assert {"head", "base"} <= {handle.name for handle in made.puppet.handle}
    assert [note.split(".")[0] for note in made.notes] == ["No legs were found", "No arms were found"]


def test_handles_can_be_had_instead_of_limbs(blob_file, tmp_path):
    made = new_puppet(blob_file, tmp_path / "a.toml", limbs=False).puppet
    assert made.limb == ()
    assert {handle.name: handle.joint for handle in made.handle} == HUMANOID


def test_the_user_says_where_limbs_end(blob_file, tmp_path):
    ends = {"left arm": "-1.5,1.2,-0.05", "right arm": "1.55,1.32,0.1"}  # crossed, for once
    made = new_puppet(blob_file, tmp_path / "a.toml", up="y", front="z", ends=ends).puppet
    points = {limb.name: limb.points for limb in made.limb}
    np.testing.assert_allclose(points["left arm"][-1], (-1.5, 1.2, -0.05), atol=0.15)
    np.testing.assert_allclose(points["right arm"][-1], (1.55, 1.32, 0.1), atol=0.15)


def test_what_has_no_feet_gets_a_base_that_stays(solver_mesh):
    ball = propose_handles(solver_mesh([((0.0, 0.0, 0.0), (0.0, 1e-6, 0.0), 1.0)], 0.2), CharacterTable(mesh="a"))
    np.testing.assert_allclose([np.linalg.norm(handle.position) for handle in ball], 1, atol=0.05)
    snowman = propose_handles(
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


def test_a_map_changes_a_proposed_limb_and_leaves_the_others(blob_file, tmp_path):
    made = new_puppet(blob_file, tmp_path / "a.toml", up="y", front="z", maps={"head": "hand_left,hand_right"}).puppet
    assert {limb.name: limb.driven_by for limb in made.limb} == {
        "trunk": (("hip_center",), ("spine",), ("shoulder_center",)),
        "head": (("hand_left",), ("hand_right",)),
        "left arm": ARM,
        "left leg": LEG,
        **{
            f"right {limb}": tuple((joints[0].replace("left", "right"),) for joints in chain)
            for limb, chain in (("arm", ARM), ("leg", LEG))
        },
    }


def test_what_is_proposed_loads_and_lies_on_the_mesh(blob_file, tmp_path):
    path = tmp_path / "made.toml"
    made = new_puppet(blob_file, path).puppet
    puppet_file.dump(made, path)
    rig = load_rig(path)
    assert rig.puppet == made
    assert len(made.limb) == 6
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
            "no limb 'nose'",
            "Name one of these limbs, or add it with --handle.",
        ),
        (
            {"crown": "0,2.1,0.3"},
            {"crown": "heat"},
            "the command line, [[handle]] 1 'crown', joint",
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


@pytest.mark.parametrize(
    ("ends", "where", "found", "fix"),
    [
        ({"paw": "1,2,3"}, "--limb paw=1,2,3", "'paw'", "Correct the name of the limb."),
        ({"head": "1,2"}, "--limb head=1,2", "'1,2'", "Write it like --limb head=0.1,1.5,0.2"),
        (
            {"left arm": "1,2,3"},
            "--limb left arm=1,2,3",
            "no --limb for the right arm",
            "Add --limb 'right arm=X,Y,Z'.",
        ),
    ],
)
def test_a_mistake_in_where_a_limb_ends_is_named(blob_file, tmp_path, ends, where, found, fix):
    with pytest.raises(PuppetError) as error:
        new_puppet(blob_file, tmp_path / "a.toml", ends=ends)
    assert (error.value.where, error.value.found, error.value.fix) == (f"the command line, {where}", found, fix)


def test_a_handle_off_the_mesh_and_a_mesh_that_is_not_there_are_refused(blob_file, tmp_path):
    with pytest.raises(PuppetError, match="away from the surface"):
        new_puppet(blob_file, tmp_path / "a.toml", handles={"far": "30,0,0"})
    with pytest.raises(MeshError, match="no such file"):
        new_puppet(tmp_path / "none.glb", tmp_path / "a.toml")
    with pytest.raises(PuppetError, match="up and front along different axes"):
        new_puppet(blob_file, tmp_path / "a.toml", up="z", front="-z")
