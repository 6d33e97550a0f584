"""Animations of a file's own skeleton: unusual skeletons, approximations, and real files in three.js."""

import numpy as np
import pygltflib as gltf
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from engine_bridge.character.character import from_document, load_character
from engine_bridge.character.document_reader import load_document
from engine_bridge.character.scene import world_transforms
from engine_bridge.export import rig_animation
from engine_bridge.export.animation import Keyframes
from engine_bridge.export.convert import convert, describe
from engine_bridge.export.rig_animation import animate_rig
from engine_bridge.performance.settings import Settings
from engine_bridge.puppet import proposal, puppet_file
from engine_bridge.puppet.puppet import SolverTable
from engine_bridge.puppet.rig_bones import rig_bones
from engine_bridge.puppet.skin_joints import vertex_influences
from puppetline.errors import MeshError
from solver.motion.limbs import bones_of

from ..bones import limb
from ..character.conftest import CORNERS, SIDES
from ..refusals import refused
from .conftest import add_animation, posed, transform

HALF = np.sqrt(0.5)
REAL = ("quaternius_Adventurer", "quaternius_Witch")
"""Real files whose joints are where limbs bend."""


BODY = limb("trunk", "0 0 0, 0 1 0, 0 2 0")
BRANCH = limb("left arm", "0.5 2 0, 1.5 2 0, 2.5 2 0")
"""A child of the trunk's second bone."""
ARM = limb("left arm", "0 0 0, 1 0 0, 2 0 0", parent=None)


def cloud(*places):
    """Four vertices around each place."""
    return (np.array(places, dtype=np.float64)[:, None] + 0.1 * CORNERS.astype(np.float64)).reshape(-1, 3)


FACES = SIDES.astype(np.uint32)


def add_skinned(glb, places, joints, which, blend=0.0):
    """Add a skin and a mesh of clouds, each of which follows a joint by its number, and the next one by a share."""
    faces = np.concatenate([FACES + 4 * index for index in range(len(places))])
    own = np.repeat(np.uint8(which), 4)
    follows = np.stack([own, (own + 1) % len(joints), 0 * own, 0 * own], axis=1)
    shares = np.tile(np.float32([1 - blend, blend, 0, 0]), (len(own), 1))
    glb.file.skins.append(gltf.Skin(joints=joints))
    mesh = glb.mesh(glb.primitive(cloud(*places), faces, JOINTS_0=follows, WEIGHTS_0=shares))
    glb.node(mesh, skin=len(glb.file.skins) - 1, name="body")


def add_joints(glb, joints, above=None, matrices=False, blend=0.25):
    """Add joints (name: world matrix, parent) in this order, each with its own vertices; return their nodes by name."""
    top = None if above is None else glb.node(name="above", matrix=np.asarray(above).T.ravel().tolist())
    world, nodes = {None: np.eye(4) if above is None else above}, {None: top}
    for name, (place, parent) in joints.items():
        local = np.linalg.solve(world[parent], place)
        if matrices:
            how = {"matrix": local.T.ravel().tolist()}
        else:
            scale = np.linalg.norm(local[:3, :3], axis=0)
            scale[0] *= np.sign(np.linalg.det(local[:3, :3]))
            turn = Rotation.from_matrix(local[:3, :3] / scale).as_quat()
            how = {"translation": local[:3, 3].tolist(), "rotation": turn.tolist(), "scale": scale.tolist()}
        nodes[name], world[name] = glb.node(parent=nodes[parent], name=name, **how), place
    (_, *own), (_, *places) = nodes.values(), world.values()
    add_skinned(glb, np.array(places)[:, :3, 3], own, range(len(own)), blend)
    inverse = np.linalg.inv(places).swapaxes(1, 2).astype(np.float32)
    glb.file.skins[-1].inverseBindMatrices = glb.add(inverse, None)
    return nodes


@pytest.fixture
def opened(glb, tmp_path):
    """Return the character of the file that a test has built."""
    return lambda: load_character(glb.save(tmp_path / "rigged.glb"))


def arm_joints(**changes):
    return {
        "upper": (transform(), None),
        "lower": (transform((1, 0, 0)), "upper"),
        "hand": (transform((1.9, 0, 0)), "lower"),
    } | changes


