import numpy as np
import pytest

from capture.network.identities import Identities

from ..bodies import STANDS

SEEN = np.ones(20, np.float32)


def pose(person, frame):
    """Return a pose of one of several people who walk past each other, 1.5 m apart."""
    return STANDS + np.array([1.5 * person, 1, 3 + 0.02 * frame * (-1) ** person]), SEEN


def follow(numbers, frames=90, people=3, order=lambda _frame, people: people):
    """Return the user numbers (frames, people) of people whose numbers a sender exchanges or renews."""
    identities = Identities()
    found = np.zeros((frames, people), int)
    for frame in range(frames):
        for person in order(frame, range(people)):
            found[frame, person] = identities.user(numbers(person, frame), pose(person, frame), frame / 30)
    return found


@pytest.mark.parametrize(
    "numbers",
    [
        lambda person, frame: person + 1 if frame < 40 else (2, 3, 1)[person],
        lambda person, frame: person + 1 if frame % 20 < 10 else (2, 1, 3)[person],
        lambda person, frame: 3 * (frame // 7) + person + 1,
    ],
)
@pytest.mark.parametrize("order", [lambda _frame, people: people, lambda frame, people: np.roll(people, frame // 11)])
def test_people_keep_their_numbers_when_a_sender_exchanges_or_renews_them(numbers, order):
    assert (follow(numbers, order=order) == [1, 2, 3]).all()


def test_a_performer_who_is_lost_and_back_at_the_same_place_keeps_the_number_and_another_does_not():
    identities = Identities()
    assert identities.user(4, pose(0, 0), 0.0) == 4
    assert identities.lost(4) == 4
    assert identities.lost(4) is None
    assert identities.user(9, pose(0, 1), 0.5) == 4
    assert identities.user(5, pose(1, 1), 0.5) == 5


def test_performers_who_have_left_are_forgotten():
    identities = Identities()
    for sent in range(1000):
        assert identities.user(sent, pose(sent % 3, 0), float(sent)) == sent
        assert identities.lost(sent) == sent
    assert len(identities._performers) == 1


def test_two_performers_at_one_place_who_both_send_are_two():
    identities = Identities()
    for frame in range(5):
        assert [identities.user(sent, pose(0, frame), frame / 30) for sent in (1, 2)] == [1, 2]
