"""Editing the mapping from joints to handles while a performer drives the character."""

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from capture.events import TICK_SECONDS
from engine_bridge.performance.character_motion import CharacterMotion
from engine_bridge.puppet import puppet_file
from engine_bridge.puppet.puppet import RootTable, with_handle
from engine_bridge.puppet.puppet_values import values_of
from engine_bridge.service.players.player_settings import PlayerSettings
from engine_bridge.service.stages.stage import PREPARATION_SECONDS

from .stage_steps import apart, largest_step, replay, ticks, with_beginnings

EASE = PlayerSettings().ease


def play(stage, events):
    """Step through events; return the frames."""
    return replay(stage, with_beginnings(stage, events))


def crossed(puppet):
    """Return the puppet with a left hand that follows head and spine in reverse, not along z, and with another root."""
    index = [handle.name for handle in puppet.handle].index("left hand")
    other = with_handle(puppet, index, ("head", "spine"), "xy", -0.5)
    return other.model_copy(update={"root": RootTable(joint="spine", axes="x")})


def test_the_character_eases_to_the_new_mapping_while_the_performer_continues(make_stage, kung_fu, prepared_blob):
    stage = make_stage(player_settings=PlayerSettings(tilt=0.0, height=0.0))
    [player] = stage.players
    puppet, edited_at = crossed(prepared_blob.puppet), kung_fu[150].time
    steady = largest_step(play(make_stage(), kung_fu), prepared_blob.mesh.diagonal)
    before = play(stage, kung_fu[:150])
    player.remap(puppet, edited_at)
    assert not player.settled
    after = play(stage, kung_fu[150:])
    assert player.settled
    assert {(frame.state, frame.user) for frame in after} == {("performing", kung_fu[0].user)}
    numbers = [frame.sequence for frame in (*before, *after)]
    assert numbers == list(range(1, len(numbers) + 1))
    assert largest_step([*before[-1:], *after], prepared_blob.mesh.diagonal) <= 1.2 * steady
    # once eased over, it is what the offline pipeline makes of the new puppet with the same calibration
    rest = player.remembered()[kung_fu[0].user][0].rest
    motion = CharacterMotion(replace(prepared_blob, puppet=puppet), rest)
    eased = 0
    for event, frame in zip(kung_fu[150:], after, strict=True):
        if event.time < edited_at + PREPARATION_SECONDS:
            continue
        aim = motion.performer.step(event)
        if event.time > edited_at + PREPARATION_SECONDS + 2 * TICK_SECONDS + EASE:
            assert_array_equal(frame.handles, aim.targets + aim.root)
            assert_array_equal(frame.pose.root, aim.root)
            eased += 1
    assert eased > 30


def test_performers_who_arrive_after_an_edit_are_calibrated_for_it(make_stage, kung_fu, prepared_blob):
    edited, new = (
        make_stage(),
        make_stage(prepared=type(prepared_blob)(**vars(prepared_blob) | {"puppet": crossed(prepared_blob.puppet)})),
    )
    edited.players[0].remap(crossed(prepared_blob.puppet), 0.0)
    assert edited.players[0].settled
    assert apart(play(edited, kung_fu), play(new, kung_fu), "pose.R").max() == 0


def test_the_idle_motion_follows_the_last_mapping_without_a_jump(make_stage, take, prepared_blob):
    stage, unedited = make_stage(idle=take), make_stage(idle=take)
    [player] = stage.players
    before = play(stage, ticks(0.0, 1.0))
    player.remap(crossed(prepared_blob.puppet), 1.0)
    assert not player.settled
    still = play(stage, ticks(1.0, 0.5))
    play(unedited, ticks(0.0, 1.0))
    assert apart(still, play(unedited, ticks(1.0, 0.5)), "pose.targets").max() == 0  # until it has been worked out
    superseded = player.make_idle()
    player.remap(crossed(crossed(prepared_blob.puppet)), 1.5)
    player.take_idle(superseded, 1.5)
    assert not player.settled
    computed, again = player.make_idle(), player.make_idle()  # by the jobs of two edits in a row
    player.take_idle(computed, 1.5)
    assert player.settled
    assert player.make_idle() is computed
    after = play(stage, ticks(1.5, 1.0))
    player.take_idle(again, 2.5)  # eased once
    assert player.motion.idle is computed
    after += play(stage, ticks(2.5, 2.0))
    steady = largest_step([*before, *still], prepared_blob.mesh.diagonal)
    assert largest_step([*before, *still, *after], prepared_blob.mesh.diagonal) <= 1.5 * steady
    assert apart(after[30:60], before, "pose.targets").max() > 0.1


