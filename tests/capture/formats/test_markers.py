import re

import numpy as np
import pytest
from numpy.testing import assert_allclose

from capture.formats import read_log
from capture.formats.markers import joints_of_markers
from capture.formats.options import ReadOptions
from capture.skeleton import JOINT_INDEX
from puppetline.errors import SkeletonLogError

from ..bodies import STANDING, STANDS, both

AXES = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
"""From the sensor's coordinates to those of a laboratory with z up."""


def pairs(joint, apart, *names):
    """Return two markers on both sides of a joint."""
    return {name: np.add(STANDING[joint], np.multiply(apart, sign)) for name, sign in zip(names, (1, -1), strict=True)}


def body(without="", **names):
    """Return the places of Plug-in Gait's markers on a body, in metres in the sensor's coordinates.

    Those whose name has a part that matches `without` are left out, and others get other names.
    """
    at = {}
    for side, letter in (("left", "L"), ("right", "R")):
        at |= pairs(f"knee_{side}", (0.05, 0, 0), f"{letter}KNE", f"{letter}.Knee.Med")
        at |= pairs(f"ankle_{side}", (0.03, 0, 0), f"{letter}ANK", f"{letter}.Ankle.Med")
        at |= pairs(f"wrist_{side}", (0.02, 0, 0), f"{letter}WRA", f"{letter}WRB")
        at |= pairs("head", (0, 0, -0.1), f"{letter}FHD", f"{letter}BHD")
        for joint, name in (("shoulder", "SHO"), ("elbow", "ELB"), ("foot", "TOE"), ("hand", "FIN"), ("hip", "HJC")):
            at[letter + name] = np.array(STANDING[f"{joint}_{side}"])
    at |= pairs("shoulder_center", (0, 0, 0.08), "C7", "CLAV")
    return {names.get(name, name): place for name, place in at.items() if not (without and re.search(without, name))}


def trc(at, frames=3, unit=1000, separator="\t"):
    """Return a TRC file of markers that move by 0.1 m per frame."""
    names = list(at)
    points = np.array([*at.values()]) + np.multiply.outer(range(frames), [[0.1, 0, 0]])
    rows = (unit * points @ AXES.T).reshape(frames, -1)
    return [
        separator.join(["PathFileType", "4", "(X/Y/Z)", "a.trc"]),
        "DataRate",
        "100",
        separator.join(["Frame#", "Time", *(each for name in names for each in (f"Someone:{name}", "", ""))]),
        separator.join(["", "", *(f"{axis}{k}" for k in range(len(names)) for axis in "XYZ")]) + "\n",
        *(separator.join(map(repr, [k + 1.0, k / 100, *row])) for k, row in enumerate(rows.tolist())),
    ]


@pytest.fixture
def clip_of(tmp_path):
    """Read lines, or markers as a TRC file."""

    def read(content, **options):
        path = tmp_path / "take"
        path.write_text("\n".join(trc(content) if isinstance(content, dict) else content) + "\n")
        [clip] = read_log(path, ReadOptions(**options))
        return clip

    return read


@pytest.mark.parametrize("separator", ["\t", ","])
@pytest.mark.parametrize("unit", [1000, 100, 1])
def test_joints_lie_between_the_markers_on_both_sides_of_them(clip_of, separator, unit):
    clip = clip_of(trc(body(), unit=unit, separator=separator))
    assert_allclose(clip.times, [0, 0.01, 0.02])
    fixed = [index for name, index in JOINT_INDEX.items() if name not in ("spine", "hip_center")]
    found, expected = (
        np.linalg.norm(each[..., fixed, None, :] - each[..., None, fixed, :], axis=-1)
        for each in (clip.positions, np.array([STANDS] * 3))
    )
    assert_allclose(found, expected, atol=1e-6)
    assert (clip.positions[:, JOINT_INDEX["head"], 1] > clip.positions[:, JOINT_INDEX["hip_center"], 1]).all()


def test_knees_and_ankles_with_one_marker_are_inside_it(clip_of):
    hips = np.linalg.norm(np.subtract(STANDING["hip_left"], STANDING["hip_right"]))
    at = body(without="Med")
    for joint, name, share in (("knee", "KNE", 0.28), ("ankle", "ANK", 0.2)):
        for side, sign in (("left", -1), ("right", 1)):
            at[side[0].upper() + name] = np.add(STANDING[f"{joint}_{side}"], [sign * share * hips, 0, 0])
    whole = clip_of(body()).positions
    assert_allclose(clip_of(at).positions, whole, atol=1e-9)
    names, points = list(at), np.tile([*at.values()], (3, 1, 1))
    points[1, names.index("RHJC")] = np.nan
    hidden = joints_of_markers(names, points)
    assert np.argwhere(np.isnan(hidden["HipRight"]).any(axis=1)).tolist() == [[1]]
    for joint in ("knee", "ankle"):
        assert_allclose(hidden[f"{joint.title()}Left"], [STANDING[f"{joint}_left"]] * 3)
    inner = clip_of(body(without="KNE")).positions
    assert_allclose(inner[:, both("knee")], whole[:, both("knee")] - [0.05, 0, 0], atol=1e-9)


