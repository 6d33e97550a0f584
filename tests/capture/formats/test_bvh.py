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

from ..bodies import table
from .bvh_files import (
    ANIMAL,
    BODY,
    POSITIONS,
    ROTATIONS,
    animal_lines,
    hierarchy,
    joints_in,
    lines_of,
    motion,
    random_rows,
    still,
)
from .people import LIMBS

RIGID = [name for name in PARENTS if name.split("_")[0] in ("knee", "ankle", "elbow", "wrist")]

# Sensor coordinates of the body in its rest pose: it faces the sensor, with the hips at (0, 0, 2.5).
REST = table("""
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
""")


@pytest.fixture
def clip_of(read):
    """Read the clip of lines, or of rows of the body's motion."""

    def of(content, **options):
        [clip] = read(bvh, lines_of(content) if isinstance(content, np.ndarray) else content, **options)
        return clip

    return of


def column(joint, axis):
    """Return the column of a joint's rotation about an axis."""
    return 3 + 3 * joints_in(hierarchy(BODY)).index(joint) + "zyx".index(axis)


def at(clip, joint):
    return clip.positions[:, JOINT_INDEX[joint]]


def way(clip, joint, parent):
    return at(clip, joint) - at(clip, parent)


def new_note(clip, whole):
    """Return the only note that another clip does not have."""
    [note] = set(clip.notes) - set(whole.notes)
    return note


def ends(tmp_path, channels, row):
    """Return joints of a chain: the root at (1, 2, 3), a joint 1 further along x, an end 2 along y and 3 along z."""
    lines = ["HIERARCHY", "ROOT a", "{", "OFFSET 1 2 3", "CHANNELS 0", "JOINT b", "{", "OFFSET 1 0 0"]
    lines += [f"CHANNELS {len(row)} {' '.join(channels)}", "End Site", "{", "OFFSET 0 2 3", "}", "}", "}"]
    (tmp_path / "take").write_text("\n".join([*lines, *motion(np.array([row]))]))
    nodes, rows, *_ = bvh_parser.parse(tmp_path / "take")
    return np.stack(bvh.motion_of(nodes, rows).positions)[1:, 0]


def test_channels_may_come_in_any_order_and_rotations_are_those_of_scipy(tmp_path):
    values = dict(zip((*POSITIONS, *ROTATIONS), (1.1, 0.2, 0.3, 31.0, -72.0, 118.0), strict=True))
    for order in list(permutations(values))[::7]:
        axes = [name for name in order if name in ROTATIONS]
        turn = Rotation.from_euler("".join(name[0] for name in axes), [values[name] for name in axes], degrees=True)
        found = ends(tmp_path, order, [values[name] for name in order])
        assert_allclose(found, [[2.1, 2.2, 3.3], np.add(turn.apply([0, 2, 3]), [2.1, 2.2, 3.3])], atol=1e-12)


@pytest.mark.parametrize(
    ("channels", "row", "joint"),
    [
        (POSITIONS, (1.1, 0.2, 0.3), (2.1, 2.2, 3.3)),  # near the offset: replaces it
        (POSITIONS, (0.1, 0.2, 0.3), (2.1, 2.2, 3.3)),  # near zero: added to it
        (["Yposition"], (0.5,), (2, 2.5, 3)),
        (["Xposition"], (1.25,), (2.25, 2, 3)),
    ],
)
def test_inner_joints_are_where_their_channels_put_them(tmp_path, channels, row, joint):
    assert_allclose(ends(tmp_path, channels, row)[0], joint, atol=1e-12)


@pytest.mark.parametrize("angle", [None, 0, 123, 180, -90])
def test_the_first_frame_faces_the_sensor_wherever_it_is(clip_of, angle):
    rows = still()
    if angle is not None:
        rows[:, :3], rows[:, 4] = (210, 95, -340), angle
        rows[1, 1] += 12
    clip = clip_of(rows)
    assert clip.times.tolist() == [0, 0.04]
    assert (clip.confidence == 1).all()
    rise = 0 if angle is None else 0.12
    for name, (x, y, z) in REST.items():
        assert_allclose(at(clip, name), [(x, y, z), (x, y + rise, z)], atol=1e-12)
    assert len(clip.notes) == (4 if angle is None else 3)  # with one on a pose without motion
    assert "centimetres; the body is then 1.75 m tall" in clip.notes[0]


def test_a_turn_after_the_first_frame_is_kept(clip_of):
    rows = still()
    rows[1, 4] = 90  # turns to its left, which is the sensor's right
    assert_allclose(at(clip_of(rows), "foot_left")[1], (-0.14, -0.93, 2.59), atol=1e-12)


