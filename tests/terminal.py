"""A terminal for tests: programs run on a real pseudo-terminal."""

import codecs
import fcntl
import os
import pty
import select
import struct
import termios

TIMEOUT_SECONDS = 180.0
"""Time after which a test fails, in seconds."""


class Terminal:
    """A command on a pseudo-terminal of its own, wide enough that no line is broken.

    Attributes
    ----------
    heard : str
        All that was read so far.
    """

    def __init__(self, commands, *arguments, cwd=None):
        self._master, slave = pty.openpty()
        fcntl.ioctl(self._master, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 300, 0, 0))
        inherited = {key: value for key, value in os.environ.items() if key not in ("NO_COLOR", "COLUMNS", "LINES")}
        self.process = commands.start(
            *arguments,
            stdin=slave,
            stdout=slave,
            stderr=slave,
            cwd=cwd,
            env=inherited | {"TERM": "xterm-256color"},
            terminal=True,
        )
        os.close(slave)
        self._decoder = codecs.getincrementaldecoder("utf-8")()
        self.heard = ""

    def type(self, keys):
        """Press keys."""
        os.write(self._master, keys)

    def hear(self, words):
        """Read until something was written."""
        while words not in self.heard:
            self.read()

    def read(self):
        """Read what comes next."""
        assert self._more(), self.heard

    def end(self):
        """Read all until the program ends, and return its exit code."""
        while self._more():
            pass
        return self.process.wait(TIMEOUT_SECONDS)

    def close(self):
        """Close the window; closing again does nothing."""
        if self._master is not None:
            os.close(self._master)
            self._master = None

    def kill(self):
        """Let go of all."""
        self.close()
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait(TIMEOUT_SECONDS)

    def _more(self):
        """Take what comes; tell whether there may be more."""
        if not select.select([self._master], [], [], TIMEOUT_SECONDS)[0]:
            return False
        try:
            text = self._decoder.decode(os.read(self._master, 65536))
        except OSError:  # Linux's way to say that the other end is closed
            return False
        self.heard += text
        return True
