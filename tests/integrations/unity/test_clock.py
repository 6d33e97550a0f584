"""The clocks of a Puppet: the engine's, with slow motion, pauses and recordings at a fixed rate, and a manual one."""

from dataclasses import replace

import numpy as np
import pytest

from ...waiting import wait_until

FPS = 30


@pytest.fixture
def send(stage):
    """Send frames of the stage, whose times are their numbers by 1/30 s."""
    [frame] = stage.next(1)
    return lambda numbers: stage.send(*(replace(frame, sequence=each + 1, time=each / FPS) for each in numbers))


@pytest.fixture
def puppet(start, stage):
    """Start a puppet with a clock, as soon as it has the scene."""

    def run(clock, **fields):
        given = {"port": stage.port, "character": "blob", "interpolationDelay": 0, "clock": clock, **fields}
        program = start("Component", "materials=Any/Shader", *(f"{name}={value}" for name, value in given.items()))
        program.until(lambda said: said.get("event") == "sceneLoaded")
        return program

    return run


def ask(program, *lines):
    """Tell lines, and return the times that are shown after those that answer with one."""
    since = len(program.said)
    for line in lines:
        program.tell(line)
    expected = sum(line.startswith(("tick", "advance")) for line in lines)
    times = []
    while len(times) < expected:
        said = program.until(lambda said: "at" in said, since)
        since = program.said.index(said, since) + 1
        times.append(said["at"])
    return times


def wait_for(program, frames):
    """Wait until so many frames are there."""

    def waiting():
        since = len(program.said)
        program.tell("waiting")
        return program.until(lambda said: "waiting" in said, since)["waiting"]

    wait_until(lambda: waiting() >= frames)


def test_a_manual_clock_moves_by_what_it_is_advanced(puppet, send):
    program = puppet("Manual")
    send(range(60))
    wait_for(program, 60)
    steps = (0.1, 0.0, 0.25, 0.5, 0.01)
    assert ask(program, *(f"advance {step}" for step in steps)) == pytest.approx(np.cumsum(steps), abs=1e-5)
    assert ask(program, "tick 0.3", "tick 0.3") == pytest.approx([0.86, 0.86], abs=1e-5)
    assert ask(program, "advance 9") == pytest.approx([59 / FPS])  # the last frame stays
    program.finish()


def test_the_engines_clock_is_scaled_and_paused(puppet, send):
    program = puppet("Engine")
    send(range(60))
    wait_for(program, 60)
    # Unity's times are scaled already; at another scale than 1, nothing is made up for.
    half = ask(program, "scale 0.5", *["tick 0.01"] * 10)
    assert np.diff([0, *half]) == pytest.approx([0.01] * 10, abs=1e-5)
    paused = ask(program, "scale 0", *["tick 0"] * 5)
    assert paused == [half[-1]] * 5
    again = ask(program, "scale 1", *["tick 0.02"] * 5)
    assert np.diff([half[-1], *again]) == pytest.approx([0.02 * 1.05] * 5, abs=1e-5)
    program.finish()


def test_a_recording_has_every_frame_once_however_late_it_comes(puppet, send):
    program = puppet("Engine", interpolationDelay=0.05)
    program.tell(f"capture {1 / FPS}")
    wait_for(program, 0)  # the command has been followed: frames that came before it would be delayed
    send(range(26))  # one more, since times are rounded
    times = ask(program, *[f"tick {1 / FPS}"] * 24)
    assert times == pytest.approx([number / FPS for number in range(1, 25)], abs=1e-5)
    program.tell("capture 0")
    assert not any("warning" in said for said in program.finish())


def test_a_recording_goes_on_after_a_while_without_frames(puppet, send):
    program = puppet("Engine")
    send([0])
    wait_for(program, 1)
    program.tell(f"capture {1 / FPS}")
    assert ask(program, *[f"tick {1 / FPS}"] * 3) == [0, 0, 0]
    program.tell("capture 0")
    assert sum("warning" in said for said in program.finish()) == 1


def test_another_clock_takes_effect_at_run_time(puppet, send):
    program = puppet("Realtime")
    send(range(10))
    program.until(lambda said: said.get("frame") == 10)
    program.tell("change clock Manual")
    wait_for(program, 0)  # the command has been followed
    send(range(10, 20))
    wait_for(program, 10)
    assert ask(program, "advance 0.1") == pytest.approx([10 / FPS + 0.1], abs=1e-5)
    program.finish()
