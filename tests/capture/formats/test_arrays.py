"""Arrays of joints are read in any order of their axes, and as parameters of SMPL."""

import io
import pickle

import numpy as np
import pytest
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from capture.formats import arrays, smpl
from capture.formats.layouts import JOINT_SETS
from capture.formats.options import ReadOptions
from capture.formats.proportions import bone_ratios
from capture.skeleton import JOINT_INDEX, JOINTS
from puppetline.errors import SkeletonLogError

from .test_positions import joints_as, person


def saved(function=np.save, *content, **named):
    buffer = io.BytesIO()
    function(buffer, *content, **named)
    return buffer.getvalue()


@pytest.mark.parametrize(
    "name",
    ["kinect_v1", "utd_mhad", "msr_action3d", "human36m", "kinect_v2", "mediapipe", "mediapipe_22", "zed_34", "zed_38"],
)
@pytest.mark.parametrize("axes", [(0, 1, 2), (1, 2, 0), (2, 0, 1)])
def test_the_order_of_joints_and_axes_is_found(read, name, axes):
    joints = joints_as(JOINT_SETS[name])
    [clip] = read(arrays, saved(np.save, joints.transpose(axes)), fps=50.0)
    arms = [JOINT_INDEX[f"{joint}_{side}"] for joint in ("elbow", "wrist", "knee") for side in ("left", "right")]
    np.testing.assert_allclose(clip.positions[:, arms], person()[:, arms], atol=1e-9)
    assert clip.times[1] == 0.02


def test_people_and_confidences_in_an_archive(read):
    people = np.stack([person(6), person(6) + np.array([1.0, 0, 0])])
    content = np.concatenate([people, np.ones((2, 6, 20, 1))], axis=3)
    content[1, 2, 5, 3] = 0.25
    one, other = read(arrays, saved(np.savez, keypoints=content, scores=np.ones(6)))
    np.testing.assert_allclose(one.positions, people[0], atol=1e-9)
    assert np.argwhere(other.confidence < 1).tolist() == [[2, 5]]


def test_matlab_files_and_a_rate_in_the_file(read, tmp_path):
    savemat(tmp_path / "joints.mat", {"d_skel": person().transpose(1, 2, 0), "fps": 60.0})
    [clip] = read(arrays, (tmp_path / "joints.mat").read_bytes())
    np.testing.assert_array_equal(clip.positions, person())
    assert clip.times[3] == 0.05


def test_the_variables_of_a_matlab_file_without_arrays_are_named(read, tmp_path):
    for do_compression in (False, True):
        take = {"by": "someone", "place": "x"}
        savemat(tmp_path / "take.mat", {"walk1": take, "author": "x"}, do_compression=do_compression)
        with pytest.raises(SkeletonLogError, match=r"walk1 \(structure of by, place\); author \(text\)"):
            read(arrays, (tmp_path / "take.mat").read_bytes())


@pytest.mark.parametrize("do_compression", [False, True])
def test_structures_with_positions_beside_their_names_or_called_like_joints(read, tmp_path, do_compression):
    """The MoCap Toolbox has the first, and programs for Qualisys the second."""
    named = np.array(JOINTS, dtype=object)
    takes = [
        {"freq": 60.0, "markerName": named[:, None], "data": person().reshape(len(person()), -1)},
        dict(zip(JOINTS, person().transpose(1, 0, 2), strict=True)) | {"freq": 60.0},
    ]
    for take in takes:
        savemat(tmp_path / "take.mat", {"walk": take, "author": "x"}, do_compression=do_compression)
        [clip] = read(arrays, (tmp_path / "take.mat").read_bytes())
        np.testing.assert_array_equal(clip.positions, person())
        assert clip.times[3] == 0.05


