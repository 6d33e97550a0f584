"""Tables are read by the names of their columns, or by their number; others are refused."""

import numpy as np
import pytest
import scipy
from hypothesis import given, settings
from hypothesis import strategies as st

from capture.formats import table
from capture.formats._cells import vector
from capture.formats.layouts import JOINT_SETS
from capture.formats.options import ReadOptions
from capture.skeleton import JOINT_INDEX, JOINTS
from puppetline.errors import SkeletonLogError

from ...effort import EFFORT
from .random_tables import judge
from .test_positions import BLAZEPOSE, joints_as, person

LIMBS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
POSES, RIGHT = person(6), np.array([1.0, 0, 0])


@given(seed=st.integers(0, 10**6))
@settings(max_examples=int(300 * EFFORT), deadline=None)
def test_random_tables_are_read_right_or_refused(tmp_path_factory, seed):
    verdict = judge(tmp_path_factory.getbasetemp() / "table.csv", seed)
    assert verdict.split(":")[0] in ("right", "refused")


def row(pose, form="{0} {1} {2}", joints=JOINTS):
    return [form.format(*(f"{value:.6f}" for value in pose[JOINT_INDEX[joint]])) for joint in joints]


def close(clip, poses=POSES):
    np.testing.assert_allclose(clip.positions, poses, atol=1e-6)


@pytest.mark.parametrize(
    ("lead", "form", "separator", "step"),
    [
        (10_000_000 / 30, "{0},{1},{2},2", ",", 1 / 30),
        (1_000_000 / 30, "{0} {1} {2} 1", " ", 1 / 30),
        (2, "{0} {1} {2}", " ", 2 / 30),
        (1000 / 30, "{0};{1};{2};0.9", ";", 1 / 30),
        (None, "{0}\t{1}\t{2}\t0\t0\t0\t1", "\t", 1 / 30),
    ],
)
def test_the_number_of_columns_tells_joints_states_and_time(read, lead, form, separator, step):
    lines = [
        separator.join([*([f"{round(lead * index)}"] if lead else []), *row(pose, form)])
        for index, pose in enumerate(POSES)
    ]
    [clip] = read(table, lines)
    close(clip)
    assert (clip.confidence == 1).all()
    np.testing.assert_allclose(np.diff(clip.times), step, atol=1e-3)


def test_states_blank_cells_and_zeros(read):
    lines = [";".join(f"{joint}{axis}" for joint in JOINTS for axis in ("X", "Y", "Z", " state"))]
    lines += [";".join(row(pose, "{0};{1};{2};2")) for pose in POSES]
    cells = lines[3].split(";")
    cells[3], cells[4:7], cells[8] = "1", ["0", "0", "0"], ""
    lines[3] = ";".join(cells)
    [clip] = read(table, lines)
    assert clip.confidence[2, :4].tolist() == [0.5, 0, 0, 1]
    assert (clip.confidence[[0, 1, 3, 4, 5]] == 1).all()


def test_people_are_told_apart_and_other_columns_ignored(read):
    lines = [
        "label,time,body_id," + ",".join(f"{joint}.{axis},{joint}.rot{axis}" for joint in JOINTS for axis in "xyz")
    ]
    for index, pose in enumerate(POSES):
        for user, moved in ((7, pose), (9, pose + RIGHT)):
            cells = ",".join(",".join(f"{value:.6f},99" for value in moved[JOINT_INDEX[joint]]) for joint in JOINTS)
            lines.append(f"wave,{index / 25},{user},{cells}")
    one, other = read(table, lines)
    assert (one.user, other.user) == (7, 9)
    close(one)
    close(other, POSES + RIGHT)
    np.testing.assert_allclose(other.times, np.arange(6) / 25)


