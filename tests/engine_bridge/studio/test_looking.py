import pytest

from engine_bridge.studio.looking import look
from engine_bridge.studio.messages import PerformerState, ServiceState, StageState, State


def seen(source="osc:7110", rate=30.0, refused=None, users=0):
    stage = StageState(name="stage", source=source, rate=rate, refused=refused or {}, recording=None)
    performers = [
        PerformerState(user=k, stage="stage", state="performing", character="dog", distance=2.5, height=1.7)
        for k in range(1, users + 1)
    ]
    return look(State(service=ServiceState(running=True), stages=[stage], performers=performers))


def test_a_performer_is_described_and_nothing_is_wrong():
    reply = seen(users=1)
    assert reply.problems == []
    assert reply.performers == ["user 1: 2.50 m away, performing, drives dog"]


@pytest.mark.parametrize(
    ("facts", "texts"),
    [
        ({}, ["Nothing arrives at osc:7110."]),
        ({"source": "freenect:"}, ["No performer is in view of freenect:."]),
        (
            {"refused": {"not OSC": 3}},
            ["osc:7110: packets that are not understood (not OSC: 3).", "No performer is in view of osc:7110."],
        ),
        ({"rate": 10.0, "users": 1}, ["osc:7110: only 10 skeletons per second arrive."]),
        ({"rate": 40.0, "users": 2}, []),
        ({"rate": 20.0, "users": 2}, ["osc:7110: only 10 skeletons per second arrive."]),
    ],
)
def test_the_reason_is_stated(facts, texts):
    assert [each.text for each in seen(**facts).problems] == texts