@pytest.mark.parametrize("name", ["C7", "CLAV"])
def test_one_marker_at_the_neck_is_not_the_neck(clip_of, name):
    positions = clip_of(body(without=name)).positions
    shoulders = positions[:, both("shoulder")].mean(axis=1)
    assert_allclose(positions[:, JOINT_INDEX["shoulder_center"]], shoulders, atol=1e-9)


@pytest.mark.parametrize(("front", "back"), [("ASI", "PSI"), ("FWT", "BWT"), ("ASIS", "BackAsis")])
def test_hips_follow_from_the_pelvis(clip_of, front, back):
    at = body(without="HJC")
    for sign, letter in ((-1, "L"), (1, "R")):
        at |= {letter + front: np.array([sign * 0.12, 0.0, -0.1]), letter + back: np.array([sign * 0.05, 0.0, 0.08])}
    positions = clip_of(at).positions[0]
    left, right = positions[both("hip")]
    assert np.linalg.norm(left - right) == pytest.approx(2 * 0.36 * 0.24, abs=1e-6)
    assert left[1] - positions[JOINT_INDEX["knee_left"], 1] == pytest.approx(-0.3 * 0.24 + 0.54, abs=1e-6)


def test_markers_of_a_leg_are_no_performer(clip_of):
    with pytest.raises(SkeletonLogError, match=r"no position for .*shoulder_right.* or all markers of Plug-in Gait"):
        clip_of(body(without="^[^L]"))


ACROMIA = {f"{side[0].upper()}AC": np.array(STANDING[f"shoulder_{side}"]) for side in ("left", "right")}
ISB = {"KNE": "FLE", ".Knee.Med": "FME", "ANK": "FAL", ".Ankle.Med": "TAM", "SHO": "SAE", "TOE": "FM2", "HJC": "HJC"}


@pytest.mark.parametrize(
    ("at", "lost"),
    [
        (body(without="KNE|ANK|Knee|Ankle"), ("knee", "ankle")),
        (body(without="SHO|ELB|WR|FIN") | ACROMIA, ("elbow", "wrist", "hand")),
        (
            {f"{name[0]}_{ISB[name[1:]]}": place for name, place in body().items() if name[1:] in ISB},
            ("elbow", "wrist", "hand"),
        ),
        ({f"{name[0]}t{name[1:]}": place for name, place in body(without="^[^LR]").items()}, ()),
    ],
    ids=["legs without knees and ankles", "acromia and legs", "ISB without arms", "sides of two letters"],
)
def test_joints_without_markers_are_lost(clip_of, at, lost):
    unknown = np.isnan(clip_of(at).positions).any(axis=(0, 2))
    assert {name for name, index in JOINT_INDEX.items() if unknown[index]} == {
        name for name in JOINT_INDEX if name.split("_")[0] in lost
    }


def test_joints_that_a_program_has_computed_are_read_by_their_names(clip_of):
    at = {"Neck": np.array(STANDING["shoulder_center"])}
    for side in ("left", "right"):
        for joint in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist"):
            at[f"{side[0].upper()}{joint.title()}"] = np.array(STANDING[f"{joint}_{side}"])
    clip = clip_of(at)
    assert not any("markers" in note for note in clip.notes)
    assert clip.positions[0, JOINT_INDEX["knee_left"], 1] < clip.positions[0, JOINT_INDEX["hip_left"], 1] - 0.4


def other(**spellings):
    """Return the body with other names of markers by what follows the letter of their side."""
    at = {}
    for name, place in body().items():
        own = spellings.get(name[1:], "{}" + name[1:])
        at["Q_" + (own.format(name[0]) if name[0] in "LR" else name)] = place
    return at


