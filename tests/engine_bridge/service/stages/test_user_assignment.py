import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from engine_bridge.service.stages.user_assignment import NEARER_METRES, NEARER_SECONDS, UserAssignment

USERS = st.integers(1, 6)


class People(RuleBasedStateMachine):
    """People come, move, go and are chosen, in any order, before two characters."""

    @initialize(policy=st.sampled_from(("each", "nearest", "queue")))
    def open(self, policy):
        self.time, self.people = 0.0, UserAssignment(policy, 5.0, [None, None])

    @rule(user=USERS, distance=st.floats(0.5, 5.0), seconds=st.floats(0.0, 3.0))
    def see(self, user, distance, seconds):
        self.time += seconds
        self.people.see(user, self.time, distance)
        self.people.assign(self.time)

    @rule(user=USERS)
    def go(self, user):
        self.people.gone(user)
        self.people.assign(self.time)

    @precondition(lambda self: self.people.present)
    @rule(data=st.data(), character=st.integers(0, 1))
    def choose(self, data, character):
        user = data.draw(st.sampled_from(sorted(self.people.present)))
        self.people.choose(character, user, self.time)
        assert self.people.performers[character] == user
        self.people.assign(self.time)

    @invariant()
    def who_plays_is_there_and_plays_one_character(self):
        playing = [user for user in self.people.performers if user is not None]
        assert set(playing) <= self.people.present.keys()
        assert len(set(playing)) == len(playing)

    @invariant()
    def no_character_is_free_while_somebody_waits(self):
        assert None not in self.people.performers or set(self.people.performers) >= self.people.present.keys()


TestPeople = People.TestCase
TestPeople.settings = settings(max_examples=180, stateful_step_count=40)


@pytest.mark.parametrize("users", [[1], [1, 2, 3]])
def test_turns_go_round_and_a_single_user_plays_without_a_time_limit(users):
    assignment, played = UserAssignment("queue", 10.0, [None]), []
    for second in range(60):
        for user in users:
            assignment.see(user, float(second), 2.0)
        assignment.assign(float(second))
        played.append(assignment.performers[0])
    assert played == [users[second // 10 % len(users)] for second in range(60)]


def test_the_nearest_takes_over_after_a_while_and_nobody_who_passes_by():
    assignment, played = UserAssignment("nearest", 0.0, [None]), []
    for time in np.arange(0, 40, 0.1).tolist():
        assignment.see(1, time, 3.0)
        passing = 10 <= time < 10 + 0.6 * NEARER_SECONDS
        if time >= 5:
            assignment.see(2, time, 2.0 if passing or time >= 20 else 3.0 - 0.5 * NEARER_METRES)
        assignment.assign(time)
        played.append(assignment.performers[0])
    assert 20 + NEARER_SECONDS <= played.index(2) / 10 < 22
