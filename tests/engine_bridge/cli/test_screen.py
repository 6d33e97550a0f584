"""The screen in programs of its own, on a real pseudo-terminal."""

import pytest

from ...terminal import DONE, IS_DONE, Terminal

PRELUDE = """
import os, time
from engine_bridge.cli import screen as screens

def wait(screen):
    while not screen.ready:
        time.sleep(0.001)

def show(screen, text):
    screen.show(chr(27) + "[H" + text)
    wait(screen)

"""


@pytest.fixture
def run(commands):
    """Run a program on a terminal."""
    started = []

    def start(program, **more):
        started.append(Terminal(commands, "-c", PRELUDE + program, **more))
        return started[-1]

    yield start
    for terminal in started:
        terminal.kill()


def shows(words):
    return lambda screen: screen.text()[0] == words


def test_the_screen_is_the_alternate_one_without_a_cursor_and_then_all_is_as_before(run):
    terminal = run("with screens.Screen() as screen: show(screen, 'seen')")
    terminal.until(shows("seen"))
    assert (terminal.screen.alternate, terminal.screen.cursor) == (True, False)
    assert terminal.end() == 0
    assert (terminal.screen.alternate, terminal.screen.cursor) == (False, True)
    assert terminal.screen.printed == ""
    assert terminal.settings() == terminal.before


def test_after_an_error_all_is_as_before_and_the_error_is_told(run):
    terminal = run("with screens.Screen() as screen: show(screen, 'seen'); raise RuntimeError('a fault')")
    assert terminal.end() == 1
    assert (terminal.screen.alternate, terminal.screen.cursor) == (False, True)
    assert "RuntimeError: a fault" in terminal.screen.printed
    assert terminal.settings() == terminal.before


def test_nothing_is_ready_before_the_terminal_has_said_so(run):
    program = "screens.ANSWERING = 1e9\nwith screens.Screen() as screen: show(screen, 'one'); show(screen, 'two')"
    terminal = run(program, answers=False)
    terminal.hear(DONE)  # of the alternate screen
    terminal.type(b"typed" + IS_DONE[:2])
    terminal.type(IS_DONE[2:])
    terminal.hear("one" + DONE)
    assert "two" not in terminal.heard
    terminal.type(IS_DONE)
    terminal.hear("two" + DONE)
    terminal.type(IS_DONE)
    assert terminal.end() == 0


def test_a_terminal_that_never_says_so_is_not_asked_any_more(run):
    program = "screens.ANSWERING = 0.1\nwith screens.Screen() as screen: show(screen, 'one'); show(screen, 'two')"
    terminal = run(program, answers=False)
    terminal.hear("two")
    assert terminal.end() == 0
    assert terminal.screen.printed == ""
    assert terminal.heard.count(DONE) == 1


def test_neither_what_is_typed_nor_what_libraries_say_is_on_the_screen(run):
    terminal = run(
        "with screens.Screen() as screen:\n"
        "    show(screen, 'one')\n"
        "    os.write(2, b'INFO: noise')\n"
        "    show(screen, 'two')\n"
        "    show(screen, 'three')\n"
        "os.write(2, b'told')"
    )
    terminal.until(shows("one"))
    terminal.type(b"keys\x1a")  # and Ctrl-Z, which would stop it
    terminal.until(shows("three"))
    assert terminal.end() == 0
    assert "noise" not in terminal.heard
    assert "keys" not in terminal.heard
    assert terminal.screen.printed == "told"


def test_a_closed_window_is_gone(run):
    terminal = run(
        "import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)\n"
        "with screens.Screen() as screen:\n"
        "    show(screen, 'seen')\n"
        "    while not screen.gone: screen.show('more'); time.sleep(0.001)\n"
        "os._exit(7)"
    )
    terminal.until(shows("seen"))
    terminal.close()
    assert terminal.process.wait(60) == 7