def test_z_up_equals_y_up(clip_of):
    rows = random_rows()
    # (x, y, z) becomes (x, −z, y): positions are swapped, and the rotations about z y x are rotations about −y z x.
    turned = rows.copy()
    turned[:, 1], turned[:, 2] = -rows[:, 2], rows[:, 1]
    turned[:, 3::3] = -rows[:, 3::3]
    lines = lines_of(turned, z_up=True, channels=("Yrotation", "Zrotation", "Xrotation"))
    converted = clip_of(lines)
    assert_allclose(converted.positions, clip_of(rows).positions, atol=1e-12)
    assert_array_equal(clip_of(lines, up="z").positions, converted.positions)


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
def test_usual_units_are_found(clip_of, scale, name):
    clip = clip_of(lines_of(still(), scale=scale))
    assert any(f"Lengths are assumed to be {name}" in note for note in clip.notes)
    assert_allclose(at(clip, "foot_left")[0], REST["foot_left"], atol=1e-9)


def test_other_units_are_scaled_to_a_usual_height_or_given(clip_of):
    lines = lines_of(still(), scale=0.237)
    assert_allclose(at(clip_of(lines), "head")[0, 1], 0.70 * 1.7 / (1.15 * (0.70 + 0.82)), atol=1e-9)
    assert_allclose(at(clip_of(lines, unit=0.02), "head")[0], (0, 70 * 0.237 * 0.02, 2.5), atol=1e-12)


def test_limbs_are_rigid_and_the_first_frame_faces_the_sensor(clip_of):
    check_body(clip_of(random_rows(40)))


def check_body(clip):
    for name in RIGID:
        length = np.linalg.norm(way(clip, name, PARENTS[name]), axis=1)
        assert_allclose(length, length[0], rtol=1e-9)
        assert 0.15 < length[0] < 0.55
    ankles = (at(clip, "ankle_left") + at(clip, "ankle_right")) / 2
    assert ((at(clip, "head") - ankles)[:, 1] > 0.9).all()
    across = (way(clip, "hip_right", "hip_left") + way(clip, "shoulder_right", "shoulder_left"))[0]
    assert_allclose(across[2], 0, atol=1e-12)
    assert across[0] > 0.2
    assert_allclose(at(clip, "hip_center")[0], (0, 0, 2.5), atol=1e-12)


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
    check_body(clip)


PROP = ["ROOT Sword", "{", "OFFSET 5 0 0", "CHANNELS 3 Xposition Yposition Zposition", "}"]
SWORD = np.full((6, 3), 9.0)


def two_roots(first, second, rows):
    return ["HIERARCHY", *first, *second, *motion(rows)]


def test_a_root_without_a_body_is_skipped_with_a_note(clip_of, assert_same_frames):
    rows = random_rows()
    whole = clip_of(rows)
    for lines in (
        two_roots(hierarchy(BODY), PROP, np.hstack([rows, SWORD])),
        two_roots(PROP, hierarchy(BODY), np.hstack([SWORD, rows])),
    ):
        clip = clip_of(lines)
        assert_same_frames(clip, whole)
        assert "Sword" in new_note(clip, whole)


def test_each_root_that_is_a_body_is_a_performer(read, clip_of, assert_same_frames):
    rows = random_rows(6, 3), random_rows(6, 4)
    clips = read(bvh, two_roots(hierarchy(BODY), hierarchy(BODY), np.hstack(rows)))
    for user, (clip, alone) in enumerate(zip(clips, map(clip_of, rows), strict=True)):
        assert_same_frames(clip, replace(alone, user=user))
        assert clip.notes == alone.notes


def test_roots_that_only_together_are_a_body_are_one_performer(clip_of):
    name, offset, (spine, left, right) = BODY
    legs, apart = hierarchy((name, offset, [left, right])), hierarchy(("Spine", (0, 10, 0), spine[2]))
    clip, whole = clip_of(two_roots(legs, apart, np.pad(still(), ((0, 0), (0, 3))))), clip_of(still())
    assert_array_equal(clip.positions, whole.positions)
    assert clip.notes == whole.notes


def test_of_joints_of_one_name_the_first_is_used_and_a_limb_without_end_site_as_long_as_its_joints(clip_of):
    lines = lines_of(random_rows())
    whole = clip_of(lines)
    fingers = ["JOINT LeftHand", "{", "OFFSET 0 -1 0", "CHANNELS 0", "}"]
    place = lines.index("End Site", lines.index("JOINT LeftHand"))
    clip = clip_of([*lines[: place + 4], *fingers, *lines[place + 4 :]])
    assert_array_equal(clip.positions, whole.positions)
    assert "LeftHand" in new_note(clip, whole)
    clip = clip_of([*lines[:place], *lines[place + 4 :]])
    assert_without(clip, whole, "hand_left")
    assert (clip.confidence[:, JOINT_INDEX["hand_left"]] == 0).all()
    assert "hand_left" in new_note(clip, whole)