def motions_of(limbs, turns):
    """Motions (F, b, 4, 3) of bones with world rotations (F, b) about their moved heads."""
    bones = bones_of(limbs)
    motions = np.zeros((len(turns), len(bones), 4, 3))
    for b, (head, parent) in enumerate(zip(bones.heads, bones.parents, strict=True)):
        motions[:, b, :3] = [row[b].inv().as_matrix() for row in turns]
        place = head if parent < 0 else np.append(head, 1) @ motions[:, parent]
        motions[:, b, 3] = place - head @ motions[:, b, :3]
    return motions


def wild(limbs, count=12, seed=3):
    turns = np.random.default_rng(seed).normal(size=(count, len(bones_of(limbs)), 3))
    return motions_of(limbs, [[Rotation.from_rotvec(turn) for turn in row] for row in turns])


def animated(character, limbs, motions, root=None):
    bones, frames = rig_bones(character, limbs), len(motions)
    keyframes = Keyframes("take", np.arange(frames, dtype=np.float32), np.zeros((frames, 0), np.float32), root)
    return *animate_rig(character.document, keyframes, bones, motions.astype(np.float32)), bones


def keys_of(document, animation=0):
    """The keyframes by joint and path."""
    chosen, nodes = document.gltf["animations"][animation], document.gltf["nodes"]
    return {
        (nodes[channel["target"]["node"]]["name"], channel["target"]["path"]): document.array(
            chosen["samplers"][channel["sampler"]]["output"]
        )
        for channel in chosen["channels"]
    }


def blended(character, bones, motions, root=None):
    """Positions (F, N, 3) of all vertices by linear blend skinning of the motions."""
    shares = bones.of_nodes(character)
    of_node = np.where(shares.any(axis=1), shares.argmax(axis=1), -1)
    nodes, share = vertex_influences(character)
    blend = np.einsum("nk,fnkrx->fnrx", share, motions[:, of_node[nodes]])
    shown = np.einsum("nr,fnrx->fnx", np.pad(character.vertices, [(0, 0), (0, 1)], constant_values=1), blend)
    return shown + (0 if root is None else np.asarray(root)[:, None])


ABOVE = {
    "a tenth of the size": transform(scale=[0.1] * 3),
    "lying, as Blender exports": transform(turn=(-90, 0, 0), scale=[100] * 3),
    "a mirror": transform((0.3, 0.1, -2), (20, 50, -70), (-2, 2, 2)),
}


def below(above, matrices):
    """Return a builder of an arm below a node, whose joints are turned, mirrored and stretched."""
    joints = {
        "upper": (transform((0, 0, 0), (10, 20, 30), [0.5] * 3), None),
        "lower": (transform((1, 0, 0), (-60, 5, 80), [-2, 2, 2]), "upper"),
        "hand": (transform((1.9, 0, 0), (0, 90, 0), (1, 3, 0.2)), "lower"),
    }

    def build(glb):
        add_joints(glb, joints, ABOVE[above], matrices)
        return [ARM]

    return build


def child_first(glb):
    """The skin has two joints with another node between them, and lists the child first."""
    lower = glb.node(name="lower", translation=[0.5, 0, 0])
    between = glb.node(name="between", translation=[0.5, 0, 0], rotation=[0, 0, HALF, HALF])
    upper = glb.node(name="upper")
    glb.file.scenes[0].nodes = [upper]
    glb.file.nodes[upper].children, glb.file.nodes[between].children = [between], [lower]
    add_skinned(glb, [(0.2, 0, 0), (0.5, 1, 0)], [lower, upper], [1, 0])
    return [limb("left arm", "0 0 0, 0.5 0.5 0, 0.5 2 0", parent=None)]


def two_skins(glb):
    """Two skeletons at one place, as some exporters write for each garment."""
    for _ in range(2):
        upper = glb.node(name="upper")
        lower = glb.node(name="lower", parent=upper, translation=[1, 0, 0])
        add_skinned(glb, [(0.5, 0, 0), (1.5, 0, 0)], [upper, lower], [0, 1])
    return [ARM]