# From here on it is the whole service.


@pytest.fixture
def dog(blob_puppet):
    """Return a puppet file for one test."""
    path = blob_puppet.with_name("dog.toml")
    path.write_text("# my dog\n" + blob_puppet.read_text())
    return path


@pytest.fixture
def service(play, dog, sender, kung_fu):
    """Play a service with the dog, and a performer who drives it for half a minute."""
    made = play("--puppet", dog, "--source", sender.uri, "--calibrate", "at_once")
    made.perform(sender, 10 * kung_fu[60:150])
    made.run(1.0)
    return made


def row(puppet, name):
    [found] = [handle for handle in puppet["handles"] if handle["name"] == name]
    return found


def test_a_mapping_is_edited_saved_and_loaded_again(service, dog, play):
    text = dog.read_text()
    puppet = service.ask("puppet", character="dog")
    assert puppet["saved"]
    assert puppet["root"] == {"joint": "hip_center", "axes": "xz", "turns": True, "feet": "lock", "walk": "in place"}
    assert (puppet["scale"], len(puppet["joints"])) == (1.3, 20)
    head = {"name": "head", "position": [0.0, 2.1, 0.3], "joints": ["head"], "axes": "xz", "gain": 0.8}
    assert row(puppet, "head") == head
    hand = [handle["name"] for handle in puppet["handles"]].index("left hand")
    edited = service.ask("set_handle", character="dog", handle="left hand", gain=2, axes="xy")
    assert (row(edited, "left hand")["gain"], edited["saved"]) == (2.0, False)
    service.run(PREPARATION_SECONDS + EASE + 0.5)
    assert np.ptp([frame.pose.targets[hand] for frame in service.run(3.0)], axis=0)[2] < 1e-6
    assert dog.read_text() == text
    assert service.ask("save_puppet", character="dog") == edited | {"saved": True}
    assert dog.read_text() == text.replace('joint = "hand_left"\n', 'joint = "hand_left"\naxes = "xy"\ngain = 2.0\n')
    assert len({frame.character.revision for frame in service.frames}) == 1
    assert play("--puppet", dog, "--source", "osc:0").ask("puppet", character="dog") == edited | {"saved": True}


def test_reverting_and_reloading_restore_the_mapping_of_the_file_and_invalid_edits_change_nothing(service):
    was = service.ask("puppet", character="dog")
    for do, arguments, wrong in (
        ("puppet", {"character": "cat"}, "character"),
        ("set_handle", {"handle": "wing", "gain": 1}, "handle"),
        ("set_handle", {"handle": "head", "joints": "head hand_lefft"}, "joints"),
    ):
        assert service.ask(do, **{"character": "dog"} | arguments)["where"] == f"the request, {wrong}"
    assert service.ask("puppet", character="dog") == was
    service.ask("set_handle", character="dog", handle="head", joints=None)
    service.ask("set_root", character="dog", joint=None)
    service.ask("set_scale", character="dog", scale="auto")
    edited = service.ask("set_handle", character="dog", handle="left foot", joints="  foot_left\tknee_left ", axes="y")
    assert (row(edited, "head")["joints"], edited["root"], edited["scale"]) == ([], None, "auto")
    assert row(edited, "left foot")["joints"] == ["foot_left", "knee_left"]
    [scene] = service.heard(service.client("dog/scene"))
    joints = [[handle["joints"] for handle in told["handles"]] for told in (scene.body.facts, edited)]
    assert joints[0] == joints[1]
    assert scene.header.revision == service.ask("describe")["characters"][0]["revision"]
    assert service.ask("revert_puppet", character="dog") == was
    assert service.ask("set_root", character="dog", joint="spine", turns=False)["root"]["joint"] == "spine"
    service.ask("reload")
    assert service.ask("puppet", character="dog") == was


