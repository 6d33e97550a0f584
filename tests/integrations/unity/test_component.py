"""The component, compiled and run with stand-ins for Unity and the real service: the data of its mesh."""

import json
import shutil
import signal
import socket
from dataclasses import replace

import numpy as np
import pytest

from engine_bridge.export.live_basis import REACH, LiveBasis
from engine_bridge.service.protocol.header import Kind
from engine_bridge.service.protocol.scene import StreamedCharacter

from ...waiting import wait_until
from .conftest import UNITY, array, assert_equal, cofactor_normals, shown


def mesh(program):
    return program.until(lambda said: said.get("event") == "sceneLoaded")


LIMITS = {"Controls": (1e-6, 1e-5), "Vertices": (1e-7, 1e-6), "Vertices16": (1e-5, 2e-4)}
"""Of the diagonal, and for normals."""


def assert_shown(vertices, *expected):
    """Compare vertices in Unity's axes with those of the service."""
    assert_equal(vertices * np.tile(UNITY, 2), *expected)


def assert_around(said, theirs, diagonal, looseness):
    bounds = np.float32(said["bounds"])
    low, high = bounds[:3] - bounds[3:] / 2, bounds[:3] + bounds[3:] / 2
    positions = theirs.positions * UNITY
    assert (low <= positions.min(axis=0) + 1e-5 * diagonal).all()
    assert (high >= positions.max(axis=0) - 1e-5 * diagonal).all()
    assert np.linalg.norm(high - low) <= looseness * np.linalg.norm(np.ptp(positions, axis=0))


@pytest.mark.parametrize("mode", LIMITS)
def test_vertices_uploaded_are_those_of_the_service_in_unitys_axes(show, stage, mode):
    """The mesh has the character's triangles, turned over, and its parts."""
    program = show(mode=mode, materials="Any/Shader,Other/Shader")
    made, diagonal = mesh(program), stage.diagonal
    triangles, positions = stage.arrays["triangles"].astype(np.int32), stage.arrays["positions"] * UNITY
    np.testing.assert_array_equal(array(made["indices"], np.int32, 3), triangles[:, [0, 2, 1]])
    assert made["parts"] == [[0, triangles.size, 0, len(positions)]]
    low, high = positions.min(axis=0), positions.max(axis=0)
    assert made["atRest"] == [pytest.approx([*(low + high) / 2, *(high - low)], abs=1e-5)]
    assert made["materials"] == ["Any/Shader"]
    assert made["layout"] == ["0 Position 3", "0 Normal 3", "1 Color 4", "1 TexCoord0 2"]
    assert (made["shown"], made["onGraphicsCard"]) == (False, False)  # before there is a pose
    white_without_texture = np.tile([1, 1, 1, 1, 0, 0], (len(positions), 1))
    np.testing.assert_array_equal(array(made["still"], columns=6), white_without_texture)
    both = shown(program, stage)
    for said, theirs in both:
        assert_shown(array(said["moving"], columns=6), theirs, diagonal, *LIMITS[mode])
        assert_around(said, theirs, diagonal, 1.001)
        assert said["enabled"]
    assert np.ptp([array(said["moving"])[:600] for said, _ in both], axis=0).max() > 0.005 * diagonal
    assert program.finish()[-1]["ended"]


def with_quick_normals(stage, said, theirs):
    return theirs._replace(normals=cofactor_normals(stage, stage.sent[said["frame"]].pose.controls))


def test_the_graphics_card_gets_the_rest_pose_once_and_then_transforms(show, stage, shader):
    """The character's block of transforms is put behind others; one of zeros leaves the rest pose."""
    program = show(api=shader.api)
    made, diagonal = mesh(program), stage.diagonal
    assert made["layout"][4:] == ["2 TexCoord1 2", *(f"2 TexCoord{k} 4" for k in range(2, 8))]
    both = shown(program, stage, 3)
    constant = array(made["ladder"], columns=26) + 3.0 * (np.arange(26) == 0)
    others = np.random.default_rng(0).normal(size=(3 * 512, 4))
    assert len({said["moving"] for said, _ in both}) == 1
    assert {said["uploads"] for said, _ in both} == {3}
    for said, theirs in both:
        moving, rows = array(said["moving"], columns=6), np.vstack([others, array(said["rows"], columns=4)])
        by_slopes, by_cofactors, before = shader(rows, moving, np.float32(constant))
        assert_shown(by_slopes, theirs, diagonal)
        if by_cofactors is not None:
            assert_shown(by_cofactors, with_quick_normals(stage, said, theirs), diagonal)
        if said["framesBefore"]:
            earlier = stage.sent[said["framesBefore"]].vertices_and_normals[0]
            assert np.abs(before * UNITY - earlier).max() <= 1e-6 * diagonal
        assert_around(said, theirs, diagonal, 3)
        for still in shader(np.zeros_like(rows), moving, np.float32(constant)):
            assert still is None or (still == moving[:, : still.shape[1]]).all()
    assert [said["framesBefore"] for said, _ in both[1:]] == [said["frame"] for said, _ in both[:-1]]
    assert program.finish()[-1]["ended"]


