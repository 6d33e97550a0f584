import math
from dataclasses import asdict
from pathlib import Path

import pytest
import zmq

from engine_bridge.service.loading.service_file import OutputTables, character_names, from_flags, load, stage_names
from engine_bridge.service.outputs.output import Opening, Output
from engine_bridge.service.protocol.scene import StreamedCharacter
from engine_bridge.service.security.endpoints import endpoints_of
from engine_bridge.service.security.guard import Guard
from puppetline.errors import ServiceError

STAGE = '[[stage]]\nsource = "osc:7110"\n'
CHARACTER = '[[stage.character]]\npuppet = "dog.toml"\n'
OSC = "[[osc]]\nport = 1\n"
BOTH, FIRST = STAGE + CHARACTER, "[[stage]] 1, [[character]] 1"


def read(tmp_path, text):
    path = tmp_path / "kiosk.toml"
    path.write_text(text)
    return load(path)


def test_the_least_that_a_file_must_say(tmp_path):
    service = read(tmp_path, STAGE + CHARACTER)
    [stage] = service.stage
    assert stage_names(service) == ["stage"]
    assert character_names(stage) == ["dog"]
    assert (service.network.host, service.network.port, service.announce) == ("127.0.0.1", 7400, True)
    assert (stage.settings.people, stage.player_settings.calibrate, stage.player_settings.tilt) == (
        "each",
        "still",
        None,
    )


def test_all_that_it_can_say(tmp_path):
    service = read(
        tmp_path,
        """
takes = "recorded"
announce = false
[network]
port = 9000
max_clients = 8
[metrics]
[[osc]]
port = 7000
rate = 15
send = ["controls", "morphs"]
characters = ["rex"]
[[stage]]
name = "left"
source = "osc:7110"
people = "queue"
turn = 45
calibrate = "command"
lost_after = 1
remember = 5
ease = 0
least_confidence = 0.5
tilt = 12.5
height = 1.6
[[stage.character]]
puppet = "dinosaur.toml"
name = "rex"
morphs = "rex.glb"
idle = "idle.log"
[[stage]]
source = "vmc:39539"
[[stage.character]]
puppet = "figures/big dog (2).toml"
""",
    )
    assert stage_names(service) == ["left", "stage2"]
    assert [character_names(stage) for stage in service.stage] == [["rex"], ["big_dog_2"]]
    assert service.stage[0].settings.turn == 45
    assert (service.stage[0].player_settings.tilt, service.stage[0].player_settings.height) == (12.5, 1.6)
    assert service.metrics.port == 9464
    assert service.osc[0].send == ("controls", "morphs")


@pytest.mark.parametrize(
    ("text", "where", "found", "fix"),
    [
        ("", "stage", "nothing", "Add a table [[stage]] there."),
        (STAGE, "[[stage]] 1, character", "nothing", "Add a table [[character]] there."),
        (BOTH + 'colour = "red"', f"{FIRST}, colour", "unknown key 'colour'", "Remove it."),
        (STAGE + 'poeple = "each"\n' + CHARACTER, "[[stage]] 1, poeple", "unknown key", "Did you mean 'people'?"),
        (STAGE + 'people = "all"\n' + CHARACTER, "[[stage]] 1, people", "'all'", "Change the value of that key."),
        (STAGE + "turn = true\n" + CHARACTER, "[[stage]] 1, turn", "True", "Change the value of that key."),
        (BOTH + 'name = "a/b"', f"{FIRST} 'a/b', name", "'a/b'", "Change"),
        (BOTH + CHARACTER, "[[stage]] 1, [[character]] 2, name", "the name 'dog' again", "Choose another"),
        (BOTH + 'name = "service"', f"{FIRST} 'service', name", "'service'", "Choose"),
        ("[network]\nport = 99999\n" + BOTH, "[network], port", "99999", "Change"),
        ("[netwrok]\n" + BOTH, "netwrok", "unknown key 'netwrok'", "Did you mean 'network'?"),
        (OSC + "send = []\n" + BOTH, "[[osc]] 1, send", "[]", "Change"),
        (OSC + 'characters = ["cat"]\n' + BOTH, "[[osc]] 1, characters, 1", "no character 'cat'", "Choose one"),
        (OSC + 'send = ["morphs"]\n' + BOTH, "[[osc]] 1, send", "morph weights", "Make"),
        (
            OSC + 'send = ["vmc"]\n' + BOTH + CHARACTER + 'name = "cat"\n',
            *("[[osc]] 1, characters", "VMC of 2 characters (dog, cat)", "Choose one of them"),
        ),
        (STAGE.replace("osc:7110", "") + CHARACTER, "[[stage]] 1, source", "''", "Change"),
    ],
)
def test_a_mistake_is_named_with_its_place(tmp_path, text, where, found, fix):
    with pytest.raises(ServiceError) as error:
        read(tmp_path, text)
    assert error.value.where == f"{tmp_path / 'kiosk.toml'}, {where}"
    assert found in error.value.found
    assert error.value.fix.startswith(fix)


def test_a_syntax_error_is_told_with_its_line(tmp_path):
    with pytest.raises(ServiceError, match="line 2"):
        read(tmp_path, "[[stage]]\nsource = osc\n")


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(ServiceError, match="Check the path"):
        load(tmp_path / "none.toml")


def test_flags_stand_for_a_file():
    one = from_flags(("osc:7110",), (Path("a.toml"), Path("b.toml")), {"people": "nearest"}, {"idle": "i.log"}, {})
    assert [(stage.source, character_names(stage), stage.people) for stage in one.stage] == [
        ("osc:7110", ["a", "b"], "nearest")
    ]
    assert one.stage[0].character[1].idle == "i.log"
    two = from_flags(("osc:1", "osc:2"), (Path("a.toml"), Path("b.toml")), {}, {}, {})
    assert [(stage.source, character_names(stage)) for stage in two.stage] == [("osc:1", ["a"]), ("osc:2", ["b"])]
    with pytest.raises(ServiceError, match="2 times --source and 1 times --puppet"):
        from_flags(("osc:1", "osc:2"), (Path("a.toml"),), {}, {}, {})


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
