import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from capture.formats import asf_amc, read_log
from capture.formats.options import ReadOptions
from capture.skeleton import JOINT_INDEX
from puppetline.errors import SkeletonLogError

BONES = """
lhipjoint root 0.7 -0.7 0 2 |
lfemur lhipjoint 0.3 -0.95 0 7 | rx ry rz
ltibia lfemur 0.3 -0.95 0 7 | rx
lfoot ltibia 0 -0.3 1 2 | rx rz
rhipjoint root -0.7 -0.7 0 2 |
rfemur rhipjoint -0.3 -0.95 0 7 | rx ry rz
rtibia rfemur -0.3 -0.95 0 7 | rx
rfoot rtibia 0 -0.3 1 2 | rx rz
lowerback root 0 1 0 2 | rx ry rz
thorax lowerback 0 1 0 4 | rx ry rz
lowerneck thorax 0 1 0 1.5 | rx ry rz
head lowerneck 0 1 0 1.6 | rx ry rz
lclavicle thorax 0.9 0.1 0 3 | ry rz
lhumerus lclavicle 1 0 0 5 | rx ry rz
lradius lhumerus 1 0 0 3 | rx
lwrist lradius 1 0 0 1.5 | ry
rclavicle thorax -0.9 0.1 0 3 | ry rz
rhumerus rclavicle -1 0 0 5 | rx ry rz
rradius rhumerus -1 0 0 3 | rx
rwrist rradius -1 0 0 1.5 | ry
"""
TABLE = [line.partition("|") for line in BONES.strip().splitlines()]
TREE = [(left.split()[0], left.split()[1], dof.split()) for left, _, dof in TABLE]
AXIS = (10.0, -20.0, 30.0)


def skeleton():
    lines = [":version 1.10", ":units", "  length 0.45", "  angle deg", ":root", "  order TX TY TZ RX RY RZ"]
    lines += ["  axis XYZ", ":bonedata"]
    for left, _, dof in TABLE:
        name, _, *direction, length = left.split()
        lines += ["  begin", f"  name {name}", f"  direction {' '.join(direction)}", f"  length {length}"]
        lines += [f"  axis {' '.join(map(str, AXIS))} XYZ", *([f"  dof {dof.strip()}"] if dof.strip() else []), "  end"]
    lines += [":hierarchy", "  begin", *(f"    {parent} {name}" for name, parent, _ in TREE), "  end"]
    return "# a comment\n" + "\n".join(lines) + "\n"


def motion(frames):
    lines = ["#!OML:ASF C:\\takes\\someone.asf", ":FULLY-SPECIFIED", ":DEGREES"]
    for number, (place, angles) in enumerate(frames, 1):
        lines += [str(number), f"root {place} 5 0 0 90 0"]
        lines += [f"{name} {' '.join(str(angles) for _ in dof)}" for name, _, dof in TREE if dof]
    return "\n".join(lines) + "\n"


@pytest.fixture
def take(tmp_path):
    def make(name="07_01.amc", skeleton_name="07.asf", frames=((0, 0), (1, 0), (2, 5))):
        (tmp_path / skeleton_name).write_text(skeleton())
        (tmp_path / name).write_text(motion(frames))
        return tmp_path / name

    return make


@pytest.mark.parametrize("skeleton_name", ["07.asf", "someone.ASF", "other.asf"])
def test_a_motion_finds_its_skeleton_and_keeps_its_bones_and_its_way(take, skeleton_name):
    (clip,) = read_log(take(skeleton_name=skeleton_name))
    unit = 0.0254 / 0.45
    assert clip.times.tolist() == [0, 1 / 120, 2 / 120]
    at = {joint: clip.positions[:, index] / unit for joint, index in JOINT_INDEX.items()}
    for joint, parent, length in (("knee_left", "hip_left", 7), ("elbow_right", "shoulder_right", 5)):
        assert_allclose(np.linalg.norm(at[joint] - at[parent], axis=1), length, rtol=0.01)
    assert_allclose(np.linalg.norm(np.diff(at["hip_center"], axis=0), axis=1), 1.0)
    assert (at["head"][:, 1] > at["hip_center"][:, 1]).all()


def test_a_bone_turns_about_its_own_axes(take):
    (still,), (turned,) = (read_log(take(frames=[(0, 0), (0, angle)])) for angle in (0, 4))
    own = Rotation.from_euler("xyz", AXIS, degrees=True)
    knee, ankle = JOINT_INDEX["knee_left"], JOINT_INDEX["ankle_left"]
    hip = own * Rotation.from_euler("xyz", [4, 4, 4], degrees=True) * own.inv()
    whole = hip * own * Rotation.from_euler("x", 4, degrees=True) * own.inv()
    shins = [np.subtract(clip.positions[1, ankle], clip.positions[1, knee]) for clip in (still, turned)]
    cosine = shins[0] @ shins[1] / np.prod(np.linalg.norm(shins, axis=1))
    way = np.array([0.3, -0.95, 0])
    assert cosine == pytest.approx(whole.apply(way) @ way / (way @ way), abs=1e-9)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("    lfemur ltibia", "    lfemur root"),
        ("    lfemur ltibia", "    lfemur ltibia ltibia"),
        ("  dof rx ry rz", "  dof rx rx"),
        ("  dof rx ry rz", "  dof rx rq"),
        ("order TX TY", "order T TY"),
        ("  direction 0.3 -0.95 0", "  direction 0.3 -0.95"),
    ],
)
def test_a_skeleton_with_a_wrong_line_is_refused_with_that_line(tmp_path, old, new):
    assert old in skeleton()
    text = skeleton().replace(old, new, 1)
    (tmp_path / "07.asf").write_text(text)
    line = next(index for index, each in enumerate(text.splitlines(), 1) if each.startswith(new) or new in each)
    with pytest.raises(SkeletonLogError, match=rf"07\.asf, line {line}\b"):
        asf_amc.read(tmp_path / "07.asf", ReadOptions())


def test_a_chain_may_be_as_long_as_the_largest_skeleton(tmp_path):
    def lengthened(count):
        names = [f"extra{index}" for index in range(count)]
        bones = "".join(f"  begin\n  name {name}\n  direction 0 0 1\n  length 0.001\n  end\n" for name in names)
        links = "".join(f"    {parent} {name}\n" for parent, name in zip(["head", *names], names, strict=False))
        text = skeleton().replace(":hierarchy\n  begin\n", f"{bones}:hierarchy\n  begin\n")
        (tmp_path / "07.asf").write_text(text.removesuffix("  end\n") + links + "  end\n")
        return asf_amc.read(tmp_path / "07.asf", ReadOptions())

    assert len(lengthened(500 - 1 - len(TREE))) == 1
    with pytest.raises(SkeletonLogError, match=r"07\.asf, line"):
        lengthened(500 - len(TREE))


def test_a_skeleton_alone_is_its_rest_pose_and_a_motion_alone_is_an_error(take, tmp_path):
    path = take()
    (rest,) = read_log(tmp_path / "07.asf")
    assert len(rest.times) == 1
    (tmp_path / "07.asf").unlink()
    with pytest.raises(SkeletonLogError, match=r"07_01\.amc.*without its skeleton"):
        asf_amc.read(path, ReadOptions())
