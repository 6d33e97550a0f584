"""The command `puppetline`, and ``python -m puppetline``."""

import os
import sys


def run() -> None:
    """Start the command line; Ctrl-C while it is still being loaded ends quietly too."""
    # all matrices here are small: threads that wait for each other, and for the engine beside, only cost time
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        from engine_bridge.cli.main import main

        main()
    except KeyboardInterrupt:
        sys.exit("puppetline: stopped")
    finally:
        # Python ends as if killed where an interrupt has once fallen into an exec(), say of a dataclass; the next
        # exec() makes it forget that
        exec("")  # noqa: S102


if __name__ == "__main__":
    run()
