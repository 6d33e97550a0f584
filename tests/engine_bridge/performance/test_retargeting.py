from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from capture import body, orientations
from capture.skeleton import JOINT_INDEX, mirrored
from capture.trackers.face import HeadDirection
from engine_bridge.performance.character_motion import make_deformer
from engine_bridge.performance.retargeting import Retargeting
from engine_bridge.puppet.puppet import RetargetTable, RootTable, SmoothingTable

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


def turned(positions, angle):
    """Positions after a turn to the performer's left about the hips, sensor coordinates."""
    hips = positions[..., [JOINT_INDEX["hip_center"]], :]
    return (positions - hips) @ Rotation.from_rotvec([0, angle, 0]).as_matrix().T + hips


def changed(puppet, **tables):
    return puppet.model_copy(update=tables)


def assert_same_pose(one, other):
    for name, tolerance in (("bones", 1e-12), ("targets", 1e-9), ("root", 1e-12)):
        assert_allclose(getattr(one, name), getattr(other, name), atol=tolerance)


@pytest.mark.parametrize("scale", ["auto", 1.7])
def test_a_mirroring_puppet_does_what_another_does_for_the_mirrored_performer(
    puppet, retargeting, frames, dance, scale
):
    takes = dance(20)
    takes[10:13, JOINT_INDEX["hand_left"]] = np.nan  # lost on one side only
    ours, _ = retargeting(changed(puppet, retarget=RetargetTable(mirror=True, scale=scale)), takes[0])
    theirs, _ = retargeting(changed(puppet, retarget=RetargetTable(scale=scale)), mirrored(takes[0]))
    for frame, other in zip(frames(takes), frames(mirrored(takes)), strict=True):
        assert_same_pose(ours.step(frame), theirs.step(other))


@pytest.mark.parametrize(("mirror", "axes"), [(False, [-1, 1, -1]), (True, [-1, -1, 1])])
def test_the_head_of_a_character_turns_as_the_face_of_the_performer(
    puppet, retargeting, frames, standing, mirror, axes
):
    """The tracker of faces moves the head and knows its orientation (`capture.trackers.face`)."""
    neck, head = (JOINT_INDEX[name] for name in ("shoulder_center", "head"))
    face, bone = HeadDirection(), standing[head] - standing[neck]
    looks = Rotation.from_rotvec(np.outer(np.clip(np.linspace(0, 2, 60), 0, 1) * 0.6, (-0.4, 0.8, 0.3)))
    (made, _), turns = retargeting(changed(puppet, retarget=RetargetTable(mirror=mirror)), standing), []
    for frame, look in zip(frames(np.tile(standing, (60, 1, 1))), looks, strict=True):
        known = orientations.unknown()
        known[neck] = look.as_quat()[[3, 0, 1, 2]]
        frame.positions[head] = frame.positions[neck] + face.turned(look.apply(bone), look.as_matrix())
        turns.append(Rotation.from_matrix(made.step(replace(frame, orientations=known)).bones[2, :3].T))
    wanted = Rotation.from_rotvec(axes * looks[-1].as_rotvec())
    assert (turns[-1] * turns[0].inv() * wanted.inv()).magnitude() < np.radians(0.1)


@pytest.mark.parametrize("turns", [True, False])
def test_a_full_turn_of_a_performer_who_dances_turns_the_character_once_round(
    puppet, retargeting, frames, dance, turns
):
    """Unless the puppet does not turn."""
    angles = np.linspace(0, 2 * np.pi, 60)
    takes = np.array([turned(pose, angle) for pose, angle in zip(dance(60), angles, strict=True)])
    made, _ = retargeting(changed(puppet, root=RootTable(turns=turns)), takes[0])
    front = np.array([made.step(frame).bones[1, 2] for frame in frames(takes)])
    heading = np.unwrap(np.arctan2(front[:, 0], front[:, 2]))
    assert_allclose(heading - heading[0], angles * turns, atol=1e-6)


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
    walk = standing + np.linspace(0, 1, 80)[:, None, None] * [2.0, 0, -3.2]
    made, bones = retargeting(puppet, standing)
    *_, last = map(made.step, frames(walk))
    lengths = body.bone_lengths(standing)
    ratio = bones.lengths[7:11].sum() / 2 / (lengths["knee_left"] + lengths["ankle_left"])
    assert_allclose(last.root[[0, 2]], ratio * np.array([-2.0, 3.2]), rtol=0.02)
    over = [(np.append(bones.tails[b], 1) @ last.bones[b] + last.root - bones.tails[b])[1] for b in (8, 10)]
    assert min(over) == pytest.approx(0, abs=1e-9)


def test_after_a_cut_everything_is_as_if_the_motion_began_there(puppet, retargeting, frames, dance):
    takes, smooth = dance(60), changed(puppet, smoothing=SmoothingTable())
    takes[30:] = turned(takes[30:], 2.0) + np.array([3, 0, 1])
    (made, _), (anew, _) = (retargeting(smooth, takes[0]) for _ in range(2))
    every = frames(takes)
    for frame in every[:30]:
        made.step(frame)
    for frame in every[30:]:
        assert_same_pose(made.step(frame), anew.step(frame))
