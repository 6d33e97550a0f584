import itertools
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from capture import body, orientations
from capture.formats import read_log
from capture.skeleton import JOINT_INDEX, mirrored, to_character_axes
from capture.trackers.face import HeadDirection
from engine_bridge.performance.character_motion import make_deformer
from engine_bridge.performance.retargeting import Retargeting
from engine_bridge.puppet.puppet import RetargetTable, RootTable, SmoothingTable

from ...capture.formats.bvh_files import JOINT_COUNT, body_file

RAW = SmoothingTable(alpha=1, gamma=0, jitter_radius=0, max_deviation=float("inf"), prediction=0)


@pytest.fixture(scope="module")
def puppet(limbed_figure):
    return limbed_figure.puppet.model_copy(update={"smoothing": RAW, "retarget": RetargetTable()})


@pytest.fixture(scope="module")
def retargeting(limbed_figure):
    def make(puppet, rest):
        deformer = make_deformer(replace(limbed_figure, puppet=puppet))
        return Retargeting(puppet, limbed_figure.mesh, deformer, rest), deformer.bones

    return make


def directions(bones, motions):
    along = np.einsum("bx,bxy->by", bones.tails - bones.heads, motions[:, :3])
    return along / np.linalg.norm(along, axis=1)[:, None]


def wanted(puppet, joints):
    """Directions of the performer's bones, in the order of the limbs."""
    positions = to_character_axes(joints)
    ends = [pair for limb in puppet.limbs for pair in itertools.pairwise(j[0] for j in limb.joints)]
    along = np.array([positions[b] - positions[a] for a, b in ends])
    return along / np.linalg.norm(along, axis=1)[:, None]


def turned(positions, angle):
    """Positions after a turn to the performer's left about the hips, sensor coordinates."""
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
        found = directions(bones, made.step(frame).bones)
        assert_allclose(found[arms], wanted(free, frame.positions)[arms], atol=1e-9)


@pytest.mark.parametrize("scale", ["auto", 1.7])
def test_a_mirroring_puppet_does_what_another_does_for_the_mirrored_performer(
    puppet, retargeting, frames, dance, scale
):
    takes = dance(20)
    takes[10:13, JOINT_INDEX["hand_left"]] = np.nan  # lost on one side only
    ours, _ = retargeting(changed(puppet, retarget=RetargetTable(mirror=True, scale=scale)), takes[0])
    theirs, _ = retargeting(changed(puppet, retarget=RetargetTable(scale=scale)), mirrored(takes[0]))
    for frame, other in zip(frames(takes), frames(mirrored(takes)), strict=True):
        a, b = ours.step(frame), theirs.step(other)
        assert_allclose(a.bones, b.bones, atol=1e-12)
        assert_allclose(a.targets, b.targets, atol=1e-9)
        assert_allclose(a.root, b.root, atol=1e-12)


def test_the_head_of_a_character_turns_as_the_face_of_the_performer(puppet, retargeting, frames, standing):
    """The tracker of faces moves the head and knows its orientation (`capture.trackers.face`)."""
    neck, head = (JOINT_INDEX[name] for name in ("shoulder_center", "head"))
    face, bone = HeadDirection(), standing[head] - standing[neck]
    looks = Rotation.from_rotvec(np.outer(np.clip(np.linspace(0, 2, 60), 0, 1) * 0.6, (-0.4, 0.8, 0.3)))
    (made, _), turns = retargeting(puppet, standing), []
    for frame, look in zip(frames(np.tile(standing, (60, 1, 1))), looks, strict=True):
        known = orientations.unknown()
        known[neck] = look.as_quat()[[3, 0, 1, 2]]
        frame.positions[head] = frame.positions[neck] + face.turned(look.apply(bone), look.as_matrix())
        turns.append(Rotation.from_matrix(made.step(replace(frame, orientations=known)).bones[2, :3].T))
    wanted = Rotation.from_rotvec([-1.0, 1, -1] * looks[-1].as_rotvec())
    assert (turns[-1] * turns[0].inv() * wanted.inv()).magnitude() < np.radians(0.1)


def test_a_full_turn_of_a_performer_who_dances_turns_the_character_once_round(puppet, retargeting, frames, dance):
    angles = np.linspace(0, 2 * np.pi, 60)
    takes = np.array([turned(pose, angle) for pose, angle in zip(dance(60), angles, strict=True)])
    made, _ = retargeting(puppet, takes[0])
    motions = np.array([made.step(frame).bones for frame in frames(takes)])
    heading = np.unwrap(np.arctan2(motions[:, 1, 2, 0], motions[:, 1, 2, 2]))
    assert_allclose(heading - heading[0], angles, atol=1e-6)
    still, _ = retargeting(changed(puppet, root=RootTable(turns=False)), takes[0])
    motions = np.array([still.step(frame).bones for frame in frames(takes)])
    assert np.ptp(np.arctan2(motions[:, 1, 2, 0], motions[:, 1, 2, 2])) < 1e-6


