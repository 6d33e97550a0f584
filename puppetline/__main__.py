"""The command `puppetline`, and ``python -m puppetline``."""

import io
import os
import sys

from puppetline.child_process import end_with_parent
from puppetline.interrupts import repeated_interrupts


def run() -> None:
    """Run the command line; Ctrl-C prints no traceback, even while modules are loaded."""
    # all matrices are small, so more threads only wait for each other and take time from the engine
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a pipe on Windows has no character for − or α
            stream.reconfigure(errors="replace")
    end_with_parent()
    try:
        with repeated_interrupts():
            from engine_bridge.cli.compile_ahead import compiling_ahead
            from engine_bridge.cli.main import main

            with compiling_ahead():
                main()
    except KeyboardInterrupt:
        sys.exit("puppetline: stopped")
    finally:
        # After an interrupt inside an exec(), for example in a dataclass, Python would exit as if killed by a signal;
        # another exec() prevents that
        exec("")  # noqa: S102


if __name__ == "__main__":
    run()
