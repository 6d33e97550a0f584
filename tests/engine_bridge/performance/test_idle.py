import itertools

import numpy as np
import pytest
from puppetline.examples.performances import PERFORMANCES

from engine_bridge.performance.idle import IdleRecording
from engine_bridge.performance.performance import make_deformer


@pytest.fixture(scope="module")
def log(record_events, tmp_path_factory):
    return record_events(tmp_path_factory.mktemp("idle") / "rear.log", PERFORMANCES["rear"]().frames())


@pytest.fixture(scope="module")
def idle(log, blob_rig):
    return IdleRecording(log, blob_rig, make_deformer(blob_rig.puppet, blob_rig.mesh, blob_rig.model))


def test_an_idle_motion_loops_without_a_seam(idle, blob_rig):
    shown = [idle.at(second) for second in np.arange(0, 30, 1 / 60)]
    steps = [np.linalg.norm(b[0] - a[0], axis=1).max() for a, b in itertools.pairwise(shown)]
    assert max(steps) < 0.03 * blob_rig.mesh.diagonal
    assert np.ptp([places.targets for places in shown], axis=0).max() > 0.05 * blob_rig.mesh.diagonal
    assert np.linalg.norm([places.root for places in shown], axis=1).max() > 0.01


def test_an_idle_motion_repeats_itself(idle):
    period = len(idle.targets) / idle._fps
    for second in (0.0, 1.234, period - 0.001):
        for ours, again in zip(idle.at(second), idle.at(second + 3 * period), strict=True):
            np.testing.assert_allclose(ours, again, atol=1e-9)


def test_a_character_idles_while_nobody_plays_it_and_eases_back_into_it(make_stage, log, kung_fu, blob_rig):
    stage = make_stage(idle=log)
    from capture.events import TICK_SECONDS, Lost, Tick

    events = [Tick(k * TICK_SECONDS) for k in range(90)]
    start = events[-1].time + TICK_SECONDS
    events += [type(f)(start + f.time, f.user, f.positions, f.confidence) for f in kung_fu[:150]]
    gone = events[-1].time + 0.01
    events += [Lost(gone, 1), *(Tick(gone + k * TICK_SECONDS) for k in range(1, 90))]
    frames = [frame for event in events for frame in stage.step(event, 0)]
    steps = [np.linalg.norm(b.targets - a.targets, axis=1).max() for a, b in itertools.pairwise(frames)]
    assert max(steps) < 0.08 * blob_rig.mesh.diagonal
    assert np.abs(frames[60].targets - frames[0].targets).max() > 0.01 * blob_rig.mesh.diagonal
