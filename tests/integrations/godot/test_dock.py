"""The dock in Godot, operated like with a mouse, with the real service; one test uses the real editor."""

import itertools
import json
import random
import threading
import tomllib

import pytest
import zmq
from PIL import Image

from engine_bridge.puppet.puppet_file import load
from engine_bridge.service.protocol.header import Header, Kind, join, topic_field, write_json

from ..messages import altered

pytestmark = pytest.mark.slow


class Dock:
    """A dock that executes commands, and its reported contents."""

    def __init__(self, start_godot, tmp_path):
        self._commands = tmp_path / "commands"
        self._commands.touch()
        self._count = 0
        self.script = start_godot("press_dock.gd", self._commands)

    def do(self, *command):
        """Execute a command; `until` considers only contents that are reported after it."""
        self._count += 1
        with self._commands.open("a") as commands:
            commands.write(json.dumps(command) + "\n")

    def until(self, wanted):
        """Wait until the contents after all commands satisfy a condition, and return them."""
        return self.script.until(lambda shown: shown["done"] == self._count and wanted(shown))

    def follow(self, port, token=""):
        self.do("type", "Token", token)
        self.do("type", "Address", f"127.0.0.1:{port}")
        self.do("show")


@pytest.fixture
def dock(start_godot, tmp_path):
    return Dock(start_godot, tmp_path)


@pytest.fixture
def puppet(blob_puppet):
    """A puppet file of the test's own."""
    path = blob_puppet.with_name("dog.toml")
    path.write_text("# my dog\n" + blob_puppet.read_text())
    return path


@pytest.fixture
def performer(sender, kung_fu):
    """A performer who never stops."""
    with sender.playing(kung_fu):
        yield sender


@pytest.fixture
def start(serve, puppet, free_port):
    """Start a service whose control socket has the port after the stream's, where the dock expects it."""

    def start_it(source, *more):
        return serve("--puppet", puppet, "--source", source, "--calibrate", "at_once", *more, "--port", free_port())

    return start_it


def row(service, name):
    return next(each for each in service.ask("puppet", character="dog")["handles"] if each["name"] == name)


def test_the_dock_shows_the_characters_state_and_its_buttons_work(dock, start, puppet, performer):
    service = start(performer.uri)
    dock.follow(service.port)
    shown = dock.until(lambda shown: "User 1 performs" in shown["facts"] and shown["rows"])
    assert shown["connection"] == f"Connected to 127.0.0.1:{service.port}."
    assert (shown["characters"], shown["character"]) == (["dog"], "dog")
    assert shown["can"] == ["Calibrate", "Mirror", "Record", "AddToScene"]
    dock.until(lambda shown: "frames per second" in shown["facts"] and "ms from sensor" in shown["facts"])
    dock.until(lambda shown: shown["performers"] == ["Any performer", "User 1"] and shown["performer"] == "User 1")
    dock.do("toggle", "Mirror", True)
    dock.until(lambda shown: shown["mirror"] and service.ask("describe")["characters"][0]["mirror"])
    dock.do("press", "Calibrate")
    dock.do("select", "Performer", "User 1")
    dock.until(lambda shown: shown["performer"] == "User 1" and not shown["trouble"])
    dock.do("toggle", "Record", True)
    shown = dock.until(lambda shown: "Save" not in shown["can"] and shown["recording"] and not shown["trouble"])
    shown = dock.until(lambda shown: not any(each["editable"] for each in shown["rows"].values()))
    [stage] = service.ask("describe")["status"]["stages"]
    assert stage["recording"].startswith(stage["name"])
    dock.do("toggle", "Record", False)
    dock.until(lambda shown: not shown["recording"] and all(each["editable"] for each in shown["rows"].values()))
    assert len(service.ask("list")["takes"]) == 1
    dock.script.end()


