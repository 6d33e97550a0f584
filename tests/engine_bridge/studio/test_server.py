import asyncio
import signal

import pytest

from engine_bridge.studio.server import StudioSettings, run


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_studio_on_a_loop_without_signal_handlers(tmp_path, monkeypatch, number):
    """Windows' event loop raises NotImplementedError."""
    monkeypatch.setattr(asyncio.SelectorEventLoop, "add_signal_handler", asyncio.AbstractEventLoop.add_signal_handler)
    before = signal.getsignal(number)
    started = []

    def begin(served):
        started.append(served.port)
        asyncio.get_running_loop().call_soon(signal.raise_signal, number)

    asyncio.run(run(StudioSettings(tmp_path, port=0), begin, lambda: None))
    assert started
    assert signal.getsignal(number) == before
