from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose

from engine_bridge.character.character import load_character, make_character
from engine_bridge.puppet import proposal
from engine_bridge.puppet.proposal import new_puppet
from engine_bridge.puppet.size import propose_scale
from puppetline.errors import PuppetError
from solver.anatomy import orientation, standing
from solver.anatomy.limb_chain import LimbChain, Limbs

from ..bones import points
from ..refusals import refused

PERSON = dict.fromkeys(["trunk", "head", "left arm", "right arm", "left leg", "right leg"], "direction")
TURNING = dict.fromkeys(PERSON, "turn")
FOUR_LEGGED = dict.fromkeys(
    ["trunk", "head", "left front leg", "right front leg", "left hind leg", "right hind leg"], "turn"
)
TAIL, NECK, WINGS = {"tail": "turn"}, {"neck": "turn"}, {"left wing": "turn", "right wing": "turn"}
EARS = {"left ear": "turn", "right ear": "turn"}
REAL = {
    "beast_32k_quads.obj": {**PERSON, "head": "turn"},
    "cheburashka.off": PERSON,
    "homer_6k.obj": PERSON,
    "human_crane_10k.obj": PERSON,
    "makehuman_base.obj": PERSON,
    "armadillo.obj": {**PERSON, **NECK, "head": "turn", **TAIL},
    "dinosaur_14k.obj": {**TURNING, **TAIL},
    "dog_10k.off": {**FOUR_LEGGED, **NECK, **TAIL},
    "cat_7k.obj": {**FOUR_LEGGED, **TAIL},  # the neck belongs to the head
    "spot_cow_uv.obj": FOUR_LEGGED,
    "feline_winged_genus2.obj": {**FOUR_LEGGED, **NECK, **WINGS, **TAIL},
    "gltf/kenney/character.glb": PERSON,
    "gltf/khronos_Fox.glb": {**FOUR_LEGGED, **TAIL},
    "gltf/quaternius_Fox.glb": {**FOUR_LEGGED, **NECK, **EARS, **TAIL},
    "gltf/quaternius_Stegosaurus.glb": {**FOUR_LEGGED, **NECK, **TAIL},
    "gltf/quaternius_Frog.glb": FOUR_LEGGED,
    "gltf/quaternius_Trex.glb": {**TURNING, **TAIL},
    "gltf/quaternius_George.glb": PERSON,
    "gltf/quaternius_Adventurer.glb": PERSON,
    "gltf/quaternius_Witch.glb": PERSON,
    "gltf/kaykit_Knight.glb": PERSON,
}
"""Expected way in which each limb of a real character follows."""


def assert_on_the_right_sides(named, basis):
    for name, place in named.items():
        if name.startswith(("left", "right")):
            other = named[name.replace("left", "right") if name.startswith("left") else name.replace("right", "left")]
            assert ((place - other) @ basis[0] > 0) == name.startswith("left")


MISREAD = {
    "armadillo.obj": "tail and neck are not found",
    "dinosaur_14k.obj": "the tail is not found",
    "feline_winged_genus2.obj": "a wing is taken for an arm",
}


@pytest.mark.slow
@pytest.mark.parametrize(
    "file",
    [
        pytest.param(file, marks=[pytest.mark.xfail(strict=True, reason=MISREAD[file])] if file in MISREAD else [])
        for file in REAL
    ],
)
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


@pytest.fixture
def propose(blob_file, tmp_path):
    """Propose a puppet for the figure with its up and front, if no others are given."""
    return partial(new_puppet, blob_file, tmp_path / "a.toml", up="y", front="z")


@pytest.fixture
def found(blob_file):
    """The limbs that are found in the figure."""
    return proposal.find_limbs(load_character(blob_file).solver_mesh(), np.eye(3))


@pytest.fixture
def find(monkeypatch):
    """Have other limbs found."""
    return lambda limbs: monkeypatch.setattr(proposal, "find_limbs", lambda *_: limbs)