def test_a_puppet_is_replaced_while_the_performer_continues_and_saved_and_reverted(service, dog, limbed_puppet):
    was = service.ask("puppet", character="dog")
    revision = service.ask("describe")["characters"][0]["revision"]
    mapped = json.loads(json.dumps(was["puppet"]))
    mapped["handle"][0] |= {"joint": None, "joints": ["head", "spine"], "gain": -1.0}
    mapped["root"], mapped["retarget"]["scale"] = None, "auto"
    godot = mapped | {"solver": {name: value and float(value) for name, value in mapped["solver"].items()}}
    reply = service.ask("set_puppet", character="dog", puppet=json.dumps(godot))  # Godot writes 8 as 8.0
    assert (reply["puppet"], reply["saved"], reply["handles"][0]["joints"]) == (mapped, False, ["head", "spine"])
    assert service.ask("describe")["characters"][0]["revision"] == revision

    limbed = values_of(puppet_file.load(limbed_puppet)) | {"root": was["puppet"]["root"]}
    limbed["retarget"]["mirror"] = True
    reply = service.ask("set_puppet", character="dog", puppet=json.dumps(limbed))
    assert reply["puppet"] == limbed
    handles = json.dumps({"handle": [limbed["handle"][0] | {"gain": 3.0}]})
    assert service.ask("set_puppet", character="dog", puppet=handles)["puppet"]["limb"] == limbed["limb"]
    assert service.ask("set_puppet", character="dog", puppet=json.dumps(limbed))["puppet"] == limbed
    assert service.ask("describe")["characters"][0]["mirror"] is True
    service.run(PREPARATION_SECONDS + EASE + 0.5)
    frame = service.run(0.1)[-1]
    assert (frame.state, frame.character.revision != revision) == ("performing", True)
    assert frame.user is not None
    service.ask("save_puppet", character="dog")
    assert values_of(puppet_file.load(dog)) == limbed
    service.ask("set_puppet", character="dog", puppet=json.dumps(was["puppet"]))
    assert service.ask("revert_puppet", character="dog")["puppet"] == limbed
    for wrong, where in (
        ("[]", "the request, puppet"),
        (json.dumps(limbed | {"limb": 1}), "the puppet, limb"),
        (json.dumps(limbed | {"handle": [limbed["handle"][0] | {"position": [9, 9, 9]}]}), "dog.toml, [[handle]] 1"),
    ):
        assert where in service.ask("set_puppet", character="dog", puppet=wrong)["where"]
    assert service.ask("puppet", character="dog")["puppet"] == limbed


def test_a_take_has_one_mapping(service):
    edited = service.ask("set_handle", character="dog", handle="left hand", joints="head", gain=-1.5)
    assert "still being applied" in service.ask("record_start", name="take")["found"]
    service.run(PREPARATION_SECONDS + EASE + 0.1)
    assert service.ask("record_start", name="take")["take"] == "take"
    for do, more in (
        ("set_handle", {"handle": "head", "gain": 1}),
        ("set_root", {"joint": None}),
        ("set_scale", {"scale": 2}),
        ("set_puppet", {"puppet": "{}"}),
        ("revert_puppet", {}),
    ):
        assert service.ask(do, character="dog", **more)["found"] == "a take that is being recorded ('take')"
    assert service.ask("save_puppet", character="dog") == edited | {"saved": True}
    service.ask("record_stop")
    assert row(service.ask("set_handle", character="dog", handle="head", gain=1), "head")["gain"] == 1


def test_the_idle_motion_is_computed_again_while_the_stream_continues(play, dog, take):
    service = play("--puppet", dog, "--source", "osc:0", "--idle", take)
    foot = [handle.name for handle in service.player("dog").character.prepared.puppet.handle].index("left foot")
    service.ask("set_handle", character="dog", handle="left foot", joints="hand_left", gain=3)
    moved = [frame.pose.targets[foot] for frame in service.run(4.0)]
    assert_allclose(moved[0], [0.55, -1.65, 0.1], atol=0.05)
    assert np.linalg.norm(moved - moved[0], axis=1).max() > 0.3
