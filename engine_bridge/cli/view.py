"""What a sensor sees now, in a terminal: pictures of half blocks, and the words below them.

Rich knows the terminal's colours and sets the words. Pictures are painted here, and only where they have changed: in
Rich's styles, a view of 160×50 took 0.18 s and 246 kB; painted here it takes 0.02 s and, after the first, some 10 kB.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from rich.color import Color, ColorSystem
from rich.console import COLOR_SYSTEMS, Console
from rich.control import Control
from rich.text import Text

from capture.sensors.sight import Reason, Sight, Watch, reasons, told
from engine_bridge.cli.screen import Screen
from engine_bridge.pictures.look import GUESSED, PAPER, color_of, small_panels

PERIOD = 0.1
"""Seconds from one view to the next, where drawing it takes less than half of that."""
LEAST = 40, 16
"""Columns and lines without which there is no view."""
WORDS = 6, 1 / 6
"""Lines below the picture, and their share of all, whichever is more."""
UNLIKE = 6
"""Of 255: a cell whose colours are no farther off is not painted anew, for the sake of slow lines."""
SHADES = " ░▒▓█"
"""Of terminals without colours."""
SHADED = ColorSystem.EIGHT_BIT, ColorSystem.TRUECOLOR
"""Of colours, those that are enough for shades."""

_Color = tuple[int, int, int]
_READY = 0.01  # seconds between looks whether the terminal is


def watch_live(looking: Watch, screen: Screen, stop: Callable[[], bool], seconds: float) -> Sight:
    """Show what a source sees, until it is enough, the source is over or the terminal is gone; return what was last.

    Parameters
    ----------
    looking : Watch
    screen : Screen
        Entered.
    stop : callable
        Says whether it is enough.
    seconds : float
        After which it is enough, too.
    """
    end = time.monotonic() + seconds
    due = time.monotonic()
    view = View((0, 0), console := Console())
    while not (stop() or looking.over or screen.gone) and time.monotonic() < end:
        looking.take_in(min(due, end))
        begun = time.monotonic()
        if begun < due:
            continue
        if not screen.ready:
            due = begun + _READY
            continue
        if view.size != screen.size:
            view = View(screen.size, console)
        screen.show(view.draw(sight := looking.sight(), reasons(sight)))
        due = begun + max(PERIOD, 2 * (time.monotonic() - begun))
    return replace(looking.sight(), retried=False)


class View:
    """Draws one sight after the other on a terminal of one size, and of each only what has changed.

    Parameters
    ----------
    size : (int, int)
        Columns and lines.
    console : Console
        Of the terminal.
    """

    def __init__(self, size: tuple[int, int], console: Console) -> None:
        self.size = size
        self._console = console
        self._colors = None if console.no_color else COLOR_SYSTEMS.get(console.color_system or "")
        self._blocks = HalfBlocks(self._colors)
        self._written: dict[int, str] = {}

    def draw(self, sight: Sight, why: Sequence[Reason]) -> str:
        """Return what is to be written, after what was written before, to show a sight and why nothing moves."""
        columns, lines = self.size
        clear = "" if self._written else f"{Control.clear()}"
        if columns < LEAST[0] or lines < LEAST[1]:
            small = f"This terminal is too small: {LEAST[0]} columns and {LEAST[1]} lines are the least."
            return clear + self._write(0, lines, Text(small))
        below = max(WORDS[0], round(WORDS[1] * lines))
        high = lines - 1 - below
        panels = small_panels(sight, columns, 2 * high, plain=self._colors not in SHADED)
        titles, canvas = Text(style="dim"), Image.new("RGB", (columns, 2 * high), PAPER)
        for panel in panels:
            width = panel.size[0]
            title = panel.title if len(panel.title) < width else panel.title.partition(",")[0]
            canvas.paste(panel.image(), (titles.cell_len, 0))
            titles.append(title[:width].ljust(width + 1))
        return (
            clear
            + self._write(0, 1, titles)
            + self._blocks.paint(np.asarray(canvas), top=1)
            + self._write(1 + high, below, _words(sight, why))
        )

    def _write(self, top: int, count: int, text: Text) -> str:
        """Return what writes a text into so many lines, as far as there is room."""
        with self._console.capture() as captured:
            self._console.print(text, width=self.size[0], end="")
        lines = captured.get().split("\n")[:count]
        written = ""
        for row, line in enumerate([*lines, *[""] * (count - len(lines))], top):
            if self._written.get(row) != line:
                self._written[row] = line
                written += f"\x1b[{row + 1};1H\x1b[0m\x1b[2K{line}"
        return written


class HalfBlocks:
    """Paints pixels, two in each cell of a terminal: the character ▀ in the upper one's colour on the lower one's.

    Parameters
    ----------
    colors : ColorSystem or None
        Of the terminal; without, the brighter of the two is told by how full the character is.
    """

    def __init__(self, colors: ColorSystem | None) -> None:
        self._colors = colors
        self._shown: NDArray[np.int16] | None = None

    def paint(self, pixels: NDArray[np.uint8], top: int = 0) -> str:
        """Return what is to be written for pixels, where those before are shown already.

        Parameters
        ----------
        pixels : (2 n, width, 3) uint8
            Each time as many.
        top : int
            Lines above.
        """
        cells = pixels.reshape(-1, 2, *pixels.shape[1:]).swapaxes(1, 2).astype(np.int16)
        if self._shown is None:
            changed = np.ones(cells.shape[:2], bool)
            self._shown = cells
        else:
            changed = np.abs(cells - self._shown).max(axis=(2, 3)) > UNLIKE
            self._shown[changed] = cells[changed]
        written, place, colors = ["\x1b[0m"], (-1, -1), ""
        for (row, column), (upper, lower) in zip(np.argwhere(changed).tolist(), cells[changed].tolist(), strict=True):
            if (row, column - 1) != place:
                written.append(f"\x1b[{top + row + 1};{column + 1}H")
            place = row, column
            before = colors
            colors, character = self._cell(tuple(upper), tuple(lower))
            written.append(character if colors == before else colors + character)
        return "".join(written) + "\x1b[0m"

    def _cell(self, upper: _Color, lower: _Color) -> tuple[str, str]:
        """Return the code that sets a cell's colours, and the character in it."""
        if self._colors is None:
            light = max(0.299 * r + 0.587 * g + 0.114 * b for r, g, b in (upper, lower))
            return "", SHADES[int(light * len(SHADES) / 256)]
        return f"\x1b[{_code(upper, True, self._colors)};{_code(lower, False, self._colors)}m", "▀"


