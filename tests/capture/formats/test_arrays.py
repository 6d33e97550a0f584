"""Arrays of joints are read in any order of their axes, and as parameters of SMPL."""

import io
import pickle
from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from capture.formats import arrays, smpl
from capture.formats.layouts import JOINT_SETS
from capture.formats.skeleton_joints import BY_SHAPE_NOTE
from capture.skeleton import JOINT_INDEX, JOINTS
from puppetline.errors import SkeletonLogError

from ..bodies import both
from .people import LIMBS, MATRICES, PERSON, assert_reads, joints_as
from .test_joint_order import moving


def written(function, *content, **named):
    buffer = io.BytesIO()
    function(buffer, *content, **named)
    return buffer.getvalue()


npy, npz, mat = (partial(written, function) for function in (np.save, np.savez, savemat))
"""Write arrays to a file in memory."""


def of_names(places):
    """Return a place for each joint of a Matlab structure."""
    return dict(zip(JOINTS, places, strict=True))


AXES = dict(zip("xyz", np.moveaxis(PERSON, 2, 0), strict=True))
MOCAP_TOOLBOX = {"markerName": np.array(JOINTS, dtype=object)[:, None], "data": PERSON.reshape(len(PERSON), -1)}
QUALISYS = of_names(PERSON.swapaxes(0, 1))


@pytest.mark.parametrize(
    ("content", "step"),
    [
        (npy(MATRICES), 1 / 30),
        (npy(MATRICES.swapaxes(2, 3)), 1 / 30),
        (npz(**{f"joints_{axis}": places for axis, places in AXES.items()}), 1 / 30),
        (mat({axis.upper(): places for axis, places in AXES.items()}), 1 / 30),
        (npy(PERSON.transpose(0, 2, 1).reshape(len(PERSON), -1)), 1 / 30),
        (mat({"body": of_names(dict(zip("xyz", each.T, strict=True)) for each in QUALISYS.values())}), 1 / 30),
        (mat({"d_skel": PERSON.transpose(1, 2, 0), "fps": 60.0}), 1 / 60),
        *(
            (mat({"walk": take | {"freq": 60.0}, "author": "x"}, do_compression=is_small), 1 / 60)
            for take in (MOCAP_TOOLBOX, QUALISYS)
            for is_small in (False, True)
        ),
    ],
)
def test_positions_may_have_names_axes_apart_matrices_and_a_rate(read, content, step):
    [clip] = read(arrays, content)
    assert_reads(clip, step=step)


@pytest.mark.parametrize(
    "name",
    [
        "kinect_v1",
        "utd_mhad",
        "msr_action3d",
        "nuitrack",
        "human36m",
        "kinect_v2",
        "body_25b",
        "mediapipe",
        "mediapipe_22",
        "zed_34",
        "zed_38",
    ],
)
@pytest.mark.parametrize("axes", [(0, 1, 2), (1, 2, 0), (2, 0, 1)])
def test_the_order_of_joints_and_axes_is_found(read, name, axes):
    joints = joints_as(JOINT_SETS[name])
    [clip] = read(arrays, npy(joints.transpose(axes)), fps=50.0)
    assert_reads(clip, joints=both("elbow", "wrist", "knee"))
    assert clip.times[1] == 0.02


@pytest.mark.parametrize("count", [6, 7])
def test_as_many_frames_as_numbers_of_positions_and_rotations_are_frames(read, count):
    frames = np.resize(PERSON, (count, *PERSON.shape[1:]))
    [clip] = read(arrays, npy(frames.transpose(1, 2, 0)))
    assert_reads(clip, frames)


def test_samples_of_people_are_performers(read):
    people = PERSON + np.arange(4)[:, None, None, None] * [0.5, 0, 0]
    samples = people.reshape(2, 2, *PERSON.shape).transpose(0, 4, 2, 3, 1)  # as networks take them
    for clip, expected in zip(read(arrays, npy(samples)), people[[0, 2, 1, 3]], strict=True):  # one of each sample
        assert_reads(clip, expected)


