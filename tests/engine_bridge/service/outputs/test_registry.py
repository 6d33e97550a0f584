import math
from dataclasses import asdict

import pytest
import zmq

from engine_bridge.service.outputs.output import Opening, Output
from engine_bridge.service.outputs.registry import OutputTables
from engine_bridge.service.protocol.frame import StreamedCharacter
from engine_bridge.service.security.endpoints import endpoints_of
from engine_bridge.service.security.guard import Guard

TABLES = {
    "network": {"port": 0},
    "osc": [{"port": 9000}, {"port": 9001, "host": "127.0.0.2"}],
    "websocket": {"port": 0},
}


@pytest.fixture
def opening(blob_rig):
    context = zmq.Context()
    endpoints = endpoints_of(OutputTables(**TABLES).network)
    guard = Guard(context, endpoints, 1)
    yield Opening([StreamedCharacter("dog", blob_rig, 1)], context, endpoints, guard, lambda _body, _reply: None)
    guard.close()
    context.term()


def test_tables_come_in_the_order_of_the_rows_each_with_its_place():
    tables = OutputTables(**TABLES)
    assert list(tables.output_tables()) == [
        (("network",), tables.network),
        (("osc", 0), tables.osc[0]),
        (("osc", 1), tables.osc[1]),
        (("websocket",), tables.websocket),
    ]


def test_every_table_opens_an_output_that_has_sent_nothing_yet(opening):
    outputs = [table.open(opening) for _, table in OutputTables(**TABLES).output_tables()]
    try:
        assert all(isinstance(output, Output) for output in outputs)
        (stream,), nothing, nothing_either, (web,) = (output.endpoints for output in outputs)
        assert (nothing, nothing_either) == ((), ())
        sent = {"bytes": 0, "failed": 0, "refused": 0, "clients": None}
        assert [asdict(output.statistics) for output in outputs] == [
            {"wire": "zeromq", "target": stream, "sent": 0, "skipped": None} | sent,
            {"wire": "osc", "target": "127.0.0.1:9000", "sent": 0, "skipped": 0} | sent,
            {"wire": "osc", "target": "127.0.0.2:9001", "sent": 0, "skipped": 0} | sent,
            {"wire": "websocket", "target": web, "sent": 0, "skipped": 0} | sent | {"clients": 0},
        ]
        assert [output.due() for output in outputs] == [math.inf] * 4
        assert [len(output.sockets) for output in outputs] == [1, 0, 0, 1]
    finally:
        for output in outputs:
            output.close()
            output.close()


def test_the_streams_sockets_are_watched_by_the_guard(opening):
    before = len(opening.guard.sockets)
    output = OutputTables(**TABLES).network.open(opening)
    assert len(opening.guard.sockets) == before + 1
    output.close()