SIDES = {"LKNE": "L_knee_lat", "L.Knee.Med": "L_knee_medial", "LELB": "LElbow_lat_v", "RWRA": "R_wrist_radius"}
SIDES |= {"RWRB": "R_wrist_ulna", "RELB": "RHUM", "LANK": "LANE", "L.Ankle.Med": "LANI"}
SHANKS = {
    f"{side[0].upper()}{name}": np.add(STANDING[f"knee_{side}"], STANDING[f"ankle_{side}"]) / 2 + [0, rise, 0]
    for side in ("left", "right")
    for name, rise in (("_sh2", 0.02), ("_sh3", 0.03), ("SHN", 0))
}
ARMS = {
    f"{side}_hum2": np.add(STANDING[f"elbow_{name}"], STANDING[f"shoulder_{name}"]) / 2
    for side, name in (("L", "left"), ("R", "right"))
}
OPENCAP = other(
    **{".Knee.Med": "{}_mknee"},
    KNE="{}_knee",
    ANK="{}_ankle",
    WRA="{}_lwrist",
    WRB="{}_mwrist",
    ELB="{}_lelbow",
    SHO="{}_shoulder",
)
OPENCAP = {f"{name}_study": place for name, place in OPENCAP.items()} | {
    f"Q_{side}{name}": place + 0.05
    for side in "LR"
    for name, place in (("Knee", body()["LKNE"]), ("Elbow", body()["LELB"]), ("Wrist", body()["RWRA"]))
}


@pytest.mark.parametrize(
    "at",
    [
        other(KNE="{}KneeOut", WRA="{}WristIn", WRB="{}WristOut", FHD="Head{}", TOE="{}Forefoot5"),
        other(SHO="{}_SAJ", KNE="Knee_{}", WRA="Radius_{}", WRB="Ulna_{}", FHD="Head_F{}", BHD="Head_B{}"),
        other(WRA="{}W1", WRB="{}W2", TOE="{}.TO", FHD="{}_HDF", BHD="{}_HDB"),
        body(**SIDES) | dict.fromkeys(("RLFC", "LEL"), np.full(3, np.nan)),
        body() | SHANKS,
        body() | ARMS,
        OPENCAP,
    ],
    ids=["Qualisys", "MoCap Toolbox", "Motion Analysis", "many names, some never seen", "shanks", "arms", "OpenCap"],
)
def test_other_spellings_and_markers_make_no_difference(clip_of, at):
    assert_allclose(clip_of(at).positions, clip_of(body()).positions, atol=1e-9)


@pytest.mark.parametrize("namespace", ["", "Someone:"])
@pytest.mark.parametrize("header_rows", [1, 2])
def test_markers_may_be_columns_of_any_table(clip_of, namespace, header_rows):
    names = [namespace + name for name in body()]
    lines = [",".join(["Frame", *(name + axis for name in names for axis in ("_X", "_Y", "_Z"))])]
    if header_rows == 2:
        lines = [",".join(["", *(f"{name},," for name in names)]), ",".join(["Frame", *("XYZ" * len(names))])]
    points = 1000 * np.add([*body().values()], [0, 0, 0.1]) @ AXES.T
    lines += [",".join([str(k), *map(str, points.ravel())]) for k in range(3)]
    moved = [each.positions[0] - each.positions[0, JOINT_INDEX["hip_center"]] for each in map(clip_of, (lines, body()))]
    assert_allclose(*moved, atol=1e-6)


def test_a_rate_replaces_the_times_of_trc(clip_of):
    assert_allclose(np.diff(clip_of(body(), fps=50).times), 0.02)


def test_a_letter_tells_where_around_a_joint_a_marker_is(clip_of):
    around = {"SHO": ("FSH", "BSH"), "ELB": ("ELB", "IEL"), "WRA": ("OWR", "IWR"), "KNE": ("KNE", "KNI")}
    at = body()
    for side in "LR":
        for joint, names in around.items():
            middle = at.pop(f"{side}{joint}")
            at |= {
                f"{side}{name}": np.add(middle, [0, 0, away]) for name, away in zip(names, (0.04, -0.04), strict=True)
            }
        at |= {f"{side}KNI": at[f"{side}KNI"] + at.pop(f"{side}.Knee.Med") - at[f"{side}KNE"]}
        at.pop(f"{side}WRB")
    found, expected = (
        each[:, both("elbow")] - each[:, both("shoulder")]
        for each in (clip_of(at).positions, clip_of(body()).positions)
    )
    assert_allclose(found, expected, atol=1e-6)


def test_markers_may_be_lost_in_the_first_frames(clip_of):
    lines = trc(body(), frames=6)
    lines[5:8] = [f"{k}\t{(k - 1) / 100}" + 3 * len(body()) * "\tnan" for k in range(1, 4)]
    clip = clip_of(lines)
    assert_allclose(clip.times, [0.0, 0.01, 0.02, 0.03, 0.04, 0.05])
    assert np.isnan(clip.positions[:3]).all()
    assert np.isfinite(clip.positions[3:, JOINT_INDEX["head"]]).all()
