"""The status (`monitoring.statistics`) for people: a live table in a terminal, lines now and then elsewhere."""

import threading
import time
from typing import Any

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

LINE_INTERVAL = 10.0
"""Seconds between the lines that are written where there is no terminal."""

LAST_DRAWING = 0.5
"""Seconds that the end waits for a terminal that does not take its last picture."""


class StatusDisplay:
    """Shows each status in a thread of its own, so that a terminal that is halted halts nothing else.

    Parameters
    ----------
    console : Console, optional
        Standard output where none is given.
    """

    def __init__(self, console: Console | None = None) -> None:
        self._console = console or Console()
        self._latest: dict[str, Any] | None = None
        self._changed = threading.Condition()
        self._open = True
        self._thread = threading.Thread(target=self._draw if self._console.is_terminal else self._write, daemon=True)
        self._thread.start()

    def update(self, status: dict[str, Any]) -> None:
        """Show this from now on."""
        with self._changed:
            self._latest = status
            self._changed.notify()

    def close(self) -> None:
        """Leave the last status standing."""
        with self._changed:
            self._open = False
            self._changed.notify()
        self._thread.join(LAST_DRAWING)

    def _next(self) -> dict[str, Any] | None:
        """Wait for a status; None when it is over."""
        with self._changed:
            self._changed.wait_for(lambda: self._latest is not None or not self._open)
            status, self._latest = self._latest, None
            return status

    def _draw(self) -> None:
        with Live(console=self._console, auto_refresh=False) as live:
            while (status := self._next()) is not None:
                live.update(show(status), refresh=True)

    def _write(self) -> None:
        written = -LINE_INTERVAL
        while (status := self._next()) is not None:
            if time.monotonic() - written >= LINE_INTERVAL:
                written = time.monotonic()
                for text in lines(status):
                    self._console.print(text, markup=False, highlight=False, soft_wrap=True)


def show(status: dict[str, Any]) -> RenderableType:
    """Return a status as tables: the service, its sources, its users, its characters, its OSC targets."""
    tables = [_stages(status), _users(status), _characters(status), _osc(status)]
    return Group(_service(status), *(table for table in tables if table.row_count))


def lines(status: dict[str, Any]) -> list[str]:
    """Return a status as a few lines: one for the service, one for each stage."""
    return [
        str(_service(status)),
        *(
            f"  {stage['name']} ({stage['source']}): {stage['rate']:.1f} frames/s, "
            f"latency p50 {_ms(stage, 'p50')} p99 {_ms(stage, 'p99')} ms, {len(stage['users'])} users, "
            f"{stage['dropped']} dropped, {sum(stage['refused'].values())} refused"
            + (f", recording {stage['recording']}" if stage["recording"] else "")
            for stage in status["stages"]
        ),
    ]


def _service(status: dict[str, Any]) -> Text:
    service, clients, sent = status["service"], status["clients"], status["sent"]
    minutes, seconds = divmod(int(service["uptime"]), 60)
    hours, minutes = divmod(minutes, 60)
    return Text(
        f"Puppetline {service['version']}  up {hours}:{minutes:02}:{seconds:02}  {service['memory'] / 1e6:.0f} MB  "
        f"{100 * service['cpu']:.0f} % of a core  {clients['connected']} of {clients['limit']} clients  "
        f"{clients['refused']} refused  {sent['messages']} messages sent"
    )


def _stages(status: dict[str, Any]) -> Table:
    table = _table("source", "users", "frames/s", "p50 ms", "p95 ms", "p99 ms", "max ms", "dropped", "refused")
    for stage in status["stages"]:
        label = stage["name"] if stage["name"] == stage["source"] else f"{stage['name']}  {stage['source']}"
        _add(
            table,
            f"{label}  ● {stage['recording']}" if stage["recording"] else label,
            len(stage["users"]),
            f"{stage['rate']:.1f}",
            *(_ms(stage, key) for key in ("p50", "p95", "p99", "max")),
            stage["dropped"],
            ", ".join(f"{count} {reason}" for reason, count in stage["refused"].items()) or 0,
        )
    return table


def _users(status: dict[str, Any]) -> Table:
    table = _table("user", "state", "character", "seen s ago", "tall m", "reach m")
    for stage in status["stages"]:
        for user in stage["users"]:
            who = f"{user['user']}" if len(status["stages"]) == 1 else f"{stage['name']} {user['user']}"
            measures = ("–" if user[name] is None else f"{user[name]:.2f}" for name in ("height", "reach"))
            _add(table, who, user["state"], user["character"] or "–", f"{user['seen']:.1f}", *measures)
    return table


def _characters(status: dict[str, Any]) -> Table:
    table = _table("character", "state", "performer", "frames/s", "frames", "residual", "limited")
    for character in status["characters"]:
        performer, residual = character["performer"], character["residual"]
        _add(
            table,
            character["name"],
            character["state"],
            "–" if performer is None else performer,
            f"{character['rate']:.1f}",
            character["frames"],
            *(("–", "–") if residual is None else (f"{residual:.2g}", character["limited"])),
        )
    return table


def _osc(status: dict[str, Any]) -> Table:
    table = _table("OSC to", "sent", "skipped", "failed")
    for target in status["osc"]:
        _add(table, target["target"], target["sent"], target["skipped"], target["failed"])
    return table


def _table(first: str, *columns: str) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column(first, overflow="fold")
    for column in columns:
        table.add_column(column, justify="right")
    return table


def _add(table: Table, *cells: object) -> None:
    table.add_row(*(Text(str(cell)) for cell in cells))  # as Text: in a str, rich takes what is in brackets for markup


def _ms(stage: dict[str, Any], key: str) -> str:
    value = stage["latency_ms"][key]
    return "–" if value is None else f"{value:.2f}"