@pytest.mark.parametrize(
    ("pipeline", "material"),
    [("Universal", "PuppetlineControls"), ("HD", "PuppetlineControls"), ("Pipeline/Lit", "Pipeline/Lit")],
)
def test_another_pipelines_own_material_is_used_on_the_processor(show, pipeline, material):
    made = mesh(show(pipeline=pipeline))
    assert (made["materials"], made["onGraphicsCard"]) == ([material], material == "PuppetlineControls")


def test_quick_normals_are_those_of_cofactors(show, stage):
    program = show(materials="Any/Shader", quickNormals=True)
    for said, theirs in shown(program, stage):
        assert_shown(array(said["moving"], columns=6), with_quick_normals(stage, said, theirs), stage.diagonal)
    program.finish()


@pytest.mark.parametrize(("whole", "skins"), [(100, "found"), (1, "given with gaps")])
def test_morphs_set_the_weights_of_the_targets_and_move_the_root(show, new_stage, danced, whole, skins):
    prepared = danced[0].character.prepared
    directions = np.float32([danced[k].pose.R - prepared.model.rest_controls for k in (20, 40)])
    character = StreamedCharacter("blob", prepared, 1, LiveBasis(directions, REACH, prepared.model))
    stage = new_stage([replace(frame, character=character) for frame in danced])
    shapes = ",".join(["smile", *(f"motion_{k}" for k in range(64))])
    program = show(stage, mode="Morphs", whole=whole, skins=skins, shapes=shapes)
    for said, theirs in shown(program, stage, kind=Kind.MORPHS):
        x, y, z = stage.sent[said["frame"]].pose.root * UNITY
        # turned by 90° about y, and scaled
        assert said["root"] == pytest.approx([1 + 2 * z, 2 + 2 * y, 3 - 2 * x], abs=1e-5)
        expected = {1 + k: whole * weight for k, weight in enumerate(theirs.weights.tolist())}
        assert dict(map(tuple, said["weights"])) == pytest.approx(expected, rel=1e-6)
        assert len(expected) == len(stage.facts["morphs"])
    assert program.finish()[-1]["rest"] == [1, 2]


@pytest.mark.slow
def test_events_are_raised_once_each_and_in_order_and_takes_are_those_of_the_characters_stage(
    serve_figure, played, blob_puppet, show, tmp_path
):
    other = shutil.copy(blob_puppet, blob_puppet.with_name("other.toml"))
    more = ("--puppet", other, *played[2:4], "--takes", tmp_path / "takes")
    service = serve_figure(*more)
    program = show(service, character="other", materials="Any/Shader")

    def event(name, value=None, since=0):
        wanted = {"event": name} | ({} if value is None else {"value": value})
        return program.until(lambda said: wanted.items() <= said.items(), since)

    event("performerCalibrated")
    service.ask("record_start", stage="stage1", name="theirs")
    program.tell("record evening")
    event("takeStarted", "evening")
    stages = {each["name"]: each["recording"] for each in service.ask("describe")["status"]["stages"]}
    assert stages == {"stage1": "theirs", "stage2": "evening"}
    for line in ("stop", "mirror on", "calibrate", "ask describe"):
        program.tell(line)
    event("takeStopped", "evening")
    described = program.until(lambda said: "reply" in said)["reply"]["result"]["characters"]
    assert [each["mirror"] for each in described] == [False, True]
    program.tell("record not/a/name")
    program.until(lambda said: "warning" in said)
    program.tell("record night")
    event("takeStarted", "night")
    service.stop(signal.SIGKILL)
    since = program.said.index(event("disconnected")) + 1
    serve_figure(*more, port=service.port)
    for name in ("connected", "sceneLoaded", "performerCalibrated"):
        event(name, since=since)
    program.until(lambda said: "frame" in said, since)
    program.finish()
    before, after = (
        [said["event"] for said in told if "event" in said] for told in (program.said[:since], program.said[since:])
    )
    for events, takes in ((before, 2), (after, 0)):  # ended by the service, and by its own end
        assert events[:4] == ["connected", "sceneLoaded", "performerFound", "performerCalibrated"]
        assert events[-1] == "disconnected"
        assert events.count("disconnected") == 1
        assert [event for event in events if event.startswith("take")] == takes * ["takeStarted", "takeStopped"]
        # once, or anew with a pass of the take
        comings = [event for event in events if event in ("performerFound", "performerLost")]
        assert comings == len(comings) // 2 * ["performerFound", "performerLost"]


def test_a_refusal_is_told_and_warned_of_once_and_another_token_lets_in(start, locked_figure, token_file):
    program = start("Component", f"port={locked_figure.port}", "token=wrong", "materials=Any/Shader")
    refused = program.until(lambda said: said.get("event") == "refused")
    assert "token" in refused["value"]
    program.tell(f"set token {token_file.read_text()}")
    program.until(lambda said: "frame" in said)
    said = program.finish()
    assert [each["warning"] for each in said if "warning" in each] == [f"Puppetline: {refused['value']}"]