def test_performers_may_have_columns_of_their_own(read):
    lines = ["clock," + ",".join(f"Body_{user}_XYZ_{joint}" for user in (1, 2, 3) for joint in JOINTS)]
    cells = '"{0}, {1}, {2}"'
    for index, pose in enumerate(POSES):
        own = [*row(pose, cells), *row(pose + RIGHT, cells), *['"0, 0, 0"'] * len(JOINTS)]
        lines.append(",".join([f"{index / 25}", *own]))
    clips = read(table, lines)
    assert [clip.user for clip in clips] == [0, 1]
    for clip, poses in zip(clips, (POSES, POSES + RIGHT), strict=True):
        close(clip, poses)
        np.testing.assert_allclose(clip.times, np.arange(6) / 25)


AXIS_NUMBERS = {
    "{0}[0],{0}[1],{0}[2]": True,
    "{0}_1,{0}_2,{0}_3": True,
    "data.joints.{0}.crd[0],data.joints.{0}.crd[1],data.joints.{0}.crd[2],data.joints.{0}.unc[0]": False,
    "{0},{0}.1,{0}.2": True,
    "{0},{0},{0}": True,
}
"""Columns of a joint without x, y and z, and whether there are no others."""


@pytest.mark.parametrize("columns", AXIS_NUMBERS)
def test_numbers_may_stand_for_axes(read, columns):
    lines = ["time," + ",".join(columns.format(joint) for joint in JOINTS)]
    form = "{0},{1},{2}" if AXIS_NUMBERS[columns] else "{0},{1},{2},7"
    lines += [",".join([f"{index / 25}", *row(pose, form)]) for index, pose in enumerate(POSES)]
    [clip] = read(table, lines)
    close(clip)
    np.testing.assert_allclose(clip.times, np.arange(6) / 25)


def test_names_of_joints_may_have_three_letters(read):
    names = {f"{joint}_{side}": f"{joint[:3]}{side[0]}".upper() for side in ("left", "right") for joint in LIMBS}
    names |= {"head": "NOS", "shoulder_center": "NEC"}
    lines = [",".join(f"{name}.{axis}" for name in names.values() for axis in "xyz")]
    lines += [",".join(row(pose, "{0},{1},{2}", names)) for pose in POSES]
    [clip] = read(table, lines)
    known = [JOINT_INDEX[joint] for joint in names]
    np.testing.assert_allclose(clip.positions[:, known], POSES[:, known], atol=1e-6)


@pytest.mark.parametrize("form", ["{0},{1},0.9", "{0},{1},{2},1"])
def test_scores_and_quaternions_are_no_third_axis(form):
    columns = "{0}[0],{0}[1],{0}[2],{0}[3]" if form.endswith(",1") else "{0}[0],{0}[1],{0}[2]"
    lines = ["time," + ",".join(columns.format(joint) for joint in JOINTS)]
    lines += [",".join([f"{index / 25}", *row(pose, form)]) for index, pose in enumerate(POSES)]
    assert not table.matches("\n".join(lines).encode())


@pytest.mark.parametrize(("ids", "users"), [(("1", "01"), [0, 1]), (("1", "x"), [0, 1]), (("07", "9"), [7, 9])])
def test_people_have_the_numbers_of_the_file_if_these_are_distinct(read, ids, users):
    lines = ["frame,person," + ",".join(f"{joint}.{axis}" for joint in JOINTS for axis in "xyz")]
    lines += [",".join([f"{index}", own, *row(pose, "{0},{1},{2}")]) for index, pose in enumerate(POSES) for own in ids]
    clips = read(table, lines)
    assert [clip.user for clip in clips] == users
    for clip in clips:
        close(clip)
        assert any("assumed" in note and "30" in note for note in clip.notes)


