"""A short run of benchmarks/live_soak.py: the service with many kinds of faults."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from ...effort import EFFORT

ROOT = Path(__file__).parents[3]

pytestmark = pytest.mark.slow

FRAMES = round(12_000 * EFFORT)
"""Number of frames; with the default effort, each kind of fault occurs about four times."""


@pytest.fixture(scope="module")
def report(blob_puppet, own_cache):
    """Return the report of a service and its clients over `FRAMES` frames with faults between them."""
    options = ("--frames", str(FRAMES), "--pause", "0.02")
    command = [sys.executable, "-m", "benchmarks.live_soak", str(blob_puppet), *options]
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, check=True, env=dict(os.environ))
    return json.loads(done.stdout)


def test_every_kind_of_fault_occurred(report):
    assert report["frames"] >= FRAMES
    assert not [name for name, times in report["done"].items() if not times]
    assert sum(report["refused"].values()) > 100
    assert report["clients_refused"] > 0


def test_no_exception_escaped_and_it_ended_cleanly(report):
    assert (report["faults"], report["tracebacks"], report["exit_code"]) == (0, 0, 0), report["logged"]


def test_a_good_client_missed_nothing_and_a_late_one_was_served(report):
    assert (report["lost"], report["not_finite"], report["back_in_time"]) == (0, 0, 0)
    assert report["late_client"]


def test_every_request_was_answered(report):
    assert report["unanswered"] == 0


def test_its_memory_stayed_within_bounds(report):
    assert report["memory_mb"]["growth"] < 0.2, report["memory_mb"]
