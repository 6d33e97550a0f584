"""A Puppet3D with services that start, stop, refuse and change, and with performers, takes and damaged frames."""

import json
import secrets
import signal
import socket

import numpy as np
import pytest

from engine_bridge.export.shader_mesh import write_shader_mesh

from ...waiting import wait_until
from .resident import Godot

ARRIVAL = ["connected", "scene_loaded", "performer_found", "performer_calibrated"]


class Watched:
    """Nodes in a running scene, and their reports."""

    def __init__(self, script, orders):
        self._script, self._orders, self._given = script, orders, 0

    def signals(self, puppet=0):
        """Names of a puppet's signals, but those of the timeline, which come with each status."""
        told = [told["signal"] for told in self._script.results if told.get("puppet") == puppet and "signal" in told]
        return [name for name in told if name != "timeline_received"]

    def states(self, puppet=0):
        return [told for told in self._script.results if told.get("puppet") == puppet and "meshes" in told]

    def until_signal(self, name, puppet=0, **what):
        wanted = {"puppet": puppet, "signal": name, **what}
        return self._script.until(lambda told: wanted.items() <= told.items())

    def until(self, wanted, puppet=0):
        """Wait for a state that comes after all that was ordered."""
        return self._script.until(
            lambda told: told.get("puppet") == puppet and told.get("done") == self._given and wanted(told)
        )

    def until_next(self, wanted, puppet=0):
        """Wait for a state of which none has been so far."""
        before = len(self.states(puppet))
        self._script.until(lambda _told: any(wanted(state) for state in self.states(puppet)[before:]))
        return next(state for state in self.states(puppet)[before:] if wanted(state))

    def order(self, **what):
        with self._orders.open("a") as orders:
            orders.write(json.dumps({"puppet": 0} | what) + "\n")
        self._given += 1

    def reply(self, number=0):
        self._script.until(lambda _told: len(self.replies()) > number)
        return self.replies()[number]

    def replies(self):
        return [told["reply"] for told in self._script.results if "reply" in told]

    def until_printed(self, text):
        wait_until(lambda: any(text in line for line in self._script.lines))

    def end(self):
        self._script.end()
        return self._script.lines


@pytest.fixture
def watch(start_godot, tmp_path):
    def start(*settings, **options):
        orders = tmp_path / "orders"
        return Watched(start_godot("watch_puppet.gd", json.dumps(settings), orders, **options), orders)

    return start


def moves(state):
    return state["calibrated"] and state["sequence"] >= 0 and state["visible"] == [True]


def test_a_node_finds_a_service_that_starts_later_and_outlives_one_that_is_killed(watch, serve_figure, free_port):
    port = free_port()
    watched = watch({"port": port})
    watched.until(lambda state: not state["connected"])
    first = serve_figure(port=port)
    before = watched.until(moves)
    first.stop(signal.SIGKILL)
    watched.until_signal("disconnected")
    gone = watched.until_next(lambda state: not state["connected"])
    assert gone["visible"] == [True]  # it stays as it was
    serve_figure(port=port)
    back = watched.until_next(moves)
    assert sorted(watched.signals()[:4]) == sorted(ARRIVAL)
    assert watched.signals()[4:6] == ["performer_lost", "disconnected"]
    assert set(watched.signals()[6:9]) == {"connected", "performer_found", "performer_calibrated"}
    assert watched.signals().count("scene_loaded") == 1
    assert (back["instances"], back["meshes"]) == (before["instances"], before["meshes"])
    watched.end()


def test_two_nodes_of_one_service_share_what_does_not_change(watch, stage):
    stage.is_playing, settings = True, {"port": stage.port, "character": "blob"}
    watched = watch(settings, {**settings, "interpolation_delay": 0.5})
    one, other = watched.until(moves), watched.until(moves, puppet=1)
    assert one["meshes"] == other["meshes"]
    assert one["instances"] != other["instances"]
    assert stage.scenes == 1
    late = watched.until_next(lambda state: state["waiting"] > 5, puppet=1)
    assert late["lost"] == 0
    assert one["saved"] == other["saved"] == 1  # nothing of it is saved with a scene
    watched.end()