@pytest.mark.parametrize("rows", [("Type", "Name", "ID"), ("Type", "Name", "ID", "Parent")])
def test_takes_of_motive_are_read_by_their_bones(read, rows):
    columns = [
        ("Bone", f"Skeleton 001:{joint}", f"{index:X}AB3", "Skeleton 001:elbow_left", kind, axis)
        for index, joint in enumerate(JOINTS)
        for kind, axes in (("Rotation", "XYZW"), ("Position", "XYZ"))
        for axis in axes
    ]
    columns += [("Bone Marker", "Skeleton 001:elbow_left", "F00D", "", "Position", axis) for axis in "XYZ"]
    labels = ("Type", "Name", "ID", "Parent")
    lines = ["Format Version,1.25,Take Name,walk,Capture Frame Rate,120.0,Length Units,Meters", ""]
    lines += [",".join(["", name, *(column[labels.index(name)] for column in columns)]) for name in rows]
    lines.append(",".join(["", "", *(column[4] for column in columns)]))
    lines.append(",".join(["Frame", "Time (Seconds)", *(column[5] for column in columns)]))
    lines += [
        ",".join([f"{index}", f"{index / 120:.6f}", *row(pose, "0,0,0,1,{0},{1},{2}"), "7,8,9"])
        for index, pose in enumerate(POSES)
    ]
    [clip] = read(table, lines)
    close(clip)
    np.testing.assert_allclose(clip.times, np.arange(len(POSES)) / 120, atol=1e-6)


def test_a_file_names_columns_that_have_no_names_for_joints(read, tmp_path):
    marks = {joint: f"m{index}" for index, joint in enumerate(JOINTS)}
    lines = ["clock," + ",".join(f"{mark}a,{mark}b,{mark}c" for mark in marks.values())]
    lines += [",".join([f"{index / 50}", *row(pose, "{0},{1},{2}")]) for index, pose in enumerate(POSES)]
    names = tmp_path / "columns.toml"
    text = ['time = "clock"', *(f'{joint} = ["{mark}a", "{mark}b", "{mark}c"]' for joint, mark in marks.items())]
    names.write_text("\n".join(text))
    [clip] = read(table, lines, columns=names)
    close(clip)
    assert clip.times[1] == 0.02
    assert table.columns(tmp_path / "take", ReadOptions(columns=names))["m0a"] == "hip_center x"
    names.write_text("\n".join(text).replace("m3b", "missing"))
    with pytest.raises(table.SkeletonLogError):
        read(table, lines, columns=names)
    for wrong in ("", text[0], 'head = "m0a"', "head = []"):
        names.write_text(wrong)
        with pytest.raises(table.SkeletonLogError):
            read(table, lines, columns=names)


def test_rows_of_more_joints_than_any_skeleton_has_are_refused(read):
    lines = ["frame,joint,x,y,z", *(f"{index},joint{index},1,2,3" for index in range(501))]
    with pytest.raises(table.SkeletonLogError, match="501 joints"):
        read(table, lines)


def test_a_cell_may_have_any_number_of_numbers():
    assert vector("(1., -.5 2e1)") == [1, -0.5, 20]
    assert vector(f"[{', '.join(['1.5'] * 72)}]") == [1.5] * 72
    assert vector("1 " * 50_000 + "x") is None


@pytest.mark.parametrize(
    ("change", "place"),
    [
        (lambda lines: [*lines[:2], lines[2].rsplit(",", 2)[0], *lines[3:]], "line 3"),
        (lambda lines: [*lines[:2], lines[2].replace(".", "_", 1), *lines[3:]], "line 3"),
        (lambda lines: [*lines[:2], f'"{"1" * 140_000}",' + lines[2], *lines[3:]], "line 3"),
        (lambda lines: [lines[0].replace("elbow", "thing"), *lines[1:]], ""),
        (lambda lines: [lines[0]], ""),
        (lambda _: ["a,b,c", "1,2,3", "4,5,6"], ""),
        (lambda _: ["some text"], ""),
    ],
)
def test_a_damaged_table_is_refused_with_its_line(refused_at, change, place):
    lines = [",".join(f"{joint}_{axis}" for joint in JOINTS for axis in "xyz")]
    lines += [",".join(row(pose, "{0},{1},{2}")) for pose in POSES]
    assert refused_at(table, change(lines)) == place


