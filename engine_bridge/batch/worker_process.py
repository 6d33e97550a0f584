"""Settings of a worker process, which Dask loads when it starts one."""

import signal


def dask_setup(_worker: object) -> None:
    """Ignore Ctrl-C, after which the command ends the workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