def test_a_new_version_of_the_character_replaces_the_old_one(watch, serve, played, blob_file, write_puppet):
    puppet = write_puppet(blob_file.with_name("changed.toml"), blob_file.name)
    service = serve("--puppet", puppet, *played[2:])
    watched = watch({"port": service.port})
    before = watched.until(moves)
    write_puppet(puppet, blob_file.name, more="[solver]\nfields = 3\nisolines = 5", replaces=True)
    assert service.ask("reload") == {"characters": ["changed"]}
    watched.until(lambda state: moves(state) and state["instances"] != before["instances"])
    assert watched.signals().count("scene_loaded") == 2
    assert watched.until_next(moves)["damaged"] == 0
    assert all(any(state["visible"]) for state in watched.states()[watched.states().index(before) :])
    watched.end()


def test_a_service_that_refuses_is_asked_again_only_when_told_to_and_when_the_token_changes(
    watch, locked_figure, token_file
):
    watched = watch({"port": locked_figure.port, "token": "wrong"})
    why = watched.until_signal("refused")["what"]
    [warning] = watched.until_next(lambda _state: True)["warnings"]
    assert why in warning
    watched.order(call=["retry"])
    watched.until_next(lambda _state: watched.signals().count("refused") == 2)
    watched.order(set={"token": token_file.read_text()})
    assert watched.until(moves)["warnings"] == []
    assert watched.signals().count("refused") == 2
    assert sum(f":{locked_figure.port} refuses the connection" in line for line in watched.end()) == 2


def test_a_source_shows_itself_until_a_service_moves_it_and_rendering_properties_are_passed_on(
    watch, serve_figure, add_glb, blob_puppet, tmp_path, free_port
):
    """Layers, shadows (double-sided is 2), global illumination (dynamic is 2), levels of detail, visibility range."""
    write_shader_mesh(blob_puppet, tmp_path / "one.glb")
    write_shader_mesh(blob_puppet, tmp_path / "two.glb")
    one, two = add_glb(tmp_path / "one.glb"), add_glb(tmp_path / "two.glb")
    port, rendering = free_port(), [[5, 1, 2, 1, 0]]  # the node's defaults
    watched = watch({"port": port, "layers": 5})
    assert watched.until(lambda _state: True)["meshes"] == []
    watched.order(set={"mesh_source": one})
    first = watched.until(lambda state: state["visible"] == [True])
    watched.order(set={"mesh_source": two})
    second = watched.until(lambda state: state["meshes"] != first["meshes"] and len(state["meshes"]) == 1)
    watched.order(set={"user_slot": 1})
    assert watched.until(lambda state: not state["meshes"])["connected"] is False
    watched.order(set={"user_slot": -1})
    assert watched.until(lambda state: state["meshes"] == second["meshes"])["rendering"] == rendering
    serve_figure(port=port)
    own = watched.until(lambda state: moves(state) and len(state["meshes"]) == 1)
    assert (own["warnings"], own["rendering"]) == ([], rendering)
    assert own["instances"] != second["instances"]
    watched.order(set={"cast_shadow": 2, "gi_mode": 0, "lod_bias": 4, "visibility_range_end": 30})
    assert watched.until(moves)["rendering"] == [[5, 2, 0, 4, 30]]
    watched.order(set={"mode": 1})
    services = watched.until(lambda state: moves(state) and state["meshes"] != own["meshes"])
    assert services["rendering"] == [[5, 2, 0, 4, 30]]
    watched.end()


def test_a_character_is_shown_only_while_its_performer_plays(watch, serve, blob_puppet, sender, frames, standing):
    service = serve("--puppet", blob_puppet, "--source", sender.uri, "--calibrate", "at_once")
    settings = {"port": service.port}
    watched = watch({**settings, "user_slot": 1}, {**settings, "user_slot": 2}, settings)
    assert watched.until(lambda state: state["sequence"] > 0)["visible"] == [False]
    assert watched.until(lambda state: state["sequence"] > 0, puppet=2)["visible"] == [True]  # and rests
    sender.play(
        frames(np.tile(standing, (1800, 1, 1))), until=lambda: watched.signals(2)[-1:] == ["performer_calibrated"]
    )
    assert watched.until(lambda state: state["calibrated"])["user"] == 1
    watched.until_next(lambda state: state["visible"] == [True])
    assert watched.until_next(lambda _state: True, puppet=1)["visible"] == [False]
    sender.lose()
    watched.until_signal("performer_lost", what=1)
    watched.until_next(lambda state: state["visible"] == [False])
    assert watched.signals(1) == ["connected", "scene_loaded"]
    assert [name for name in watched.signals(2) if "performer" in name] == [
        "performer_found",
        "performer_calibrated",
        "performer_lost",
    ]
    watched.end()


