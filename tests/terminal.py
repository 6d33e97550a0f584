"""A terminal for tests: programs run on a real pseudo-terminal, and what is on its screen."""

import codecs
import fcntl
import os
import pty
import re
import select
import struct
import termios
import time

import numpy as np

PATIENCE = 180.0
"""Seconds after which a test gives up."""

DONE, IS_DONE = "\x1b[5n", b"\x1b[0n"
"""What a terminal is asked after each view, and what it answers."""

_CODE = re.compile(r"\x1b\[(\??)([\d;]*)([A-Za-z])|([^\x1b])", re.DOTALL)
_DEFAULT = (-1, -1, -1)


class Emulated:
    """What is on the screen of a terminal after all that was written to it, as far as Puppetline makes use of one.

    Attributes
    ----------
    characters : (lines, columns) str
    colors : (lines, columns, 2, 3) int
        Of each cell the foreground and the background, -1 where that is the terminal's own.
    alternate, cursor : bool
        Whether the alternate screen is shown, and the cursor.
    printed : str
        What was written to the other screen.
    """

    def __init__(self, columns, lines):
        self.alternate, self.cursor, self.printed = False, True, ""
        self._row = self._column = 0
        self._pen = [_DEFAULT, _DEFAULT]
        self.resize(columns, lines)

    def resize(self, columns, lines):
        """Be so large, and empty."""
        self.characters = np.full((lines, columns), " ")
        self.colors = np.full((lines, columns, 2, 3), -1)

    def feed(self, text):
        """Show a text with whole control codes."""
        for private, numbers, code, character in _CODE.findall(text):
            if not code:
                self._put(character)
            elif private:
                self._switch(int(numbers), code == "h")
            else:
                self._obey(code, [int(number or 0) for number in numbers.split(";")])

    def text(self):
        """Return what is written on it, line by line."""
        return ["".join(line).rstrip() for line in self.characters]

    def pixels(self):
        """Return the (2 n, columns, 3) colours of the half blocks, -1 where there is something else."""
        cells = np.where((self.characters == "▀")[..., None, None], self.colors, -1)
        return cells.swapaxes(1, 2).reshape(-1, cells.shape[1], 3)

    def _put(self, character):
        if not self.alternate:
            self.printed += character
            return
        lines, columns = self.characters.shape
        if self._row < lines and self._column < columns:  # what was on its way when the window became smaller
            self.characters[self._row, self._column] = character
            self.colors[self._row, self._column] = self._pen
        self._column += 1

    def _switch(self, mode, on):
        if mode == 1049:
            self.alternate = on
        else:
            assert mode == 25, mode
            self.cursor = on

    def _obey(self, code, numbers):
        if code == "H":
            self._row, self._column = (numbers[0] or 1) - 1, (numbers[-1] or 1) - 1
        elif code == "m":
            self._paint(numbers)
        elif (code, numbers) == ("J", [2]):
            self.characters[:], self.colors[:] = " ", -1
        else:
            assert (code, numbers) == ("K", [2]), (code, numbers)
            self.characters[self._row :][:1], self.colors[self._row :][:1] = " ", -1

    def _paint(self, numbers):
        if numbers == [0]:
            self._pen = [_DEFAULT, _DEFAULT]
        while numbers:
            first, *numbers = numbers
            if first in (38, 48):
                assert numbers[0] == 2, numbers
                self._pen[first == 48] = tuple(numbers[1:4])
                numbers = numbers[4:]


class Terminal:
    """A program on a pseudo-terminal of its own, which answers as terminals do.

    Attributes
    ----------
    screen : Emulated
        As it was after the last whole view, and after all when the program has ended.
    heard : str
        All that was read so far.
    before : list
        How its keyboard and its lines were set before the program began, as `settings` returns it.
    """

    def __init__(self, commands, *arguments, columns=80, lines=24, answers=True, cwd=None, **environment):
        self._answers = answers
        self._master, slave = pty.openpty()
        self.screen = Emulated(columns, lines)
        self.resize(columns, lines)
        self.before = self.settings()
        inherited = {key: value for key, value in os.environ.items() if key not in ("NO_COLOR", "COLUMNS", "LINES")}
        self.process = commands.start(
            *arguments,
            stdin=slave,
            stdout=slave,
            stderr=slave,
            cwd=cwd,
            env=inherited | {"TERM": "xterm-256color", "COLORTERM": "truecolor"} | environment,
            terminal=True,
        )
        os.close(slave)
        self._decoder = codecs.getincrementaldecoder("utf-8")()
        self.heard = self._text = ""

    def resize(self, columns, lines):
        """Make the window so large; what was on it is gone."""
        fcntl.ioctl(self._master, termios.TIOCSWINSZ, struct.pack("HHHH", lines, columns, 0, 0))
        self.screen.resize(columns, lines)

    def type(self, keys):
        """Press keys."""
        os.write(self._master, keys)

    def until(self, condition):
        """Read whole views until one satisfies a condition."""
        assert any(condition(self.screen) for _ in self._views()), (self.screen.text(), self.screen.printed)

    def hear(self, words):
        """Read until something was written, in whatever view."""
        while words not in self.heard:
            assert self._read(), self.heard

    def end(self):
        """Read all until the program ends, and return its exit code."""
        for _ in self._views():
            pass
        self.screen.feed(self._text)
        return self.process.wait(PATIENCE)

    def settings(self):
        """Return how its keyboard and its lines are set."""
        return termios.tcgetattr(self._master)

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
        self.process.wait(PATIENCE)

    def _views(self):
        """Go through whole views, as long as there are any."""
        give_up = time.monotonic() + PATIENCE
        while time.monotonic() < give_up:
            view, done, rest = self._text.partition(DONE)
            if done:
                self._text = rest
                self.screen.feed(view)
                if self._answers:
                    self.type(IS_DONE)
                yield
            elif not self._read():
                return

    def _read(self):
        """Take what comes; tell whether there may be more."""
        if not select.select([self._master], [], [], PATIENCE)[0]:
            return False
        try:
            text = self._decoder.decode(os.read(self._master, 65536))
        except OSError:  # Linux's way to say that the other end is closed
            return False
        self._text += text
        self.heard += text
        return True
