"""Waiting for what other threads and processes do."""

import time


def wait_until(condition, seconds=60.0):
    """Wait until a function returns something true, and return that; fail after so many seconds."""
    give_up = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < give_up, "it has not come"
        time.sleep(0.001)
    return found
