"""Readers of text recordings with one frame per line: what each reads, damaged files, and real recordings."""

import importlib

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from capture.formats.layouts import CAD60
from capture.formats.options import ReadOptions
from capture.skeleton import JOINT_INDEX, JOINTS

COUNTS = {"cad60": 15, "kinect_v2_csv": 25, "msrc12": 20, "utkinect": 20}
TICKS_PER_SECOND = {"cad60": 30, "kinect_v2_csv": 1e7, "msrc12": 1e6, "utkinect": 30}
PLACES = np.arange(1, 76).reshape(25, 3) / 16


def module(name):
    return importlib.import_module(f"capture.formats.{name}")


def line(name, time, places=PLACES, states=2, separator=None):
    """Return a line of a format; states are 0 lost, 1 inferred and 2 tracked, as far as the format has them."""
    count = COUNTS[name]
    places = 1000 * places[:count] if name == "cad60" else places[:count]
    states = np.broadcast_to(states, 25)[:count] - (name in ("cad60", "msrc12"))
    columns = [f"{time}"]
    for joint in range(count):
        if name == "cad60" and joint < 11:
            columns += ["nan", *["0.5"] * 8, "1"]  # an orientation, which is not used
        columns += [f"{value:.6f}" for value in places[joint]]
        if name != "utkinect":
            columns.append(f"{states[joint]}")
    return (separator or ("," if name in ("cad60", "kinect_v2_csv") else " ")).join(columns)


@pytest.fixture(params=COUNTS)
def name(request):
    return request.param


ORDER = {
    "cad60": [CAD60.index(joint) if joint in CAD60 else -1 for joint in JOINTS],
    "kinect_v2_csv": [0, 1, 20, *range(3, 20)],
    "msrc12": list(range(20)),
    "utkinect": list(range(20)),
}
"""The place in a line of each of the 20 joints; −1 for a joint that is placed between its neighbours."""


def test_times_positions_and_states_are_read(read, name):
    tick = round(TICKS_PER_SECOND[name])
    states, places = np.full(25, 2), PLACES.copy()
    states[4], places[7] = 1, 0.0
    lines = [line(name, tick), line(name, 2 * tick + tick // 2, places, states), "END"]
    assert module(name).matches(lines[0].encode())
    [clip] = read(module(name), lines if name == "cad60" else lines[:2])
    assert (clip.format, clip.user, clip.times.tolist()) == (name, 0, [1.0, 2.5])
    order = np.array(ORDER[name])
    known = order >= 0
    assert_allclose(clip.positions[0, known], PLACES[order[known]], atol=1e-12)
    confidence = np.where(order == 7, 0, np.where((order == 4) & (name != "utkinect"), 0.5, 1))
    assert_array_equal(clip.confidence[0, known], 1)
    assert_array_equal(clip.confidence[1, known], confidence[known])
    assert_array_equal(np.isnan(clip.positions).all(axis=2), clip.confidence == 0)


def test_joints_that_cad_60_lacks_are_placed_between_their_neighbours(read):
    [clip] = read(module("cad60"), [line("cad60", 1), "END"])
    elbow, hand, wrist = (clip.positions[0, JOINT_INDEX[f"{part}_left"]] for part in ("elbow", "hand", "wrist"))
    assert wrist == pytest.approx(elbow / 4 + 3 * hand / 4)
    assert len(clip.notes) == 3
    [endless] = read(module("cad60"), [line("cad60", 1)])
    assert len(set(endless.notes) - set(clip.notes)) == 1


@pytest.mark.parametrize("name", ["cad60", "utkinect"])
def test_the_rate_can_be_given(read, name):
    lines = [line(name, 10), line(name, 15), *["END"] * (name == "cad60")]
    [assumed], [clip] = read(module(name), lines), read(module(name), lines, fps=5.0)
    assert clip.times.tolist() == [2.0, 3.0]
    assert len(assumed.notes) == len(clip.notes) + 1


@pytest.mark.parametrize("torn", [slice(70), slice(0)])
def test_a_recording_cut_off_within_a_line_is_read_up_to_the_last_complete_line(read, name, assert_same_frames, torn):
    whole = f"{line(name, 1)}\n{line(name, 4)}\n"
    [expected] = read(module(name), whole)
    [clip] = read(module(name), whole + (line(name, 2)[torn] or "-"))
    [note] = set(clip.notes) - set(expected.notes)
    assert "line 3" in note
    assert_same_frames(clip, expected)


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("{good}\n{short}\n", "line 2"),
        ("{good}\n{short}\n{good}", "line 2"),
        ("{short}", "line 1"),
        ("{good}{separator}1\n", "line 1"),
        ("{good}\nnan{later}\n", "line 2"),
        ("{good}\ninf{later}\n", "line 2"),
        ("{good}\n{empty}\n", "line 2"),
        ("{good}\nEND\nEND\n", "line 2"),
        ("{lost}\n{lost}\n", ""),
        ("", ""),
    ],
)
def test_a_damaged_recording_is_refused_with_its_line(refused_at, name, text, place):
    good, separator = line(name, 1), "," if name in ("cad60", "kinect_v2_csv") else " "
    parts = {"good": good, "separator": separator, "short": good[:70], "later": good[1:]}
    parts |= {"empty": good[:-1] + "x", "lost": line(name, 1, 0 * PLACES)}
    assert refused_at(module(name), text.format(**parts)) == place


