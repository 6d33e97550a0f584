import asyncio
import json

from engine_bridge.studio.service_process import ServiceProcess


def line(event, **fields):
    return json.dumps({"level": "info", "event": event, "fields": fields})


def test_the_state_says_what_the_first_start_compiles_until_it_serves(tmp_path):
    async def run():
        process = ServiceProcess(tmp_path / "service.toml", "token", lambda: None)
        process._set(starting=True)
        process._read(line("compiling, once on this machine", functions=12))
        starting = process.state
        process._read(line("serving", stream=["tcp://127.0.0.1:1", "ws://127.0.0.1:2"], control=["tcp://127.0.0.1:3"]))
        return starting, process.state, process.reached

    starting, serving, reached = asyncio.run(run())
    assert starting.text == "It compiles functions, once on this machine: 12 so far, of about 40."
    assert (serving.running, serving.starting, serving.text) == (True, False, "")
    assert (reached.stream, reached.control) == ("ws://127.0.0.1:2", "tcp://127.0.0.1:3")
