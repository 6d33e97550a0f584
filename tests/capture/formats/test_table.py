"""Tables are read by the names of their columns, or by their number; others are refused."""

import numpy as np
import pytest
import scipy
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from capture.formats import read_log, table
from capture.formats._cells import vector
from capture.formats.layouts import JOINT_SETS
from capture.formats.options import ReadOptions
from capture.formats.skeleton_joints import BY_SHAPE_NOTE
from capture.skeleton import JOINT_INDEX, JOINTS
from puppetline.errors import SkeletonLogError

from ...effort import EFFORT
from ..bodies import both
from .people import BLAZEPOSE, LIMBS, PERSON, POINTS, assert_reads, joints_as, moving
from .random_tables import judge

RIGHT = np.array([1.0, 0, 0])


@given(seed=st.integers(0, 10**6))
@settings(max_examples=int(300 * EFFORT), deadline=None)
def test_random_tables_are_read_right_or_refused(tmp_path_factory, seed):
    verdict = judge(tmp_path_factory.getbasetemp() / "table.csv", seed)
    assert verdict.split(":")[0] in ("right", "refused")


def heads(form="{0}_x,{0}_y,{0}_z", names=JOINTS):
    return ",".join(map(form.format, names))


def cells(form, points, names):
    """Return a text per joint in a list per frame."""
    return [
        [form.format(frame=k, name=name, x=x, y=y, z=z) for name, (x, y, z) in zip(names, pose.tolist(), strict=True)]
        for k, pose in enumerate(points)
    ]


def wide(form="{x},{y},{z}", points=PERSON, names=None, lead="", separator=",", end=""):
    """Return a line per frame, which may begin with its time at 25 frames per second; joints' names are numbers."""
    return [
        lead.format(frame=k, time=k / 25, ms=40 * k) + separator.join(row) + end
        for k, row in enumerate(cells(form, points, names or range(points.shape[1])))
    ]


def long(form, points=PERSON, names=None, above=()):
    """Return a line per joint, below lines per frame."""
    rows = cells(form, points, names or range(points.shape[1]))
    return [line for k, row in enumerate(rows) for line in (*(each.format(k) for each in above), *row)]


def motive(labels):
    """Return a take of Motive with some of its rows of labels."""
    columns = [
        ("Bone", f"Skeleton 001:{joint}", f"{index:X}AB3", "Skeleton 001:elbow_left", kind, axis)
        for index, joint in enumerate(JOINTS)
        for kind, axes in (("Rotation", "XYZW"), ("Position", "XYZ"))
        for axis in axes
    ]
    columns += [("Bone Marker", "Skeleton 001:elbow_left", "F00D", "", "Position", axis) for axis in "XYZ"]
    *named, kinds, axes = (",".join(row) for row in zip(*columns, strict=True))
    return [
        "Format Version,1.25,Take Name,walk,Capture Frame Rate,25.0,Length Units,Meters\n",
        *(
            f",{label},{row}"
            for label, row in zip(("Type", "Name", "ID", "Parent"), named, strict=True)
            if label in labels
        ),
        f",,{kinds}",
        f"Frame,Time (Seconds),{axes}",
        *wide("0,0,0,1,{x},{y},{z}", lead="{frame},{time:.6f},", end=",7,8,9"),
    ]


TITLES = [joint.title().replace("_", "") for joint in JOINTS]
LETTERS = [f"{JOINTS[joint][:3]}{JOINTS[joint].split('_')[1][0]}".upper() for joint in LIMBS]
SPANISH = [
    f"{part}_{side}" for part in ("hombro", "codo", "muneca", "cadera", "rodilla", "tobillo") for side in ("izq", "der")
]
NAMED_JOINTS = [JOINT_INDEX["head"], *LIMBS, JOINT_INDEX["shoulder_center"]]
SOME = [0, *range(11, 17), *range(23, 33)]
"""Numbers of BlazePose's landmarks on nose, arms and legs."""
SENTENCE = "Joint {name}: Position({x}, {y}, {z}), Orientation(1.5, 0, 0, 0.5), Confidence: 2"
SPACE = ("{0}_x,{0}_y,{0}_z", "{0}_world_x,{0}_world_y,{0}_world_z", "{0}_velocity_x,{0}_velocity_y,{0}_velocity_z")

