"""Animations of a file's own skeleton: known answers, unusual skeletons, and real files in three.js."""

import numpy as np
import pygltflib as gltf
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from engine_bridge.character.character import from_document, load_character
from engine_bridge.character.document_reader import load_document
from engine_bridge.character.scene import influences, world_transforms
from engine_bridge.export import rig_animation
from engine_bridge.export.animation import Keyframes
from engine_bridge.export.convert import convert, describe
from engine_bridge.export.rig_animation import animate_rig
from engine_bridge.performance.settings import Settings
from engine_bridge.puppet import puppet_file
from engine_bridge.puppet.rig_bones import rig_bones
from engine_bridge.puppet.rig_limbs import rig_limbs
from puppetline.errors import MeshError
from solver.motion.limbs import Limb, bones_of

from ..refusals import refused_place
from .conftest import add_animation, posed

HALF = np.sqrt(0.5)
REAL = {
    "kaykit_Knight": ("chest", "spine"),
    "quaternius_Adventurer": (),
    "quaternius_Witch": (),
    "quaternius_George": ("Head",),
}
"""Real files, and their joints that are not where limbs bend; what follows these only approximates the motions."""
CHAINS = {"trunk": ("hip_center", "spine", "shoulder_center"), "head": ("shoulder_center", "head")} | {
    f"{side} {limb}": tuple(f"{joint}_{side}" for joint in joints)
    for side in ("left", "right")
    for limb, joints in (("arm", ("shoulder", "elbow", "wrist", "hand")), ("leg", ("hip", "knee", "ankle", "foot")))
}


def limb(name, *points, parent=None):
    return Limb(name, np.array(points, dtype=np.float64), ((0,),) * len(points), parent=parent)


BODY = limb("trunk", (0, 0, 0), (0, 1, 0), (0, 2, 0))
BRANCH = limb("left arm", (0.5, 2, 0), (1.5, 2, 0), (2.5, 2, 0), parent="trunk")
"""A child of the trunk's second bone."""
ARM = limb("left arm", (0, 0, 0), (1, 0, 0), (2, 0, 0))


