import asyncio
import os

import pytest

from engine_bridge.studio.long_work import worker as module
from engine_bridge.studio.long_work.worker import Worker
from puppetline.errors import PuppetlineError

TASKS = """
import os, time
from puppetline.errors import PuppetlineError

def double(progress, number):
    progress("Doubling", 0.5)
    print("printed by a library")
    return {"twice": 2 * number, "process": os.getpid()}

def refuse(progress):
    raise PuppetlineError("a.obj, line 3", found="x", expected="a number", fix="Write one.")

def fail(progress):
    raise ZeroDivisionError("nothing to divide")

def crash(progress):
    os.abort()

def sleep(progress):
    progress("Sleeping", 0.0)
    time.sleep(600)

done = []

def last(progress, number):
    return done[-1:]

def fail_afterwards(progress, number):
    progress("Nobody listens", 0.0)
    done.append(number)
    raise ZeroDivisionError

AFTERWARDS = {"double": fail_afterwards}
"""

PROGRAM = """
import sys, types
tasks = types.ModuleType("engine_bridge.studio.long_work.tasks")
exec(open(sys.argv[0].replace("program", "tasks")).read(), tasks.__dict__)
sys.modules["engine_bridge.studio.long_work.tasks"] = tasks
import engine_bridge.studio as package
package.tasks = tasks
from engine_bridge.studio.long_work import worker_process
worker_process.main()
"""


@pytest.fixture
def tasks(tmp_path, monkeypatch):
    """Let workers run the tasks above, without the seconds in which the studio's own load."""
    (tmp_path / "own_tasks.py").write_text(TASKS)
    (tmp_path / "own_program.py").write_text(PROGRAM)
    monkeypatch.setattr(module, "MODULE", "own_program")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])]))


def test_tasks_run_one_after_another_in_one_process(tasks):
    async def run():
        worker, steps = Worker(), []
        results = await asyncio.gather(
            *(worker.run("double", k, progress=lambda *step: steps.append(step)) for k in (1, 2, 3))
        )
        await worker.close()
        return results, steps

    results, steps = asyncio.run(run())
    assert [each["twice"] for each in results] == [2, 4, 6]
    assert len({each["process"] for each in results} | {os.getpid()}) == 2
    assert steps == [("Doubling", 0.5)] * 3


def test_the_process_that_got_ready_runs_the_first_task(tasks):
    async def run():
        worker = Worker()
        await worker.get_ready()
        ready = worker._process.pid
        first = await worker.run("double", 1)
        await worker.close()
        return first["process"] == ready

    assert asyncio.run(run())


def test_what_is_done_after_a_task_is_done_before_the_next_and_cannot_fail_it(tasks):
    async def run():
        worker, steps = Worker(), []
        await worker.run("double", 7, progress=lambda *step: steps.append(step))
        done = await worker.run("last", 0, progress=lambda *step: steps.append(step))
        await worker.close()
        return done, steps

    assert asyncio.run(run()) == ([7], [("Doubling", 0.5)])


@pytest.mark.parametrize(
    ("task", "where", "found"),
    [
        ("refuse", "a.obj, line 3", "x"),
        ("fail", "the work", "an internal error (ZeroDivisionError: nothing to divide)"),
        ("crash", "the work", "a crash of the program that reads the file"),
        ("sleep", "the work", "no result after 1 s"),
    ],
)
def test_a_task_that_fails_costs_nothing_but_itself(tasks, task, where, found):
    async def run():
        worker = Worker()
        with pytest.raises(PuppetlineError) as caught:
            await worker.run(task, seconds=60 if task != "sleep" else 1)
        result = await worker.run("double", 4)
        await worker.close()
        return caught.value.where, caught.value.found, result["twice"]

    assert asyncio.run(run()) == (where, found, 8)


def test_cancelling_ends_the_work_and_not_what_waits(tasks):
    async def run():
        worker, begun = Worker(), asyncio.Event()
        asleep = asyncio.create_task(worker.run("sleep", progress=lambda *_: begun.set()))
        waiting = [asyncio.create_task(worker.run("double", k)) for k in (1, 2)]
        await begun.wait()
        waiting[1].cancel()
        asleep.cancel()
        results = await asyncio.gather(asleep, *waiting, return_exceptions=True)
        await worker.close()
        return results

    first, second, third = asyncio.run(run())
    assert second["twice"] == 2
    assert all(isinstance(each, asyncio.CancelledError) for each in (first, third))
