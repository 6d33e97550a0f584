from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from capture.formats import bvh, bvh_parser
from capture.formats.options import ReadOptions
from capture.skeleton import JOINT_INDEX, PARENTS
from capture.timeline import resample
from puppetline.errors import SkeletonLogError

from .bvh_files import (
    ANIMAL,
    BODY,
    JOINT_COUNT,
    POSITIONS,
    ROTATIONS,
    animal_file,
    body_file,
    clips_of,
    hierarchy,
    motion,
    random_rows,
    write,
)

RIGID_JOINTS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
RIGID = [name for name in PARENTS if name.split("_")[0] in ("knee", "ankle", "elbow", "wrist")]

# Sensor coordinates of the body in its rest pose: it faces the sensor, with the hips at (0, 0, 2.5).
REST_TABLE = """
hip_center      0 0 2.5
spine           0 0.1 2.5
shoulder_center 0 0.5 2.5
head            0 0.7 2.5
shoulder_right  0.18 0.48 2.5
elbow_right     0.18 0.2 2.5
wrist_right     0.18 -0.05 2.5
hand_right      0.18 -0.13 2.5
hip_left        -0.09 -0.05 2.5
knee_left       -0.09 -0.46 2.5
ankle_left      -0.09 -0.87 2.5
foot_left       -0.09 -0.93 2.36
"""
REST = {name: tuple(map(float, place)) for name, *place in map(str.split, REST_TABLE.strip().splitlines())}


def chain_file(folder, channels, row, count=6):
    """Write a chain: the root at (1, 2, 3), a joint 1 further along x, an end 2 further along y and 3 along z."""
    lines = ["HIERARCHY", "ROOT a", "{", "OFFSET 1 2 3", "CHANNELS 0", "JOINT b", "{", "OFFSET 1 0 0"]
    lines += [f"CHANNELS {count} {channels}", "End Site", "{", "OFFSET 0 2 3", "}", "}", "}"]
    lines += ["MOTION", "Frames: 1", "Frame Time: 1", " ".join(map(str, row))]
    return write(folder, lines)


def ends(path):
    nodes, rows, *_ = bvh_parser.parse(path)
    return np.stack(bvh.motion_of(nodes, rows).positions)[:, 0]


def test_channels_may_come_in_any_order_and_rotations_are_those_of_scipy(tmp_path):
    values = dict(zip((*POSITIONS, *ROTATIONS), (1.1, 0.2, 0.3, 31.0, -72.0, 118.0), strict=True))
    for order in list(permutations(values))[::7]:
        axes = [name for name in order if name in ROTATIONS]
        turn = Rotation.from_euler("".join(name[0] for name in axes), [values[name] for name in axes], degrees=True)
        found = ends(chain_file(tmp_path, " ".join(order), [values[name] for name in order]))
        assert_allclose(found[1:], [[2.1, 2.2, 3.3], np.add(turn.apply([0, 2, 3]), [2.1, 2.2, 3.3])], atol=1e-12)


@pytest.mark.parametrize(
    ("channels", "row", "joint"),
    [
        ("Xposition Yposition Zposition", (1.1, 0.2, 0.3), (2.1, 2.2, 3.3)),  # near the offset: replaces it
        ("Xposition Yposition Zposition", (0.1, 0.2, 0.3), (2.1, 2.2, 3.3)),  # near zero: added to it
        ("Yposition", (0.5,), (2, 2.5, 3)),
        ("Xposition", (1.25,), (2.25, 2, 3)),
    ],
)
def test_inner_joints_are_where_their_channels_put_them(tmp_path, channels, row, joint):
    assert_allclose(ends(chain_file(tmp_path, channels, row, len(row)))[1], joint, atol=1e-12)


def test_rest_pose_faces_the_sensor(tmp_path):
    (clip,) = bvh.read(body_file(tmp_path), ReadOptions())
    assert clip.times.tolist() == [0, 0.04]
    assert (clip.confidence == 1).all()
    for name, place in REST.items():
        assert_allclose(clip.positions[:, JOINT_INDEX[name]], [place, place], atol=1e-12)
    assert len(clip.notes) == 4  # with one on a pose without motion
    assert "centimetres; the body is then 1.75 m tall" in clip.notes[0]


