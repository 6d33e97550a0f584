import io
import re

import numpy as np
import pytest
from puppetline.examples.performances import PERFORMANCES
from rich.color import Color, ColorSystem
from rich.console import Console

from capture.sensors.sight import Reason, Sight, reasons, told
from capture.skeleton import SkeletonFrame
from capture.trackers.picture import Lens, Picture
from engine_bridge.cli.view import LEAST, SHADES, UNLIKE, HalfBlocks, View
from engine_bridge.pictures.look import PAPER, PERFORMERS

from ...terminal import Emulated

SIZE = 80, 24
WALK = PERFORMANCES["walk"]()


@pytest.fixture
def random():
    return np.random.default_rng(5)


@pytest.fixture
def screen():
    screen = Emulated(*SIZE)
    screen.alternate = True
    return screen


@pytest.fixture
def console():
    return Console(file=io.StringIO(), force_terminal=True, color_system="truecolor", _environ={})


def sight_of(user=0, picture=None, number=0):
    sight = Sight("test:", False, picture=picture)
    sight.take(SkeletonFrame(number / 30, user, WALK.positions[number], np.ones(20, np.float32)))
    return sight


def test_each_pixel_is_a_half_of_a_cell(screen, random):
    pixels = random.integers(0, 256, (34, 60, 3), dtype=np.uint8)
    screen.feed(HalfBlocks(ColorSystem.TRUECOLOR).paint(pixels, top=3))
    np.testing.assert_array_equal(screen.pixels()[6:40, :60], pixels)
    assert (screen.characters[:3] == " ").all()
    assert (screen.characters[20:] == " ").all()
    assert (screen.characters[:, 60:] == " ").all()


def test_only_cells_that_look_different_are_painted_anew(screen, random):
    blocks = HalfBlocks(ColorSystem.TRUECOLOR)
    pixels = random.integers(UNLIKE, 256 - UNLIKE, (20, 30, 3), dtype=np.uint8)
    screen.feed(blocks.paint(pixels))
    noise = random.integers(-UNLIKE, UNLIKE + 1, pixels.shape)
    assert blocks.paint((pixels + noise).astype(np.uint8)).count("▀") == 0
    other = pixels.copy()
    other[4:6, 10:20] = 255 - pixels[4:6, 10:20]
    other[11, 29] ^= 128
    text = blocks.paint(other)
    assert text.count("▀") == 11
    screen.feed(text)
    np.testing.assert_array_equal(screen.pixels()[:20, :30], other)


def test_noise_does_not_add_up(screen, random):
    """A picture that becomes another one little by little is never farther from what is shown than what is let pass."""
    blocks = HalfBlocks(ColorSystem.TRUECOLOR)
    for light in range(0, 200, 2):
        pixels = np.full((4, 4, 3), light, np.uint8)
        screen.feed(blocks.paint(pixels))
        assert np.abs(screen.pixels()[:4, :4] - pixels).max() <= UNLIKE


@pytest.mark.parametrize("colors", [ColorSystem.EIGHT_BIT, ColorSystem.STANDARD])
def test_terminals_of_fewer_colours_get_the_nearest_of_theirs(colors, random):
    (color,) = random.integers(0, 256, (1, 3)).tolist()
    upper, lower = tuple(color), (0, 0, 0)
    text = HalfBlocks(colors).paint(np.array([[upper], [lower]], np.uint8))
    expected = [
        ";".join(Color.from_rgb(*each).downgrade(colors).get_ansi_codes(k == 0))
        for k, each in enumerate((upper, lower))
    ]
    assert re.findall(r"\x1b\[([\d;]+)m▀", text) == [";".join(expected)]


def test_terminals_without_colours_get_shades_of_the_brighter_half(screen):
    light = np.linspace(0, 255, 5).astype(np.uint8)
    pixels = np.zeros((2, 5, 3), np.uint8)
    pixels[[0, 1, 0, 1, 0], np.arange(5)] = light[:, None]
    text = HalfBlocks(None).paint(pixels)
    screen.feed(text)
    assert "".join(screen.characters[0, :5]) == SHADES
    assert (screen.colors == -1).all()


def test_a_view_fills_the_screen_with_titles_panels_and_words(screen, console):
    picture = Picture(0.0, Lens(640, 480, 525.0), np.full((480, 640, 3), (100, 160, 220), np.uint8), None)
    sight = sight_of(picture=picture)
    screen.feed(View(SIZE, console).draw(sight, reasons(sight)))
    assert screen.text()[0].split() == ["colour", "from", "above"]
    assert screen.text()[18:22] == [
        "All is well.",
        f"■ {told(sight.performers[0])}",
        "test:, Ctrl-C ends",
        "",
    ]
    assert screen.colors[19, 0, 0].tolist() == list(PERFORMERS[0])
    pixels = screen.pixels()[2:36]
    np.testing.assert_array_equal(pixels[:4, :45], np.broadcast_to((70, 112, 154), (4, 45, 3)))  # dimmed
    np.testing.assert_array_equal(pixels[:, 45], np.broadcast_to(PAPER, (34, 3)))
    assert (pixels[:, 45 + 35 :] == PAPER).all()


def test_what_has_not_changed_is_not_written_again(screen, console):
    view = View(SIZE, console)
    sight = sight_of()
    view.draw(sight, ())
    again = view.draw(sight, ())
    assert "▀" not in again
    assert "user" not in again
    moved = sight_of(number=20)
    amiss = [Reason("The light is off.", "Switch it on.")]
    screen.feed(View(SIZE, console).draw(sight, ()))
    screen.feed(view.draw(moved, amiss))
    fresh = Emulated(*SIZE)
    fresh.alternate = True
    fresh.feed(View(SIZE, console).draw(moved, amiss))
    assert screen.text() == fresh.text()
    assert np.abs(screen.pixels() - fresh.pixels()).max() <= UNLIKE


def test_words_are_broken_and_cut_where_there_is_no_more_room(screen, console):
    amiss = [Reason(" ".join(f"reason{number}" for number in range(100)), "fix")]
    screen.feed(View(SIZE, console).draw(sight_of(), amiss))
    words = screen.text()[18:]
    assert " ".join(words).split() == [f"reason{number}" for number in range(len(" ".join(words).split()))]
    assert all(words)


def test_what_would_move_the_cursor_is_not_written(screen, console):
    screen.feed(View(SIZE, console).draw(sight_of(), [Reason("driver\x1b[2Jfail\red\n[bold]x[/]", "")]))
    assert screen.text()[18] == "driver [2Jfail ed [bold]x[/]"


@pytest.mark.parametrize("size", [(LEAST[0] - 1, LEAST[1]), (LEAST[0], LEAST[1] - 1), (5, 3), (1, 1)])
def test_a_terminal_that_is_too_small_says_so(console, size):
    screen = Emulated(*size)
    screen.alternate = True
    screen.feed(View(size, console).draw(sight_of(), ()))
    said = "".join("".join(line) for line in screen.characters)
    assert "This terminal is too small: 40 columns and 16 lines are the least.".startswith(
        " ".join(said.split())[: size[0]]
    )
    assert (screen.pixels() == -1).all()


def test_the_smallest_terminal_has_a_picture(console):
    screen = Emulated(*LEAST)
    screen.alternate = True
    screen.feed(View(LEAST, console).draw(sight_of(), ()))
    assert (np.abs(screen.pixels() - PERFORMERS[0]).max(axis=2) < 90).sum() > 10
