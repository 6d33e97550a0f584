"""Speech bubbles: they are in the picture and beside the head, not over it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine_bridge.film.bubbles import LETTERS_PER_LINE, Bubble, wrapped
from engine_bridge.film.scene import BubbleTable

SIZE = (640, 360)


KINDS = pytest.mark.parametrize("kind", ["speech", "thought", "name"])


def bubble_of(**table):
    return Bubble(BubbleTable(character="a", **table), SIZE, "bubble", None)


@KINDS
@given(x=st.floats(0.15, 0.85), y=st.floats(0.15, 0.5))
def test_a_bubble_is_in_the_picture_and_does_not_hide_the_head(kind, x, y):
    bubble = bubble_of(text="How do you do?", kind=kind)
    head, body = ([[x - side, y - 0.06], [x + side, y + below]] for side, below in ((0.03, 0.06), (0.1, 0.4)))
    head, body = np.multiply(head, SIZE), np.multiply(body, SIZE)
    pixels, place = bubble.draw(bubble.place(head, body, head))
    left, top, right, bottom = np.array(place) * [*SIZE, *SIZE]
    assert pixels.shape == (round(bottom - top), round(right - left), 4)
    shown = np.argwhere(pixels[..., 3] > 128)[:, ::-1] + [left, top]
    assert ((shown >= 0) & (shown < SIZE)).all()
    hides_head = ((shown > head[0] + 2) & (shown < head[1] - 2)).all(axis=1)
    assert hides_head.mean() < 0.02  # at most the tip of its tail


@KINDS
@given(x=st.floats(-1e6, 1e6), y=st.floats(-1e6, 1e6), usual=st.floats(-1e6, 1e6))
def test_a_bubble_is_not_much_larger_than_the_picture_wherever_the_head_is(kind, x, y, usual):
    bubble = bubble_of(text="How do you do?", kind=kind)
    pixels, _ = bubble.draw(bubble.place(np.array([[x, y], [x + 50, y + 80]]), *np.full((2, 2, 2), usual)))
    letters = 4 * bubble.table.size * SIZE[1]
    assert (np.array(pixels.shape[1::-1]) <= np.array(SIZE) + letters).all()


@given(st.lists(st.text("abcdefghij", min_size=1, max_size=12), min_size=1))
def test_lines_end_between_words(words):
    text = " ".join(words)
    lines = wrapped(text).split("\n")
    assert " ".join(lines) == text
    assert max(map(len, lines)) <= LETTERS_PER_LINE


def test_a_name_needs_no_text():
    bubbles = [bubble_of(kind="name", **text) for text in ({}, {"text": "a"})]
    (pixels, _), (same, _) = (each.draw(each.place(*np.full((3, 2, 2), 100.0))) for each in bubbles)
    assert (pixels == same).all()
