import logging
from collections import Counter

from capture.network.refusals import Refusals


def test_all_are_counted_and_logged_once_a_second_together(caplog):
    counts = Counter()
    refusals = Refusals("osc:7110", counts)
    with caplog.at_level(logging.WARNING, "capture.network.refusals"):
        refusals.report(100.0)
        for millisecond in range(2500):
            refusals.add("cut short")
            if millisecond % 10 == 0:
                refusals.add("unknown message")
            refusals.report(100.0 + millisecond / 1000)
        refusals.report(200.0)
        refusals.report(300.0)
    assert counts == {"cut short": 2500, "unknown message": 250}
    assert caplog.messages == [
        "osc:7110: refused 1 × cut short, 1 × unknown message",
        "osc:7110: refused 1000 × cut short, 100 × unknown message",
        "osc:7110: refused 1000 × cut short, 100 × unknown message",
        "osc:7110: refused 499 × cut short, 49 × unknown message",
    ]
