from dataclasses import asdict
from pathlib import Path

from engine_bridge.service.loading.service_file import character_names, from_flags, load, stage_names
from engine_bridge.service.players.player_settings import PlayerSettings
from puppetline.errors import ServiceError

from ...refusals import refused_place

STAGE = '[[stage]]\nsource = "osc:7110"\n'
CHARACTER = '[[stage.character]]\npuppet = "dog.toml"\n'
OSC = "[[osc]]\nport = 1\n"
BOTH, FIRST = STAGE + CHARACTER, "[[stage]] 1, [[character]] 1"


def read(tmp_path, text):
    path = tmp_path / "kiosk.toml"
    path.write_text(text)
    return load(path)


def test_the_least_that_a_file_must_say(tmp_path):
    service = read(tmp_path, BOTH)
    [stage] = service.stage
    assert stage_names(service) == ["stage"]
    assert character_names(stage) == ["dog"]
    assert service.network.host == "127.0.0.1"
    assert service.network.port == 7400
    assert service.announce
    assert stage.settings.people == "each"
    assert stage.player_settings == PlayerSettings()


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
    assert service.stage[0].player_settings.tilt == 12.5
    assert service.stage[0].player_settings.height == 1.6
    assert service.metrics.port == 9464
    assert service.osc[0].send == ("controls", "morphs")


MISTAKES = {
    "": "stage",
    STAGE: "[[stage]] 1, character",
    BOTH + 'colour = "red"': f"{FIRST}, colour",
    STAGE + 'poeple = "each"\n' + CHARACTER: "[[stage]] 1, poeple",
    STAGE + 'people = "all"\n' + CHARACTER: "[[stage]] 1, people",
    STAGE + "turn = true\n" + CHARACTER: "[[stage]] 1, turn",
    BOTH + 'name = "a/b"': f"{FIRST} 'a/b', name",
    BOTH + CHARACTER: "[[stage]] 1, [[character]] 2, name",
    BOTH + 'name = "service"': f"{FIRST} 'service', name",
    "[network]\nport = 99999\n" + BOTH: "[network], port",
    "[netwrok]\n" + BOTH: "netwrok",
    OSC + "send = []\n" + BOTH: "[[osc]] 1, send",
    OSC + 'characters = ["cat"]\n' + BOTH: "[[osc]] 1, characters, 1",
    OSC + 'send = ["morphs"]\n' + BOTH: "[[osc]] 1, send",
    OSC + 'send = ["vmc"]\n' + BOTH + CHARACTER + 'name = "cat"\n': "[[osc]] 1, characters",
    STAGE.replace("osc:7110", "") + CHARACTER: "[[stage]] 1, source",
}


def test_a_mistake_is_named_with_its_place(tmp_path):
    path = tmp_path / "kiosk.toml"
    refused_place(ServiceError, path, load, path)  # which is not there
    for text, place in MISTAKES.items():
        path.write_text(text)
        assert refused_place(ServiceError, path, load, path).startswith(place)


def test_flags_stand_for_a_file():
    puppets = Path("a.toml"), Path("b.toml")
    [one] = from_flags(("osc:7110",), puppets, {"people": "nearest"}, {"idle": "i.log"}, {}).stage
    assert one.source == "osc:7110"
    assert one.people == "nearest"
    assert character_names(one) == ["a", "b"]
    assert one.character[1].idle == "i.log"
    two = from_flags(("osc:1", "osc:2"), puppets, {}, {}, {})
    assert [(stage.source, character_names(stage)) for stage in two.stage] == [("osc:1", ["a"]), ("osc:2", ["b"])]


def test_every_table_opens_an_output_that_has_sent_nothing_yet(play_file):
    service = play_file('[[osc]]\nport = 9000\n[[osc]]\nport = 9001\nhost = "127.0.0.2"\n[websocket]\nport = 0')
    stream, web = service.service.stream
    sent = {"sent": 0, "bytes": 0, "skipped": 0, "failed": 0, "refused": 0, "clients": None}
    assert [asdict(each) for each in service.service.status.outputs] == [
        {"wire": "zeromq", "target": stream} | sent | {"skipped": None},
        {"wire": "osc", "target": "127.0.0.1:9000"} | sent,
        {"wire": "osc", "target": "127.0.0.2:9001"} | sent,
        {"wire": "websocket", "target": web} | sent | {"clients": 0},
    ]
    service.close()
    service.close()