TIMED = {
    "axes in brackets": ["time," + heads("{0}[0],{0}[1],{0}[2]"), *wide(lead="{time},")],
    "axes 1 to 3": ["time," + heads("{0}_1,{0}_2,{0}_3"), *wide(lead="{time},")],
    "axes before an uncertainty": [
        "time," + heads("data.{0}.crd[0],data.{0}.crd[1],data.{0}.crd[2],data.{0}.unc[0]"),
        *wide("{x},{y},{z},7", lead="{time},"),
    ],
    "names repeated and numbered": ["time," + heads("{0},{0}.1,{0}.2"), *wide(lead="{time},")],
    "names above three columns each": ["time," + heads("{0},,"), *wide(lead="{time},")],
    "names repeated": ["time," + heads("{0},{0},{0}"), *wide(lead="{time},")],
    "durations": ["timestamp," + heads(), *wide(lead="0 days 00:00:{time:09.6f}000,")],
    "rows with names, moments and decimal commas": [
        f"{row.replace('.', ',')};12:00:{k / 25 + joint / 1000:09.6f};Tracked"
        for k, rows in enumerate(cells("{name};{x:.12f};{y:.12f};{z:.12f}", PERSON, TITLES))
        for joint, row in enumerate(rows)
    ],
    "Motive 1.x": motive(("Type", "Name", "ID")),
    "Motive 2.x": motive(("Type", "Name", "ID", "Parent")),
    "decimal commas among commas": [
        "Index,Time,User,Hand" + ",Joint,Status,PositionX,PositionY,PositionZ,RotationW" * len(JOINTS),
        *(
            line.replace(".", ",")
            for line in wide(
                "{name},TRACKED,{x:.10f},{y:.10f},{z:.10f},0",
                names=TITLES,
                lead="{frame},{ms},72057594038089027,NOT_TRACKED,",
            )
        ),
    ],
    "all coordinates in a cell": ["time,joints", *wide("{x}, {y}, {z}", lead='{time},"[', separator=", ", end=']"')],
    "a rate of Qualisys": ["NO_OF_FRAMES\t4", "FREQUENCY\t25", "MARKER_NAMES," + heads("{0}"), *wide()],
    "a rate of Vicon": ["Trajectories", "25", "MARKER_NAMES," + heads("{0}"), *wide()],
    "a rate in a remark": ["# fps: 25.0", "MARKER_NAMES," + heads("{0}"), *wide()],
}
TIMELESS = {
    "a row per coordinate": [
        f"{joint}_{axis},{','.join(map(str, PERSON[:, k, a]))}"
        for k, joint in enumerate(JOINTS)
        for a, axis in enumerate("xyz")
    ],
    "several files in one": [heads(), *wide()[:2], heads(), *wide()[2:]],
    "labels in cells of several lines": [heads("{0}"), *wide('"x: {x}\ny: {y}\nz: {z}\nvisibility: 0.9\n"')],
    "labels in cells": [heads("{0}"), *wide("\"{{'x': {x}, 'y': {y}, 'z': {z}}}\"")],
    "a column of parts": ["parts,x_coords,y_coords,z_coords", *long("{name},{x},{y},{z}", names=JOINTS)],
    "sentences": long(SENTENCE, above=["frame {} begins"]),
    "equations": long("{name} - X = {x} | Y = {y} | Z = {z}", names=TITLES, above=["frame {} begins"]),
    "numbers of columns for names": [",".join(map(str, range(3 * len(JOINTS)))) + ",label", *wide(end=",squat")],
    "lists with symbols": ["[", *long("[\\{name},{x},{y},{z}],", names=JOINTS), "]"],
    "states in words": long("{name} at [{x} {y} {z}] state Tracked", names=TITLES, above=["frame {} begins"]),
    "positions beside rotations": [
        heads("{0}.px,{0}.py,{0}.pz,{0}.rx,{0}.ry,{0}.rz,{0}.rw"),
        *wide("{x},{y},{z},0.5,0.5,0.5,0.5"),
    ],
    "rows below the number of a frame": long("{name}, {x}, {y}, {z}, 0.99 ", above=["Frame: {} "]),
    "rows below names": long("{name}:\n[ {x:.9e}  {y:.9e}\n  {z:.9e} ]", names=TITLES),
    "rows below both": long("{name}:\n[ {x:.9e}  {y:.9e}\n  {z:.9e} ]", names=TITLES, above=["Frame: {} "]),
}
TIMED_LANDMARKS = {
    "a number before each, and a short header": [
        "Time,Landmark,X,Y,Z",
        *wide("{name},{x},{y},{z},0.9", POINTS[:, SOME], SOME, lead="{ms},"),
    ],
    "a depth of the camera before z": [
        line
        for k, row in enumerate(cells("{name}, {x}, {y}, 14{name:02}, {z}", POINTS, range(33)))
        for line in [f"{40 * k}.5, {each}" for each in row]
    ],
}
LANDMARKS = {
    "a number before each": wide("{name} {x} {y} {z}", POINTS[:, SOME], SOME),
    "a number before each of all": wide("{name},{x},{y},{z}", POINTS),
    "a number before each in brackets": wide("[{name};{x};{y};{z}]", POINTS[:, SOME], SOME),
    "names that are numbers": [heads("{0}", range(33)), *wide('"[{x}, {y}, {z}]"', POINTS)],
    "slashes": [heads("{0}", BLAZEPOSE), *wide('"{x}/{y}/{z}"', POINTS)],
    "rows with frame and number": [f"{line},down" for line in long("{frame},{name},{x},{y},{z}", POINTS)],
    "rows with frame and number from 1": long("{frame},{name},{x},{y},{z},down", POINTS, range(1, 34)),
    "positions in space among others": [
        heads(",".join(SPACE), BLAZEPOSE),
        *wide("0.5,0.4,0.01,{x},{y},{z},1,2,3", POINTS),
    ],
    "rows with an ID and positions in space among others": [
        "Sample,ID,Pixel_X,Pixel_Y,Norm_X,Norm_Y,Norm_Z,World_X,World_Y,World_Z",
        *long("1,{name},300,200,0.5,0.4,0.1,{x},{y},{z}", POINTS),
    ],
    "hands in some frames": [
        ",".join(
            [
                *(f"pose_landmark_{k}_{axis}" for k in range(33) for axis in "xyz"),
                *(f"hand_0_landmark_{k}_{axis}" for k in range(21) for axis in "xyz"),
            ]
        ),
        *(line + (k == 1) * (63 * ",0.5") for k, line in enumerate(wide(points=POINTS))),
    ],
    "a hand after the pose, and words before it": wide(
        points=POINTS, lead="0_{frame},8_12,wave,easy,", end=63 * ",0.5"
    ),
    "names of pictures": wide(points=POINTS, lead="squat_{frame}.jpg,"),
    "a face after the pose": [heads("x{0},y{0},z{0}", range(1, 502)), *wide(points=POINTS, end=468 * ",0,0,0")],
    "a word and a number": ["Pose,Landmark,X,Y,Z", *long("up,Landmark_{name},{x},{y},{z}", POINTS)],
    "a short word and a number": ["Pose,Landmark,X,Y,Z", *long("up,kp{name},{x},{y},{z}", POINTS)],
    "a word, a space and a number": ["Pose,Landmark,X,Y,Z", *long("up,joint {name},{x},{y},{z}", POINTS)],
}
NAMES = {
    "three letters": [heads("{0}.x,{0}.y,{0}.z", ["NOS", *LETTERS, "NEC"]), *wide(points=PERSON[:, NAMED_JOINTS])],
    "Spanish": [heads(names=["cabeza", *SPANISH]), *wide(points=PERSON[:, NAMED_JOINTS[:-1]])],
}
CASES = {
    name: (lines, joints, step)
    for forms, joints, step in (
        (TIMED, slice(None), 1 / 25),
        (TIMELESS, slice(None), 1 / 30),
        (TIMED_LANDMARKS, LIMBS, 1 / 25),
        (LANDMARKS, LIMBS, 1 / 30),
        (NAMES, NAMED_JOINTS, 1 / 30),
    )
    for name, lines in forms.items()
}