def transform(place=(0, 0, 0), turn=(0, 0, 0), scale=(1, 1, 1)):
    """A (4, 4) matrix for column vectors; Euler angles in degrees."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler("xyz", turn, degrees=True).as_matrix() * scale
    matrix[:3, 3] = place
    return matrix


def cloud(*places):
    """Four vertices around each place."""
    corners = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
    return (np.array(places, dtype=np.float64)[:, None] + corners).reshape(-1, 3)


FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.uint32)


def add_skinned(glb, vertices, faces, joints, which, shares):
    """Add a mesh, whose vertices follow four of the joints by their numbers (V, 4), and its skin."""
    primitive = glb.primitive(vertices, faces)
    primitive.attributes.JOINTS_0 = glb.add(which.astype(np.uint8))
    primitive.attributes.WEIGHTS_0 = glb.add(np.tile(np.float32(shares), (len(which), 1)))
    glb.file.skins.append(gltf.Skin(joints=joints))
    glb.node(glb.mesh(primitive), skin=len(glb.file.skins) - 1, name="body")


def add_two_clouds(glb, places, joints, followed):
    """Add a mesh of a cloud at each of two places, which follows one of the joints by its number, and its skin."""
    which = np.pad(np.repeat(followed, 4)[:, None], [(0, 0), (0, 3)])
    add_skinned(glb, cloud(*places), np.concatenate([FACES, FACES + 4]), joints, which, [1, 0, 0, 0])


@pytest.fixture
def build(glb, tmp_path):
    """Build a character of joints (name: world matrix, parent) in this order, each with its own vertices."""

    def make(joints, above=None, matrices=False, blend=0.25, own_animation=False):
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
            nodes[name], world[name] = glb.node(parent=nodes[parent], name=name, **how), np.asarray(place)
        skin_joints, matrices_of = list(nodes.values())[1:], np.array(list(world.values())[1:])
        count = len(skin_joints)
        faces = np.concatenate([FACES + 4 * index for index in range(count)])
        own = np.repeat(np.arange(count), 4)
        which = np.column_stack([own, (own + 1) % count, own * 0, own * 0])
        add_skinned(glb, cloud(*matrices_of[:, :3, 3]), faces, skin_joints, which, [1 - blend, blend, 0, 0])
        inverse = np.linalg.inv(matrices_of).swapaxes(1, 2).reshape(-1, 16).astype(np.float32)
        glb.file.skins[-1].inverseBindMatrices = glb.add(inverse, None)
        if own_animation:
            add_animation(glb, "wave", skin_joints[0], "rotation", [0, 1], [[0, 0, 0, 1], [0, 1, 0, 0]])
        return load_character(glb.save(tmp_path / "rigged.glb"))

    return make


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
        matrix = Rotation.concatenate([row[b] for row in turns]).as_matrix()
        place = head if parent < 0 else np.append(head, 1) @ motions[:, parent]
        motions[:, b, :3] = matrix.swapaxes(1, 2)
        motions[:, b, 3] = place - head @ motions[:, b, :3]
    return motions


def wild(limbs, count=12, seed=3):
    rng = np.random.default_rng(seed)
    bones = len(bones_of(limbs))
    return motions_of(limbs, [[Rotation.from_rotvec(rng.normal(size=3)) for _ in range(bones)] for _ in range(count)])


def keyframes_of(motions, root=None):
    times = np.arange(len(motions), dtype=np.float32)
    root = None if root is None else np.asarray(root, np.float32)
    return Keyframes("take", times, np.zeros((len(motions), 0), np.float32), root)


def animated(character, limbs, motions, root=None):
    bones = rig_bones(character, limbs)
    return *animate_rig(character.document, keyframes_of(motions, root), bones, motions.astype(np.float32)), bones


def keys_of(document, animation=0):
    """The keyframes by joint and path."""
    chosen, nodes = document.gltf["animations"][animation], document.gltf["nodes"]
    return {
        (nodes[channel["target"]["node"]]["name"], channel["target"]["path"]): document.array(
            chosen["samplers"][channel["sampler"]]["output"]
        )
        for channel in chosen["channels"]
    }


def followed_nodes(character, part):
    """Return the nodes (V, k) that a part's vertices follow, and their shares."""
    document, count = character.document, len(part.vertices)
    node = document.gltf["nodes"][part.node]
    if "skin" not in node:
        return np.full((count, 1), part.node), np.ones((count, 1))
    primitive = document.gltf["meshes"][node["mesh"]]["primitives"][part.primitive]
    which, share = influences(document, primitive, node["skin"], count)
    return np.array(document.gltf["skins"][node["skin"]]["joints"])[which], share


def blended(character, bones, motions, root=None):
    """Positions (F, N, 3) of all vertices by linear blend skinning of the motions."""
    shares = bones.of_nodes(character)
    of_node = np.where(shares.any(axis=1), shares.argmax(axis=1), -1)
    shown = []
    for part in character.parts:
        nodes, share = followed_nodes(character, part)
        blend = np.einsum("nk,fnkrx->fnrx", share, motions[:, of_node[nodes]])
        shown.append(np.einsum("nr,fnrx->fnx", np.pad(part.vertices, [(0, 0), (0, 1)], constant_values=1), blend))
    return np.concatenate(shown, axis=1) + (0 if root is None else np.asarray(root)[:, None])


def depth_first(nodes):
    """Yield the numbers of nodes, each after its parent."""
    children = {child for node in nodes for child in node.get("children", [])}
    waiting = [number for number in range(len(nodes)) if number not in children]
    while waiting:
        yield waiting[-1]
        waiting.extend(nodes[waiting.pop()].get("children", []))


def assert_goes_with(character, document, bones, motions, root=None, within=2e-6):
    expected = blended(character, bones, motions, root)
    size = np.linalg.norm(np.ptp(character.vertices, axis=0))
    for frame, places in enumerate(expected):
        assert np.abs(from_document(posed(document, frame)).vertices - places).max() < within * size