def body_joints():
    """Limbs bend at the joints, the skeleton has a root, and a foot's target has no parent."""
    return {
        "root": (transform(), None),
        "hips": (transform((0, 0.1, 0), (0, 40, 0)), "root"),
        "chest": (transform((0, 1, 0), (10, 0, 0)), "hips"),
        "collar": (transform((0.2, 1.9, 0)), "chest"),
        "upper": (transform((0.5, 2, 0), (0, 0, -90)), "collar"),
        "lower": (transform((1.5, 2, 0)), "upper"),
        "target": (transform((2.4, 2, 0), (5, 6, 7)), None),
    }


def armed(glb):
    """A sword on a bone, and a hat on nothing."""
    hand, thing = add_joints(glb, body_joints())["lower"], glb.mesh(glb.primitive(cloud((0, 0, 0)), FACES))
    glb.node(thing, parent=hand, name="sword", translation=[0.9, 0.2, 0])
    glb.node(thing, name="hat", translation=[0, 2.2, 0])
    return [BODY, BRANCH]


SKELETONS = {f"{above}{' by matrices' * way}": (below(above, way), 2e-5) for above in ABOVE for way in (False, True)}
SKELETONS |= {build.__name__: (build, 2e-6) for build in (child_first, two_skins, armed)}
"""Builders of skeletons, which return the limbs, and how far vertices may be away, as a fraction of the size."""


@pytest.mark.parametrize("name", SKELETONS)
def test_all_vertices_go_where_the_bones_of_their_joints_do(name, glb, opened):
    build, within = SKELETONS[name]
    limbs, character = build(glb), opened()
    motions, root = wild(limbs), np.random.default_rng(1).normal(size=(12, 3))
    document, made, bones = animated(character, limbs, motions, root)
    assert (made.uneven, bones.loose) == ((), ("hat",) if name == "armed" else ())
    assert made.error < 1e-5
    size = np.linalg.norm(np.ptp(character.vertices, axis=0))
    for frame, places in enumerate(blended(character, bones, motions, root)):
        assert np.abs(from_document(posed(document, frame)).vertices - places).max() < within * size


def test_keys_are_of_joints_with_bones_and_all_else_in_the_file_stays_to_the_bit(glb, opened):
    nodes = add_joints(glb, body_joints())
    add_animation(glb, "wave", nodes["root"], "rotation", [0, 1], [[0, 0, 0, 1], [0, 1, 0, 0]])
    before = opened().document
    after, _, _ = animated(opened(), [BODY, BRANCH], wild([BODY, BRANCH]), np.ones((12, 3)))
    keys = keys_of(after)
    assert {name for name, path in keys if path == "translation"} == {"root", "target"}
    assert {name for name, path in keys if path == "rotation"} == {"root", "chest", "upper", "lower", "target"}
    assert bytes(after.blob[: len(before.blob)]) == bytes(before.blob)
    assert [each["name"] for each in after.gltf["animations"]] == ["take", "wave"]
    del after.gltf["animations"][0]
    for name in ("accessors", "bufferViews"):
        del after.gltf[name][len(before.gltf[name]) :]
    assert after.gltf == before.gltf


def test_a_joint_between_bends_takes_of_each_bone_what_it_covers(glb, opened):
    """The trunk bends at height 1, between joints at 0.5 and 1.5, each of which turns by half of the bend."""
    joints = {
        "hips": (transform(), None),
        "belly": (transform((0, 0.5, 0)), "hips"),
        "breast": (transform((0, 1.5, 0)), "belly"),
        "upper": (transform((0.5, 2, 0)), "breast"),
    }
    add_joints(glb, joints, blend=0)
    character, limbs = opened(), [BODY, BRANCH]
    bend = Rotation.from_euler("x", 40, degrees=True)
    document, _, bones = animated(character, limbs, motions_of(limbs, [[Rotation.identity(), bend, bend, bend]] * 2))
    assert bones.shares[1].tolist() == [0.5, 0.5, 0, 0]
    turned = Rotation.from_matrix(world_transforms(posed(document, 0))[bones.nodes[1:3], :3, :3])
    assert_allclose(turned.as_rotvec(degrees=True), [[20, 0, 0], [40, 0, 0]], atol=1e-4)