@pytest.mark.parametrize("angle", [0, 123, 180, -90])
def test_position_and_facing_in_the_first_frame_do_not_matter(tmp_path, angle):
    rows = np.zeros((2, 3 + 3 * JOINT_COUNT))
    rows[:, :3] = (210, 95, -340)
    rows[:, 4] = angle
    rows[1, 1] += 12
    (clip,) = bvh.read(body_file(tmp_path, rows), ReadOptions())
    for name, (x, y, z) in REST.items():
        assert_allclose(clip.positions[:, JOINT_INDEX[name]], [(x, y, z), (x, y + 0.12, z)], atol=1e-12)


def test_a_turn_after_the_first_frame_is_kept(tmp_path):
    rows = np.zeros((2, 3 + 3 * JOINT_COUNT))
    rows[1, 4] = 90  # turns to its left, which is the sensor's right
    (clip,) = bvh.read(body_file(tmp_path, rows), ReadOptions())
    assert_allclose(clip.positions[1, JOINT_INDEX["foot_left"]], (-0.14, -0.93, 2.59), atol=1e-12)


def test_z_up_equals_y_up(tmp_path):
    rows = random_rows()
    (upright,) = bvh.read(body_file(tmp_path, rows), ReadOptions())
    # (x, y, z) becomes (x, −z, y): positions are swapped, and the rotations about z y x are rotations about −y z x.
    turned = rows.copy()
    turned[:, 1], turned[:, 2] = -rows[:, 2], rows[:, 1]
    turned[:, 3::3] = -rows[:, 3::3]
    channels = ("Yrotation", "Zrotation", "Xrotation")
    path = body_file(tmp_path, turned, "z_up.bvh", z_up=True, channels=channels)
    (converted,) = bvh.read(path, ReadOptions())
    assert_allclose(converted.positions, upright.positions, atol=1e-12)
    (given,) = bvh.read(path, ReadOptions(up="z"))
    assert_array_equal(given.positions, converted.positions)


@pytest.mark.parametrize(
    ("scale", "name"),
    [
        (1, "centimetres"),
        (0.01, "metres"),
        (0.1, "decimetres"),
        (10, "millimetres"),
        (1 / 2.54, "inches"),
        (0.45 / 2.54, "CMU units"),
    ],
)
def test_usual_units_are_found(tmp_path, scale, name):
    (clip,) = bvh.read(body_file(tmp_path, scale=scale), ReadOptions())
    assert any(f"Lengths are assumed to be {name}" in note for note in clip.notes)
    assert_allclose(clip.positions[0, JOINT_INDEX["foot_left"]], REST["foot_left"], atol=1e-9)


def test_other_units_are_scaled_to_a_usual_height_or_given(tmp_path):
    path, head = body_file(tmp_path, scale=0.237), JOINT_INDEX["head"]
    (scaled,), (given,) = (bvh.read(path, ReadOptions(unit=unit)) for unit in (None, 0.02))
    assert_allclose(scaled.positions[0, head, 1], 0.70 * 1.7 / (1.15 * (0.70 + 0.82)), atol=1e-9)
    assert_allclose(given.positions[0, head], (0, 70 * 0.237 * 0.02, 2.5), atol=1e-12)


def test_limbs_are_rigid_and_the_first_frame_faces_the_sensor(tmp_path):
    (clip,) = bvh.read(body_file(tmp_path, random_rows(40)), ReadOptions())
    check_body(clip.positions)


def check_body(positions):
    at = {name: positions[:, index] for name, index in JOINT_INDEX.items()}
    for name in RIGID:
        length = np.linalg.norm(at[name] - at[PARENTS[name]], axis=1)
        assert_allclose(length, length[0], rtol=1e-9)
        assert 0.15 < length[0] < 0.55
    ankles = (at["ankle_left"] + at["ankle_right"]) / 2
    assert ((at["head"] - ankles)[:, 1] > 0.9).all()
    across = (at["hip_right"] - at["hip_left"] + at["shoulder_right"] - at["shoulder_left"])[0]
    assert_allclose(across[2], 0, atol=1e-12)
    assert across[0] > 0.2
    assert_allclose(at["hip_center"][0], (0, 0, 2.5), atol=1e-12)


