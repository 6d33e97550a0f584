from pathlib import Path

import pytest

from engine_bridge.batch.conversion import Outcome
from engine_bridge.batch.grouping import TASK_SECONDS, Grouping
from engine_bridge.batch.store import Job, Record


def jobs(count, puppet="p", ending=".log"):
    return [Job(f"{puppet}/{index}{ending}", Path(f"{index}{ending}"), Path(puppet), "") for index in range(count)]


def outcome(job, seconds):
    return Outcome(job, Record("", "", None, (), {}), seconds)


def test_a_kind_that_has_never_run_is_converted_alone():
    grouping = Grouping(jobs(5) + jobs(5, ending=".csv"), [100] * 10)
    assert [len(grouping.take(1)) for _ in range(3)] == [1, 1, 1]


def test_a_task_has_recordings_for_some_seconds_in_their_order():
    work = jobs(100)
    grouping = Grouping(work, [50] + [100] * 99)
    first = grouping.take(2)
    grouping.learn(outcome(first[0], 0.05))  # a millisecond per byte
    group = grouping.take(2)
    assert group == work[1 : 1 + int(99 * 0.1 / 4 / 0.1)]  # a quarter of the rest, which is shorter than TASK_SECONDS
    grouping = Grouping(work, [50] + [100] * 99)
    grouping.learn(outcome(grouping.take(2)[0], 0.5))
    assert len(grouping.take(2)) == TASK_SECONDS // 1.0


def test_tasks_become_shorter_at_the_end_so_that_workers_end_together():
    work = jobs(41)
    grouping = Grouping(work, [100] * 41)
    grouping.learn(outcome(grouping.take(2)[0], 0.25))
    sizes = []
    while grouping:
        sizes.append(len(grouping.take(2)))
    assert sum(sizes) == 40
    assert sizes == sorted(sizes, reverse=True)
    assert (sizes[0], sizes[-1]) == (10, 1)


@pytest.mark.parametrize("workers", [1, 3])
def test_every_recording_is_in_one_task_and_a_task_has_one_kind_until_it_is_known(workers):
    work = jobs(30, "p") + jobs(30, "q")
    grouping, taken = Grouping(work, list(range(1, 61))), []
    while grouping:
        group = grouping.take(workers)
        for job in group:
            grouping.learn(outcome(job, 0.01))
        taken += group
    assert taken == work