@lru_cache(1 << 16)
def _code(color: _Color, foreground: bool, colors: ColorSystem) -> str:
    return ";".join(Color.from_rgb(*color).downgrade(colors).get_ansi_codes(foreground))


def _words(sight: Sight, why: Sequence[Reason]) -> Text:
    """Say why nothing moves and who is seen how well, the most important first."""
    lines = [] if why else [Text("All is well.", "bold green")]
    for reason in why:
        lines.append(Text(_printable(reason.what), "red" if lines else "bold red"))
        if reason.fix:
            lines.append(Text(reason.fix))
    for _, performer in sorted(sight.performers.items()):
        lines.append(_swatch(color_of(performer)).append(told(performer)))
    if sight.level is not None:
        lines.append(Text(f"the sensor: {sight.level}"))
    if any((each.known() & ~each.seen()).any() for each in sight.performers.values()):
        lines.append(_swatch(GUESSED).append("joints that are guessed"))
    lines.append(Text(f"{_printable(sight.source)}, Ctrl-C ends", "dim"))
    return Text("\n").join(lines)


def _swatch(color: _Color) -> Text:
    return Text.assemble(("■ ", f"rgb({color[0]},{color[1]},{color[2]})"))


def _printable(text: str) -> str:
    """Return a text without what would move the cursor, for some of it comes from drivers and the network."""
    return "".join(each if each.isprintable() else " " for each in text)
