"""Bodies that no person has are refused or have a note; those of persons have none."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy
from numpy.testing import assert_array_equal

from capture.formats import read_log
from capture.formats.clips import build_clip
from capture.formats.plausibility import checked
from capture.skeleton import JOINT_INDEX, JOINTS, PARENTS
from puppetline.errors import SkeletonLogError

from ...recordings import record
from ..bodies import both
from .people import person

PATH = Path("take")


def clip_of(poses):
    return build_clip(PATH, "table", np.arange(len(poses)) / 30, poses, np.ones(poses.shape[:2], np.float32), ("one",))


def with_sides_of_legs_swapped(poses):
    legs = np.reshape(both("hip", "knee", "ankle", "foot"), (4, 2))
    poses[:, legs] = poses[:, legs[:, ::-1]]
    return poses


def with_head_below(poses):
    poses[:, JOINT_INDEX["head"]] = poses[:, JOINT_INDEX["shoulder_center"]] - [0, 0.2, 0]
    return poses


def with_broken_knees(poses):
    poses[:, both("knee"), 2] += 0.3
    return poses


def with_thighs_back(poses):
    poses[:, both("knee")] = poses[:, both("hip")] + [0, 0, 0.48]
    poses[:, both("ankle")] = poses[:, both("knee")] + [0, -0.38, 0]
    return poses


def turned(poses, degrees, axis="z"):
    turn = scipy.spatial.transform.Rotation.from_euler(axis, degrees, degrees=True)
    return turn.apply(poses.reshape(-1, 3)).reshape(poses.shape)


@pytest.mark.parametrize(
    ("contort", "thing"),
    [
        (with_sides_of_legs_swapped, "shoulders face away from where the hips face in 100 % of the frames"),
        (with_head_below, "the head is below the shoulders in 100 % of the frames"),
        (with_broken_knees, "knees bend forwards in 100 % of the frames"),
        (with_thighs_back, "thighs point backwards in 100 % of the frames"),
    ],
)
def test_a_contorted_body_is_refused_and_has_a_note_if_only_some_frames_have_it(contort, thing):
    with pytest.raises(SkeletonLogError) as error:
        checked(PATH, [clip_of(contort(person(10)))])
    assert thing in error.value.found
    some = np.concatenate([person(6), contort(person(4))])
    (clip,) = checked(PATH, [clip_of(some)])
    assert_array_equal(clip.positions, some)
    assert clip.notes[0] == "one"
    assert thing.replace("100", "40") in clip.notes[1]
    few = np.concatenate([person(9), contort(person(1))])
    assert checked(PATH, [clip_of(few)])[0].notes == ("one",)


def test_another_person_of_the_recording_may_be_contorted():
    one, other = clip_of(person(5)), replace(clip_of(with_broken_knees(person(5))), user=1)
    first, second = checked(PATH, [one, other])
    assert first.notes == one.notes
    assert "knees bend forwards in 100 % of the frames" in second.notes[-1]


@pytest.mark.parametrize(("degrees", "axis"), [(37, "z"), (-90, "z"), (30, "x")])
def test_a_stretched_body_that_leans_as_nobody_stands_has_a_note(degrees, axis):
    poses = turned(person(5), degrees, axis)
    (clip,) = checked(PATH, [clip_of(poses)])
    body = poses[0, JOINT_INDEX["head"]] - poses[0, both("ankle")].mean(axis=0)
    lean = np.degrees(np.arccos(body[1] / np.linalg.norm(body)))
    (note,) = clip.notes[1:]
    assert f"leans {lean:.0f}° from upright" in note
    for axis_of_a_stand in ("y", axis):
        upright = turned(person(5), 15, axis_of_a_stand)
        assert checked(PATH, [clip_of(upright)])[0].notes == ("one",)


def test_frames_of_different_people_and_bones_of_other_length_have_a_note():
    sizes = np.where(np.arange(20) % 2, 1.0, 1.2)[:, None, None]
    (clip,) = checked(PATH, [clip_of(person(20) * sizes)])
    assert clip.notes[1:] == (
        "Bones change their length by 20 % from frame to frame. The tracking failed, or they are different people.",
    )
    poses = person(5)
    poses[:, both("wrist", "hand")] += 3 * np.tile(poses[:, both("wrist")] - poses[:, both("elbow")], (1, 2, 1))
    (clip,) = checked(PATH, [clip_of(poses)])
    assert clip.notes[1:] == (
        "The proportions are not those of a person: elbow_left to wrist_left 4 times a person's, "
        "elbow_right to wrist_right 4 times a person's.",
    )


def test_files_are_checked_but_not_own_takes_whose_joints_are_no_guess(tmp_path):
    poses = with_sides_of_legs_swapped(person(3)).round(5)
    header = ",".join(f"{joint}_{axis}" for joint in JOINTS for axis in "xyz")
    np.savetxt(tmp_path / "take.csv", poses.reshape(3, -1), delimiter=",", header=header, comments="")
    with pytest.raises(SkeletonLogError, match="shoulders face away"):
        read_log(tmp_path / "take.csv")
    (clip,) = read_log(record(tmp_path / "take.log", list(clip_of(poses).frames())))
    assert_array_equal(clip.positions, poses)


def test_bones_that_become_longer_and_shorter_have_a_note():
    poses, still = person(40), person(40)
    for index, (joint, parent) in enumerate(PARENTS.items()):
        here, before = JOINT_INDEX[joint], JOINT_INDEX[parent]
        factor = 1.5 ** np.sin(np.linspace(0, 6.28, 40) + index)[:, None]
        poses[:, here] = poses[:, before] + factor * (still[:, here] - still[:, before])
    (clip,) = checked(PATH, [clip_of(poses)])
    assert re.fullmatch("Bones change their length by [5-9][0-9] % over the recording. .*", clip.notes[1])


def test_people_of_any_size_are_people_and_what_has_other_proportions_in_each_frame_is_none():
    rng = np.random.default_rng(0)
    people = person(20) * rng.uniform(0.5, 2, (20, 1, 1))
    assert_array_equal(checked(PATH, [clip_of(people)])[0].positions, people)
    others = person(20) * rng.uniform(0.4, 1.6, (20, 20, 1))
    with pytest.raises(SkeletonLogError, match=r"a body whose proportions change by \d+ % from frame to frame"):
        checked(PATH, [clip_of(others)])
    with pytest.raises(SkeletonLogError, match="a contorted body"):  # few frames may be pictures of anything
        checked(PATH, [clip_of(others[:19])])


def test_sides_that_differ_have_a_note():
    poses = person(5)
    knee, ankle, foot = (JOINT_INDEX[f"{joint}_left"] for joint in ("knee", "ankle", "foot"))
    poses[:, [ankle, foot]] += 0.9 * (poses[:, [ankle]] - poses[:, [knee]])
    (clip,) = checked(PATH, [clip_of(poses)])
    assert clip.notes[1:] == (
        "The sides of the body differ: ankle is 1.9 times as far from knee on one side. "
        "The tracking failed, or joints are swapped.",
    )