def test_a_mesh_without_limbs_gets_handles(make_shape, tmp_path):
    ball = make_shape([((0.0, 0.0, 0.0), (0.0, 1e-6, 0.0), 1.0)], 0.2)
    make_character("ball", ball.vertices.astype(float), ball.faces).document.save(tmp_path / "ball.glb")
    made = new_puppet(tmp_path / "ball.glb", tmp_path / "a.toml", up="y", front="z")
    assert made.puppet.limb == ()
    assert [handle.name for handle in made.puppet.handle] == ["head", "left hand", "right hand", "base"]
    assert [note.split(".")[0] for note in made.notes[:2]] == ["No legs were found", "No arms were found"]
    assert "it is a person" in made.notes[2]


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        ("jawOpen cheekPuff eyeBlinkLeft mouthSmileLeft", "voice jawOpen, mouth_open jawOpen, blink_left eyeBlinkLeft"),
        ("A Blink browInnerUp", "voice A, mouth_open A, blink_left Blink, blink_right Blink, brow_up browInnerUp"),
        ("mouthSmileLeft mouthSmileRight EE", "mouth_wide EE, smile mouthSmileLeft, smile mouthSmileRight"),
    ],
)
def test_targets_that_the_mesh_has_follow_the_channels_of_their_usual_names(glb, blob, tmp_path, names, expected):
    names, target = names.split(), {"POSITION": np.zeros_like(blob.vertices)}
    targets = [target] * len(names)
    made = glb.primitive(blob.vertices, blob.faces, NORMAL=blob.normals, targets=targets)
    glb.node(glb.mesh(made, extras={"targetNames": names}))
    glb.save(tmp_path / "face.glb")
    puppet = new_puppet(tmp_path / "face.glb", tmp_path / "face.toml").puppet
    assert ", ".join(f"{morph.channel} {morph.target}" for morph in puppet.morph) == expected


def test_the_user_says_where_limbs_end(propose):
    ends = {"left arm": "-1.5,1.2,-0.05", "right arm": "1.55,1.32,0.1"}  # crossed
    made = propose(ends=ends).puppet
    tips = {limb.name: limb.points[-1] for limb in made.limb}
    assert_allclose(tips["left arm"], (-1.5, 1.2, -0.05), atol=0.15)
    assert_allclose(tips["right arm"], (1.55, 1.32, 0.1), atol=0.15)


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


def test_a_map_changes_a_proposed_limb_and_leaves_the_others(propose):
    made = propose(maps={"head": "hand_left,hand_right"}).puppet
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


def test_how_it_stands_is_proposed_by_its_shape_and_said_unless_it_is_given(propose):
    made = propose(up=None, front=None)
    stands = orientation.propose(made.character.solver_mesh())
    table = made.puppet.character
    assert (table.up, table.front) == (stands.up, stands.front)
    height = np.ptp(made.character.vertices @ table.basis[1])
    scale, reason = propose_scale(height, made.plan)
    assert table.scale == scale
    assert made.assumed == (*stands.reasons, reason)
    made = propose(up="z", front=None, scale=0.01)
    assert (made.puppet.character.up, made.puppet.character.scale, len(made.assumed)) == ("z", 0.01, 1)
    assert propose(up="z", front="x", scale=2.0).assumed == ()


def test_a_shape_stands_as_the_points_inside_say_where_its_outline_leaves_it_open(propose, blob_file, monkeypatch):
    by_shape = orientation.propose
    lies = replace(by_shape(load_character(blob_file).solver_mesh()), up="z", front="y", confidence=0.6)
    lies = replace(lies, others=(("y", "z", 0.3), ("-y", "z", 0.1)))

    def stand(mesh, *known, **_):
        return by_shape(mesh, *known) if all(known) else lies

    monkeypatch.setattr(orientation, "propose", stand)
    monkeypatch.setattr(standing, "standing_logits", lambda *_: [0.0, 8.0, 0.0])
    made = propose(up=None, front=None)
    assert (made.puppet.character.up, made.puppet.character.front) == ("y", "z")
    assert {limb.name for limb in made.puppet.limb} == PERSON.keys()
    assert made.notes[0] == "With a probability of 16%, up is z and front is y. If so: --up z --front y"


