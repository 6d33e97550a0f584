"""The real command on a bad day (benchmarks/live_soak.py), a short one."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from ...effort import EFFORT

ROOT = Path(__file__).parents[3]

pytestmark = pytest.mark.slow

FRAMES = round(20_000 * EFFORT)
"""With 0.3, everything befalls it six times or so."""


@pytest.fixture(scope="module")
def day(blob_puppet, own_cache):
    """What became of a service and its clients in `FRAMES` frames with as many faults as went in between."""
    command = [
        sys.executable,
        "-m",
        "benchmarks.live_soak",
        str(blob_puppet),
        "--frames",
        str(FRAMES),
        "--pause",
        "0.02",
    ]
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, check=True, env=dict(os.environ))
    return json.loads(done.stdout)


def test_everything_that_may_befall_it_did(day):
    assert day["frames"] >= FRAMES
    assert not [name for name, times in day["done"].items() if not times]
    assert sum(day["refused"].values()) > 100
    assert day["clients_refused"] > 0


def test_no_exception_escaped_and_it_ended_as_it_should(day):
    assert (day["faults"], day["tracebacks"], day["exit_code"]) == (0, 0, 0), day["logged"]


def test_a_good_client_missed_nothing_and_one_who_came_late_was_served(day):
    assert (day["lost"], day["not_finite"], day["back_in_time"]) == (0, 0, 0)
    assert day["late_client"]


def test_every_request_was_answered(day):
    assert day["unanswered"] == 0


def test_its_memory_stayed_within_bounds(day):
    assert day["memory_mb"]["growth"] < 0.2, day["memory_mb"]
