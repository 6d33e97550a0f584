import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine_bridge.service.outputs.subscriptions import ANSWER_BYTES_PER_SECOND, MAX_PENDING, Answers, Subscriptions
from engine_bridge.service.protocol.header import Kind, topic

DOG, CAT = topic("dog", Kind.CONTROLS), topic("cat", Kind.CONTROLS)


@pytest.fixture
def made():
    return Subscriptions()


def test_a_client_that_reuses_the_number_of_a_leaving_one_is_served(made):
    made.add(DOG[:13], 1, [DOG])
    made.add(DOG[:13], 1, [DOG])
    made.remove(DOG[:13], None)
    assert made.wants(DOG)
    made.remove(DOG[:13], None)
    assert not made.wants(DOG)


@pytest.mark.parametrize(
    "prefix", [b"dog/nothing", b"dog/controls\0x", b"/", b"\xff", b"dog\0", b"x" * 33, b"dog/controls" + b"\0" * 60]
)
def test_a_subscription_that_matches_no_topic_is_not_kept(made, prefix):
    made.add(prefix, 1, [DOG])
    made.remove(prefix, 1)
    assert made.ignored == 1
    assert not made.wants(DOG)


TOPICS = [DOG, CAT, topic("dog", Kind.JOINTS), topic("dog2", Kind.CONTROLS)]
PREFIXES = [b"", b"dog", b"dog/", DOG[:13], CAT[:13]]


@given(st.lists(st.tuples(st.booleans(), st.sampled_from(PREFIXES), st.integers(1, 3))))
def test_any_sequence_of_requests_serves_every_client_that_has_subscribed(said):
    """To what begins so; the cat comes later."""
    made, balance = Subscriptions(), {}
    for asks, prefix, client in said:
        (made.add if asks else lambda p, c, _: made.remove(p, c))(prefix, client, [DOG])
        count = balance.get((prefix, client), 0)
        balance[prefix, client] = count + 1 if asks else max(count - 1, 0)
    held = [prefix for (prefix, _), count in balance.items() if count]
    assert [made.wants(each) for each in TOPICS] == [any(map(each.startswith, held)) for each in TOPICS]
    assert made.ignored == 0


def test_a_topic_waits_no_longer_than_the_bytes_before_it_take():
    answers = Answers()
    answers.ask(DOG, 0.0)
    answers.ask(CAT, 0.0)
    answers.given(answers.take(0.0), int(ANSWER_BYTES_PER_SECOND / 10), 0.0)
    assert answers.take(0.09) is None
    assert answers.due() == pytest.approx(0.1)
    assert answers.take(0.11) == CAT


def test_the_list_has_an_end():
    answers = Answers()
    taken = [answers.ask(b"%d" % number, 0.0) for number in range(MAX_PENDING + 5)]
    assert sum(taken) == MAX_PENDING