def test_an_arm_that_is_raised_and_bent_has_the_keys_worked_out_by_hand(build):
    """The upper arm turns by 90° about z, the forearm by 180°, and the root moves by 5 to the left."""
    character = build(arm_joints(), blend=0)
    quarter, half = (Rotation.from_euler("z", angle, degrees=True) for angle in (90, 180))
    motions = motions_of([ARM], [[Rotation.identity()] * 2, [quarter, half]])
    document, made, bones = animated(character, [ARM], motions, [[0, 0, 0], [5, 0, 0]])
    keys = keys_of(document)
    assert keys.keys() == {("upper", "rotation"), ("upper", "translation"), ("lower", "rotation")}
    assert_allclose(keys["upper", "rotation"], [[0, 0, 0, 1], [0, 0, HALF, HALF]], atol=1e-7)
    assert_allclose(keys["lower", "rotation"], [[0, 0, 0, 1], [0, 0, HALF, HALF]], atol=1e-7)
    assert_allclose(keys["upper", "translation"], [[0, 0, 0], [5, 0, 0]], atol=1e-7)
    world = world_transforms(posed(document, 1))[bones.nodes, :3, 3]
    assert_allclose(world, [[5, 0, 0], [5, 1, 0], [4.1, 1, 0]], atol=1e-6)
    assert (made.animated, made.following, made.uneven) == (2, 1, ())
    assert made.error < 1e-6


ABOVE = {
    "a tenth of the size": transform(scale=[0.1] * 3),
    "lying, as Blender exports": transform(turn=(-90, 0, 0), scale=[100] * 3),
    "a mirror": transform((0.3, 0.1, -2), (20, 50, -70), (-2, 2, 2)),
}


@pytest.mark.parametrize("above", ABOVE)
@pytest.mark.parametrize("matrices", [False, True])
def test_nodes_above_the_joints_do_not_change_the_result(build, above, matrices):
    joints = {
        "upper": (transform((0, 0, 0), (10, 20, 30), [0.5] * 3), None),
        "lower": (transform((1, 0, 0), (-60, 5, 80), [-2, 2, 2]), "upper"),
        "hand": (transform((1.9, 0, 0), (0, 90, 0), (1, 3, 0.2)), "lower"),
    }
    character = build(joints, ABOVE[above], matrices)
    motions, root = wild([ARM]), np.random.default_rng(1).normal(size=(12, 3))
    document, made, bones = animated(character, [ARM], motions, root)
    assert made.uneven == ()
    assert_goes_with(character, document, bones, motions, root, within=2e-5)


def test_nodes_between_joints_and_children_listed_first_are_followed(glb, tmp_path):
    """The skin has two joints with another node between them, and lists the child first."""
    lower = glb.node(name="lower", translation=[0.5, 0, 0])
    between = glb.node(name="between", translation=[0.5, 0, 0], rotation=[0, 0, HALF, HALF])
    upper = glb.node(name="upper")
    glb.file.scenes[0].nodes = [upper]
    glb.file.nodes[upper].children, glb.file.nodes[between].children = [between], [lower]
    limbs = [limb("left arm", (0, 0, 0), (0.5, 0.5, 0), (0.5, 2, 0))]
    add_two_clouds(glb, [(0.2, 0, 0), (0.5, 1, 0)], [lower, upper], [1, 0])
    character = load_character(glb.save(tmp_path / "between.glb"))
    motions = wild(limbs)
    document, _, bones = animated(character, limbs, motions)
    assert [character.document.gltf["nodes"][node]["name"] for node in bones.nodes] == ["upper", "lower"]
    assert_goes_with(character, document, bones, motions)


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


def test_trunk_arm_and_a_target_of_inverse_kinematics_go_where_their_bones_do(build):
    character, limbs = build(body_joints()), [BODY, BRANCH]
    motions, root = wild(limbs), np.random.default_rng(2).normal(size=(12, 3))
    document, made, bones = animated(character, limbs, motions, root)
    assert_goes_with(character, document, bones, motions, root)
    assert made.error < 1e-5
    keys = keys_of(document)
    assert {name for name, path in keys if path == "translation"} == {"root", "target"}
    assert {name for name, path in keys if path == "rotation"} == {"root", "chest", "upper", "lower", "target"}