def test_a_mapping_is_edited_live_and_saved(dock, start, puppet, performer):
    service = start(performer.uri)
    text = puppet.read_text()
    dock.follow(service.port)
    shown = dock.until(lambda shown: "performs" in shown["facts"] and shown["rows"])
    said = service.ask("puppet", character="dog")
    assert {name: (each["joints"], each["axes"], each["gain"]) for name, each in shown["rows"].items()} == {
        each["name"]: (", ".join(each["joints"]) or "none", each["axes"], each["gain"]) for each in said["handles"]
    }
    assert (shown["root"], shown["scale"]) == (["hip_center", "xz"], 1.3)
    assert shown["figure"] == ["hand_left"]
    shown = dock.until(lambda shown: {"left hand", "right hand", "head"} <= set(shown["moved"]))
    assert not {"left foot", "right foot"} & set(shown["moved"])
    dock.do("joint", "left foot", "hand_left")
    dock.do("gain", "left foot", 2.5)
    dock.do("axis", "left foot", "z", False)
    dock.until(lambda shown: "Save" in shown["can"] and shown["rows"]["left foot"]["joints"] == "hand_left")
    dock.until(lambda shown: "left foot" in shown["moved"])
    dock.do("point", "left foot", "head")
    dock.until(lambda shown: shown["figure"] == ["hand_left", "head"])
    dock.do("gain", "head", -1.15)
    dock.do("carry", "spine")
    dock.do("scale", 0.9)
    shown = dock.until(
        lambda shown: (
            shown["rows"]["left foot"]["joints"] == "hand_left, head"
            and shown["rows"]["head"]["gain"] == -1.15
            and shown["root"] == ["spine", "xz"]
            and shown["scale"] == 0.9
            and not shown["trouble"]
        )
    )
    assert puppet.read_text() == text
    dock.do("press", "Save")
    dock.until(lambda shown: "Save" not in shown["can"] and not shown["trouble"])
    saved = puppet.read_text()
    assert saved.startswith("# my dog\n")
    before, after = tomllib.loads(text), tomllib.loads(saved)
    before["handle"][2]["gain"] = -1.15
    before["handle"][3] |= {"joints": ["hand_left", "head"], "gain": 2.5, "axes": "xy"}
    before["root"]["joint"], before["retarget"]["scale"] = "spine", 0.9
    assert after == before
    assert load(puppet).handle[3].driven_by == tuple(row(service, "left foot")["joints"]) == ("hand_left", "head")
    dock.script.end()


def test_edits_can_be_taken_back_and_others_are_seen(dock, start, puppet):
    service = start("demo:walk?loop")
    dock.follow(service.port)
    dock.until(lambda shown: shown["rows"])
    dock.do("joint", "head", "head")
    dock.do("carry", "nothing")
    dock.until(lambda shown: shown["rows"]["head"]["joints"] == "none" and shown["root"] == ["nothing", ""])
    dock.do("press", "Revert")
    dock.until(lambda shown: shown["rows"]["head"]["joints"] == "head" and "Revert" not in shown["can"])
    dock.do("carry", "nothing")
    dock.do("carry", "head")
    dock.until(lambda shown: shown["root"] == ["head", "xz"])
    service.ask("set_handle", character="dog", handle="head", gain=4, axes="y")
    dock.until(lambda shown: shown["rows"]["head"]["gain"] == 4 and shown["rows"]["head"]["axes"] == "y")
    puppet.write_text(puppet.read_text() + "\n# and a remark\n")
    dock.do("press", "Save")
    shown = dock.until(lambda shown: shown["trouble"])
    assert "has changed since it was loaded" in shown["trouble"]
    assert str(puppet) in shown["trouble"]
    assert shown["rows"]["head"]["gain"] == 4
    dock.do("press", "TroubleSeen")
    dock.until(lambda shown: not shown["trouble"])
    for gain in range(50):  # faster than the service answers
        dock.do("gain", "right hand", gain / 10)
    dock.until(lambda shown: shown["rows"]["right hand"]["gain"] == 4.9)
    dock.do("scale", 2.0)
    dock.until(lambda shown: shown["scale"] == 2.0 and not shown["trouble"])
    while row(service, "right hand")["gain"] != 4.9:
        pass
    dock.script.end()


def test_the_dock_waits_for_a_service_and_outlives_it(dock, serve, puppet, free_port):
    port = free_port()
    dock.follow(port)
    dock.until(lambda shown: "Retrying" in shown["connection"] and not shown["characters"])
    service = serve("--puppet", puppet, "--source", "demo:walk?loop", "--port", port)
    dock.until(lambda shown: shown["rows"] and shown["can"])
    dock.do("gain", "head", 3.0)
    dock.until(lambda shown: "Save" in shown["can"])
    service.process.kill()
    shown = dock.until(lambda shown: not shown["characters"])
    assert "Retrying" in shown["connection"]
    assert not shown["rows"]
    assert not shown["can"]
    dock.do("gain", "head", 2.0)  # whatever is still pressed
    dock.do("press", "Save")
    dock.do("press", "Calibrate")
    service.process.wait()
    serve("--puppet", puppet, "--source", "demo:walk?loop", "--port", port)
    shown = dock.until(lambda shown: shown["rows"])
    assert shown["rows"]["head"]["gain"] == 0.8
    assert "Save" not in shown["can"]
    dock.script.end()