def test_a_table_cut_off_within_a_line_is_read_up_to_the_line_before(read):
    lines = [",".join(f"{joint}_{axis}" for joint in JOINTS for axis in "xyz")]
    lines += [",".join(row(pose, "{0},{1},{2}")) for pose in POSES]
    [clip] = read(table, "\n".join(lines)[:-200])
    close(clip, POSES[:-1])
    assert "line 7" in clip.notes[0]


@pytest.mark.parametrize("form", ["x: {0}\ny: {1}\nz: {2}\nvisibility: 0.9\n", "{{'x': {0}, 'y': {1}, 'z': {2}}}"])
def test_a_cell_may_have_labels_and_several_lines(read, form):
    lines = [",".join(JOINTS), *(",".join(f'"{cell}"' for cell in row(pose, form)) for pose in POSES)]
    content = "\n".join(lines) + "\n"
    assert table.matches(content.encode())
    assert table.matches(content.encode()[:-100])
    [clip] = read(table, content)
    close(clip)


def test_rows_in_which_a_time_grows_are_no_joints(read):
    walk = np.cumsum(np.random.default_rng(0).uniform(0, 0.2, (900, 1)), axis=0)
    points = np.hstack([walk, np.resize(POSES[0][:, :2], (900, 2))])
    content = "\n".join(" ".join(f"{value:.4f}" for value in point) for point in points)
    assert not table.matches(content.encode())


def test_rows_of_landmarks_may_be_rough_if_a_name_says_so(read):
    points = joints_as(BLAZEPOSE) * [1, 1, 1.6]
    lines = [f"{x:.5f},{y:.5f},{z:.5f}" for pose in points for x, y, z in pose]
    [clip] = read(table, ["Landmark_X,Landmark_Y,Landmark_Z", *lines])
    assert len(clip.times) == len(points)


def test_a_single_point_is_no_performer(read):
    with pytest.raises(table.SkeletonLogError, match="single point"):
        read(table, ["frame,x,y,z", *(f"{index},1,2,{index}" for index in range(9))])


@pytest.mark.parametrize("first", [0, 1])
def test_rows_may_have_frame_and_number_of_a_joint_without_a_header(read, first):
    points = joints_as(BLAZEPOSE)
    lines = [
        f"{7 + frame},{first + joint},{x:.6f},{y:.6f},{z:.6f},down"
        for frame, pose in enumerate(points)
        for joint, (x, y, z) in enumerate(pose)
    ]
    assert table.matches("\n".join(lines).encode())
    [clip] = read(table, lines)
    known = [JOINT_INDEX[joint] for joint in ("elbow_left", "wrist_right", "knee_left", "ankle_right")]
    np.testing.assert_allclose(clip.positions[:, known], person()[:, known], atol=1e-5)


def test_one_pose_may_be_the_whole_file(read):
    content = "".join(f"{x:.6f},{y:.6f},{z:.6f},0.9\n" for x, y, z in joints_as(BLAZEPOSE)[0])
    assert table.matches(content.encode())
    [clip] = read(table, content)
    assert len(clip.times) == 1


@pytest.mark.parametrize("form", ["{k},{x},{y},{z},0.9", "{k} {x} {y} {z}", "[{k};{x};{y};{z}]"])
def test_the_number_of_a_joint_may_stand_before_its_position_in_a_row(read, form):
    """Some of the landmarks suffice, and a header that is shorter than the rows says nothing."""
    names = JOINT_SETS["mediapipe"]
    numbers = [0, *range(11, 17), *range(23, 33)]
    own = joints_as(names)
    lines = ["Time,Landmark,X,Y,Z"] if "0.9" in form else []
    for index, pose in enumerate(own):
        x_y_z = [dict(zip("xyz", map("{:.6f}".format, pose[k]), strict=True)) for k in numbers]
        cells = [form.format(k=k, **each) for k, each in zip(numbers, x_y_z, strict=True)]
        lines.append(",".join(([str(40 * index)] if "0.9" in form else []) + cells))
    [clip] = read(table, lines)
    arms = [JOINT_INDEX[f"{joint}_{side}"] for joint in LIMBS for side in ("left", "right")]
    np.testing.assert_allclose(clip.positions[:, arms], person()[:, arms], atol=1e-5)