@pytest.mark.parametrize("name", ["kinect_v2_csv", "msrc12"])
def test_an_unknown_state_is_refused_with_its_line(refused_at, name):
    assert refused_at(module(name), [line(name, 1), line(name, 2, states=3)]) == "line 2"


def test_a_file_matches_by_the_separator_and_number_of_columns(name):
    matches, good = module(name).matches, line(name, 1)
    separator = "," if "," in good else " "
    assert matches(good.encode())
    assert matches((good + separator).encode())
    for text in ("", good[2:], f"1{separator}{good}", f"x{good}", line(name, 1, separator=";")):
        assert not matches(text.encode())
    assert not matches(good.translate(str.maketrans(", ", " ,")).encode())


def test_repeated_frames_are_skipped(read):
    [clip] = read(module("utkinect"), [line("utkinect", 1), line("utkinect", 1, 2 * PLACES), line("utkinect", 2)])
    assert (clip.positions == PLACES[:20]).all()
    assert len(clip.times) == 2
    assert "1 of 3 frames" in clip.notes[-1]


@pytest.mark.parametrize(
    ("name", "log", "counts", "gap", "frame", "time", "places"),
    [
        (
            "kinect_v2_csv",
            "kinect_v2_laban_csv/KinectReader_joints.csv",
            (371, 371),
            0.066,
            6,
            3186.9373727,
            {"hand_right": [0.268829, -0.549694, 1.01212], "shoulder_center": [0.0100643, -0.0418049, 1.03005]},
        ),
        (
            "msrc12",
            "msrc12/P1_1_1_p06.csv",
            (1027, 1007),
            2.033563,
            26,
            643.809794,
            {"head": [0.06953, 0.725342, 2.678191], "hand_right": [0.254431, -0.085197, 2.680496]},
        ),
        (
            "utkinect",
            "utkinect/joints_s09_e01.txt",
            (1244, 1244),
            298 / 30,
            5,
            44 / 30,
            {"head": [0.338894, 0.781109, 2.680387]},
        ),
    ],
)
def test_a_real_recording_has_the_frames_gaps_and_numbers_of_its_file(
    real_logs, name, log, counts, gap, frame, time, places
):
    [clip] = module(name).read(real_logs / log, ReadOptions())
    assert (len(clip.times), clip.tracked_frames) == counts
    assert np.diff(clip.times).max() == pytest.approx(gap, abs=1e-3)
    assert clip.times[frame] == time
    for joint, place in places.items():
        assert clip.positions[frame, JOINT_INDEX[joint]].tolist() == place