def test_the_service_is_asked_to_do_something_and_takes_are_of_the_characters_stage(
    watch, serve_figure, played, blob_file, write_puppet
):
    other = write_puppet(blob_file.with_name("other.toml"), blob_file.name)
    service = serve_figure("--puppet", other, *played[2:4])
    watched = watch({"port": service.port, "character": "other"})
    watched.until(moves)
    watched.order(request={"do": "ping"})
    assert watched.reply() == {"id": 1, "ok": True, "result": "pong"}
    watched.order(call=["set_mirror", True])
    service.ask("record_start", stage="stage1", name="theirs")
    watched.order(call=["start_recording", "mine"])
    watched.until_signal("take_started", what="mine")
    described = service.ask("describe")
    assert {each["name"]: each["recording"] for each in described["status"]["stages"]} == {
        "stage1": "theirs",
        "stage2": "mine",
    }
    assert [each["mirror"] for each in described["characters"]] == [False, True]
    watched.order(call=["stop_recording"])
    watched.until_signal("take_stopped", what="mine")
    assert [name for name in watched.signals() if "take" in name] == ["take_started", "take_stopped"]
    watched.order(call=["calibrate"])  # at once, so its state does not change; a failure would be a warning
    watched.order(call=["start_recording", "../mine"])
    watched.until_printed("../mine")
    warnings = [line for line in watched.end() if "WARNING" in line]
    assert warnings
    assert all("../mine" in line for line in warnings)


def test_a_changed_slot_reports_its_own_performer_at_once(watch, figure):
    watched = watch({"port": figure.port, "user_slot": 99})
    watched.until(lambda state: state["visible"] == [False] and state["sequence"] >= 0)
    assert "performer_found" not in watched.signals()
    user = figure.ask("describe")["characters"][0]["performer"]
    watched.order(set={"user_slot": user})
    assert watched.until(moves)["user"] == user
    assert watched.signals()[-2:] == ["performer_found", "performer_calibrated"]
    watched.end()


def test_a_request_is_answered_though_the_node_goes_elsewhere_or_finds_no_service(watch, free_port):
    with socket.create_server(("127.0.0.1", 0)) as silent:
        watched = watch({"port": silent.getsockname()[1] - 1}, {"host": ""})
        for puppet in (0, 1):
            watched.order(request={"do": "ping"}, puppet=puppet)
        watched.until(lambda _state: True)
        watched.order(set={"port": free_port()})
        found = [watched.reply(number)["error"]["found"] for number in (0, 1)]
        assert sorted(found) == ["a node that has disconnected from the service", "no service"]
        watched.end()


def test_properties_set_at_run_time_take_effect(watch, serve, played, blob_file, write_puppet):
    one, two = (write_puppet(blob_file.with_name(f"{name}.toml"), blob_file.name) for name in ("one", "two"))
    service = serve("--puppet", one, "--puppet", two, *played[2:4], *played[2:])
    watched = watch({"port": service.port})
    assert watched.until(moves)["character"] == "one"
    watched.order(set={"character": "two"})
    assert watched.until(lambda state: moves(state) and state["character"] == "two")["warnings"] == []
    watched.order(set={"mode": 1, "follow_root": False})
    watched.until(moves)
    watched.order(set={"character": "three"})
    nobody = watched.until(lambda state: state["warnings"])
    assert "'three'" in nobody["warnings"][0]
    assert nobody["meshes"] == []
    watched.order(set={"character": ""})
    assert watched.until(moves)["character"] == "one"
    watched.order(set={"mode": 2})
    watched.until(lambda state: len(state["warnings"]) == 2)
    watched.end()


def test_a_mesh_of_another_puppet_and_one_for_vertices_are_not_used(
    watch, stage, add_glb, blob_file, write_puppet, tmp_path
):
    stage.is_playing = True
    other = write_puppet(blob_file.with_name("coarser.toml"), blob_file.name, more="[solver]\nfields = 3\nisolines = 5")
    write_shader_mesh(other, tmp_path / "other.glb")
    watched = watch({"port": stage.port, "mesh_source": add_glb(tmp_path / "other.glb")})
    state = watched.until(lambda state: state["calibrated"] and any(state["visible"]) and state["warnings"])
    assert "run `puppetline shader-mesh` again" in state["warnings"][0]
    watched.order(set={"mode": 1})
    [warning] = watched.until(lambda state: moves(state) and "again" not in state["warnings"][0])["warnings"]
    assert "mesh_source is used by CONTROLS and MORPHS only" in warning
    assert sum("WARNING" in line and "run `puppetline shader-mesh` again" in line for line in watched.end()) == 1