def test_all_else_in_the_file_stays_to_the_bit_and_its_own_animation_comes_after(build):
    character = build(body_joints(), own_animation=True)
    document, _, _ = animated(character, [BODY, BRANCH], wild([BODY, BRANCH]), np.ones((12, 3)))
    before, after = character.document, document
    assert bytes(after.blob[: len(before.blob)]) == bytes(before.blob)
    for name, value in before.gltf.items():
        if name in ("accessors", "bufferViews"):
            assert after.gltf[name][: len(value)] == value
        elif name == "animations":
            assert after.gltf[name][1:] == value
            assert [each["name"] for each in after.gltf[name]] == ["take", "wave"]
        else:
            assert after.gltf[name] == value


def test_a_joint_between_bends_takes_of_each_bone_what_it_covers(build):
    """The trunk bends at height 1, between joints at 0.5 and 1.5, each of which turns by half of the bend."""
    joints = {
        "hips": (transform(), None),
        "belly": (transform((0, 0.5, 0)), "hips"),
        "breast": (transform((0, 1.5, 0)), "belly"),
        "upper": (transform((0.5, 2, 0)), "breast"),
    }
    character, limbs = build(joints, blend=0), [BODY, BRANCH]
    bend = Rotation.from_euler("x", 40, degrees=True)
    document, made, bones = animated(character, limbs, motions_of(limbs, [[Rotation.identity(), bend, bend, bend]] * 2))
    assert bones.shares[1].tolist() == [0.5, 0.5, 0, 0]
    turned = Rotation.from_matrix(world_transforms(posed(document, 0))[bones.nodes[1:3], :3, :3])
    assert_allclose(turned.as_rotvec(degrees=True), [[20, 0, 0], [40, 0, 0]], atol=1e-4)
    # the arm's root by hand: 0.5 up, then 1 at 20°, then 0.5 at 40°; the bones have 1 up, then 1 at 40°
    slight, whole = (np.array([np.cos(angle), np.sin(angle)]) for angle in np.radians([20, 40]))
    here = np.array([0.5, 0]) + slight + 0.5 * whole
    there = np.array([1, 0]) + whole
    arm = world_transforms(posed(document, 0))[bones.nodes[3], 1:3, 3]
    assert_allclose(arm, here, atol=1e-6)
    assert_allclose(made.error, np.linalg.norm(here - there), atol=1e-6)


def test_quaternions_do_not_jump_over_two_turns_and_over_chunks(build, monkeypatch):
    character = build(arm_joints())
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


def test_two_skins_on_two_skeletons_at_one_place_move_together(glb, tmp_path):
    """Some exporters write a separate skeleton for each garment."""
    for _ in range(2):
        upper = glb.node(name="upper")
        lower = glb.node(name="lower", parent=upper, translation=[1, 0, 0])
        add_two_clouds(glb, [(0.5, 0, 0), (1.5, 0, 0)], [upper, lower], [0, 1])
    character = load_character(glb.save(tmp_path / "twice.glb"))
    motions = wild([ARM])
    document, made, bones = animated(character, [ARM], motions)
    assert made.animated == 4
    assert_goes_with(character, document, bones, motions)


def test_a_sword_on_a_bone_and_a_hat_on_nothing_come_along(build, glb, tmp_path):
    build(body_joints())
    hand = next(index for index, node in enumerate(glb.file.nodes) if node.name == "lower")
    glb.node(glb.mesh(glb.primitive(cloud((0, 0, 0)), FACES)), parent=hand, name="sword", translation=[0.9, 0.2, 0])
    glb.node(glb.mesh(glb.primitive(cloud((0, 0, 0)), FACES)), name="hat", translation=[0, 2.2, 0])
    character, limbs = load_character(glb.save(tmp_path / "armed.glb")), [BODY, BRANCH]
    motions, root = wild(limbs), np.ones((12, 3))
    document, _, bones = animated(character, limbs, motions, root)
    assert bones.loose == ("hat",)
    assert_goes_with(character, document, bones, motions, root)


def test_a_scale_that_differs_by_axis_is_said_and_the_places_below_are_measured(build):
    character, motions = build(arm_joints(upper=(transform(scale=(1, 2, 1)), None))), wild([ARM])
    document, made, bones = animated(character, [ARM], motions)
    assert made.uneven == ("lower",)
    # upper and the positions of its children are exact; the hand is off by the approximate rotation of lower
    aims = np.append([1.9, 0, 0], 1) @ motions[:, 1]
    hands = [world_transforms(posed(document, frame))[bones.nodes[2], :3, 3] for frame in range(12)]
    away = np.linalg.norm(hands - aims, axis=1)
    assert away.max() > 0.01
    assert_allclose(made.error, away.max(), atol=1e-6)