@pytest.mark.parametrize(("form", "first"), [("[{x}, {y}, {z}]", ",".join(map(str, range(33)))), ("{x}/{y}/{z}", None)])
def test_a_cell_may_be_a_joint_whose_name_is_its_number_or_have_slashes(read, form, first):
    cells = [[form.format(**dict(zip("xyz", point, strict=True))) for point in pose] for pose in joints_as(BLAZEPOSE)]
    lines = [",".join(f'"{cell}"' for cell in row) for row in cells]
    [clip] = read(table, [first or ",".join(BLAZEPOSE), *lines])
    arms = [JOINT_INDEX[f"{joint}_{side}"] for joint in LIMBS for side in ("left", "right")]
    np.testing.assert_allclose(clip.positions[:, arms], person()[:, arms], atol=1e-9)


def test_positions_in_space_count_among_several_of_a_joint(read):
    kinds = ("{}_{}", "{}_world_{}", "{}_velocity_{}")
    lines = [",".join(kind.format(name, axis) for name in BLAZEPOSE for kind in kinds for axis in "xyz")]
    lines += [",".join(f"0.5,0.4,0.01,{x},{y},{z},1,2,3" for x, y, z in pose) for pose in joints_as(BLAZEPOSE)]
    [clip] = read(table, lines)
    arms = [JOINT_INDEX[f"{joint}_{side}"] for joint in LIMBS for side in ("left", "right")]
    np.testing.assert_allclose(clip.positions[:, arms], person()[:, arms], atol=1e-9)


def test_the_depth_of_several_columns_is_that_of_a_person(read):
    """RealSense's depth in millimetres stands between MediaPipe's y and z."""
    lines = [
        f"{40 * frame + 0.5}, {joint}, {x:.6f}, {y:.6f}, {1400 + 7 * (joint % 5)}, {z:.6f}"
        for frame, pose in enumerate(joints_as(BLAZEPOSE))
        for joint, (x, y, z) in enumerate(pose)
    ]
    [clip] = read(table, lines)
    known = [JOINT_INDEX[joint] for joint in ("elbow_left", "wrist_right", "knee_left", "ankle_right")]
    np.testing.assert_allclose(clip.positions[:, known], person()[:, known], atol=1e-5)
    np.testing.assert_allclose(np.diff(clip.times), 0.04)


def test_hands_beside_the_pose_are_numbered_apart_and_may_be_missing_at_the_end(read):
    names = [f"pose_landmark_{k}_{axis}" for k in range(33) for axis in "xyz"]
    hand = [f"hand_0_landmark_{k}_{axis}" for k in range(21) for axis in "xyz"]
    rows = [[f"{each:.6f}" for each in pose.ravel()] for pose in joints_as(BLAZEPOSE)]
    rows[1] += ["0.5"] * len(hand)
    [clip] = read(table, [",".join(row) for row in (names + hand, *rows)])
    arms = [JOINT_INDEX[f"{joint}_{side}"] for joint in LIMBS for side in ("left", "right")]
    np.testing.assert_allclose(clip.positions[:, arms], person()[:, arms], atol=1e-5)


def test_a_fourth_number_of_a_cell_is_its_visibility(read):
    rows = [";".join(f"[{each}, 0.9]" for each in row(pose, "{0}, {1}, {2}")) for pose in POSES]
    rows[2] = rows[2].replace("0.9", "0.2", 1)
    [clip] = read(table, [";".join(JOINTS), *rows])
    close(clip)
    assert np.argwhere(clip.confidence < 1).tolist() == [[2, 0]]