REAL = {
    "cmu_01_01_hops": (2752, 0.0083333, "CMU units", "y"),
    "jumping_jacks": (125, 0.03333, "CMU units", "y"),
    "kinect2_static": (219, 0.033333, "millimetres", "z"),
    "makehuman_walk1": (14, 0.041667, "decimetres", "z"),
    "wave_hello": (839, 0.008342, "scaled to 1.7 m", "z"),
}


@pytest.mark.parametrize("name", REAL)
def test_real_files_are_human(real_data, name):
    frames, step, unit, up = REAL[name]
    (clip,) = bvh.read(real_data / "bvh" / f"{name}.bvh", ReadOptions())
    begins_with_rest = clip.rest is not None
    assert begins_with_rest == (name == "cmu_01_01_hops")
    assert len(clip.times) == frames - begins_with_rest
    assert clip.times[0] == begins_with_rest * step
    assert unit in clip.notes[0]
    assert f"Up is assumed to be {up}" in clip.notes[1]
    assert any("All frames are equal" in note for note in clip.notes) == (name == "kinect2_static")
    assert (clip.confidence == 1).all()
    check_body(clip.positions)


PROP = ["ROOT Sword", "{", "OFFSET 5 0 0", "CHANNELS 3 Xposition Yposition Zposition", "}"]


def two_roots(folder, first, second, rows, name="two.bvh"):
    return write(folder, ["HIERARCHY", *first, *second, *motion(rows)], name)


def test_a_root_without_a_body_is_skipped_with_a_note(tmp_path, assert_same_frames):
    rows, sword = random_rows(), np.full((6, 3), 9.0)
    (whole,) = clips_of(body_file(tmp_path, rows))
    for path in (
        two_roots(tmp_path, hierarchy(BODY), PROP, np.hstack([rows, sword]), "after.bvh"),
        two_roots(tmp_path, PROP, hierarchy(BODY), np.hstack([sword, rows]), "before.bvh"),
    ):
        (clip,) = clips_of(path)
        assert_same_frames(clip, whole)
        (note,) = set(clip.notes) - set(whole.notes)
        assert "Sword" in note


def test_each_root_that_is_a_body_is_a_performer(tmp_path, assert_same_frames):
    rows = random_rows(6, 3), random_rows(6, 4)
    clips = clips_of(two_roots(tmp_path, hierarchy(BODY), hierarchy(BODY), np.hstack(rows)))
    for user, (clip, own) in enumerate(zip(clips, rows, strict=True)):
        (alone,) = clips_of(body_file(tmp_path, own))
        assert_same_frames(clip, replace(alone, user=user))
        assert clip.notes == alone.notes


def test_roots_that_only_together_are_a_body_are_one_performer(tmp_path, assert_same_frames):
    name, offset, (spine, left, right) = BODY
    (whole,) = clips_of(body_file(tmp_path, np.zeros((2, 3 + 3 * JOINT_COUNT))))
    legs = hierarchy((name, offset, [left, right]))
    apart = hierarchy(("Spine", (0, 10, 0), spine[2]))
    (clip,) = clips_of(two_roots(tmp_path, legs, apart, np.zeros((2, 6 + 3 * JOINT_COUNT))))
    assert_array_equal(clip.positions, whole.positions)
    assert clip.notes == whole.notes


def test_of_joints_of_one_name_the_first_is_used_and_a_limb_without_end_site_as_long_as_its_joints(tmp_path):
    lines = ["HIERARCHY", *hierarchy(BODY), *motion(random_rows())]
    (whole,) = clips_of(write(tmp_path, lines))
    fingers = ["JOINT LeftHand", "{", "OFFSET 0 -1 0", "CHANNELS 0", "}"]
    place = lines.index("End Site", lines.index("JOINT LeftHand"))
    (clip,) = clips_of(write(tmp_path, [*lines[:place], *lines[place : place + 4], *fingers, *lines[place + 4 :]]))
    assert_array_equal(clip.positions, whole.positions)
    (note,) = set(clip.notes) - set(whole.notes)
    assert "LeftHand" in note
    (clip,) = clips_of(write(tmp_path, [*lines[:place], *lines[place + 4 :]]))
    others = [index for name, index in JOINT_INDEX.items() if name != "hand_left"]
    assert_array_equal(clip.positions[:, others], whole.positions[:, others])
    assert (clip.confidence[:, JOINT_INDEX["hand_left"]] == 0).all()
    (note,) = set(clip.notes) - set(whole.notes)
    assert "hand_left" in note