@pytest.mark.parametrize("is_named", [True, False])
def test_structures_may_have_the_bodies_of_each_frame(read, tmp_path, is_named):
    poses = joints_as(JOINT_SETS["kinect_v2"])

    def body(pose):
        joints = np.empty((1, len(pose)), object)
        for index, (name, point) in enumerate(zip(JOINT_SETS["kinect_v2"], pose, strict=True)):
            joints[0, index] = {"camera": point[:, None], "trackingState": 2.0} | ({"name": name} if is_named else {})
        return {"isBodyTracked": 1.0, "joints": joints}

    bodies = np.empty((len(poses), 6), object)
    for frame, pose in enumerate(poses):
        bodies[frame] = [{"isBodyTracked": 0.0}] * 2 + [body(pose)] + [{"isBodyTracked": 0.0}] * 3
    savemat(tmp_path / "body.mat", {"body": bodies})
    [clip] = read(arrays, (tmp_path / "body.mat").read_bytes())
    own = [JOINT_INDEX[joint] for joint in JOINTS if joint.startswith(("elbow", "wrist", "hip", "knee", "ankle"))]
    np.testing.assert_allclose(clip.positions[:, own], person()[:, own], atol=1e-9)


def test_smpl_parameters_turn_the_bones(read):
    poses = np.zeros((5, 52, 3))
    poses[:, 16] = [0, 0, -np.pi / 2]  # the left arm hangs
    poses[:, 0] = Rotation.from_euler("x", 90, degrees=True).as_rotvec()  # z up
    content = saved(np.savez, poses=poses.reshape(5, -1), trans=np.ones((5, 3)), mocap_framerate=120.0, gender="male")
    [clip] = read(arrays, content)
    assert clip.times[1] == pytest.approx(1 / 120)
    place = {joint: clip.positions[2, index] for joint, index in JOINT_INDEX.items()}
    arm = place["wrist_left"] - place["shoulder_left"]
    np.testing.assert_allclose(arm / np.linalg.norm(arm), [0, -1, 0], atol=1e-9)
    other = place["wrist_right"] - place["shoulder_right"]
    np.testing.assert_allclose(other / np.linalg.norm(other), [1, 0, 0], atol=1e-9)
    assert (place["head"] - place["hip_center"])[1] > 0.5
    np.testing.assert_allclose(bone_ratios(clip.positions), 1, atol=1e-6)
    names, joints = smpl.positions(poses[:, :22], np.zeros((5, 3)))
    assert names == list(JOINT_SETS["smpl"])
    assert joints.shape == (5, 24, 3)


@pytest.mark.parametrize(
    "content",
    [
        saved(np.save, np.zeros((9, 17, 2))),
        saved(np.save, np.random.default_rng(0).normal(size=(50, 17, 3))),
        saved(np.save, np.zeros((9, 263))),
        saved(np.save, np.array([{"joints": 1}], dtype=object)),
        saved(np.savez, labels=np.arange(9)),
        saved(np.save, person())[:-99],
        saved(np.savez, joints=person())[:-30],
        saved(np.save, np.zeros((9, 20, 3))),
        saved(np.save, np.zeros((0, 9, 20, 3))),
        saved(np.save, person()).replace(b"(4, 20, 3)", b"(4, 20, (3"),
        saved(np.save, person()).replace(b"3), }" + 20 * b" ", b"3" + 20 * b"0" + b"), }"),
        saved(np.savez, global_orient=np.zeros((4, 3)), body_pose=np.zeros((5, 63))),
    ],
)
def test_other_arrays_are_refused(read, content):
    assert arrays.matches(content[:999])
    with pytest.raises(SkeletonLogError):
        read(arrays, content)


def test_pickles_are_no_arrays():
    assert not arrays.matches(pickle.dumps({"poses": np.zeros((9, 72))}))


def test_an_archive_of_objects_is_called_one(read):
    with pytest.raises(SkeletonLogError, match="Python objects"):
        read(arrays, saved(np.savez, results=np.array([{"joints": 1}], dtype=object)))


def test_one_pose_may_be_a_row_of_numbers(read):
    [clip] = read(arrays, saved(np.save, joints_as(JOINT_SETS["mediapipe"])[0].ravel()))
    assert len(clip.times) == 1


