import numpy as np
import pytest
from puppetline.examples.performances import PERFORMANCES, clean

from capture.clip import SkeletonClip
from capture.fusion.alignment import align
from capture.skeleton import mirrored
from puppetline.errors import SkeletonLogError


def errors(found, pose, clip):
    """Return the error of a pose at the performer's position in metres, and of its angle in degrees."""
    middle = clip.positions[:, 0].mean(axis=0)
    apart = found.apply((middle - pose.position) @ pose.rotation) - middle
    cosine = (np.trace(found.rotation.T @ pose.rotation) - 1) / 2
    return np.linalg.norm(apart), np.degrees(np.arccos(np.clip(cosine, -1, 1)))


@pytest.mark.slow
@pytest.mark.parametrize("name", list(PERFORMANCES))
@pytest.mark.parametrize("from_where", ["beside", "behind"])
def test_without_noise_pose_and_clock_are_exact(name, from_where, request, virtual_sensor, here):
    clip, pose = clean(name), request.getfixturevalue(from_where)
    found = align(virtual_sensor(here).record(clip), virtual_sensor(pose, 1.7).record(clip), "two")
    np.testing.assert_allclose(found.pose.rotation, pose.rotation, atol=1e-9)
    np.testing.assert_allclose(found.pose.position, pose.position, atol=1e-9)
    assert found.clock == pytest.approx(1.7, abs=1e-9)
    assert found.residual < 1e-9
    assert found.swapped > 0.98 if from_where == "behind" else found.swapped < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("from_where", ["beside", "behind"])
@pytest.mark.parametrize("performance", ["walk", "kung_fu", "turn"])
def test_with_noise_the_error_at_the_performer_is_below_half_a_centimetre(
    performance, from_where, seed, request, virtual_sensor, here
):
    clip, pose = request.getfixturevalue(performance), request.getfixturevalue(from_where)
    first, other = virtual_sensor(here, 0, seed), virtual_sensor(pose, -0.04, seed + 50)
    found = align(first.record(clip), other.record(clip, phase=0.013), "two")
    apart, angle = errors(found.pose, pose, clip)
    assert apart < 0.005
    assert angle < 0.75
    assert found.clock == pytest.approx(-0.04, abs=0.005)
    assert 0.02 < found.residual < 0.06
    assert found.seconds == pytest.approx(len(clip.times) / 30, abs=0.2)


def refusal(first, other):
    with pytest.raises(SkeletonLogError) as caught:
        align(first, other, "a.log and b.log")
    assert caught.value.where == "a.log and b.log"
    return caught.value.found


@pytest.mark.slow
def test_recordings_that_do_not_fit_are_refused(walk, kung_fu):
    assert "cm between the joints in the best fit" in refusal(walk, kung_fu)
    assert "cm between the joints" in refusal(
        walk, SkeletonClip("", 1, walk.times, mirrored(walk.positions) * [1, 1.5, 1], walk.confidence)
    )


def test_recordings_with_too_little_in_common_are_refused(walk):
    still = SkeletonClip("", 1, walk.times, np.repeat(walk.positions[:1], len(walk.times), axis=0), walk.confidence)
    assert "little in common (correlation 0.00)" in refusal(walk, still)
    short = SkeletonClip("", 1, *(part[60:130] for part in (walk.times, walk.positions, walk.confidence)))
    assert "less than 3 s in which both sensors saw the performer" in refusal(walk, short)


def test_a_plank_that_turns_about_itself_has_no_front(virtual_sensor, here, walk):
    """A body in one plane that only moves up and down fits equally well in the opposite direction."""
    flat = np.repeat(walk.positions[:1], len(walk.times), axis=0)
    flat[..., 2] = 2.5
    flat[..., 1] += 0.2 * np.sin(3 * walk.times**1.5)[:, None]
    clip = SkeletonClip("", 1, walk.times, flat, walk.confidence)
    other = virtual_sensor(here, swaps=False, seed=3).record(clip)
    assert "two opposite poses of the second sensor that fit similarly well" in refusal(clip, other)
