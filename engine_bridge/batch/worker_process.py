"""Settings of a worker process, which Dask loads when it starts one."""

import signal


def dask_setup(_worker: object) -> None:
    """Ignore Ctrl-C, because the command ends the workers itself."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
