import signal
import subprocess
import sys

import pytest

PROGRAM = """
import ctypes, logging, os, sys
from capture.native_output import logged

logging.basicConfig(format="log: %(message)s", level=sys.argv[1])
with logged():
    os.write(2, b"native error\\n")
    ctypes.CDLL(None).puts(b"native output")
    print("output")
    print("error", file=sys.stderr)
    logging.warning("warning")
    if sys.argv[2:] == ["stop"]:
        raise SystemExit("stopped")
    if sys.argv[2:] == ["crash"]:
        ctypes.CDLL(None).abort()
    if sys.argv[2:] == ["flood"]:
        ctypes.PyDLL(None).write(2, bytes(1 << 20), 1 << 20)  # nobody can read meanwhile
print("output afterwards")
logging.warning("warning afterwards")
os.write(2, b"native error afterwards\\n")
"""


def run(*arguments):
    return subprocess.run([sys.executable, "-c", PROGRAM, *arguments], capture_output=True, text=True, check=False)


def test_output_of_libraries_reaches_neither_stream_and_all_other_output_does():
    result = run("WARNING")
    assert result.stdout == "output\noutput afterwards\n"
    assert result.stderr == "error\nlog: warning\nlog: warning afterwards\nnative error afterwards\n"


def test_output_of_libraries_is_in_the_debug_log():
    result = run("DEBUG")
    assert result.stdout == "output\noutput afterwards\n"
    lines = result.stderr.splitlines()
    assert lines.index("log: native error") < lines.index("log: warning afterwards")
    assert "log: native output" in lines


@pytest.mark.parametrize("level", ["WARNING", "DEBUG"])
def test_an_error_is_written_as_ever(level):
    result = run(level, "stop")
    assert result.returncode == 1
    assert result.stderr.splitlines()[-1] == "stopped"


def test_a_crash_says_where():
    result = run("WARNING", "crash")
    assert result.returncode == -signal.SIGABRT
    assert "Fatal Python error: Aborted" in result.stderr
    assert 'File "<string>"' in result.stderr


def test_too_much_output_of_libraries_blocks_nothing():
    result = run("WARNING", "flood")
    assert (result.returncode, result.stdout) == (0, "output\noutput afterwards\n")