@pytest.mark.parametrize("shape", [(2, 4, 1, 20), (1, 1, 4, 20)])
def test_axes_of_five_may_have_one_element_or_be_matrices(read, shape):
    points = np.broadcast_to(PERSON.reshape(1, 4, 1, 20, 3) if shape[0] > 1 else PERSON, (*shape, 3))
    assert_reads(read(arrays, npy(points))[0])
    matrices = np.tile(np.eye(4), (1, 4, 20, 1, 1))
    matrices[..., :3, 3] = PERSON
    assert_reads(read(arrays, npy(matrices))[0])


@pytest.mark.parametrize("count", [3, 4])
def test_rotations_may_follow_positions(read, count):
    turns = np.random.default_rng(0).uniform(-90, 90, (*PERSON.shape[:2], count))
    [clip] = read(arrays, npz(frames=np.concatenate([PERSON, turns], axis=2)[None]))
    assert_reads(clip)


def test_people_and_confidences_in_an_archive(read):
    people = np.stack([PERSON, PERSON + np.array([1.0, 0, 0])])
    content = np.concatenate([people, np.ones((2, 4, 20, 1))], axis=3)
    content[1, 2, 5, 3] = 0.25
    one, other = read(arrays, npz(keypoints=content, scores=np.ones(4)))
    assert_reads(one)
    assert_reads(other, people[1])
    assert np.argwhere(other.confidence < 1).tolist() == [[2, 5]]


def test_the_variables_of_a_matlab_file_without_arrays_are_named(read):
    for is_small in (False, True):
        take = {"walk1": {"by": "someone", "place": "x"}, "author": "x"}
        with pytest.raises(SkeletonLogError, match=r"walk1 \(structure of by, place\); author \(text\)"):
            read(arrays, mat(take, do_compression=is_small))


@pytest.mark.parametrize("is_named", [True, False])
def test_structures_may_have_the_bodies_of_each_frame(read, is_named):
    poses = joints_as(JOINT_SETS["kinect_v2"])

    def body(pose):
        joints = np.empty((1, len(pose)), object)
        for index, (name, point) in enumerate(zip(JOINT_SETS["kinect_v2"], pose, strict=True)):
            joints[0, index] = {"camera": point[:, None], "trackingState": 2.0} | ({"name": name} if is_named else {})
        return {"isBodyTracked": 1.0, "joints": joints}

    bodies = np.empty((len(poses), 6), object)
    for frame, pose in enumerate(poses):
        bodies[frame] = [{"isBodyTracked": 0.0}] * 2 + [body(pose)] + [{"isBodyTracked": 0.0}] * 3
    [clip] = read(arrays, mat({"body": bodies}))
    assert_reads(clip, joints=LIMBS)


def test_smpl_parameters_turn_the_bones(read):
    poses = np.zeros((5, 52, 3))
    poses[:, 16] = [0, 0, -np.pi / 2]  # the left arm hangs
    poses[:, 0] = Rotation.from_euler("x", 90, degrees=True).as_rotvec()  # z up
    content = npz(poses=poses.reshape(5, -1), trans=np.ones((5, 3)), mocap_framerate=120.0, gender="male")
    [clip] = read(arrays, content)
    assert clip.times[1] == pytest.approx(1 / 120)
    place = {joint: clip.positions[2, index] for joint, index in JOINT_INDEX.items()}
    assert_allclose(place["wrist_left"] - place["shoulder_left"], [0.005, -0.525, 0.034], atol=1e-9)
    assert_allclose(place["wrist_right"] - place["shoulder_right"], [0.525, -0.005, 0.034], atol=1e-9)
    assert (place["head"] - place["hip_center"])[1] > 0.5
    assert_allclose(place["knee_left"] - place["hip_left"], [-0.043, -0.385, -0.002], atol=1e-9)
    assert_allclose(place["ankle_right"] - place["knee_right"], [-0.017, -0.424, 0.036], atol=1e-9)
    names, joints = smpl.positions(poses[:, :22], np.zeros((5, 3)))
    assert names == list(JOINT_SETS["smpl"])
    assert joints.shape == (5, 24, 3)


