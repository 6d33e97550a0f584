import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from capture import body
from capture.skeleton import JOINT_INDEX, mirrored, to_character_axes
from engine_bridge.performance.performance import make_deformer
from engine_bridge.performance.retargeting import Retargeting, legs_of
from engine_bridge.puppet.puppet import RetargetTable, RootTable, SmoothingTable

RAW = SmoothingTable(alpha=1, gamma=0, jitter_radius=0, max_deviation=float("inf"), prediction=0)


@pytest.fixture(scope="module")
def puppet(limbed_rig):
    return limbed_rig.puppet.model_copy(update={"smoothing": RAW, "retarget": RetargetTable()})


@pytest.fixture(scope="module")
def retargeting(limbed_rig):
    def make(puppet, rest):
        deformer = make_deformer(puppet, limbed_rig.mesh, limbed_rig.model)
        return Retargeting(puppet, limbed_rig.mesh, deformer, rest), deformer.bones

    return make


def directions(bones, motions):
    along = np.einsum("bx,bxy->by", bones.tails - bones.heads, motions[:, :3])
    return along / np.linalg.norm(along, axis=1)[:, None]


def wanted(puppet, joints):
    """Where the performer's bones point, limb after limb as the bones are."""
    positions = to_character_axes(joints)
    ends = [pair for limb in puppet.limbs for pair in itertools.pairwise(j[0] for j in limb.joints)]
    along = np.array([positions[b] - positions[a] for a, b in ends])
    return along / np.linalg.norm(along, axis=1)[:, None]


def turned(positions, angle):
    """Sensor frame; a turn to the performer's left about the hips."""
    hips = positions[..., [JOINT_INDEX["hip_center"]], :]
    return (positions - hips) @ Rotation.from_rotvec([0, angle, 0]).as_matrix().T + hips


def changed(puppet, **tables):
    return puppet.model_copy(update=tables)


def test_bones_point_where_the_performers_do_whatever_pose_it_was_calibrated_in(puppet, retargeting, frames, dance):
    free = changed(puppet, root=RootTable(feet="free"))
    takes = dance(30)
    made, bones = retargeting(free, takes[17])
    arms = slice(3, None)  # the spine of this performer is as near to the hips as Kinect v1 has it
    for frame in frames(takes):
        found = directions(bones, made.step(frame).motions)
        np.testing.assert_allclose(found[arms], wanted(free, frame.positions)[arms], atol=1e-9)


def test_a_mirroring_puppet_does_what_another_does_for_the_mirrored_performer(puppet, retargeting, frames, dance):
    takes = dance(20)
    ours, _ = retargeting(changed(puppet, retarget=RetargetTable(mirror=True)), takes[0])
    theirs, _ = retargeting(puppet, mirrored(takes[0]))
    for frame, other in zip(frames(takes), frames(mirrored(takes)), strict=True):
        a, b = ours.step(frame), theirs.step(other)
        np.testing.assert_allclose(a.motions, b.motions, atol=1e-12)
        np.testing.assert_allclose(a.root, b.root, atol=1e-12)


def test_a_full_turn_of_a_performer_who_dances_turns_the_character_once_round(puppet, retargeting, frames, dance):
    angles = np.linspace(0, 2 * np.pi, 60)
    takes = np.array([turned(pose, angle) for pose, angle in zip(dance(60), angles, strict=True)])
    made, _ = retargeting(puppet, takes[0])
    motions = np.array([made.step(frame).motions for frame in frames(takes)])
    heading = np.unwrap(np.arctan2(motions[:, 1, 2, 0], motions[:, 1, 2, 2]))
    np.testing.assert_allclose(heading - heading[0], angles, atol=1e-6)
    still, _ = retargeting(changed(puppet, root=RootTable(turns=False)), takes[0])
    motions = np.array([still.step(frame).motions for frame in frames(takes)])
    assert np.ptp(np.arctan2(motions[:, 1, 2, 0], motions[:, 1, 2, 2])) < 1e-6


def test_handles_are_carried_by_the_trunk_and_move_against_it(puppet, retargeting, frames, standing):
    numeric = changed(puppet, retarget=RetargetTable(scale=1.0))
    nod = standing.copy()
    nod[JOINT_INDEX["head"]] += [0, -0.1, -0.2]  # down and forwards
    made, bones = retargeting(numeric, standing)
    takes = np.array([standing, nod, turned(nod, 0.5), turned(nod, 1.0)])
    aims = [made.step(frame) for frame in frames(takes)]
    there = aims[0].targets + np.array([0, -0.1, 0.2])
    np.testing.assert_allclose(aims[1].targets, there, atol=1e-9)
    for aim, angle in zip(aims[2:], (0.5, 1.0), strict=True):
        turn = Rotation.from_rotvec([0, angle, 0])
        hips = bones.heads[0]
        np.testing.assert_allclose(aim.targets, turn.apply(there - hips) + hips, atol=1e-9)


def test_who_is_calibrated_turned_to_the_side_moves_the_handles_the_same(puppet, retargeting, frames, dance):
    numeric = changed(puppet, retarget=RetargetTable(scale=1.0), root=None)
    takes = dance(12)
    ours, bones = retargeting(numeric, takes[0])
    theirs, _ = retargeting(numeric, turned(takes[0], 0.7))
    turn, hips = Rotation.from_rotvec([0, 0.7, 0]), bones.heads[0]
    for a, b in zip(frames(takes), frames(turned(takes, 0.7)), strict=True):
        np.testing.assert_allclose(theirs.step(b).targets, turn.apply(ours.step(a).targets - hips) + hips, atol=1e-9)


def test_two_legs_stand_on_the_floor_unless_the_puppet_says_otherwise(puppet):
    assert [(leg.thigh, leg.shin, leg.foot) for leg in legs_of(puppet)] == [(7, 8, -1), (9, 10, -1)]
    assert [leg.joint for leg in legs_of(puppet)] == [JOINT_INDEX["ankle_left"], JOINT_INDEX["ankle_right"]]
    assert legs_of(changed(puppet, root=RootTable(feet="free"))) == ()
    assert legs_of(changed(puppet, root=None)) == ()
    assert legs_of(changed(puppet, limb=puppet.limb[:-1])) == ()
    turning = puppet.limb[-1].model_copy(update={"follow": "turn"})
    assert legs_of(changed(puppet, limb=(*puppet.limb[:-1], turning))) == ()


def test_a_walk_is_scaled_by_the_length_of_the_legs_and_stays_at_the_height_of_the_floor(
    puppet, retargeting, frames, standing
):
    walk = np.tile(standing, (20, 1, 1)) + np.linspace(0, 1, 20)[:, None, None] * [0.5, 0, -0.8]
    made, bones = retargeting(puppet, standing)
    aims = [made.step(frame) for frame in frames(walk)]
    lengths = body.bone_lengths(standing)
    performers = lengths["knee_left"] + lengths["ankle_left"]
    characters = np.mean([bones.lengths[7:9].sum(), bones.lengths[9:11].sum()])
    np.testing.assert_allclose(aims[-1].root[[0, 2]], characters / performers * np.array([-0.5, 0.8]), rtol=0.02)
    over = [(np.append(bones.tails[b], 1) @ aims[-1].motions[b] + aims[-1].root - bones.tails[b])[1] for b in (8, 10)]
    assert min(over) == pytest.approx(0, abs=1e-9)