def test_bodies_that_cannot_be_placed_are_refused(tmp_path):
    lying = np.zeros((2, 3 + 3 * JOINT_COUNT))
    lying[:, 3] = 90  # on its side
    for path, options in (
        (body_file(tmp_path, lying, "lying.bvh"), {"up": "y"}),
        (two_roots(tmp_path, PROP, PROP, np.zeros((2, 6))), {}),
    ):
        with pytest.raises(SkeletonLogError) as caught:
            clips_of(path, **options)
        assert caught.value.where == str(path)


def test_recognises_its_keyword_and_nothing_else():
    assert bvh.matches(b"\xef\xbb\xbfHierarchy\nROOT a\n")
    assert not bvh.matches(b"")
    assert not bvh.matches(b"HIERARCHYX\n")


def test_the_orientation_of_a_bone_is_how_it_turns_from_the_pose_of_its_offsets(tmp_path):
    (clip,) = bvh.read(body_file(tmp_path, random_rows()), ReadOptions(unit=0.01))
    for joint, end in (("elbow_left", "wrist_left"), ("hip_right", "knee_right"), ("wrist_left", "hand_left")):
        turns = Rotation.from_quat(clip.orientations[:, JOINT_INDEX[joint]][:, [1, 2, 3, 0]])
        along = clip.positions[:, JOINT_INDEX[end]] - clip.positions[:, JOINT_INDEX[joint]]
        # the offsets of these bones point down in the file's axes, whatever the sensor's are
        assert_allclose(turns.apply([0, -1, 0]), along / np.linalg.norm(along, axis=1)[:, None], atol=1e-6)
    assert np.isnan(clip.orientations[:, JOINT_INDEX["hand_left"]]).all()


def test_a_forearm_that_turns_about_itself_moves_no_joint_but_its_orientation(tmp_path):
    rows = np.zeros((3, 3 + 3 * JOINT_COUNT))
    rows[:, 3 + 3 * 6 + 1] = [0, 40, 80]  # LeftForeArm is the seventh joint, y the second channel
    (clip,) = bvh.read(body_file(tmp_path, rows), ReadOptions())
    assert_allclose(clip.positions, np.broadcast_to(clip.positions[0], clip.positions.shape), atol=1e-12)
    turns = Rotation.from_quat(clip.orientations[:, JOINT_INDEX["elbow_left"]][:, [1, 2, 3, 0]])
    angles = np.degrees((turns * turns[0].inv()).as_rotvec())
    assert_allclose(angles, [[0, 0, 0], [0, 40, 0], [0, 80, 0]], atol=1e-9)


def test_motion_of_another_skeleton_is_called_so(tmp_path):
    rows = np.pad(random_rows(), ((0, 0), (0, 6)))
    with pytest.raises(SkeletonLogError) as caught:
        clips_of(write(tmp_path, ["HIERARCHY", *hierarchy(BODY), *motion(rows)]))
    assert caught.value.found.startswith(f"{rows.shape[1]} numbers in most frames")


@pytest.mark.parametrize(
    ("height", "way", "z_up", "turn"),
    [
        *(((*motion, *axes)) for motion in ((22, 120), (45, 400)) for axes in ((False, 90), (False, -90), (True, 90))),
        (139, 400, False, 90),  # the floor is at 94
    ],
)
def test_a_body_that_crawls_lies_on_the_floor_of_the_file(tmp_path, z_up, turn, height, way):
    rows = np.zeros((40, 3 + 3 * JOINT_COUNT))
    rows[:, 5] = turn  # face down or up
    rows[:, 2 if not z_up else 1] = np.linspace(0, -way, 40)
    rows[:, 1 if not z_up else 2] = height
    rows[:, [3 + 3 * 17 + 2, 3 + 3 * 13 + 2]] = 9 * np.sin(np.arange(40))[:, None]  # knees
    (clip,) = clips_of(body_file(tmp_path, rows, z_up=z_up))
    trunk = clip.positions[:, JOINT_INDEX["shoulder_center"]] - clip.positions[:, JOINT_INDEX["hip_center"]]
    assert_allclose(trunk[:, 1], 0, atol=1e-9)
    assert any("from the floor" in note for note in clip.notes)
    across = clip.positions[:, JOINT_INDEX["hip_right"]] - clip.positions[:, JOINT_INDEX["hip_left"]]
    toes = clip.positions[:, JOINT_INDEX["foot_left"]] - clip.positions[:, JOINT_INDEX["ankle_left"]]
    assert (np.einsum("ti,ti->t", np.cross(across, trunk), toes) < 0).all()  # not mirrored


