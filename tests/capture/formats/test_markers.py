import numpy as np
import pytest

from capture.formats import read_log
from capture.formats.options import ReadOptions
from capture.skeleton import JOINT_INDEX
from puppetline.errors import SkeletonLogError

from ..bodies import STANDING

AXES = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
"""From the sensor's coordinates to those of a laboratory with z up."""


def pairs(joint, apart, *names):
    """Return two markers on both sides of a joint."""
    return {name: np.add(STANDING[joint], np.multiply(apart, sign)) for name, sign in zip(names, (1, -1), strict=True)}


def body():
    """Return the places of Plug-in Gait's markers on a body, in metres in the sensor's coordinates."""
    at = {}
    for side, letter in (("left", "L"), ("right", "R")):
        at |= pairs(f"knee_{side}", (0.05, 0, 0), f"{letter}KNE", f"{letter}.Knee.Med")
        at |= pairs(f"ankle_{side}", (0.03, 0, 0), f"{letter}ANK", f"{letter}.Ankle.Med")
        at |= pairs(f"wrist_{side}", (0.02, 0, 0), f"{letter}WRA", f"{letter}WRB")
        for joint, name in (("shoulder", "SHO"), ("elbow", "ELB"), ("foot", "TOE"), ("hand", "FIN"), ("hip", "HJC")):
            at[letter + name] = np.array(STANDING[f"{joint}_{side}"])
        at |= {
            f"{letter}FHD": np.add(STANDING["head"], [0, 0, -0.1]),
            f"{letter}BHD": np.add(STANDING["head"], [0, 0, 0.1]),
        }
    at |= pairs("shoulder_center", (0, 0, 0.08), "C7", "CLAV")
    return at


def trc(path, at, frames=3, unit=1000, separator="\t"):
    names = list(at)
    rows = [
        np.array([AXES @ (unit * np.add(place, [0.1 * frame, 0, 0])) for place in at.values()])
        for frame in range(frames)
    ]
    lines = [separator.join(["PathFileType", "4", "(X/Y/Z)", "a.trc"]), "DataRate", "100"]
    lines += [separator.join(["Frame#", "Time", *(each for name in names for each in (f"Someone:{name}", "", ""))])]
    lines += [separator.join(["", "", *(f"{axis}{k}" for k in range(len(names)) for axis in "XYZ")]), ""]
    lines += [separator.join(map(repr, [k + 1.0, k / 100, *row.ravel().tolist()])) for k, row in enumerate(rows)]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("separator", ["\t", ","])
@pytest.mark.parametrize("unit", [1000, 100, 1])
def test_joints_lie_between_the_markers_on_both_sides_of_them(tmp_path, separator, unit):
    (clip,) = read_log(trc(tmp_path / "a.trc", body(), unit=unit, separator=separator), ReadOptions())
    np.testing.assert_allclose(clip.times, [0, 0.01, 0.02])
    own = np.array(list(STANDING.values()))
    fixed = [index for name, index in JOINT_INDEX.items() if name not in ("spine", "hip_center")]
    expected = np.linalg.norm(own[fixed][:, None] - own[fixed][None], axis=2)
    found = np.linalg.norm(clip.positions[:, fixed][:, :, None] - clip.positions[:, fixed][:, None], axis=3)
    np.testing.assert_allclose(found, np.broadcast_to(expected, found.shape), atol=1e-6)
    assert (clip.positions[:, JOINT_INDEX["head"], 1] > clip.positions[:, JOINT_INDEX["hip_center"], 1]).all()


@pytest.mark.parametrize(("front", "back"), [("ASI", "PSI"), ("FWT", "BWT"), ("ASIS", "BackAsis")])
def test_hips_follow_from_the_pelvis(tmp_path, front, back):
    at = {name: place for name, place in body().items() if not name.endswith("HJC")}
    for sign, letter in ((-1, "L"), (1, "R")):
        at |= {letter + front: np.array([sign * 0.12, 0.0, -0.1]), letter + back: np.array([sign * 0.05, 0.0, 0.08])}
    (clip,) = read_log(trc(tmp_path / "a.trc", at), ReadOptions())
    hips = [clip.positions[0, JOINT_INDEX[f"hip_{side}"]] for side in ("left", "right")]
    assert np.linalg.norm(np.subtract(*hips)) == pytest.approx(2 * 0.36 * 0.24, abs=1e-6)
    knee = clip.positions[0, JOINT_INDEX["knee_left"]]
    assert hips[0][1] - knee[1] == pytest.approx(-0.3 * 0.24 + 0.54, abs=1e-6)