def assert_without(clip, whole, joint):
    expected = whole.positions.copy()
    expected[:, JOINT_INDEX[joint]] = np.nan
    assert_allclose(clip.positions, expected, atol=1e-9)


def lying(*angles):
    """Return a body that lies on its side, at these angles, in the first frames."""
    rows = still(5)
    rows[:, 1] = 90
    rows[: len(angles), 3] = angles
    return rows


@pytest.mark.parametrize(
    ("lines", "options", "place", "found"),
    [
        (lines_of(lying(*[90] * 5)), {"up": "y"}, "", "the left-to-right line of hips and shoulders points up"),
        (two_roots(PROP, PROP, np.zeros((2, 6))), {}, "", ""),
        (lines_of(np.pad(random_rows(), ((0, 0), (0, 6)))), {}, ", line 125", "69 numbers in most frames"),
        (lines_of(np.full_like(still(), np.nan)), {}, "", "no frame whose numbers are all known"),
        (animal_lines(), {}, "", "a four-legged skeleton: no performer"),
    ],
    ids=["it lies", "no body", "motion of another skeleton", "unknown numbers", "an animal"],
)
def test_motion_without_a_person_is_called_what_it_is(read, tmp_path, lines, options, place, found):
    with pytest.raises(SkeletonLogError) as caught:
        read(bvh, lines, **options)
    assert caught.value.where == f"{tmp_path / 'take'}{place}"
    assert found in caught.value.found


def test_recognises_its_keyword_and_nothing_else():
    assert bvh.matches(b"\xef\xbb\xbfHierarchy\nROOT a\n")
    assert not bvh.matches(b"")
    assert not bvh.matches(b"HIERARCHYX\n")


def turns_of(clip, joint):
    return Rotation.from_quat(clip.orientations[:, JOINT_INDEX[joint]], scalar_first=True)


def test_the_orientation_of_a_bone_is_how_it_turns_from_the_pose_of_its_offsets(clip_of):
    clip = clip_of(random_rows(), unit=0.01)
    for joint, end in (("elbow_left", "wrist_left"), ("hip_right", "knee_right"), ("wrist_left", "hand_left")):
        along = way(clip, end, joint)
        # the offsets of these bones point down in the file's axes, whatever the sensor's are
        down = turns_of(clip, joint).apply([0, -1, 0])
        assert_allclose(down, along / np.linalg.norm(along, axis=1)[:, None], atol=1e-6)
    assert np.isnan(clip.orientations[:, JOINT_INDEX["hand_left"]]).all()


def test_a_forearm_that_turns_about_itself_moves_no_joint_but_its_orientation(clip_of):
    rows = still(3)
    rows[:, column("LeftForeArm", "y")] = [0, 40, 80]
    clip = clip_of(rows)
    assert_allclose(clip.positions, clip.positions[[0, 0, 0]], atol=1e-12)
    turns = turns_of(clip, "elbow_left")
    angles = np.degrees((turns * turns[0].inv()).as_rotvec())
    assert_allclose(angles, [[0, 0, 0], [0, 40, 0], [0, 80, 0]], atol=1e-9)


@pytest.mark.parametrize(
    ("height", "distance", "z_up", "turn"),
    [
        *(((*motion, *axes)) for motion in ((22, 120), (45, 400)) for axes in ((False, 90), (False, -90), (True, 90))),
        (139, 400, False, 90),  # the floor is at 94
    ],
)
def test_a_body_that_crawls_lies_on_the_floor_of_the_file(clip_of, z_up, turn, height, distance):
    rows = still(40)
    rows[:, 5] = turn  # face down or up
    rows[:, 2 if not z_up else 1] = np.linspace(0, -distance, 40)
    rows[:, 1 if not z_up else 2] = height
    rows[:, [column("LeftLeg", "x"), column("RightLeg", "x")]] = 9 * np.sin(np.arange(40))[:, None]
    clip = clip_of(lines_of(rows, z_up=z_up))
    trunk = way(clip, "shoulder_center", "hip_center")
    assert_allclose(trunk[:, 1], 0, atol=1e-9)
    assert any("from the floor" in note for note in clip.notes)
    across, toes = way(clip, "hip_right", "hip_left"), way(clip, "foot_left", "ankle_left")
    assert (np.einsum("ti,ti->t", np.cross(across, trunk), toes) < 0).all()  # not mirrored


def test_no_frames_are_a_pose(clip_of):
    assert_array_equal(clip_of(still(0)).positions, clip_of(still(1)).positions)


def test_the_toes_of_a_body_that_kneels_do_not_tell_its_front(clip_of):
    rows = still(4)
    for side in ("Left", "Right"):  # shins and feet lie behind the knees
        rows[:, [column(f"{side}Leg", "x"), column(f"{side}Foot", "x")]] = [100, 60]
    clip = clip_of(rows)
    assert not any("left-handed" in note for note in clip.notes)
    assert at(clip, "ankle_left")[0, 2] > at(clip, "knee_left")[0, 2] + 0.3