@pytest.mark.parametrize("form", CASES)
def test_positions_are_found_in_the_forms_of_many_programs(read, form):
    lines, joints, step = CASES[form]
    assert table.matches("\n".join(lines).encode())
    [clip] = read(table, lines)
    assert_reads(clip, joints=joints, step=step)
    short = [note for note in clip.notes if "fewer cells" in note]
    expected = ["3 rows have fewer cells than the header. Their last cells are missing."]
    assert short == expected * (form == "hands in some frames")


def test_people_are_told_apart_and_other_columns_ignored(read):
    lines = ["label,time,body_id," + heads("{0}.x,{0}.rotx,{0}.y,{0}.roty,{0}.z,{0}.rotz")]
    for user, poses in ((7, PERSON), (9, PERSON + RIGHT)):
        lines += wide("{x},99,{y},99,{z},99", poses, lead=f"wave,{{time}},{user},")
    one, other = read(table, lines)
    assert (one.user, other.user) == (7, 9)
    assert_reads(one, step=1 / 25)
    assert_reads(other, PERSON + RIGHT, step=1 / 25)


def test_performers_may_have_columns_of_their_own(read):
    people = np.concatenate([PERSON, PERSON + RIGHT, 0 * PERSON], axis=1)
    header = "clock," + ",".join(heads(f"Body_{user}_XYZ_{{0}}") for user in (1, 2, 3))
    one, other = read(table, [header, *wide('"{x}, {y}, {z}"', people, lead="{time},")])
    assert (one.user, other.user) == (0, 1)
    assert_reads(one, step=1 / 25)
    assert_reads(other, PERSON + RIGHT, step=1 / 25)