def test_names_of_pictures_may_be_before_the_numbers(read):
    lines = [
        f"squat_{k}.jpg," + ",".join(f"{each:.5f}" for each in pose.ravel())
        for k, pose in enumerate(joints_as(BLAZEPOSE))
    ]
    assert table.matches("\n".join(lines).encode())
    [clip] = read(table, lines)
    assert len(clip.times) == len(lines)
    arms = [JOINT_INDEX[f"{joint}_{side}"] for joint in LIMBS for side in ("left", "right")]
    np.testing.assert_allclose(clip.positions[:, arms], person()[:, arms], atol=1e-4)


def test_rows_may_have_parts(read):
    lines = [f"{name},{x:.6f},{y:.6f},{z:.6f}" for pose in POSES for name, (x, y, z) in zip(JOINTS, pose, strict=True)]
    [clip] = read(table, ["parts,x_coords,y_coords,z_coords", *lines])
    close(clip)


def test_landmarks_of_a_face_may_follow_the_pose(read):
    points = np.concatenate([joints_as(BLAZEPOSE), np.zeros((len(person()), 468, 3))], axis=1)
    header = ",".join(f"{axis}{k + 1}" for k in range(501) for axis in "xyz")
    lines = [",".join(f"{each:.6f}" for each in pose.ravel()) for pose in points]
    [clip] = read(table, [header, *lines])
    arms = [JOINT_INDEX[f"{joint}_{side}"] for joint in LIMBS for side in ("left", "right")]
    np.testing.assert_allclose(clip.positions[:, arms], person()[:, arms], atol=1e-5)


@pytest.mark.parametrize(
    "sentence",
    [
        "Joint {k}: Position({x}, {y}, {z}), Orientation(1.5, 0, 0, 0.5), Confidence: 2",
        "{name} - X = {x} | Y = {y} | Z = {z}",
        "{name} at [{x} {y} {z}] state Tracked",
    ],
)
def test_sentences_with_words_before_numbers_are_rows(read, sentence):
    lines = []
    for frame, pose in enumerate(POSES):
        lines += [f"frame {frame} begins"]
        for k, (name, point) in enumerate(zip(JOINTS, pose, strict=True)):
            x, y, z = (f"{value:.7f}" for value in point)
            lines += [sentence.format(k=k, name=name.title().replace("_", ""), x=x, y=y, z=z)]
    [clip] = read(table, lines)
    np.testing.assert_allclose(clip.positions, POSES, atol=1e-6)
    assert "6 lines have another form than the others. They are omitted." in clip.notes


def test_text_without_words_before_its_numbers_is_no_table(read):
    with pytest.raises(SkeletonLogError, match="text without rows of numbers"):
        read(table, ["one line of words", "and 12 another", "and a third"])


@pytest.mark.parametrize("word", ["Landmark_", "kp", "joint "])
def test_numbers_of_joints_may_follow_a_word_in_each_row(read, word):
    rows = [f"up,{word}{k},{x},{y},{z}" for pose in joints_as(BLAZEPOSE) for k, (x, y, z) in enumerate(pose)]
    [clip] = read(table, ["Pose,Landmark,X,Y,Z", *rows])
    arms = [JOINT_INDEX[f"{joint}_{side}"] for joint in ("elbow", "wrist", "knee") for side in ("left", "right")]
    np.testing.assert_allclose(clip.positions[:, arms], person()[:, arms], atol=1e-9)


