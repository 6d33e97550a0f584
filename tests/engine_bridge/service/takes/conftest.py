"""Takes of a small character, and a service's part that plays them on a clock that tests turn."""

import pytest

from engine_bridge.service.players.character_player import PlayerSettings
from engine_bridge.service.stages.stage_runner import StageRunner
from engine_bridge.service.takes.count_in import CountIn
from engine_bridge.service.takes.take_playback import TakePlayback

SOON = PlayerSettings(calibrate="at_once", ease=0.2)


class Theatre:
    """A stage with characters and a source, and the takes that play on them."""

    def __init__(self, clock, runner):
        self.clock, self.runner = clock, runner
        self.frames = []
        self.playback = TakePlayback(self.find, lambda _, frames: self.frames.extend(frames))
        self.count_in = CountIn(self.playback)

    def find(self, name):
        players = {player.character.name: player for player in self.runner.stage.players}
        return (self.runner, players[name]) if name in players else None

    def player(self, name):
        return self.find(name)[1]

    def run(self, seconds):
        """Let time pass as the service's loop does; return the frames."""
        self.frames = []
        end, turns = self.clock.now() + seconds, 0
        while self.clock.now() < end:
            due = min(self.runner.due(), self.playback.due(), self.count_in.due(), end)
            turns = 0 if due > self.clock.now() else turns + 1
            assert turns < 5, "the loop does not wait"
            self.clock.advance_to(due)
            self.frames += self.runner.take_in()
            self.playback.advance()
            self.count_in.advance()
        return self.frames

    def of(self, name):
        """Return the last run's frames of a character."""
        return [frame for frame in self.frames if frame.character.name == name]


@pytest.fixture
def make_theatre(given_clock, make_stage, record_events, kung_fu, until_end, tmp_path):
    """Make stages with a performer in a loop of an example, or without one."""

    def make(
        names=("dog", "cat"), performer=True, player_settings=SOON, uri="replay:performer.log?loop", sound=None, **more
    ):
        log = tmp_path / "performer.log"
        if not log.exists():
            record_events(log, kung_fu)
        source = uri if performer else "osc:0"
        stage = make_stage(names, player_settings, **more)
        return Theatre(given_clock, until_end(StageRunner(source, stage, tmp_path, sound)))

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
            theatre.runner.stop_recording().close()
            recorded[key] = path.read_bytes(), frames
        content, frames = recorded[key]
        path.write_bytes(content)
        return path, frames

    return record
