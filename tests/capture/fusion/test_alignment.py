from dataclasses import replace
from itertools import cycle, product

import numpy as np
import pytest
from numpy.testing import assert_allclose
from puppetline.examples.performances import PERFORMANCES, clean

from capture.fusion.alignment import align
from capture.skeleton import mirrored
from puppetline.errors import SkeletonLogError

from .virtual_sensors import BEHIND, BESIDE, HERE, KUNG_FU, TURN, WALK, VirtualSensor, part

NOISY = list(product((WALK, KUNG_FU, TURN), (BESIDE, BEHIND), (1, 2)))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "pose"), list(zip(PERFORMANCES, cycle((BESIDE, BEHIND)), strict=False)))
def test_without_noise_pose_and_clock_are_exact(name, pose):
    clip = clean(name)
    found = align(VirtualSensor(HERE).record(clip), VirtualSensor(pose, 1.7).record(clip), "two")
    assert_allclose(found.pose.rotation, pose.rotation, atol=1e-9)
    assert_allclose(found.pose.position, pose.position, atol=1e-9)
    assert found.clock == pytest.approx(1.7, abs=1e-9)
    assert found.residual < 1e-9
    assert found.swapped > 0.98 if pose is BEHIND else found.swapped < 0.1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("clip", "pose", "seed"),
    [pytest.param(*each, marks=pytest.mark.exhaustive if k % 5 else []) for k, each in enumerate(NOISY)],
)
def test_with_noise_the_error_at_the_performer_is_below_half_a_centimetre(clip, pose, seed):
    first, other = VirtualSensor(HERE, 0, seed), VirtualSensor(pose, -0.04, seed + 50)
    found = align(first.record(clip), other.record(clip, phase=0.013), "two")
    middle = clip.positions[:, 0].mean(axis=0)
    apart = found.pose.apply((middle - pose.position) @ pose.rotation) - middle
    assert np.linalg.norm(apart) < 0.005
    cosine = (np.trace(found.pose.rotation.T @ pose.rotation) - 1) / 2
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))) < 0.75
    assert found.clock == pytest.approx(-0.04, abs=0.005)
    assert 0.02 < found.residual < 0.06
    assert found.seconds == pytest.approx(len(clip.times) / 30, abs=0.2)


def plank():
    """A body in one plane that only moves up and down fits equally well in the opposite direction."""
    flat = np.repeat(WALK.positions[:1], len(WALK.times), axis=0)
    flat[..., 2] = 2.5
    flat[..., 1] += 0.2 * np.sin(3 * WALK.times**1.5)[:, None]
    return replace(WALK, positions=flat)


STILL = replace(WALK, positions=np.repeat(WALK.positions[:1], len(WALK.times), axis=0))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("first", "other", "why"),
    [
        (WALK, KUNG_FU, "cm between the joints"),
        (WALK, replace(WALK, positions=mirrored(WALK.positions) * [1, 1.5, 1]), "cm between the joints"),
        (WALK, STILL, "little in common (correlation 0.00)"),
        (WALK, part(WALK, 60, 130), "less than 3 s in which both sensors saw the performer"),
        (plank(), VirtualSensor(HERE, swaps=False, seed=3).record(plank()), "two opposite poses"),
    ],
)
def test_recordings_that_do_not_fit_or_fit_twice_are_refused(first, other, why):
    with pytest.raises(SkeletonLogError) as caught:
        align(first, other, "a.log and b.log")
    assert caught.value.where == "a.log and b.log"
    assert why in caught.value.found
