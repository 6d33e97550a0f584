import itertools

import numpy as np
from puppetline.examples.performances import PERFORMANCES

from engine_bridge.performance.character_motion import make_deformer
from engine_bridge.performance.idle import idle_motion


def test_an_idle_motion_loops_without_a_seam(record_events, prepared_blob, tmp_path):
    log = record_events(tmp_path / "rear.log", PERFORMANCES["rear"]().frames())
    idle = idle_motion(log, prepared_blob, make_deformer(prepared_blob))
    shown = [idle.at(second) for second in np.arange(0, 30, 1 / 60)]
    steps = [np.linalg.norm(b.targets - a.targets, axis=1).max() for a, b in itertools.pairwise(shown)]
    assert max(steps) < 0.03 * prepared_blob.mesh.diagonal
    assert np.ptp([places.targets for places in shown], axis=0).max() > 0.05 * prepared_blob.mesh.diagonal
    assert np.linalg.norm([places.root for places in shown], axis=1).max() > 0.01
