"""Reads each file in a process with limited memory, and prints what that took.

The file of the first argument is only read to load libraries. For each of the others, the program prints a line of
JSON: the kind of error or null, the peak of additional memory in bytes, and the number of lines of Python that ran.
"""

import json
import os
import resource
import sys
import warnings
from pathlib import Path

from engine_bridge.character.character import load_character
from engine_bridge.character.materials import preview_colors

EXTRA_MEMORY_BYTES = 2**31
"""Maximum memory that reading a file may add, in bytes."""


def read(path):
    """Read a file as far as a picture requires; return the kind of error, or None."""
    try:
        character = load_character(path)
        preview_colors(character)  # which reads the pictures
        character.solver_mesh()
    except Exception as error:
        return type(error).__name__
    return None


def count_steps(function, *arguments):
    """Call a function; return what it returns, and the number of lines that ran."""
    steps = 0

    def trace(_frame, event, _argument):
        nonlocal steps
        steps += event == "line"
        return trace

    sys.settrace(trace)
    try:
        result = function(*arguments)
    finally:
        sys.settrace(None)
    return result, steps


def main(good, *paths):
    warnings.simplefilter("ignore")
    read(Path(good))  # imports and compiles
    here = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (here + EXTRA_MEMORY_BYTES, here + EXTRA_MEMORY_BYTES))
    for path in paths:
        if os.fork() == 0:
            before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            kind, steps = count_steps(read, Path(path))
            peak = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
            sys.stdout.write(json.dumps([kind, peak, steps]) + "\n")
            sys.stdout.flush()
            os._exit(0)
        os.wait()


if __name__ == "__main__":
    main(*sys.argv[1:])