def test_a_line_may_count_the_people_or_the_joints_after_it(read):
    people = zip(*(wide("{x} {y} {z}", POINTS + way, separator=" ") for way in (0, RIGHT)), strict=True)
    one, other = read(table, [line for pair in people for line in ("2 33", *pair)])
    assert (one.user, other.user) == (0, 1)
    assert_reads(one, joints=LIMBS, step=1 / 30)
    assert_reads(other, PERSON + RIGHT, joints=LIMBS, step=1 / 30)
    [clip] = read(table, long("{x} {y} {z}", above=["20"]))
    assert_reads(clip, step=1 / 30)


@pytest.mark.parametrize(("ids", "users"), [(("1", "01"), [0, 1]), (("1", "x"), [0, 1]), (("07", "9"), [7, 9])])
def test_people_have_the_numbers_of_the_file_if_these_are_distinct(read, ids, users):
    lines = [
        "frame,person," + heads("{0}.x,{0}.y,{0}.z"),
        *(line for own in ids for line in wide(lead=f"{{frame}},{own},")),
    ]
    clips = read(table, lines)
    assert [clip.user for clip in clips] == users
    for clip in clips:
        assert_reads(clip)
        assert any("assumed" in note and "30" in note for note in clip.notes)


@pytest.mark.parametrize(
    ("lead", "form", "separator", "step"),
    [
        (10_000_000 / 30, "{x},{y},{z},2", ",", 1 / 30),
        (1_000_000 / 30, "{x} {y} {z} 1", " ", 1 / 30),
        (2, "{x} {y} {z}", " ", 2 / 30),
        (1000 / 30, "{x};{y};{z};0.9", ";", 1 / 30),
        (None, "{x}\t{y}\t{z}\t0\t0\t0\t1", "\t", 1 / 30),
    ],
)
def test_the_number_of_columns_tells_joints_states_and_time(read, lead, form, separator, step):
    lines = wide(form, separator=separator)
    [clip] = read(table, [f"{round(lead * k)}{separator}{line}" for k, line in enumerate(lines)] if lead else lines)
    assert_reads(clip)
    assert (clip.confidence == 1).all()
    assert_allclose(np.diff(clip.times), step, atol=1e-3)


def test_states_blank_cells_and_zeros(read):
    lines = [heads("{0}X;{0}Y;{0}Z;{0} state").replace(",", ";"), *wide("{x};{y};{z};2", separator=";")]
    cells = lines[3].split(";")
    cells[3], cells[4:7], cells[8] = "1", ["0", "0", "0"], ""
    lines[3] = ";".join(cells)
    [clip] = read(table, lines)
    expected = np.ones((4, 20))
    expected[2, :3] = 0.5, 0, 0
    assert_array_equal(clip.confidence, expected)