def test_a_mode_changed_at_run_time_takes_effect(show, stage):
    program = show()
    shown(program, stage, 2)
    since = len(program.said)
    program.tell("set mode Vertices")
    program.until(lambda said: said.get("event") == "sceneLoaded", since)
    for said, theirs in shown(program, stage, 2):
        assert_shown(array(said["moving"], columns=6), theirs, stage.diagonal)
    program.finish()


def test_morphs_without_a_mesh_of_the_character_say_what_to_do(start, figure):
    program = start("Component", f"port={figure.port}", "mode=Morphs", "shapes=smile")
    assert "puppetline bake" in program.until(lambda said: "warning" in said)["warning"]


def test_a_disabled_puppet_answers_every_request_with_an_error(start, free_port):
    """Those that wait for a service, and those that come later."""
    port = free_port()
    with socket.create_server(("127.0.0.1", port + 1)):  # takes connections, and says nothing
        program = start("Component", f"port={port}")
        program.tell("ask ping")
        program.tell("disable")
        program.tell("ask describe")
        program.tell("calibrate")
        said = program.finish()
    errors = [each["reply"]["error"] for each in said if "reply" in each]
    assert [error["found"] for error in errors] == ["a client that has been disposed", "a disabled Puppet"]
    assert [error["where"] for error in errors] == [f"the control socket 127.0.0.1:{port + 1}", "describe"]
    assert [each["warning"] for each in said if "warning" in each][-1].startswith(
        "Puppetline: calibrate: found a disabled"
    )


@pytest.mark.parametrize("event", ["connected", "sceneLoaded", "performerFound", "disconnected"])
def test_a_listener_of_an_event_may_disable_the_component(show, stage, event):
    stage.send(*stage.next(10))
    program = show(materials="Any/Shader", leaveOn=event)
    if event == "disconnected":
        program.until(lambda said: "frame" in said)
        stage.close()
    left = program.until(lambda said: "left" in said)
    said = program.finish()
    assert left == {"left": event}
    assert not any("frame" in each for each in said[said.index(left) :])
    assert said[-1]["ended"]


@pytest.mark.slow
def test_the_samples_buttons_record_a_take_play_it_record_over_it_and_trim_it(show, serve_figure, tmp_path):
    service = serve_figure("--takes", tmp_path / "takes")
    program = show(service)

    def press(button, wanted):
        """Press a button until the service's timeline is as wanted, and return it."""

        def pressed():
            program.tell(f"press {button}")
            program.tell("ask ping")
            program.until(lambda said: "reply" in said, len(program.said))
            found = service.ask("describe")["status"]["timeline"]
            return [found] if wanted(found) else None

        [found] = wait_until(pressed)
        return found

    def record(button):
        since = len(program.said)
        program.tell(f"press {button}")
        take = program.until(lambda said: said.get("event") == "takeStarted", since)["value"]
        since = len(program.said)
        program.until(lambda _: sum("frame" in said for said in program.said[since:]) > 60)
        program.tell(f"press Stop {take}")
        program.until(lambda said: said.get("event") == "takeStopped", since)
        return take

    program.until(lambda said: said.get("event") == "performerCalibrated")
    first = record("Record")
    whole = press(f"Play {first}", lambda now: now is not None)["takes"][0]
    assert (whole["take"], whole["character"]) == (first, "blob")
    press("Play in a loop", lambda now: now["loop"])
    second = record("Record over")
    assert [each["name"] for each in service.ask("list")["takes"]] == sorted([first, second])
    press("Pause", lambda now: now["paused"])
    service.ask("seek", seconds=whole["seconds"] / 2)
    trimmed = press("Begin here", lambda now: now["takes"][0]["seconds"] < whole["seconds"])["takes"]
    assert [each["take"] for each in trimmed] == [first]
    press("Continue", lambda now: now is None or not now["paused"])  # it may have come to its end
    press("Back to the performer", lambda now: now is None)
    program.finish()


@pytest.mark.parametrize("mode", ["Morphs", "Bones"])
def test_a_voice_moves_the_targets_that_the_meshes_have_themselves(mode, show, new_stage, spoken, tmp_path):
    prepared = spoken[0].character.prepared
    directions = np.float32([frame.pose.R - prepared.model.rest_controls for frame in spoken[:2]])
    character = StreamedCharacter("talker", prepared, 1, LiveBasis(directions, REACH, prepared.model))
    stage, bones = new_stage([replace(frame, character=character) for frame in spoken]), tmp_path / "bones.json"
    bones.write_text(json.dumps(stage.facts["bones"]))
    shapes = ",".join(["jaw", *stage.facts["morphs"]])
    program = show(stage, character="talker", mode=mode, shapes=shapes, bones=bones)
    jaws = [dict(map(tuple, said["weights"]))[0] for said, _ in shown(program, stage, 3)]
    np.testing.assert_allclose(jaws, [0, 40, 100], rtol=1e-5)
    assert dict(map(tuple, program.finish()[-1]["weights"]))[0] == 0