@pytest.mark.parametrize(("away", "feet"), [(0.0, ["left foot"]), (50.0, ["left foot", "right foot"])])
def test_limbs_that_overlap_or_leave_the_mesh_are_replaced_by_handles(propose, find, away, feet):
    leg = points("0 1 0, 0 0.5 0, 0 0.1 0, 0 0 0.1")
    trunk, other = leg[0] + np.outer([0, 0.2, 0.4], [0, 1, 0]), leg + np.array([away, 0, 0])
    named = {"trunk": trunk, "head": trunk[::2] + np.array([0, 0.4, 0]), "left leg": leg, "right leg": other}
    find(Limbs(tuple(LimbChain(name, each) for name, each in named.items())))
    made = propose()
    assert made.puppet == propose(limbs=False).puppet
    assert [handle.name for handle in made.puppet.handle] == ["head", *feet]
    assert (made.puppet.limb, len(made.notes)) == ((), 1)


def test_limbs_that_overlap_or_leave_the_mesh_are_left_out_if_the_others_stay(propose, found, find):
    jaw, tail = LimbChain("jaw", found.points["head"]), LimbChain("tail", found.points["left leg"])
    rest = tuple(chain for chain in found.chains if "arm" not in chain.name)
    arms = [LimbChain(name, chain + 50.0) for name, chain in found.points.items() if "arm" in name]
    for good, wrong, are in ((found.chains, (jaw,), "is"), (rest, (*arms, tail, jaw), "are")):
        find(Limbs((*good, *wrong)))
        made = propose()
        assert {limb.name for limb in made.puppet.limb} == {chain.name for chain in good}
        names = " and ".join(chain.name for chain in wrong)
        assert made.notes == (f"{names} would overlap another limb or leave the mesh, and {are} left out.",)


def test_other_limbs_are_said_with_the_plan_that_takes_them(propose, found, find):
    armless = tuple(chain for chain in found.chains if "arm" not in chain.name)
    body = tuple(chain for chain in found.chains if "leg" not in chain.name)
    find(replace(found, others=((0.2, armless[:-1]), (0.15, armless), (0.1, body))))
    made = propose()
    assert made.plan == "upright"
    assert made.notes == (
        "With a probability of 20%, it is a body on two legs: one head, one leg. If so: --plan 'two legs'",
    )
    for plan, chains in (("two legs", armless[:-1]), ("no legs", body), ("upright", found.chains)):
        chosen = propose(plan=plan)
        assert [limb.name for limb in chosen.puppet.limb] == [chain.name for chain in chains]
        assert (chosen.plan, chosen.notes) == (plan, ())
    assert propose(plan="many legs").notes == (
        "No limbs of the plan 'many legs' were found. "
        "These follow the performer by that plan: a person: one head, two arms, two legs.",
    )


@pytest.mark.parametrize(
    ("given", "place"),
    [
        ({"handles": {"paw": "1,2"}}, "the command line, --handle paw=1,2"),
        ({"maps": {"nose": "head"}}, "the command line, --map nose=head"),
        (
            {"handles": {"crown": "0,2.1,0.3"}, "maps": {"crown": "heat"}},
            "the command line, [[handle]] 1 'crown', joint",
        ),
        ({"ends": {"paw": "1,2,3"}}, "the command line, --limb paw=1,2,3"),
        ({"ends": {"left arm": "1,2,3"}}, "the command line, --limb left arm=1,2,3"),
        (
            {"ends": {"left arm": "1.55,1.32,0.1", "right arm": "-4,1.2,0"}},
            "the command line, --limb right arm=-4,1.2,0",
        ),
        ({"handles": {"far": "30,0,0"}}, "the command line, [[handle]] 1 'far', position"),
        ({"up": "z", "front": "-z"}, "the command line, [character], front"),
    ],
)
def test_a_mistake_on_the_command_line_is_named(propose, given, place):
    assert refused(PuppetError, propose, **given).where == place
