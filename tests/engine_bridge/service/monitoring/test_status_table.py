import io
import threading
import time
from dataclasses import replace

from rich.console import Console

from engine_bridge.service.monitoring.status_table import StatusDisplay, lines, show


def drawn(status, width=140):
    console = Console(file=io.StringIO(), width=width)
    console.print(show(status))
    return [" ".join(line.split()) for line in console.file.getvalue().splitlines()]


TABLE = """
Puppetline 1.2.3 up 1:02:05 123 MB 25 % of a core 3 of 64 clients 2 refused
source users frames/s p50 ms p95 ms p99 ms max ms dropped refused
kinect osc:7110 ● evening 2 30.0 1.23 2.50 – 9.00 4 2 [red]not OSC, 1 short
user state character seen s ago tall m reach m
1 performing dog 0.0 1.68 0.60
5 waiting – 1.5 – –
character state performer frames/s frames residual limited
dog performing 1 29.9 890 0.012 7
cat waiting – 0.0 10 – –
take character from s to s now s speed
rehearsal cat 0.5 9.5 1.2 0.5, loop
output clients sent skipped failed
zeromq tcp://127.0.0.1:7400 – 5000 – 0
osc 127.0.0.1:9000 – 90 12 1
websocket ws://127.0.0.1:7402 2 70 5 0
"""


def test_the_table_has_sources_users_rates_percentiles_clients_and_drops(status):
    assert drawn(status) == TABLE.strip().splitlines()


def test_tables_without_rows_are_left_out_and_latencies_without_frames_are_dashes(silent):
    assert drawn(silent)[1:] == [
        "source users frames/s p50 ms p95 ms p99 ms max ms dropped refused",
        "kinect osc:7110 0 30.0 – – – – 4 0",
    ]


def test_a_count_in_and_a_pause_are_shown(status):
    stage = replace(status.stages[0], recording=None, count_in=3)
    paused = replace(status, stages=[stage], timeline=replace(status.timeline, paused=True))
    assert "kinect osc:7110 3… 2 30.0 1.23 2.50 – 9.00 4 2 [red]not OSC, 1 short" in drawn(paused)
    assert "rehearsal cat 0.5 9.5 1.2 paused" in drawn(paused)
    assert lines(paused)[1].endswith(", recording in 3 s")


def show_all(console, statuses):
    """Give a display one status after the other, each when the one before has been taken."""
    display = StatusDisplay(console)
    for status in statuses:
        display.update(status)
        while display._latest is not None:
            time.sleep(0.001)
    display.close()
    assert not display._thread.is_alive()
    return console.file.getvalue()


def test_a_terminal_is_drawn_over_and_the_last_status_stays(status, silent):
    console = Console(file=io.StringIO(), force_terminal=True, width=140)
    text = show_all(console, [status, silent])
    assert text.count("\x1b[1A") >= 10  # as many lines up as there were
    assert text.count("Puppetline") >= 2
    assert "evening" not in text.rpartition("Puppetline")[2]


def test_elsewhere_lines_are_written_once_in_a_while_without_colour_or_markup(status):
    console = Console(file=io.StringIO(), width=40)
    assert show_all(console, [status] * 5).splitlines() == lines(status)
    service, stage = lines(status)
    assert service.startswith("Puppetline 1.2.3  up 1:02:05")
    assert stage == (
        "  kinect (osc:7110): 30.0 frames/s, latency p50 1.23 p99 – ms, 2 users, 4 dropped, 3 refused, "
        "recording evening"
    )


def test_a_terminal_that_is_halted_halts_neither_updates_nor_the_end(status):
    class Halted(io.StringIO):
        released = threading.Event()

        def write(self, text):
            self.released.wait()
            return super().write(text)

    display = StatusDisplay(Console(file=Halted(), force_terminal=True))
    for _ in range(100):
        display.update(status)
    display.close()
    assert display._thread.is_alive()
    Halted.released.set()
    display._thread.join()
