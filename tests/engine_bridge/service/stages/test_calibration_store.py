import time

import numpy as np
import pytest

from capture.sensor_tilt import SensorTilt
from engine_bridge.performance.calibration import Calibration
from engine_bridge.service.stages import calibration_store

from ..stage_steps import play


def test_calibrations_come_back_to_the_same_character_of_the_same_source(make_stage, kung_fu, tmp_path):
    stage, path = make_stage(("dog", "cat")), tmp_path / "state" / "performers.json"
    play(stage, kung_fu[:120])
    calibration_store.write(calibration_store.known_performers({"osc:1": (stage, kung_fu[119].time)}), path)
    later, elsewhere = make_stage(("dog", "horse")), make_stage()
    calibration_store.recall({"osc:1": (later, 1000.0), "osc:2": (elsewhere, 1000.0)}, path)
    [(user, (calibration, left))] = later.players[0].remembered().items()
    before, _ = stage.players[0].remembered()[user]
    np.testing.assert_array_equal(calibration.rest, before.rest)
    assert calibration.sensor == before.sensor
    assert left == pytest.approx(1000.0, abs=1.0)
    assert later.players[1].remembered() == elsewhere.players[0].remembered() == {}


def test_the_time_since_counts(make_stage, tmp_path, kung_fu):
    stage = make_stage()
    stage.players[0].remember({5: (Calibration(kung_fu[0].positions, SensorTilt(3.0, 1.0)), 90.0)})
    known = calibration_store.known_performers({"osc:1": (stage, 100.0)})
    known["written"] = time.time() - 20.0
    path = tmp_path / "performers.json"
    calibration_store.write(known, path)
    later = make_stage()
    calibration_store.recall({"osc:1": (later, 50.0)}, path)
    assert later.players[0].remembered()[5][1] == pytest.approx(50.0 - 30.0, abs=1.0)


DAMAGED = ["", "{", "[]", "{}", '{"version": 1}', '{"version": 9}', "\0"]
DAMAGED += ['{"version": 1, "written": 0, "performers": [[1]]}']


@pytest.mark.parametrize("content", DAMAGED)
def test_a_damaged_file_gives_nothing(make_stage, tmp_path, content):
    path = tmp_path / "performers.json"
    path.write_text(content)
    stage = make_stage()
    calibration_store.recall({"osc:1": (stage, 0.0)}, path)
    assert stage.players[0].remembered() == {}