def test_no_frames_are_a_pose(tmp_path):
    (clip,) = clips_of(body_file(tmp_path, np.zeros((0, 3 + 3 * JOINT_COUNT))))
    (pose,) = clips_of(body_file(tmp_path, np.zeros((1, 3 + 3 * JOINT_COUNT))))
    assert_array_equal(clip.positions, pose.positions)


def test_the_toes_of_a_body_that_kneels_do_not_tell_its_front(tmp_path):
    rows = np.zeros((4, 3 + 3 * JOINT_COUNT))
    for knee, foot in ((13, 14), (17, 18)):
        rows[:, [3 + 3 * knee + 2, 3 + 3 * foot + 2]] = [100, 60]  # shins and feet lie behind the knees
    (clip,) = clips_of(body_file(tmp_path, rows))
    assert not any("left-handed" in note for note in clip.notes)
    assert clip.positions[0, JOINT_INDEX["ankle_left"], 2] > clip.positions[0, JOINT_INDEX["knee_left"], 2] + 0.3


def test_a_person_who_sits_and_reaches_forward_is_no_animal(tmp_path):
    rows = np.zeros((3, 3 + 3 * JOINT_COUNT))
    names = [line.split()[1] for line in hierarchy(BODY) if line.split()[0] in ("ROOT", "JOINT")]
    for name in ("LeftArm", "RightArm", "LeftUpLeg", "RightUpLeg"):
        rows[:, 3 + 3 * names.index(name) + 2] = -90  # degrees about x: hanging limbs point forward
    [clip] = bvh.read(body_file(tmp_path, rows), ReadOptions())
    for joint in ("wrist_left", "wrist_right", "ankle_left", "ankle_right"):
        root = joint.replace("wrist", "shoulder").replace("ankle", "hip")
        way = clip.positions[:, JOINT_INDEX[joint]] - clip.positions[:, JOINT_INDEX[root]]
        np.testing.assert_allclose(way / np.linalg.norm(way, axis=1, keepdims=True), [[0, 0, -1]] * 3, atol=1e-6)


def test_frames_whose_numbers_are_not_known_are_omitted(tmp_path):
    rows = random_rows(6)
    [whole] = bvh.read(body_file(tmp_path, rows), ReadOptions())
    rows[2, 4] = np.nan
    [clip] = bvh.read(body_file(tmp_path, rows), ReadOptions())
    kept = [0, 1, 3, 4, 5]
    assert_allclose(clip.times, whole.times[kept])
    assert_allclose(clip.positions, whole.positions[kept], atol=1e-9)
    assert "In 1 of 6 frames, numbers are not known. These are omitted." in clip.notes
    rows[:] = np.nan
    with pytest.raises(SkeletonLogError, match="no frame whose numbers are all known"):
        bvh.read(body_file(tmp_path, rows), ReadOptions())


def test_ends_of_joints_with_positions_only_are_nowhere(tmp_path):
    """As in files that some converters of positions write: each joint hangs on the hips, with the same end."""
    rows = random_rows(5)
    nodes, motion_rows, *_ = bvh_parser.parse(body_file(tmp_path, rows))
    moving = bvh.motion_of(nodes, motion_rows)
    named = [at for at, name in enumerate(moving.names) if name and "Toe" not in name]
    lines = ["HIERARCHY", "ROOT Hips", "{", "OFFSET 0 0 0", f"CHANNELS 6 {' '.join((*POSITIONS, *ROTATIONS))}"]
    columns = [moving.positions[0], np.zeros((5, 3))]
    for at in named[1:]:
        lines += [f"JOINT {moving.names[at]}", "{", "OFFSET 0 0 0", f"CHANNELS 3 {' '.join(POSITIONS)}"]
        lines += ["End Site", "{", "OFFSET 0 10 0", "}", "}"]
        columns.append(moving.positions[at] - moving.positions[0])
    lines += ["}", *motion(np.concatenate(columns, axis=1))]
    [clip] = bvh.read(write(tmp_path, lines), ReadOptions())
    [whole] = bvh.read(body_file(tmp_path, rows), ReadOptions())
    assert np.isnan(clip.positions[:, JOINT_INDEX["foot_left"]]).all()
    for joint in RIGID:
        tip, root = JOINT_INDEX[joint], JOINT_INDEX[PARENTS[joint]]
        assert_allclose(*(each.positions[:, tip] - each.positions[:, root] for each in (clip, whole)), atol=1e-6)


