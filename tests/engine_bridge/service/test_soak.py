"""A service on many bad days: a short one in this process, of which every frame is accounted for, and a long one."""

import itertools
import json
import os
import random
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from capture.events import TICK_SECONDS

from ...effort import EFFORT

ROOT = Path(__file__).parents[3]

FRAMES = round(12_000 * EFFORT)
"""Number of frames of the long day; with the default effort, each kind of fault occurs about four times."""

TURNS = round(400 * EFFORT)
"""Number of the short day's turns, in each of which two performers send a frame."""


def test_every_frame_is_shown_or_dropped_by_a_stall_whatever_else_happens(
    play, blob_puppet, sender, kung_fu, given_clock, caplog
):
    chance, done, sent = random.Random(7), Counter(), Counter()
    service = play("--puppet", blob_puppet, "--source", sender.uri, "--calibrate", "at_once")
    bodies = itertools.cycle(kung_fu)

    def stall():
        for _ in range(chance.randrange(1, 8)):  # nobody turns the loop while these come
            sender.send(next(bodies))
            sent["frame"] += 1
        given_clock.advance(0.2)

    def garbage():
        sender.raw(chance.randbytes(chance.randrange(1, 200)))
        sent["garbage"] += 1

    def ask(do, **arguments):
        return lambda: service.ask(do, **arguments)

    dog = {"character": "blob"}
    faults = {
        "stall": stall,
        "garbage": garbage,
        "lose": sender.lose,
        "mirror": ask("mirror", **dog),
        "nonsense": ask("mirror", character=7),
        "calibrate": ask("calibrate", **dog),
        "reload": ask("reload"),
        "remap": lambda: service.ask("set_handle", handle="head", gain=chance.random(), **dog),
        "silence": lambda: service.run(chance.choice((0.1, 0.7, 2.0))),
    }
    for _ in range(TURNS):
        service.perform(sender, [next(bodies)])
        sent["frame"] += 1
        service.run(TICK_SECONDS)
        if chance.random() < 0.2:
            name = chance.choice([*faults])
            faults[name]()
            done[name] += 1
    service.run(3.0)
    stage = service.stage()
    assert done.keys() == faults.keys()
    assert sum(stage["refused"].values()) == sent["garbage"]
    assert service.runner.skeletons + stage["dropped"] == sent["frame"]
    assert stage["faults"] == 0
    assert "internal error" not in caplog.text
    assert [frame.sequence for frame in service.frames] == [*range(1, len(service.frames) + 1)]
    assert (np.diff([frame.time for frame in service.frames]) >= 0).all()
    assert all(np.isfinite(frame.pose.controls).all() for frame in service.frames)


@pytest.mark.slow
@pytest.mark.exhaustive
def test_a_good_client_misses_nothing_over_a_long_day_with_all_faults(blob_puppet, own_cache):
    command = [sys.executable, "-m", "benchmarks.live_soak", str(blob_puppet), "--frames", str(FRAMES)]
    done = subprocess.run([*command, "--pause", "0.02"], cwd=ROOT, stdout=subprocess.PIPE, check=True, env=os.environ)
    report = json.loads(done.stdout)
    assert report["frames"] >= FRAMES
    assert not [name for name, times in report["done"].items() if not times]
    assert sum(report["refused"].values()) > 100
    assert report["clients_refused"] > 0
    assert (report["faults"], report["tracebacks"], report["exit_code"]) == (0, 0, 0), report["logged"]
    assert report["lost"] == 0
    assert report["not_finite"] == 0
    assert report["back_in_time"] == 0
    assert report["late_client"]
    assert report["unanswered"] == 0
    assert report["memory_mb"]["growth"] < 0.2, report["memory_mb"]