@pytest.mark.parametrize(
    "content",
    [
        npy(np.zeros((9, 17, 2))),
        npy(np.random.default_rng(0).normal(size=(50, 17, 3))),
        npy(np.zeros((9, 263))),
        npy(np.array([{"joints": 1}], dtype=object)),
        npz(labels=np.arange(9)),
        npy(PERSON)[:-99],
        npz(joints=PERSON)[:-30],
        npy(np.zeros((9, 20, 3))),
        npy(np.zeros((0, 9, 20, 3))),
        npy(PERSON).replace(b"(4, 20, 3)", b"(4, 20, (3"),
        npy(PERSON).replace(b"3), }" + 20 * b" ", b"3" + 20 * b"0" + b"), }"),
        npz(global_orient=np.zeros((4, 3)), body_pose=np.zeros((5, 63))),
    ],
)
def test_other_arrays_are_refused(read, content):
    assert arrays.matches(content[:999])
    with pytest.raises(SkeletonLogError):
        read(arrays, content)


def test_pickles_are_no_arrays():
    assert not arrays.matches(pickle.dumps({"poses": np.zeros((9, 72))}))


ANGLES = {"LKneeAngles": np.ones((9, 3)), "RKneeAngles": np.ones((9, 3)), "time": np.arange(9.0)}


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (npz(results=np.array([{"joints": 1}], dtype=object)), "Python objects"),
        (npy(np.random.default_rng(0).normal(size=(40, 263))), "features of HumanML3D"),
        (npz(**ANGLES), ": angles, which give no positions without their skeleton"),
    ],
)
def test_arrays_without_positions_are_called_what_they_are(read, content, found):
    with pytest.raises(SkeletonLogError, match=found):
        read(arrays, content)


def test_one_pose_may_be_a_row_of_numbers(read):
    [clip] = read(arrays, npy(joints_as(JOINT_SETS["mediapipe"])[0].ravel()))
    assert len(clip.times) == 1


def test_features_of_humanml3d_become_joints(read):
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
    [clip] = read(arrays, npy(features.astype(np.float32)))
    [expected] = read(arrays, npy(joints), fps=20)
    assert_allclose(clip.positions, expected.positions, atol=1e-5)
    assert_allclose(clip.times, expected.times)


@pytest.mark.parametrize(
    "swapped", [("shoulder_left", "elbow_left"), ("knee_right", "ankle_right"), ("neck", "hip_left")]
)
def test_an_unknown_order_of_joints_is_refused(read, swapped):
    order = list(JOINT_SETS["lsp"])
    points = joints_as(order)
    [clip] = read(arrays, npy(points))
    assert_reads(clip, joints=[JOINT_INDEX[joint] for joint in order if joint in JOINT_INDEX])
    one, other = map(order.index, swapped)
    points[:, [one, other]] = points[:, [other, one]]
    with pytest.raises(SkeletonLogError, match="name the order with --joints"):
        read(arrays, npy(points))


def test_joints_in_an_unknown_order_are_told_by_the_bones(read):
    points = moving()[:, [3, *range(20), 7]]
    order = np.random.default_rng(4).permutation(points.shape[1])
    [clip] = read(arrays, mat({"skeleton": 1000 * points[:, order].transpose(1, 2, 0)}))
    assert BY_SHAPE_NOTE in clip.notes
    assert_allclose(np.diff(clip.positions[:, LIMBS], axis=0), np.diff(moving()[:, LIMBS], axis=0), atol=1e-6)
