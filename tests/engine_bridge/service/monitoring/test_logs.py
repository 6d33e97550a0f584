import io
import json
import logging
import re
import threading
from datetime import datetime

import pytest

from engine_bridge.service.monitoring.logs import MAX_QUEUED, OnceASecond, beside, fields, setup


@pytest.fixture
def stream():
    """Where all logs go during a test; the root logger is as it was afterwards."""
    root = logging.getLogger()
    handlers, level = root.handlers[:], root.level
    root.handlers[:] = []
    yield io.StringIO()
    root.handlers[:] = handlers
    root.setLevel(level)


@pytest.fixture
def log():
    return logging.getLogger("engine_bridge.service.stages.stage")


def test_json_is_one_object_a_line_with_time_level_logger_event_and_fields(stream, log):
    setup("json", stream=stream)
    before = datetime.now().astimezone()
    log.info("performer %s", "found\nand kept", extra=fields(stage="kinect", user=3, name="é"))
    log.warning("lost", extra=fields(why=ValueError("gone")))
    first, second = map(json.loads, stream.getvalue().splitlines())
    assert abs((datetime.fromisoformat(first.pop("time")) - before).total_seconds()) < 60
    assert first == {
        "level": "info",
        "logger": "engine_bridge.service.stages.stage",
        "event": "performer found\nand kept",
        "fields": {"stage": "kinect", "user": 3, "name": "é"},
    }
    assert second["level"] == "warning"
    assert second["event"] == "lost"
    assert second["fields"] == {"why": "gone"}


def test_text_is_one_line_to_which_the_network_adds_none_and_in_which_it_moves_no_cursor(stream, log):
    setup("text", stream=stream)
    log.info("performer found", extra=fields(stage="kinect", user=3))
    log.warning("refused %s", "a\nb\x1b[2J\u2028\u202e", extra=fields(reason="c\rd é"))
    found, refused = stream.getvalue().splitlines()
    assert re.fullmatch(
        r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d\.\d{3} info     "
        r"service\.stages\.stage: performer found \(stage=kinect, user=3\)",
        found,
    )
    assert refused.endswith("refused a\\nb\\x1b[2J\\u2028\\u202e (reason=c\\rd é)")


def test_records_below_the_level_are_left_out_and_a_second_setup_replaces_the_first(stream, log):
    setup("json", "info", stream)
    setup("text", "warning", stream)
    log.info("quiet")
    log.warning("loud")
    assert stream.getvalue().splitlines()[0].endswith("service.stages.stage: loud")
    assert stream.getvalue().count("\n") == 1


def test_each_event_is_said_once_a_second_and_then_how_often_it_was_not(stream, log, given_clock):
    setup("json", stream=stream)
    limited = OnceASecond(log)
    events = (0, "refused", 0, 1000), (0, "skipped", 0, 1), (1, "refused", 1, 2), (5, "refused", 2, 1)
    for after, event, number, times in events:
        given_clock.advance(after)
        for _ in range(times):
            limited.warning(event, source=number)
    said = [(line["event"], line["fields"]) for line in map(json.loads, stream.getvalue().splitlines())]
    assert said == [
        ("refused", {"source": 0}),
        ("skipped", {"source": 0}),
        ("refused", {"source": 1, "more": 999}),
        ("refused", {"source": 2, "more": 1}),
    ]


@pytest.mark.parametrize("form", ["text", "json"])
def test_logs_beside_come_in_order_and_with_their_tracebacks(stream, log, form):
    setup(form, stream=stream)
    with beside():
        for number in range(500):
            log.info("event", extra=fields(number=number))
        try:
            raise ZeroDivisionError("at all")
        except ZeroDivisionError:
            log.exception("fault")
    text = stream.getvalue()
    assert "Traceback" in text
    if form == "json":
        lines = [json.loads(line) for line in text.splitlines()]
        assert [line["fields"].get("number") for line in lines] == [*range(500), None]
        assert lines[-1]["traceback"].endswith("ZeroDivisionError: at all")


def test_a_stream_that_is_stuck_costs_records_and_no_time(stream, log):
    class Stuck(io.StringIO):
        going_on = threading.Event()

        def write(self, text):
            self.going_on.wait()
            return super().write(text)

    stuck = Stuck()
    setup("text", stream=stuck)
    with beside():
        for number in range(3 * MAX_QUEUED):
            log.info("event", extra=fields(number=number))
    stuck.going_on.set()