def test_legs_without_knees_and_ankles_are_lost(tmp_path):
    at = {name: place for name, place in body().items() if "KNE" not in name and "ANK" not in name}
    at = {name: place for name, place in at.items() if "Knee" not in name and "Ankle" not in name}
    (clip,) = read_log(trc(tmp_path / "a.trc", at), ReadOptions())
    lost = {name for name, index in JOINT_INDEX.items() if np.isnan(clip.positions[:, index]).any()}
    assert lost == {f"{joint}_{side}" for joint in ("knee", "ankle") for side in ("left", "right")}


def test_markers_of_a_leg_are_no_performer(tmp_path):
    at = {name: place for name, place in body().items() if name.startswith("L")}
    with pytest.raises(SkeletonLogError, match=r"no position for .*shoulder_right.* or all markers of Plug-in Gait"):
        read_log(trc(tmp_path / "a.trc", at), ReadOptions())


def test_joints_that_a_program_has_computed_are_read_by_their_names(tmp_path):
    joints = ("Hip", "Knee", "Ankle", "Shoulder", "Elbow", "Wrist")
    at = {
        f"{side[0].upper()}{joint}": np.array(STANDING[f"{joint.lower()}_{side}"])
        for side in ("left", "right")
        for joint in joints
    }
    (clip,) = read_log(trc(tmp_path / "a.trc", at | {"Neck": np.array(STANDING["shoulder_center"])}), ReadOptions())
    assert not any("markers" in note for note in clip.notes)
    assert clip.positions[0, JOINT_INDEX["knee_left"], 1] < clip.positions[0, JOINT_INDEX["hip_left"], 1] - 0.4


def test_sides_of_joints_have_many_names_and_markers_that_are_never_seen_do_not_count(tmp_path):
    names = {"LKNE": "L_knee_lat", "L.Knee.Med": "L_knee_medial", "LELB": "LElbow_lat_v", "RWRA": "R_wrist_radius"}
    names |= {"RWRB": "R_wrist_ulna", "RELB": "RHUM", "LANK": "LANE", "L.Ankle.Med": "LANI"}
    at = {names.get(name, name): place for name, place in body().items()}
    unseen = {"RLFC": np.full(3, np.nan), "LEL": np.full(3, np.nan)}
    (clip,), (same,) = (
        read_log(trc(tmp_path / f"{name}.trc", markers), ReadOptions())
        for name, markers in (("a", at | unseen), ("b", body()))
    )
    np.testing.assert_allclose(clip.positions, same.positions, atol=1e-9)


@pytest.mark.parametrize("namespace", ["", "Someone:"])
@pytest.mark.parametrize("header_rows", [1, 2])
def test_markers_may_be_columns_of_any_table(tmp_path, namespace, header_rows):
    path, at = tmp_path / "a.csv", body()
    axes = [f"{namespace}{name}{axis}" for name in at for axis in ("_X", "_Y", "_Z")]
    lines = [",".join(["Frame", *axes])]
    if header_rows == 2:
        lines = [",".join(["", *(each for name in at for each in (namespace + name, "", ""))])]
        lines += [",".join(["Frame", *("XYZ" * len(at))])]
    points = [AXES @ (1000 * np.add(place, [0, 0, 0.1])) for place in at.values()]
    lines += [",".join([str(k), *map(str, np.ravel(points))]) for k in range(3)]
    path.write_text("\n".join(lines))
    (clip,), (same,) = (read_log(each, ReadOptions()) for each in (path, trc(tmp_path / "a.trc", body())))
    moved = [each.positions[0] - each.positions[0, JOINT_INDEX["hip_center"]] for each in (clip, same)]
    np.testing.assert_allclose(*moved, atol=1e-6)


def test_a_rate_replaces_the_times_of_trc(tmp_path):
    (clip,) = read_log(trc(tmp_path / "a.trc", body()), ReadOptions(fps=50))
    np.testing.assert_allclose(np.diff(clip.times), 0.02)


@pytest.mark.parametrize(
    "spellings",
    [
        {"KNE": "{}KneeOut", "WRA": "{}WristIn", "WRB": "{}WristOut", "FHD": "Head{}", "TOE": "{}Forefoot5"},
        {"KNE": "Knee_{}", "WRA": "Radius_{}", "WRB": "Ulna_{}", "FHD": "Head_F{}", "BHD": "Head_B{}"},
        {"WRA": "{}W1", "WRB": "{}W2", "TOE": "{}.TO", "FHD": "{}HEA"},
    ],
)
def test_programs_spell_the_same_markers_in_other_ways(tmp_path, spellings):
    """Qualisys, the MoCap Toolbox, and Motion Analysis."""
    other = {}
    for name, place in body().items():
        own = spellings.get(name[1:], "{}" + name[1:])
        other["Q_" + (own.format(name[0]) if name[0] in "LR" else name)] = place
    clips = [read_log(trc(tmp_path / f"{k}.trc", at), ReadOptions())[0] for k, at in enumerate((body(), other))]
    np.testing.assert_allclose(clips[1].positions, clips[0].positions, atol=1e-9)