def test_a_four_legged_skeleton_is_an_animal_if_one_is_asked_for(tmp_path):
    path = animal_file(tmp_path)
    with pytest.raises(SkeletonLogError, match="a four-legged skeleton: no performer"):
        bvh.read(path, ReadOptions())
    [clip] = bvh.read(path, ReadOptions(animals=True))
    [person] = bvh.read(path, ReadOptions(as_person=True, animals=True))
    assert (clip.legs, person.legs, resample(clip).legs) == (4, 2, 4)
    assert_allclose(clip.positions, person.positions)
    assert any("four-legged" in note for note in clip.notes)


def test_an_end_far_from_its_hand_is_no_tip(tmp_path):
    lines = ["HIERARCHY", *hierarchy(BODY), *motion(np.zeros((2, 3 + 3 * JOINT_COUNT)))]
    hand = next(k for k, line in enumerate(lines) if line.endswith("JOINT RightHand"))
    end = next(k for k in range(hand, len(lines)) if lines[k] == "End Site")
    lines[end + 2] = "OFFSET 161 0 0"
    [clip] = bvh.read(write(tmp_path, lines), ReadOptions())
    [whole] = bvh.read(body_file(tmp_path), ReadOptions())
    assert np.isnan(clip.positions[:, JOINT_INDEX["hand_right"]]).all()
    others = [at for name, at in JOINT_INDEX.items() if name != "hand_right"]
    assert_allclose(clip.positions[:, others], whole.positions[:, others], atol=1e-9)


def test_animals_whose_joints_have_other_names_are_known_by_their_shape(tmp_path):
    rows = np.zeros((4, 3 + 3 * sum(line.split()[0] in ("ROOT", "JOINT") for line in hierarchy(ANIMAL))))
    rows[:, 3:] = np.random.default_rng(1).uniform(-12, 12, rows[:, 3:].shape)
    lines = hierarchy(ANIMAL)
    [named] = bvh.read(write(tmp_path, ["HIERARCHY", *lines, *motion(rows)]), ReadOptions(animals=True))
    numbered = [
        f"{line.split()[0]} b{k}" if line.split()[0] in ("ROOT", "JOINT") else line for k, line in enumerate(lines)
    ]
    path = write(tmp_path, ["HIERARCHY", *numbered, *motion(rows)], "numbered.bvh")
    with pytest.raises(SkeletonLogError, match="a four-legged skeleton: no performer"):
        bvh.read(path, ReadOptions())
    [clip] = bvh.read(path, ReadOptions(animals=True))
    assert clip.legs == 4
    limbs = [JOINT_INDEX[f"{joint}_{side}"] for joint in RIGID_JOINTS for side in ("left", "right")]
    assert_allclose(clip.positions[:, limbs], named.positions[:, limbs], atol=1e-9)


def test_a_performer_may_lie_on_the_side_in_the_first_frame(tmp_path):
    rows = np.zeros((5, 3 + 3 * JOINT_COUNT))
    rows[:, 1] = 90
    [whole] = bvh.read(body_file(tmp_path, rows), ReadOptions(up="y"))
    rows[:2, 3] = 90, 89.9  # about z, from side to side
    [clip] = bvh.read(body_file(tmp_path, rows), ReadOptions(up="y"))
    assert_allclose(clip.positions[-3:], whole.positions[-3:], atol=1e-9)
    rows[:, 3] = 90
    with pytest.raises(SkeletonLogError, match="the left-to-right line of hips and shoulders points up"):
        bvh.read(body_file(tmp_path, rows), ReadOptions(up="y"))