def test_quaternions_do_not_jump_over_two_turns_and_over_chunks(glb, opened, monkeypatch):
    add_joints(glb, arm_joints())
    character = opened()
    turns = [[Rotation.from_euler("y", angle, degrees=True)] * 2 for angle in np.linspace(0, 720, 60)]
    motions = motions_of([ARM], turns)
    whole, *_ = animated(character, [ARM], motions)
    monkeypatch.setattr(rig_animation, "FRAMES_PER_CHUNK", 7)
    chunks, *_ = animated(character, [ARM], motions)
    for key, quaternions in keys_of(whole).items():
        assert (keys_of(chunks)[key] == quaternions).all()
        if key[1] == "rotation":
            assert (np.einsum("fc,fc->f", quaternions[1:], quaternions[:-1]) > 0.9).all()
    assert whole.gltf["animations"][0]["samplers"][0]["interpolation"] == "LINEAR"


def test_a_scale_that_differs_by_axis_is_said_and_the_places_below_are_measured(glb, opened):
    add_joints(glb, arm_joints(upper=(transform(scale=(1, 2, 1)), None)))
    motions = wild([ARM])
    document, made, bones = animated(opened(), [ARM], motions)
    assert made.uneven == ("lower",)
    # upper and the positions of its children are exact; the hand is off by the approximate rotation of lower
    hands = [world_transforms(posed(document, frame))[bones.nodes[2], :3, 3] for frame in range(12)]
    away = np.linalg.norm(hands - [1.9, 0, 0, 1] @ motions[:, 1], axis=1).max()
    assert away > 0.01
    assert_allclose(made.error, away, atol=1e-6)


def test_a_node_below_a_scale_of_zero_has_no_keys(glb, opened):
    glb.file.nodes[add_joints(glb, arm_joints())["upper"]].scale = [1, 0, 1]
    document, made, _ = animated(opened(), [ARM], wild([ARM]))
    assert keys_of(document).keys() == {("upper", "rotation"), ("upper", "translation")}
    assert made.error < 1e-5


def test_a_sheared_joint_is_refused(glb, opened):
    node = glb.node(name="upper", matrix=[*(1, 0, 0, 0), *(0.5, 1, 0, 0), *(0, 0, 1, 0), *(0, 0, 0, 1)])
    add_skinned(glb, [(0.5, 0, 0), (1.5, 0, 0)], [node], [0, 0])
    error = refused(MeshError, animated, opened(), [ARM], wild([ARM]))
    assert error.where.endswith(", nodes[0].matrix")


@pytest.mark.parametrize("name", REAL)
def test_three_plays_real_characters_as_their_weights_blend_the_motions(
    name, real_data, take, play, validate, tmp_path
):
    mesh, output = real_data / "mesh" / "gltf" / f"{name}.glb", tmp_path / "out.glb"
    character, frames = load_character(mesh), np.arange(0, 58, 3)
    puppet = proposal.new_puppet(mesh, tmp_path / "puppet.toml").puppet
    small = puppet.model_copy(update={"solver": SolverTable(fields=2, isolines=4)})
    puppet_file.dump(small, tmp_path / "puppet.toml")
    clip, summary = convert(take, tmp_path / "puppet.toml", output, Settings(form="rig"))
    bones = rig_bones(character, clip.motion.prepared.puppet.limbs)
    expected = blended(character, bones, clip.motion.bones[frames].astype(np.float64), clip.motion.root[frames])
    played = {each.part: each.positions for each in play(output, len(frames)).meshes}
    for part, place in zip(character.parts, character.vertex_slices, strict=True):
        away = np.abs(played.pop((part.node, part.primitive)) - expected[:, place])
        assert away.max() < 1e-4 * clip.motion.prepared.mesh.diagonal
    assert not played
    before, after = ([validate(path)[kind] for kind in ("errors", "warnings")] for path in (mesh, output))
    assert after == before
    joints = {joint for skin in character.document.gltf["skins"] for joint in skin["joints"]}
    moved = {channel["target"]["node"] for channel in load_document(output).gltf["animations"][0]["channels"]}
    assert (summary.bones, summary.bones + summary.following) == (len(moved), len(joints))
    assert f"{summary.bones} animated, {summary.following} follow" in describe(summary)
    assert summary.error < 1e-5
