import asyncio
import json
import sys

import pytest

from engine_bridge.studio.service.service_process import RETRY_SECONDS, STEADY_SECONDS, ServiceProcess


def line(event, **fields):
    return json.dumps({"level": "info", "event": event, "fields": fields})


@pytest.fixture
def process(tmp_path):
    return ServiceProcess(tmp_path / "service.toml", "token", lambda: None)


def test_the_state_says_what_the_first_start_compiles_until_it_serves(process):
    async def run():
        process._set(starting=True)
        process._read(line("compiling, once on this machine", functions=12))
        starting = process.state
        process._read(line("serving", stream=["tcp://127.0.0.1:1", "ws://127.0.0.1:2"], control=["tcp://127.0.0.1:3"]))
        return starting, process.state, process.reached

    starting, serving, reached = asyncio.run(run())
    assert starting.text == "It compiles functions, once on this machine: 12 so far, of about 40."
    assert (serving.running, serving.starting, serving.text) == (True, False, "")
    assert (reached.stream, reached.control) == ("ws://127.0.0.1:2", "tcp://127.0.0.1:3")


def test_it_waits_longer_after_each_failure_and_from_the_beginning_again_after_a_steady_run(process, monkeypatch):
    """The fourth of five runs is steady."""
    clock, waits, steady = [0.0], [], iter([False, False, False, True, False])

    async def run():
        process._wanted = True

        async def run_once():
            clock[0] += 2 * STEADY_SECONDS if next(steady) else 1.0
            return ["ended"]

        async def sleep(seconds):
            waits.append(seconds)
            process._wanted = len(waits) < 5

        monkeypatch.setattr(process, "_run", run_once)
        monkeypatch.setattr(asyncio.get_running_loop(), "time", lambda: clock[0])
        monkeypatch.setattr(asyncio, "sleep", sleep)
        await process._keep()

    asyncio.run(run())
    assert waits == [*RETRY_SECONDS[:3], *RETRY_SECONDS[:2]]


def test_two_that_stop_it_at_once_both_wait_until_it_has_ended(process):
    async def run():
        process._keeper = ending = asyncio.create_task(asyncio.sleep(0.01))
        await asyncio.gather(process.stop(), process.stop())
        return ending.done(), process._keeper

    assert asyncio.run(run()) == (True, None)


WAITING = """
import json, sys
sys.stdin.readline()
fields = {"stream": ["ws://127.0.0.1:2"], "control": ["tcp://127.0.0.1:3"]}
print(json.dumps({"event": "serving", "fields": fields}), file=sys.stderr, flush=True)
sys.stdin.read()
"""


def test_a_process_that_got_ready_serves_when_it_is_needed_and_ends_if_it_is_not(process, monkeypatch):
    spawned = []

    async def spawn():
        pipes = dict.fromkeys(("stdin", "stderr"), asyncio.subprocess.PIPE)
        spawned.append(await asyncio.create_subprocess_exec(sys.executable, "-c", WAITING, **pipes))
        return spawned[-1]

    async def run():
        monkeypatch.setattr(process, "_spawn", spawn)
        for _ in range(2):  # the second time, there is one already
            await process.get_ready()
        assert (len(spawned), process.reached) == (1, None)
        await process.start()
        await process.get_ready()
        served = process.reached.control
        await process.stop()
        await process.get_ready()
        await process.stop()
        return served, [each.returncode is not None for each in spawned]

    assert asyncio.run(run()) == ("tcp://127.0.0.1:3", [True, True])