def test_a_node_below_a_scale_of_zero_has_no_keys(build, glb, tmp_path):
    build(arm_joints())
    next(node for node in glb.file.nodes if node.name == "upper").scale = [1, 0, 1]
    document, made, _ = animated(load_character(glb.save(tmp_path / "hidden.glb")), [ARM], wild([ARM]))
    assert keys_of(document).keys() == {("upper", "rotation"), ("upper", "translation")}
    assert made.error < 1e-5


def test_a_sheared_joint_is_refused(glb, tmp_path):
    sheared = np.eye(4)
    sheared[0, 1] = 0.5
    node = glb.node(name="upper", matrix=sheared.T.ravel().tolist())
    add_two_clouds(glb, [(0.5, 0, 0), (1.5, 0, 0)], [node], [0, 0])
    path = glb.save(tmp_path / "sheared.glb")
    place = refused_place(MeshError, path, animated, load_character(path), [ARM], wild([ARM]))
    assert place == "nodes[0].matrix"


@pytest.mark.parametrize("name", REAL)
def test_three_plays_real_characters_as_their_weights_blend_the_motions(
    name, real_data, take, play, validate, tmp_path
):
    mesh, output = real_data / "mesh" / "gltf" / f"{name}.glb", tmp_path / "out.glb"
    character, bends_elsewhere = load_character(mesh), REAL[name]
    nodes, frames = character.document.gltf["nodes"], np.arange(0, 58, 3)
    chains = rig_limbs(character).chains
    values = {
        "character": {"mesh": str(mesh)},
        "limb": [
            {"name": each.name, "points": each.points.tolist(), "joints": list(CHAINS[each.name])} for each in chains
        ],
        "root": {"joint": "hip_center", "axes": "xyz"},
        "solver": {"fields": 2, "isolines": 4},
    }
    puppet_file.dump(puppet_file.check(values, "the test"), tmp_path / "puppet.toml")
    clip, summary = convert(take, tmp_path / "puppet.toml", output, Settings(form="rig"))

    bones = rig_bones(character, clip.rig.puppet.limbs)
    expected = blended(character, bones, clip.motions[frames].astype(np.float64), clip.root[frames])
    elsewhere = {number for number, node in enumerate(nodes) if node.get("name") in bends_elsewhere}
    for number in depth_first(nodes):
        if number in elsewhere:
            elsewhere.update(nodes[number].get("children", []))
    played, compared = play(output, len(frames)).meshes, 0
    for part, place in zip(character.parts, character.vertex_slices, strict=True):
        count = len(part.vertices)
        followed, share = followed_nodes(character, part)
        exact = ~(np.isin(followed, list(elsewhere)) & (share > 0)).any(axis=1)
        same = [mesh.positions[:, exact] for mesh in played if mesh.positions.shape[1] == count]
        away = min(np.abs(positions - expected[:, place][:, exact]).max(initial=0) for positions in same)
        assert away < 1e-4 * clip.rig.mesh.diagonal
        compared += exact.sum()
    assert sum(mesh.positions.shape[1] for mesh in played) == len(character.vertices)
    assert compared > (0.1 if name == "kaykit_Knight" else 0.7) * len(character.vertices)

    before, after = validate(mesh), validate(output)
    assert (after["errors"], after["warnings"]) == (before["errors"], before["warnings"])
    own, made = (document.gltf["animations"] for document in (character.document, load_document(output)))
    assert [each.get("name") for each in made] == ["dance", *(each.get("name") for each in own)]
    joints = {joint for skin in character.document.gltf["skins"] for joint in skin["joints"]}
    moved = {channel["target"]["node"] for channel in made[0]["channels"]}
    assert (summary.bones, summary.bones + summary.following) == (len(moved), len(joints))
    assert f"{summary.bones} animated, {summary.following} follow" in describe(summary)
    assert summary.error < (0.1 if bends_elsewhere else 1e-5)