def test_features_of_humanml3d_become_joints(tmp_path):
    """The features are made from joints as their paper defines them."""
    rng, count = np.random.default_rng(2), 7
    walk = np.cumsum(rng.uniform(-0.1, 0.1, (count, 3)), axis=0)
    joints = smpl.positions(rng.uniform(-0.2, 0.2, (count, 22, 3)), walk)[1][:, :22]
    half = 0.1 * np.arange(count)  # half of the turn of the root about y
    away = Rotation.from_rotvec(np.outer(2 * half, [0, 1, 0]))  # from the file's axes to those of the root
    features = np.zeros((count, 263))
    features[:-1, 0] = np.diff(half)
    features[:-1, 1:3] = away[1:].apply(np.diff(joints[:, 0], axis=0))[:, [0, 2]]
    features[:, 3] = joints[:, 0, 1]
    level = joints[:, 1:] - joints[:, :1] * [1, 0, 1]
    features[:, 4:67] = np.stack([turn.apply(pose) for turn, pose in zip(away, level, strict=True)]).reshape(count, -1)
    np.save(tmp_path / "features.npy", features.astype(np.float32))
    np.save(tmp_path / "joints.npy", joints)
    [clip] = arrays.read(tmp_path / "features.npy", ReadOptions())
    [expected] = arrays.read(tmp_path / "joints.npy", ReadOptions(fps=20))
    np.testing.assert_allclose(clip.positions, expected.positions, atol=1e-5)
    np.testing.assert_allclose(clip.times, expected.times)


def test_normalised_features_are_no_person(tmp_path):
    np.save(tmp_path / "features.npy", np.random.default_rng(0).normal(size=(40, 263)))
    with pytest.raises(SkeletonLogError, match="features of HumanML3D"):
        arrays.read(tmp_path / "features.npy", ReadOptions())


def test_arrays_of_angles_are_called_so(read):
    with pytest.raises(SkeletonLogError) as caught:
        read(arrays, saved(np.savez, LKneeAngles=np.ones((9, 3)), RKneeAngles=np.ones((9, 3)), time=np.arange(9.0)))
    assert ": angles, which give no positions without their skeleton" in caught.value.found


@pytest.mark.parametrize(
    "swapped", [("shoulder_left", "elbow_left"), ("knee_right", "ankle_right"), ("neck", "hip_left")]
)
def test_an_unknown_order_of_joints_is_refused(read, swapped):
    order = list(JOINT_SETS["lsp"])
    points = joints_as(order)
    [clip] = read(arrays, saved(np.save, points))
    own = [JOINT_INDEX[joint] for joint in order if joint in JOINT_INDEX]
    np.testing.assert_allclose(clip.positions[:, own], person()[:, own], atol=1e-9)
    one, other = map(order.index, swapped)
    points[:, [one, other]] = points[:, [other, one]]
    with pytest.raises(SkeletonLogError, match="name the order with --joints"):
        read(arrays, saved(np.save, points))


def matrices(*, by_columns):
    """Return matrices (T, 20, 4, 4) whose origins are a person's joints."""
    axes = np.tile(np.eye(4), (*person().shape[:2], 1, 1))
    axes[..., :3, 3] = person()
    return axes.swapaxes(2, 3) if by_columns else axes


@pytest.mark.parametrize(
    "content",
    [
        saved(np.save, matrices(by_columns=False)),
        saved(np.save, matrices(by_columns=True)),
        saved(np.savez, **{f"joints_{axis}": person()[..., k] for k, axis in enumerate("xyz")}),
        saved(savemat, {axis: person()[..., k] for k, axis in enumerate("XYZ")}),
        saved(np.save, person().transpose(0, 2, 1).reshape(len(person()), -1)),
        saved(
            savemat,
            {"body": {j: {axis: person()[:, k, a] for a, axis in enumerate("xyz")} for k, j in enumerate(JOINTS)}},
        ),
    ],
)
def test_positions_may_be_origins_of_matrices_or_have_their_axes_apart(read, content):
    [clip] = read(arrays, content)
    np.testing.assert_allclose(clip.positions, person(), atol=1e-9)