@pytest.fixture
def announced(multicast, blob_file, write_puppet, take, token_file, tmp_path, free_port):
    """The name of a character and the file of a service that announces it, and wants a token."""
    name = f"figure_{secrets.token_hex(4)}"  # there may be other services
    puppet, service = blob_file.with_name(f"{name}.toml"), tmp_path / "service.toml"
    write_puppet(puppet, blob_file.name)
    service.write_text(
        f'takes = "{tmp_path / "takes"}"\n[network]\nport = {free_port()}\n'
        f'token_file = "{token_file}"\n[[stage]]\n'
        f'source = "replay:{take}?loop"\ncalibrate = "at_once"\n[[stage.character]]\npuppet = "{puppet}"\n'
    )
    return name, service


def test_a_service_is_found_in_the_network_but_gets_no_token_unless_the_network_is_trusted(
    watch, serve, announced, token_file
):
    """Of two nodes that look for it, one trusts the network."""
    name, service = announced
    settings = {"host": "", "character": name, "token": token_file.read_text()}
    watched = watch(settings, settings | {"trust_network": True})
    serve("--config", service)
    assert watched.until(moves, puppet=1)["character"] == name
    assert "trust_network" in watched.states()[-1]["warnings"][0]
    assert watched.signals() == []
    watched.order(request={"do": "ping"}, puppet=1)
    assert watched.reply()["result"] == "pong"
    watched.order(set={"trust_network": True})
    assert watched.until(moves)["warnings"] == []
    watched.end()


def test_a_changed_material_is_drawn(run_godot, stage):
    stage.is_playing = True
    standard, shader = run_godot("change_material.gd", stage.port)
    assert standard == {"albedo_color": "(0.25, 0.5, 0.75, 1.0)", "emission": "(1.0, 0.5, 0.25, 1.0)", "same": True}
    assert shader == {"tint": "(0.5, 1.0, 0.0)", "same": True}


def test_frames_that_are_wrong_are_as_good_as_none(watch, stage, danced):
    stage.is_playing, controls = True, danced[0].controls.astype("<f4")
    watched, whole = watch({"port": stage.port}), controls.tobytes()
    good = watched.until(lambda state: state["visible"] == [True])

    def send(payload, **header):
        stage.make = lambda: stage.send_controls(payload, **header)

    def grows(name, by):
        before = watched.states()[-1][name]
        wait_until(lambda: watched.states()[-1][name] > before + by)

    for wrong in b"", whole[:-4], whole + bytes(48):
        send(wrong)
        grows("damaged", 10)
    for value in np.nan, np.inf, 1e38:
        send(np.full_like(controls, value).tobytes())
        grows("sequence", 10)
    shown, asked = watched.states()[-1]["sequence"], stage.scenes
    send(whole, revision=2)
    wait_until(lambda: stage.scenes > asked + 1)
    assert watched.states()[-1]["sequence"] <= shown + 64
    stage.make = stage.send_next
    grows("sequence", 100)
    assert watched.states()[-1]["instances"] == good["instances"]  # it has never been made anew
    assert watched.signals().count("scene_loaded") == 1
    watched.end()


EDITED = """[gd_scene load_steps=2 format=3]
[ext_resource type="Script" path="res://addons/puppetline/puppet_3d.gd" id="1"]
[node name="Edited" type="Node3D"]
[node name="Puppet" type="Node3D" parent="."]
script = ExtResource("1")
port = {port}
preview_in_editor = {preview}
"""


@pytest.mark.parametrize("preview", [True, False])
def test_a_puppet_plays_in_the_editor_unless_the_preview_is_off(godot, project, stage, preview):
    (project / "edited.tscn").write_text(EDITED.format(port=stage.port, preview=str(preview).lower()))
    editing = ("--headless", "--editor", "--path", project, "res://edited.tscn", "--quit-after", 200)
    Godot(godot, *editing).finish(300)
    assert (stage.scenes > 0) == preview
