import pytest

from engine_bridge.service.stages import calibration_store

from ..stage_steps import play


def test_calibrations_come_back_to_the_same_character_of_the_same_source(make_stage, kung_fu, tmp_path, given_clock):
    stage, path = make_stage(("dog", "cat")), tmp_path / "state" / "performers.json"
    play(stage, kung_fu[:120])
    known = calibration_store.known_performers({"osc:1": (stage, kung_fu[119].time + 10.0)})
    calibration_store.write(known, path)
    given_clock.advance(20.0)
    later, elsewhere = make_stage(("dog", "horse")), make_stage()
    calibration_store.recall({"osc:1": (later, 1000.0), "osc:2": (elsewhere, 1000.0)}, path)
    (dog, horse), [other] = later.players, elsewhere.players
    [(calibration, left)] = dog.remembered().values()
    assert calibration.to_json() == stage.players[0].calibration.to_json()
    assert left == pytest.approx(1000.0 - 30.0)
    assert dog.remembered().keys() == stage.players[0].remembered().keys()
    assert horse.remembered() == other.remembered() == {}


def test_a_damaged_file_gives_nothing(make_stage, tmp_path):
    path, stage = tmp_path / "performers.json", make_stage()
    for content in ("{", "[]", '{"version": 9}', '{"version": 1, "written": 0, "performers": [[1]]}', "\0"):
        path.write_text(content)
        calibration_store.recall({"osc:1": (stage, 0.0)}, path)
        assert stage.players[0].remembered() == {}