def test_numbers_split_at_their_decimal_commas_are_whole_again(read):
    """As programs write a table of commas where decimals have commas too."""
    header = "Index,Time,User,Hand" + "".join(",Joint,Status,PositionX,PositionY,PositionZ,RotationW" for _ in JOINTS)
    rows = []
    for k, pose in enumerate(POSES):
        cells = [str(k), str(129627 + 33 * k), "72057594038089027", "NOT_TRACKED"]
        for name, point in zip(JOINTS, pose, strict=True):
            numbers = [f"{value + 1e-7:.7f}".replace(".", ",") for value in point]
            cells += [name.title().replace("_", ""), "TRACKED", *numbers, "0"]
        rows.append(",".join(cells))
    [clip] = read(table, [header, *rows])
    np.testing.assert_allclose(clip.positions, POSES, atol=1e-6)
    np.testing.assert_allclose(np.diff(clip.times), 0.033, atol=1e-6)


def test_all_coordinates_may_be_in_one_cell(read):
    rows = [f'{index / 25},"[{", ".join(map(str, row.ravel()))}]"' for index, row in enumerate(person())]
    [clip] = read(table, ["time,joints", *rows])
    np.testing.assert_allclose(clip.positions, person(), atol=1e-9)
    np.testing.assert_allclose(clip.times, np.arange(len(rows)) / 25)


def test_times_that_begin_again_follow_the_others(read):
    header = ",".join(["frame", *(f"{joint}_{axis}" for joint in JOINTS for axis in "xyz")])
    takes = [np.tile(person(), (4, 1, 1))[:13], np.tile(person(), (4, 1, 1))[1:12]]
    rows = [",".join(map(str, [index, *row.ravel()])) for take in takes for index, row in enumerate(take)]
    [clip] = read(table, [header, *rows], fps=10)
    np.testing.assert_allclose(clip.times, np.arange(24) / 10)
    np.testing.assert_allclose(clip.positions, np.concatenate(takes), atol=1e-9)
    assert "The times begin again once. These frames follow the others." in clip.notes


def test_lengths_may_be_feet(read):
    header = ",".join(f"{joint}_{axis}" for joint in JOINTS for axis in "xyz")
    [clip] = read(table, [header, *(",".join(map(str, row)) for row in person().reshape(-1, 60) / 0.3048)])
    np.testing.assert_allclose(clip.positions - clip.positions[:, :1], person() - person()[:, :1], atol=1e-9)
    assert any("feet" in note for note in clip.notes)


@pytest.mark.parametrize("form", ["numbers of joints", "names of joints", "both"])
def test_rows_may_stand_below_the_number_of_a_frame_or_the_name_of_a_joint(read, form):
    lines = []
    for index, pose in enumerate(person()):
        lines += [] if form == "names of joints" else [f"Frame: {index} "]
        for number, (joint, point) in enumerate(zip(JOINTS, pose, strict=True)):
            if form == "numbers of joints":
                lines += [f"{number}, {', '.join(map(str, point))}, 0.99 "]
            else:
                lines += [
                    f"{joint.replace('_', ' ').title()}:",
                    f"[ {point[0]:.9e}  {point[1]:.9e}",
                    f"  {point[2]:.9e} ]",
                ]
    [clip] = read(table, lines, fps=30)
    np.testing.assert_allclose(clip.positions, person(), atol=1e-6)
    np.testing.assert_allclose(clip.times, np.arange(len(person())) / 30)


def test_rows_of_another_form_are_left_out(read):
    header = ",".join(f"{joint}_{axis}" for joint in JOINTS for axis in "xyz")
    rows = [",".join(map(str, row)) for row in np.tile(person(), (9, 1, 1)).reshape(-1, 60)]
    [clip] = read(table, [header, *(f"{row},1,2,3" if index % 6 == 5 else row for index, row in enumerate(rows))])
    assert len(clip.times) == len(rows) - len(rows) // 6
    assert f"{len(rows) // 6} lines have another form than the others. They are omitted." in clip.notes