def test_a_fourth_number_of_a_cell_is_its_visibility(read):
    rows = wide("[{x}, {y}, {z}, 0.9]", separator=";")
    rows[2] = rows[2].replace("0.9]", "0.2]", 1)
    [clip] = read(table, [";".join(JOINTS), *rows])
    assert_reads(clip)
    assert np.argwhere(clip.confidence < 1).tolist() == [[2, 0]]


def test_a_file_names_columns_that_have_no_names_for_joints(read, tmp_path):
    lines = ["clock," + heads("m{0}a,m{0}b,m{0}c", range(20)), *wide(lead="{time},")]
    names = tmp_path / "columns.toml"
    text = ['time = "clock"', *(f'{joint} = ["m{k}a", "m{k}b", "m{k}c"]' for k, joint in enumerate(JOINTS))]
    names.write_text("\n".join(text))
    [clip], [same] = read(table, lines, columns=names), read_log(tmp_path / "take", ReadOptions(columns=names))
    assert_reads(clip, step=1 / 25)
    assert_reads(same, step=1 / 25)
    with pytest.raises(SkeletonLogError):
        read_log(tmp_path / "take")
    assert table.columns(tmp_path / "take", ReadOptions(columns=names))["m0a"] == "hip_center x"
    for wrong in ("\n".join(text).replace("m3b", "missing"), "", text[0], 'head = "m0a"', "head = []"):
        names.write_text(wrong)
        with pytest.raises(SkeletonLogError):
            read(table, lines, columns=names)


def test_a_cell_may_have_any_number_of_numbers():
    assert vector("(1., -.5 2e1)") == [1, -0.5, 20]
    assert vector(f"[{', '.join(['1.5'] * 72)}]") == [1.5] * 72
    assert vector("1 " * 50_000 + "x") is None


WHOLE = [heads(), *wide()]


@pytest.mark.parametrize(
    ("lines", "place"),
    [
        ([*WHOLE[:2], WHOLE[2].rsplit(",", 2)[0], *WHOLE[3:]], "line 3"),
        ([*WHOLE[:2], WHOLE[2].replace(".", "_", 1), *WHOLE[3:]], "line 3"),
        ([*WHOLE[:2], f'"{"1" * 140_000}",' + WHOLE[2], *WHOLE[3:]], "line 3"),
        ([WHOLE[0].replace("shoulder", "thing"), *WHOLE[1:]], ""),
        (WHOLE[:1], ""),
        (["a,b,c", "1,2,3", "4,5,6"], ""),
        (["some text"], ""),
        (["0.0;elbow_left", *long("{frame};{name};{x};{y};{z}", names=JOINTS)[6:]], ""),
    ],
)
def test_a_damaged_table_is_refused_with_its_line(refused_at, lines, place):
    assert refused_at(table, lines) == place


TURNS = scipy.spatial.transform.Rotation.random(9 * len(JOINTS), rng=0).as_quat().reshape(9, -1, 4).tolist()


@pytest.mark.parametrize(
    ("lines", "found"),
    [
        (["frame,joint,x,y,z", *(f"{k},joint{k},1,2,3" for k in range(501))], "501 joints"),
        (["frame,x,y,z", *(f"{k},1,2,{k}" for k in range(9))], "single point"),
        (["one line of words", "and 12 another", "and a third"], "text without rows of numbers"),
        (
            [",".join(["walk", *(f"{j * k / 7:.3f}" for j in range(1, 36))]) for k in range(9)],
            "36 columns without names",
        ),
        (
            ["\t".join(JOINTS), *("\t".join(" ".join(map(str, each)) for each in row) for row in TURNS)],
            "unit quaternion: rotations",
        ),
    ],
)
def test_a_table_without_a_performer_is_called_what_it_has(read, lines, found):
    with pytest.raises(SkeletonLogError, match=found):
        read(table, lines)


TIMES = np.cumsum(np.random.default_rng(0).uniform(0, 0.2, 900))