def test_a_person_who_sits_and_reaches_forward_is_no_animal(clip_of):
    rows = still(3)
    for name in ("LeftArm", "RightArm", "LeftUpLeg", "RightUpLeg"):
        rows[:, column(name, "x")] = -90  # hanging limbs point forward
    clip = clip_of(rows)
    for joint in ("wrist_left", "wrist_right", "ankle_left", "ankle_right"):
        along = way(clip, joint, joint.replace("wrist", "shoulder").replace("ankle", "hip"))
        assert_allclose(along / np.linalg.norm(along, axis=1, keepdims=True), [[0, 0, -1]] * 3, atol=1e-6)


def test_frames_whose_numbers_are_not_known_are_omitted(clip_of):
    rows = random_rows(6)
    whole = clip_of(rows)
    rows[2, 4] = np.nan
    clip = clip_of(rows)
    kept = [0, 1, 3, 4, 5]
    assert_allclose(clip.times, whole.times[kept])
    assert_allclose(clip.positions, whole.positions[kept], atol=1e-9)
    assert "In 1 of 6 frames, numbers are not known. These are omitted." in clip.notes


def star(moving):
    """Return a file as some converters of positions write it: each joint hangs on the hips, with the same end."""
    lines = ["HIERARCHY", "ROOT Hips", "{", "OFFSET 0 0 0", f"CHANNELS 6 {' '.join((*POSITIONS, *ROTATIONS))}"]
    columns = [moving.positions[0], np.zeros_like(moving.positions[0])]
    for name, places in list(zip(moving.names, moving.positions, strict=True))[1:]:
        if name and "Toe" not in name:
            lines += [f"JOINT {name}", "{", "OFFSET 0 0 0", f"CHANNELS 3 {' '.join(POSITIONS)}"]
            lines += ["End Site", "{", "OFFSET 0 10 0", "}", "}"]
            columns.append(places - moving.positions[0])
    return [*lines, "}", *motion(np.concatenate(columns, axis=1))]


def test_a_skeleton_without_offsets_has_its_first_frame_at_rest_and_ends_of_its_limbs_are_nowhere(clip_of, tmp_path):
    rows = random_rows(9) / 5
    for name in ("LeftUpLeg", "RightUpLeg", "LeftArm", "RightArm"):
        rows[3:6, column(name, "x")] = -90  # after it has stood upright, it sits and reaches forward
    whole = clip_of(rows, up="y")
    nodes, rows, *_ = bvh_parser.parse(tmp_path / "take")
    clip = clip_of(star(bvh.motion_of(nodes, rows)))
    assert clip.legs == 2
    assert np.isnan(at(clip, "foot_left")).all()
    for joint in RIGID:
        assert_allclose(*(way(each, joint, PARENTS[joint]) for each in (clip, whole)), atol=1e-6)


def test_a_four_legged_skeleton_is_an_animal_if_one_is_asked_for(clip_of):
    clip, person = clip_of(animal_lines(), animals=True), clip_of(animal_lines(), as_person=True, animals=True)
    assert (clip.legs, person.legs, resample(clip).legs) == (4, 2, 4)
    assert_allclose(clip.positions, person.positions)
    assert any("four-legged" in note for note in clip.notes)


def test_an_end_far_from_its_hand_is_no_tip(clip_of):
    lines = lines_of(still())
    lines[lines.index("End Site", lines.index("JOINT RightHand")) + 2] = "OFFSET 161 0 0"
    assert_without(clip_of(lines), clip_of(still()), "hand_right")


def test_animals_whose_joints_have_other_names_are_known_by_their_shape(clip_of):
    names = joints_in(hierarchy(ANIMAL))
    rows = np.zeros((4, 3 + 3 * len(names)))
    rows[:, 3:] = np.random.default_rng(1).uniform(-12, 12, rows[:, 3:].shape)
    lines = animal_lines(rows)
    named = clip_of(lines, animals=True)
    numbered = [
        f"{line.split()[0]} b{k}" if line.startswith(("ROOT", "JOINT")) else line for k, line in enumerate(lines)
    ]
    with pytest.raises(SkeletonLogError, match="a four-legged skeleton: no performer"):
        clip_of(numbered)
    clip = clip_of(numbered, animals=True)
    assert clip.legs == 4
    assert_allclose(clip.positions[:, LIMBS], named.positions[:, LIMBS], atol=1e-9)


def test_a_performer_may_lie_on_the_side_in_the_first_frame(clip_of):
    whole, clip = clip_of(lying(), up="y"), clip_of(lying(90, 89.9), up="y")
    assert_allclose(clip.positions[-3:], whole.positions[-3:], atol=1e-9)