def test_handles_are_carried_by_the_trunk_and_move_against_it(puppet, retargeting, frames, standing):
    """Whichever way the performer faced in the calibration."""
    numeric = changed(puppet, retarget=RetargetTable(scale=1.0))
    nod = standing.copy()
    nod[JOINT_INDEX["head"]] += [0, -0.1, -0.2]  # down and forwards
    takes, start = np.array([standing, nod, turned(nod, 0.5), turned(nod, 1.0)]), None
    for heading in (0.0, 0.7):
        made, bones = retargeting(numeric, turned(standing, heading))
        back = Rotation.from_rotvec([0, -heading, 0])
        aims = [back.apply(made.step(frame).targets - bones.heads[0]) for frame in frames(turned(takes, heading))]
        start = aims[0] if start is None else start
        assert_allclose(aims[0], start, atol=1e-9)
        for aim, angle in zip(aims[1:], (0.0, 0.5, 1.0), strict=True):
            turn = Rotation.from_rotvec([0, angle, 0])
            assert_allclose(aim, turn.apply(np.add(start, [0, -0.1, 0.2])), atol=1e-9)


def test_a_walk_is_scaled_by_the_length_of_the_legs_and_stays_at_the_height_of_the_floor(
    puppet, retargeting, frames, standing
):
    walk = np.tile(standing, (80, 1, 1)) + np.linspace(0, 1, 80)[:, None, None] * [2.0, 0, -3.2]
    made, bones = retargeting(puppet, standing)
    aims = [made.step(frame) for frame in frames(walk)]
    lengths = body.bone_lengths(standing)
    performers = lengths["knee_left"] + lengths["ankle_left"]
    characters = np.mean([bones.lengths[7:9].sum(), bones.lengths[9:11].sum()])
    assert_allclose(aims[-1].root[[0, 2]], characters / performers * np.array([-2.0, 3.2]), rtol=0.02)
    over = [(np.append(bones.tails[b], 1) @ aims[-1].bones[b] + aims[-1].root - bones.tails[b])[1] for b in (8, 10)]
    assert min(over) == pytest.approx(0, abs=1e-9)


FOREARM = 3 + 3 * 6 + 1
"""Column of the left forearm's rotation about its axis, of which the arm hangs, in a BVH file."""


@pytest.fixture(scope="module")
def twisted(tmp_path_factory):
    """The left forearm turns by 150° about its axis within a second, and then stays for another second."""
    rows = np.zeros((61, 3 + 3 * JOINT_COUNT))
    rows[:, FOREARM] = np.minimum(np.arange(61) * 5, 150)
    (clip,) = read_log(body_file(tmp_path_factory.mktemp("log"), rows))
    return clip


def forearm_turns(made, puppet, frames):
    """Rotation vectors (T, 3) of the left forearm, or the right one of a mirroring puppet, since the first frame."""
    side = "right" if puppet.retarget.mirror else "left"
    bone = next(
        number
        for number, joints in enumerate(
            pair[0] for limb in puppet.limbs for pair in itertools.pairwise(j[0] for j in limb.joints)
        )
        if joints == JOINT_INDEX[f"elbow_{side}"]
    )
    turns = Rotation.from_matrix(np.array([made.step(frame).bones[bone, :3].T for frame in frames]))
    return (turns * turns[0].inv()).as_rotvec()


@pytest.mark.parametrize("mirror", [False, True])
def test_a_straight_forearm_turns_about_itself_by_as_much_as_the_performers(puppet, retargeting, twisted, mirror):
    own = changed(puppet, retarget=RetargetTable(mirror=mirror))
    made, _ = retargeting(own, twisted.positions[0])
    found = np.degrees(forearm_turns(made, own, twisted.frames()))
    turn = np.array([0, -5 if mirror else 5, 0])
    assert_allclose(found[-1], 30 * turn, atol=0.01)
    assert_allclose(np.diff(found[10:30], axis=0), np.tile(turn, (19, 1)), atol=0.1)
    made, _ = retargeting(own, twisted.positions[0])
    without = forearm_turns(made, own, [replace(frame, orientations=None) for frame in twisted.frames()])
    assert_allclose(np.degrees(without), 0, atol=1e-6)


def test_after_a_cut_everything_is_as_if_the_motion_began_there(puppet, retargeting, frames, dance):
    takes = dance(60)
    takes[30:] = turned(takes[30:], 2.0) + np.array([3, 0, 1])
    smooth = changed(puppet, smoothing=SmoothingTable())
    made, _ = retargeting(smooth, takes[0])
    anew, _ = retargeting(smooth, takes[0])
    every = list(frames(takes))
    for frame in every[:30]:
        made.step(frame)
    for frame in every[30:]:
        ours, theirs = made.step(frame), anew.step(frame)
        assert_allclose(ours.bones, theirs.bones, atol=1e-12)
        assert_allclose(ours.targets, theirs.targets, atol=1e-12)
        assert_allclose(ours.root, theirs.root, atol=1e-12)
