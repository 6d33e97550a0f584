from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from engine_bridge.service.stages.user_assignment import NEARER_METRES, NEARER_SECONDS, UserAssignment

USERS = st.integers(1, 6)
POLICIES = ("each", "nearest", "queue")


class People(RuleBasedStateMachine):
    """People come, move, go and are chosen, in any order, before two characters."""

    def __init__(self):
        super().__init__()
        self.time = 0.0
        self.assignments = {policy: UserAssignment(policy, 5.0, [None, None]) for policy in POLICIES}

    @rule(user=USERS, distance=st.floats(0.5, 5.0), seconds=st.floats(0.0, 3.0))
    def see(self, user, distance, seconds):
        self.time += seconds
        for assignment in self.assignments.values():
            assignment.see(user, self.time, distance)
            assignment.assign(self.time)

    @rule(user=USERS)
    def go(self, user):
        for assignment in self.assignments.values():
            assignment.gone(user)
            assignment.assign(self.time)

    @precondition(lambda self: self.assignments["each"].present)
    @rule(data=st.data(), character=st.integers(0, 1))
    def choose(self, data, character):
        user = data.draw(st.sampled_from(sorted(self.assignments["each"].present)))
        for assignment in self.assignments.values():
            assignment.choose(character, user, self.time)
            assert assignment.performers[character] == user
            assignment.assign(self.time)

    @invariant()
    def who_plays_is_there_and_plays_one_character(self):
        for assignment in self.assignments.values():
            playing = [user for user in assignment.performers if user is not None]
            assert set(playing) <= assignment.present.keys()
            assert len(set(playing)) == len(playing)

    @invariant()
    def no_character_is_free_while_somebody_waits(self):
        for assignment in self.assignments.values():
            assert (assignment.performers.count(None) == 0) or set(assignment.performers) >= assignment.present.keys()


TestPeople = People.TestCase
TestPeople.settings = settings(max_examples=60, stateful_step_count=40)


def test_turns_go_round_and_a_single_user_plays_without_a_time_limit():
    for users, expected in ((1, [1] * 60), (3, [user for user in (1, 2, 3, 1, 2, 3) for _ in range(10)])):
        assignment, played = UserAssignment("queue", 10.0, [None]), []
        for second in range(60):
            for user in range(1, users + 1):
                assignment.see(user, float(second), 2.0)
            assignment.assign(float(second))
            played.append(assignment.performers[0])
        assert played == expected


def test_the_nearest_takes_over_after_a_while_and_nobody_who_passes_by():
    assignment = UserAssignment("nearest", 0.0, [None])
    changes = []
    for k in range(400):
        time = k / 10
        assignment.see(1, time, 3.0)
        passing = 10 <= time < 10 + 0.6 * NEARER_SECONDS
        if time >= 5:
            assignment.see(2, time, 2.0 if passing or time >= 20 else 3.0 - 0.5 * NEARER_METRES)
        assignment.assign(time)
        if assignment.performers[0] == 2 and not changes:
            changes.append(time)
    [change] = changes
    assert 20 + NEARER_SECONDS <= change < 22
