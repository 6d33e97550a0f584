"""Services that record and play takes of a small character."""

from functools import partial

import pytest

from engine_bridge.service.takes.take_track import TakeTrack


@pytest.fixture
def make_theatre(play_file, record_events, kung_fu, tmp_path):
    """Play services with a performer in a loop of an example, who is calibrated at once."""

    def make(names=("dog", "cat"), source="replay:performer.log?loop", ease=0.2, stage="", **more):
        log = tmp_path / "performer.log"
        if not log.exists():
            record_events(log, kung_fu)
        stage += f'\ncalibrate = "at_once"\nease = {ease}'
        theatre = play_file(names=names, source=source, stage=stage, **more)
        theatre.playback, theatre.count_in = theatre.service.playback, theatre.service.count_in
        theatre.count = partial(theatre.count_in.start, theatre.runner)
        theatre.left = partial(theatre.count_in.left, theatre.runner)
        theatre.end_take = lambda: theatre.runner.stop_recording().close()
        theatre.load = lambda name, path: TakeTrack(theatre.player(name), path)
        return theatre

    return make


@pytest.fixture(scope="session")
def recorded():
    """Takes that have been recorded, and their frames."""
    return {}


@pytest.fixture
def record_take(make_theatre, tmp_path, recorded):
    """Record a take of the performer; return its path and the frames that were shown meanwhile."""

    def record(name="take1", seconds=3.0, **more):
        path, key = tmp_path / f"{name}.log", repr((seconds, more))
        if key not in recorded:
            theatre = make_theatre(**more)
            theatre.runner.start_recording(path)
            frames = theatre.run(seconds)
            theatre.end_take()
            recorded[key] = path.read_bytes(), frames
            theatre.close()
        content, frames = recorded[key]
        path.write_bytes(content)
        return path, frames

    return record
