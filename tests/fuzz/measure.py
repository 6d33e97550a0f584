"""Read files, each in a process of its own that cannot have much memory, and write what that took.

The first argument is read for warming up. For each of the others there is a line of JSON: the kind of error or null,
the peak of memory over what was there before in bytes, and seconds.
"""

import json
import os
import resource
import sys
import time
import warnings
from pathlib import Path

from engine_bridge.character.character import load_character

ROOM = 2**31


def read(path):
    """Read a file as far as a picture of it needs, and return the error's kind, if any."""
    try:
        character = load_character(path)
        character.colors  # noqa: B018 - which reads the pictures
        character.solver_mesh()
    except Exception as error:
        return type(error).__name__
    return None


def main(good, *paths):
    warnings.simplefilter("ignore")
    read(Path(good))  # imports and compiles
    here = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (here + ROOM, here + ROOM))
    for path in paths:
        if os.fork() == 0:
            before, start = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
            kind = read(Path(path))
            seconds = time.process_time() - start
            peak = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
            sys.stdout.write(json.dumps([kind, peak, seconds]) + "\n")
            sys.stdout.flush()
            os._exit(0)
        os.wait()


if __name__ == "__main__":
    main(*sys.argv[1:])