def test_a_token_is_wanted_and_is_not_sent_to_another_service(dock, start, token_file):
    """The other service has the same token, and would accept it."""
    token = token_file.read_text()
    one, other = start("osc:0", "--token-file", token_file), start("osc:0", "--token-file", token_file)

    def refused(shown):
        return "token" in shown["connection"] and not shown["rows"]

    for wrong in "", token[::-1]:
        dock.follow(one.port, wrong)
        dock.until(refused)
    dock.follow(one.port, token)
    shown = dock.until(lambda shown: shown["rows"] and shown["facts"].startswith("No performer"))
    assert shown["token"] == token
    for choose in ("type", "Address", f"127.0.0.1:{other.port}"), ("find", "127.0.0.1", one.port):
        dock.do(*choose)
        assert dock.until(refused)["token"] == ""
        dock.do("type", "Token", token)
        dock.until(lambda shown: shown["rows"])
    dock.script.end()


def test_the_dock_switches_characters_and_disconnects_while_hidden(dock, start, puppet):
    other = puppet.with_name("cat.toml")
    other.write_text(puppet.read_text().replace('name = "head"', 'name = "nose"'))
    service = start("demo:walk?loop", "--puppet", other)
    dock.follow(service.port)
    dock.until(lambda shown: shown["characters"] == ["dog", "cat"] and "head" in shown["rows"])
    dock.do("select", "Character", "cat")
    dock.until(lambda shown: shown["character"] == "cat" and "nose" in shown["rows"] and "head" not in shown["rows"])
    dock.do("hide")
    dock.until(lambda shown: not shown["characters"])
    dock.do("show")
    dock.until(lambda shown: shown["character"] == "cat" and "nose" in shown["rows"])
    dock.script.end()


def test_the_dock_is_in_the_editor_and_adds_a_character_to_the_scene(drive_editor, project, start, tmp_path):
    service = start("demo:walk?loop")
    environment = {"ADDRESS": f"127.0.0.1:{service.port}", "PICTURE": str(tmp_path / "editor.png")}
    world = '[gd_scene format=3]\n\n[node name="World" type="Node3D"]\n'
    told = drive_editor("use_editor.gd", world, **environment)
    node = ["dog", True, "dog", "127.0.0.1", service.port]
    assert [{key: value for key, value in each.items() if key != "selected"} for each in told] == [
        {"before": []},
        {"added": [node]},
        {"undone": []},
        {"redone": [node]},
    ]
    assert told[1]["selected"] == ["dog"]
    scene = (project / "world.tscn").read_text()
    assert '[node name="dog" type="Node3D"' in scene
    assert "puppet_3d.gd" in scene
    assert "ArrayMesh" not in scene  # what it shows is not saved with the scene
    assert Image.open(tmp_path / "editor.png").size == (1600, 1000)


DESCRIBED = {
    "characters": [{"name": "dog", "stage": "s", "performer": None, "mirror": False}],
    "status": {"stages": [{"name": "s", "users": [{"user": 1}]}]},
}
HANDLE = {"name": "fine", "joint": None, "joints": ["head"], "axes": "xyz", "gain": 2.5}
PUPPET = {"handle": [HANDLE], "root": None, "retarget": {"scale": 1.0}}
MAPPING = {"character": "dog", "puppet": PUPPET, "joints": ["head"], "saved": True}


def nonsense(valid):
    """Yield some replies that make no sense, and then the valid one again and again."""
    wrong = [value for _, value in altered(valid)]
    yield from random.Random(3).sample(wrong, 8)
    yield from itertools.repeat(valid)


@pytest.fixture
def impostor(free_port):
    """A server in place of the service that follows the protocol but sends invalid values."""
    port, over = free_port(), threading.Event()
    status = write_json({"service": None})
    message = join(topic_field("service/status"), Header(kind=Kind.STATUS, length=len(status)), status)

    def answer():
        asked = {"describe": nonsense(DESCRIBED), "puppet": nonsense(MAPPING)}
        while not over.is_set():
            while control.poll(20):
                sender, body = control.recv_multipart()
                request = json.loads(body)
                does = request["do"] in asked
                result = next(asked[request["do"]]) if does else None
                reply = {"id": request["id"], "ok": does, "result": result, "error": {"found": "an edit"}}
                control.send_multipart([sender, json.dumps(reply).encode()])
            stream.send(message)

    with zmq.Context() as context, context.socket(zmq.XPUB) as stream, context.socket(zmq.ROUTER) as control:
        stream.linger = control.linger = 0
        stream.bind(f"tcp://127.0.0.1:{port}")
        control.bind(f"tcp://127.0.0.1:{port + 1}")
        answering = threading.Thread(target=answer)
        answering.start()
        yield port
        over.set()
        answering.join()


def test_answers_that_make_no_sense_do_no_harm_and_an_edit_that_is_refused_is_taken_back(dock, impostor):
    dock.follow(impostor)
    dock.until(lambda shown: shown["rows"].get("fine", {}).get("gain") == 2.5)
    dock.do("gain", "fine", 1.0)
    dock.until(lambda shown: "an edit" in shown["trouble"] and shown["rows"]["fine"]["gain"] == 2.5)
    dock.script.end()