def test_markers_may_be_those_of_isb_without_arms(tmp_path):
    names = {
        "KNE": "FLE",
        "Knee.Med": "FME",
        "ANK": "FAL",
        "Ankle.Med": "TAM",
        "SHO": "SAE",
        "TOE": "FM2",
        "HJC": "HJC",
    }
    at = {
        f"{name[0]}_{names[own]}": place
        for name, place in body().items()
        if (own := name[1:].removeprefix(".")) in names
    }
    (clip,) = read_log(trc(tmp_path / "a.trc", at), ReadOptions())
    known = [JOINT_INDEX[f"{joint}_{side}"] for joint in ("shoulder", "knee", "foot") for side in ("left", "right")]
    assert np.isfinite(clip.positions[:, known]).all()
    assert (clip.confidence[:, JOINT_INDEX["elbow_left"]] == 0).all()


def test_sides_of_markers_may_have_two_letters(tmp_path):
    at = {f"{name[0]}t{name[1:]}": place for name, place in body().items() if name[0] in "LR"}
    (clip,) = read_log(trc(tmp_path / "a.trc", at), ReadOptions())
    assert np.isfinite(clip.positions[:, JOINT_INDEX["elbow_left"]]).all()


def test_a_letter_tells_where_around_a_joint_a_marker_is(tmp_path):
    around = {"SHO": ("FSH", "BSH"), "ELB": ("ELB", "IEL"), "WRA": ("OWR", "IWR"), "KNE": ("KNE", "KNI")}
    at = body()
    for side in "LR":
        for joint, names in around.items():
            middle = at.pop(f"{side}{joint}")
            for name, depth in zip(names, (0.04, -0.04), strict=True):
                at[f"{side}{name}"] = np.add(middle, [0, 0, depth])
        at |= {f"{side}KNI": at[f"{side}KNI"] + at.pop(f"{side}.Knee.Med") - at[f"{side}KNE"]}
        at.pop(f"{side}WRB")
    (clip,), (other,) = (read_log(trc(tmp_path / f"{len(own)}.trc", own), ReadOptions()) for own in (at, body()))
    arms = [JOINT_INDEX[f"{joint}_{side}"] for joint in ("shoulder", "elbow") for side in ("left", "right")]
    bones = clip.positions[:, arms[2:]] - clip.positions[:, arms[:2]]
    np.testing.assert_allclose(bones, other.positions[:, arms[2:]] - other.positions[:, arms[:2]], atol=1e-6)


def test_markers_on_shanks_are_at_no_shoulder(tmp_path):
    at = body()
    expected = read_log(trc(tmp_path / "a.trc", at), ReadOptions())[0].positions
    for side, letter in (("left", "L"), ("right", "R")):
        middle = np.add(STANDING[f"knee_{side}"], STANDING[f"ankle_{side}"]) / 2
        at |= {f"{letter}_sh{k}": np.add(middle, [0, 0.01 * k, 0]) for k in (2, 3)} | {f"{letter}SHN": middle}
    [clip] = read_log(trc(tmp_path / "b.trc", at), ReadOptions())
    np.testing.assert_array_equal(clip.positions, expected)


def test_markers_of_acromia_and_legs_are_a_person(tmp_path):
    at = {name: place for name, place in body().items() if name[1:] not in ("SHO", "ELB", "WRA", "WRB", "FIN")}
    at |= {f"{side[0].upper()}AC": np.array(STANDING[f"shoulder_{side}"]) for side in ("left", "right")}
    (clip,) = read_log(trc(tmp_path / "a.trc", at), ReadOptions())
    known = {name for name, index in JOINT_INDEX.items() if np.isfinite(clip.positions[:, index]).all()}
    assert known == {name for name in JOINT_INDEX if name.split("_")[0] not in ("elbow", "wrist", "hand")}


def test_markers_may_be_lost_in_the_first_frames(tmp_path):
    path = trc(tmp_path / "a.trc", body(), frames=6)
    lines = path.read_text().splitlines()
    count = lines[-1].count("\t")
    lines[5:8] = [f"{k}\t{(k - 1) / 100}" + "\tnan" * (count - 1) for k in range(1, 4)]
    path.write_text("\n".join(lines) + "\n")
    [clip] = read_log(path, ReadOptions())
    np.testing.assert_allclose(clip.times, [0.0, 0.01, 0.02, 0.03, 0.04, 0.05])
    assert np.isnan(clip.positions[:3]).all()
    assert np.isfinite(clip.positions[3:, JOINT_INDEX["head"]]).all()
