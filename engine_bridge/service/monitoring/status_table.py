"""The status as text: a live table in a terminal, a few lines every 10 seconds elsewhere."""

import threading

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from engine_bridge.service.monitoring.status import Status
from puppetline import clock

LINE_INTERVAL_SECONDS = 10.0
"""Time between two statuses as lines, where the output is no terminal, in seconds."""

CLOSE_SECONDS = 0.5
"""Maximum time that closing waits for a terminal that does not accept the last status, in seconds."""


class StatusDisplay:
    """Shows each status in a thread of its own, so that a paused terminal does not stop the service.

    Parameters
    ----------
    console : Console, optional
        Standard output by default.
    """

    def __init__(self, console: Console | None = None) -> None:
        self._console = console or Console()
        self._latest: Status | None = None
        self._changed = threading.Condition()
        self._open = True
        self._thread = threading.Thread(target=self._draw if self._console.is_terminal else self._write, daemon=True)
        self._thread.start()

    def update(self, status: Status) -> None:
        """Show a status from now on."""
        with self._changed:
            self._latest = status
            self._changed.notify()

    def close(self) -> None:
        """Stop; the last status stays visible."""
        with self._changed:
            self._open = False
            self._changed.notify()
        self._thread.join(CLOSE_SECONDS)

    def _next(self) -> Status | None:
        """Wait for the next status; None once the display is closed and has shown the last one."""
        with self._changed:
            self._changed.wait_for(lambda: self._latest is not None or not self._open)
            status, self._latest = self._latest, None
            return status

    def _draw(self) -> None:
        with Live(console=self._console, auto_refresh=False) as live:
            while (status := self._next()) is not None:
                live.update(show(status), refresh=True)

    def _write(self) -> None:
        written = -LINE_INTERVAL_SECONDS
        while (status := self._next()) is not None:
            if clock.now() - written >= LINE_INTERVAL_SECONDS:
                written = clock.now()
                for text in lines(status):
                    self._console.print(text, markup=False, highlight=False, soft_wrap=True)


def show(status: Status) -> RenderableType:
    """Return a status as tables: the service, its sources, users, characters and outputs."""
    tables = [_stages(status), _users(status), _characters(status), _takes(status), _outputs(status)]
    return Group(_service(status), *(table for table in tables if table.row_count))


def lines(status: Status) -> list[str]:
    """Return a status as a few lines: one for the service, one for each stage."""
    return [
        str(_service(status)),
        *(
            f"  {stage.name} ({stage.source}): {stage.rate:.1f} frames/s, "
            f"latency p50 {_ms(stage.latency_ms.p50)} p99 {_ms(stage.latency_ms.p99)} ms, {len(stage.users)} users, "
            f"{stage.dropped} dropped, {sum(stage.refused.values())} refused"
            + (f", recording {stage.recording}" if stage.recording else "")
            + (f", recording in {stage.count_in} s" if stage.count_in else "")
            for stage in status.stages
        ),
    ]


def _service(status: Status) -> Text:
    service, clients = status.service, status.clients
    minutes, seconds = divmod(int(service.uptime), 60)
    hours, minutes = divmod(minutes, 60)
    return Text(
        f"Puppetline {service.version}  up {hours}:{minutes:02}:{seconds:02}  {service.memory / 1e6:.0f} MB  "
        f"{100 * service.cpu:.0f} % of a core  {clients.connected} of {clients.limit} clients  "
        f"{clients.refused} refused"
    )


def _stages(status: Status) -> Table:
    table = _table("source", "users", "frames/s", "p50 ms", "p95 ms", "p99 ms", "max ms", "dropped", "refused")
    for stage in status.stages:
        label = stage.name if stage.name == stage.source else f"{stage.name}  {stage.source}"
        latency = stage.latency_ms
        recording = f"  ● {stage.recording}" if stage.recording else f"  {stage.count_in}…" if stage.count_in else ""
        _add(
            table,
            label + recording,
            len(stage.users),
            f"{stage.rate:.1f}",
            *map(_ms, (latency.p50, latency.p95, latency.p99, latency.max)),
            stage.dropped,
            ", ".join(f"{count} {reason}" for reason, count in stage.refused.items()) or 0,
        )
    return table


def _users(status: Status) -> Table:
    table = _table("user", "state", "character", "seen s ago", "tall m", "reach m")
    for stage in status.stages:
        for user in stage.users:
            who = f"{user.user}" if len(status.stages) == 1 else f"{stage.name} {user.user}"
            measures = ("–" if value is None else f"{value:.2f}" for value in (user.height, user.reach))
            _add(table, who, user.state, user.character or "–", f"{user.seen:.1f}", *measures)
    return table


def _characters(status: Status) -> Table:
    table = _table("character", "state", "performer", "frames/s", "frames", "residual", "limited")
    for character in status.characters:
        _add(
            table,
            character.name,
            character.state,
            "–" if character.performer is None else character.performer,
            f"{character.rate:.1f}",
            character.frames,
            *(("–", "–") if character.residual is None else (f"{character.residual:.2g}", character.limited)),
        )
    return table


def _takes(status: Status) -> Table:
    table = _table("take", "character", "from s", "to s", "now s", "speed")
    timeline = status.timeline
    if timeline is None:
        return table
    for take in timeline.takes:
        speed = "paused" if timeline.paused else f"{timeline.speed:g}{', loop' if timeline.loop else ''}"
        times = (f"{seconds:.1f}" for seconds in (take.at, take.at + take.seconds, timeline.position))
        _add(table, take.take, take.character, *times, speed)
    return table


def _outputs(status: Status) -> Table:
    table = _table("output", "clients", "sent", "skipped", "failed")
    for output in status.outputs:
        clients, skipped = ("–" if count is None else count for count in (output.clients, output.skipped))
        _add(table, f"{output.wire}  {output.target}", clients, output.sent, skipped, output.failed)
    return table


def _table(first: str, *columns: str) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column(first, overflow="fold")
    for column in columns:
        table.add_column(column, justify="right")
    return table


def _add(table: Table, *cells: object) -> None:
    table.add_row(*(Text(str(cell)) for cell in cells))  # in a str, rich would read brackets as markup


def _ms(milliseconds: float | None) -> str:
    return "–" if milliseconds is None else f"{milliseconds:.2f}"