@pytest.mark.parametrize(
    "lines",
    [
        ["time," + heads("{0}[0],{0}[1],{0}[2]"), *wide("{x},{y},0.9", lead="{time},")],
        ["time," + heads("{0}[0],{0}[1],{0}[2],{0}[3]"), *wide("{x},{y},{z},1", lead="{time},")],
        [
            f"{time:.4f} {x:.4f} {y:.4f}"
            for time, (x, y) in zip(TIMES, np.resize(PERSON[0, :, :2], (900, 2)), strict=True)
        ],
        long("{x} {y} {z}", PERSON + 3 * np.arange(4)[:, None, None] * RIGHT),
    ],
    ids=["scores", "quaternions", "times", "path"],
)
def test_scores_quaternions_times_and_paths_of_a_point_are_no_joints(lines):
    assert not table.matches("\n".join(lines).encode())


def test_a_table_cut_off_within_a_line_is_read_up_to_the_line_before(read):
    [clip] = read(table, "\n".join(WHOLE)[:-200])
    assert_reads(clip, PERSON[:-1])
    assert "line 5" in clip.notes[0]
    content = "\n".join(TIMELESS["labels in cells of several lines"])
    assert table.matches(content.encode()[:-100])


def test_rows_of_landmarks_may_be_rough_if_a_name_says_so(read):
    [clip] = read(table, ["Landmark_X,Landmark_Y,Landmark_Z", *long("{x},{y},{z}", POINTS * [1, 1, 1.6])])
    assert len(clip.times) == len(POINTS)


def test_one_pose_may_be_the_whole_file(read):
    lines = long("{x},{y},{z},0.9", POINTS[:1])
    assert table.matches("\n".join(lines).encode())
    [clip] = read(table, lines)
    assert_reads(clip, PERSON[:1], LIMBS)


def test_times_that_begin_again_follow_the_others(read):
    takes = [np.tile(PERSON, (4, 1, 1))[:13], np.tile(PERSON, (4, 1, 1))[1:12]]
    rows = [line for take in takes for line in wide(points=take, lead="{frame},")]
    [clip] = read(table, ["frame," + heads(), *rows], fps=10)
    assert_reads(clip, np.concatenate(takes), step=1 / 10)
    assert "The times begin again once. These frames follow the others." in clip.notes


def test_lengths_may_be_feet(read):
    [clip] = read(table, [heads(), *wide(points=PERSON / 0.3048)])
    assert_allclose(clip.positions - clip.positions[:, :1], PERSON - PERSON[:, :1], atol=1e-9)
    assert any("feet" in note for note in clip.notes)


def test_rows_of_another_form_are_left_out(read):
    poses = np.tile(PERSON, (9, 1, 1))
    rows = wide(points=poses)
    [clip] = read(table, [heads(), *(f"{row},1,2,3" if k % 6 == 5 else row for k, row in enumerate(rows))])
    assert_reads(clip, poses[np.arange(36) % 6 != 5])
    assert "6 lines have another form than the others. They are omitted." in clip.notes


def test_joints_in_no_known_order_are_told_by_how_they_move(read):
    points = moving()
    order = np.random.default_rng(0).permutation(20)
    [clip] = read(table, wide(points=points[:, order]))
    assert BY_SHAPE_NOTE in clip.notes
    assert_reads(clip, points, joints=both("shoulder", "elbow", "wrist", "hip", "knee", "ankle"), step=1 / 30)


def test_the_first_joints_of_an_order_suffice(read):
    points = joints_as(JOINT_SETS["mediapipe"])[:, :25]  # to the hips: 25 as Kinect v2 has
    [clip] = read(table, ["joint,x,y,z", *long("{name},{x},{y},{z}", points)])
    assert_reads(clip, joints=both("elbow", "wrist"))
    assert np.isnan(clip.positions[:, both("knee")]).all()


def test_a_list_of_points_may_be_empty(read):
    rows = wide("[{x}, {y}, {z}]", POINTS, lead='{time},"[', separator=", ", end=']"')
    [clip] = read(table, ["Timestamp,Pose", *rows, "0.25,[]"])
    assert_allclose(clip.positions[:-1, LIMBS], PERSON[:, LIMBS], atol=1e-9)
    assert_allclose(clip.times, [0, 0.04, 0.08, 0.12, 0.25])
    assert (clip.confidence[-1] == 0).all()
