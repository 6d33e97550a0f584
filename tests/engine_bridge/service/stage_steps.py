"""Stages that tests feed with events, and the frames that they return."""

import itertools
import json
from dataclasses import replace
from operator import attrgetter

import numpy as np

from capture.events import TICK_SECONDS, Cue, Tick


def with_beginnings(stage, events):
    """Go through events, and before each one the cues that a `StageRunner` gives a stage for a recording."""
    for event in events:
        for cue in stage.beginnings(event.time, recorded=True):
            yield replace(cue, arguments=as_read(cue.arguments))
        yield event


def as_read(values):
    """Return values as they are read back from a take."""
    return json.loads(json.dumps(values, allow_nan=False))


def play(stage, events):
    """Step through events; return the frames of each character."""
    shown = {player.character.name: [] for player in stage.players}
    for frame in replay(stage, with_beginnings(stage, events)):
        shown[frame.character.name].append(frame)
    return shown


def with_beginnings_of(stage, events):
    """Return the events that a stage was given, cues of its calibrations among them."""
    given = []
    for event in with_beginnings(stage, events):
        given.append(event)
        stage.step(event, 0)
    return given


def replay(stage, events):
    """Step through the events of a take, which says itself when calibrations begin."""
    return [frame for event in events for frame in stage.step(event, 0)]


def beginning(stage):
    """Return the cue with which a take of a stage begins, as it is read back."""
    snapshot = as_read(stage.snapshot(0.0))
    return Cue(snapshot["time"], "stage", snapshot)


def states(frames):
    return {frame.state for frame in frames}


def phases(frames):
    """Return the states one after the other."""
    return [state for state, _ in itertools.groupby(frame.state for frame in frames)]


def from_the_middle(make, events, cut):
    """Return the frames that a stage gives after an event, those of a take of it, and their seconds in the take."""
    stage, other = make(), make()
    replay(stage, events[:cut])
    begin = beginning(stage)
    ours, theirs = replay(stage, events[cut:]), replay(other, [begin, *events[cut:]])
    assert len(ours) == len(theirs) > 50
    assert [player.sensor for player in stage.players] == [player.sensor for player in other.players]
    for a, b in zip(ours, theirs, strict=True):
        assert a.character.name == b.character.name
        assert a.time == b.time
        assert a.state == b.state
        assert a.user == b.user
    return ours, theirs, np.array([frame.time for frame in ours]) - begin.time


def apart(ours, theirs, what):
    """Return how far apart a value of frames is (T,)."""
    value = attrgetter(what)
    return np.array([np.abs(value(a) - value(b)).max() for a, b in zip(ours, theirs, strict=True)])


def ticks(start, seconds):
    return [Tick(start + k * TICK_SECONDS) for k in range(1, round(seconds / TICK_SECONDS) + 1)]


def largest_step(frames):
    """Return how far any handle goes from one frame to the next, in diagonals."""
    steps = [np.linalg.norm(b.handles - a.handles, axis=1).max() for a, b in itertools.pairwise(frames)]
    return max(steps) / frames[0].character.prepared.mesh.diagonal


def level(time, **changed):
    return Cue(time, "level", {"tilt": 12.0, "roll": 4.0, "height": 1.3} | changed)