def test_the_first_joints_of_an_order_suffice(read):
    points = joints_as(JOINT_SETS["mediapipe"])[:, :25]  # to the hips: 25 as Kinect v2 has
    rows = [f"{k},{x},{y},{z}" for pose in points for k, (x, y, z) in enumerate(pose)]
    [clip] = read(table, ["joint,x,y,z", *rows])
    arms = [JOINT_INDEX[f"{joint}_{side}"] for joint in ("elbow", "wrist") for side in ("left", "right")]
    np.testing.assert_allclose(clip.positions[:, arms], person()[:, arms], atol=1e-9)
    assert np.isnan(clip.positions[:, JOINT_INDEX["knee_left"]]).all()


def test_axes_may_follow_the_letter_of_a_position_beside_that_of_a_rotation(read):
    header = ",".join(f"{joint}.{axis}" for joint in JOINTS for axis in ("px", "py", "pz", "rx", "ry", "rz", "rw"))
    rows = np.concatenate([person(), np.full((*person().shape[:2], 4), 0.5)], axis=2).reshape(len(person()), -1)
    [clip] = read(table, [header, *(",".join(map(str, row)) for row in rows)])
    np.testing.assert_allclose(clip.positions, person(), atol=1e-9)


def test_unit_quaternions_are_no_positions(tmp_path):
    turns = scipy.spatial.transform.Rotation.random(9 * len(JOINTS), rng=0).as_quat().reshape(9, -1, 4)
    path = tmp_path / "take.txt"
    rows = ["\t".join(" ".join(map(str, each)) for each in frame) for frame in turns]
    path.write_text("\n".join(["\t".join(JOINTS), *rows]))
    with pytest.raises(SkeletonLogError, match="unit quaternion: rotations"):
        table.read(path, ReadOptions())


@pytest.mark.parametrize("stated", [["NO_OF_FRAMES\t4", "FREQUENCY\t100"], ["Trajectories", "100"], ["# fps: 100.0"]])
def test_the_lines_above_may_state_the_rate(read, stated):
    above = [*stated, "MARKER_NAMES\t" + "\t".join(JOINTS)]
    [clip] = read(table, [*above, *("\t".join(map(str, row)) for row in person().reshape(len(person()), -1))])
    np.testing.assert_allclose(clip.positions, person(), atol=1e-9)
    np.testing.assert_allclose(clip.times, np.arange(len(person())) / 100)


SPANISH = {
    "shoulder": "hombro",
    "elbow": "codo",
    "wrist": "muneca",
    "hip": "cadera",
    "knee": "rodilla",
    "ankle": "tobillo",
}


def test_sides_may_have_the_words_of_other_languages(read):
    sides = {"left": "izq", "right": "der"}
    own = {f"{part}_{side}": f"{SPANISH[part]}_{sides[side]}" for part in SPANISH for side in sides} | {
        "head": "cabeza"
    }
    header = ",".join(f"{name}_{axis}" for name in own.values() for axis in "xyz")
    rows = person()[:, [JOINT_INDEX[joint] for joint in own]].reshape(len(person()), -1)
    [clip] = read(table, [header, *(",".join(map(str, row)) for row in rows)])
    seen = [JOINT_INDEX[joint] for joint in own]
    np.testing.assert_allclose(clip.positions[:, seen], person()[:, seen], atol=1e-9)


def test_all_points_of_a_frame_may_be_a_list_in_a_cell(read):
    times = np.arange(len(person())) / 20
    rows = [f'{time},"{pose.tolist()}"' for time, pose in zip(times, joints_as(BLAZEPOSE), strict=True)]
    [clip] = read(table, ["Timestamp,Pose", *rows, "0.25,[]"])
    arms = [JOINT_INDEX[f"{joint}_{side}"] for joint in ("elbow", "wrist", "knee") for side in ("left", "right")]
    np.testing.assert_allclose(clip.positions[:-1, arms], person()[:, arms], atol=1e-9)
    np.testing.assert_allclose(clip.times[:-1], times)
    assert (clip.confidence[-1] == 0).all()
