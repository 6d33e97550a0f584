"""Editing the mapping from joints to handles while a performer drives the character."""

import json
from dataclasses import replace
from functools import partial

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
    before = play(stage, kung_fu[:150])
    player.remap(puppet, edited_at)
    assert not player.settled
    after = play(stage, kung_fu[150:])
    assert player.settled
    assert {(frame.state, frame.user) for frame in after} == {("performing", kung_fu[0].user)}
    assert [frame.sequence for frame in (*before, *after)] == [*range(1, len(kung_fu) + 1)]
    assert largest_step([*before[-1:], *after]) <= 1.2 * largest_step(play(make_stage(), kung_fu))
    # once eased over, it is what the offline pipeline makes of the new puppet with the same calibration
    motion = CharacterMotion(replace(prepared_blob, puppet=puppet), player.calibration.rest)
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


def test_the_idle_motion_follows_the_last_mapping_without_a_jump(make_stage, take, prepared_blob):
    stage, unedited = make_stage(idle=take), make_stage(idle=take)
    [player], puppet = stage.players, crossed(prepared_blob.puppet)
    before = play(stage, ticks(0.0, 1.0))
    player.remap(puppet, 1.0)
    assert not player.settled
    still = play(stage, ticks(1.0, 0.5))
    shown = play(unedited, [*ticks(0.0, 1.0), *ticks(1.0, 0.5)])
    assert apart([*before, *still], shown, "pose.targets").max() == 0  # until it has been worked out
    superseded = player.make_idle()
    player.remap(crossed(puppet), 1.5)
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
    assert largest_step([*shown, *after]) <= 1.5 * largest_step(shown)
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
    """Play a service with the dog, whose mapping `edit` asks for, and a performer who drives it for half a minute."""
    made = play("--puppet", dog, "--source", sender.uri, "--calibrate", "at_once")
    made.edit = partial(made.ask, character="dog")
    made.perform(sender, 10 * kung_fu[60:150])
    made.run(1.0)
    return made


def revision(service):
    return service.player("dog").character.revision


def row(puppet, name):
    return next(handle for handle in puppet["handles"] if handle["name"] == name)


def test_a_mapping_is_edited_saved_and_loaded_again(service, dog, play):
    text, was = dog.read_text(), service.edit("puppet")
    assert was["puppet"] == values_of(puppet_file.load(dog))
    assert was["root"] == was["puppet"]["root"]
    assert was["scale"] == 1.3
    assert len(was["joints"]) == 20
    assert was["saved"] is True
    head = {"name": "head", "position": [0.0, 2.1, 0.3], "joints": ["head"], "axes": "xz", "gain": 0.8}
    assert row(was, "head") == head
    edited = service.edit("set_handle", handle="left hand", gain=2, axes="xy")
    assert row(edited, "left hand")["gain"] == 2.0
    assert edited["saved"] is False
    service.run(PREPARATION_SECONDS + EASE + 0.5)
    hand = edited["handles"].index(row(edited, "left hand"))
    assert np.ptp([frame.pose.targets[hand] for frame in service.run(3.0)], axis=0)[2] < 1e-6
    assert dog.read_text() == text
    assert service.edit("save_puppet") == edited | {"saved": True}
    assert dog.read_text() == text.replace('joint = "hand_left"\n', 'joint = "hand_left"\naxes = "xy"\ngain = 2.0\n')
    assert len({frame.character.revision for frame in service.frames}) == 1
    assert play("--puppet", dog, "--source", "osc:0").ask("puppet", character="dog") == edited | {"saved": True}


def test_reverting_and_reloading_restore_the_mapping_of_the_file_and_invalid_edits_change_nothing(service):
    was = service.edit("puppet")
    for do, arguments, wrong in (
        ("puppet", {"character": "cat"}, "character"),
        ("set_handle", {"handle": "wing", "gain": 1}, "handle"),
        ("set_handle", {"handle": "head", "joints": "head hand_lefft"}, "joints"),
    ):
        assert service.edit(do, **arguments)["where"] == f"the request, {wrong}"
    assert service.edit("puppet") == was
    service.edit("set_handle", handle="head", joints=None)
    service.edit("set_root", joint=None)
    service.edit("set_scale", scale="auto")
    edited = service.edit("set_handle", handle="left foot", joints="  foot_left\tknee_left ", axes="y")
    assert row(edited, "head")["joints"] == []
    assert edited["root"] is None
    assert edited["scale"] == "auto"
    assert row(edited, "left foot")["joints"] == ["foot_left", "knee_left"]
    [scene] = service.heard(service.client("dog/scene"))
    joints = [[handle["joints"] for handle in told["handles"]] for told in (scene.body.facts, edited)]
    assert joints[0] == joints[1]
    assert scene.header.revision == revision(service)
    assert service.edit("revert_puppet") == was
    assert service.edit("set_root", joint="spine", turns=False)["root"]["joint"] == "spine"
    service.ask("reload")
    assert service.edit("puppet") == was


def test_a_puppet_is_replaced_while_the_performer_continues_and_saved_and_reverted(service, dog, limbed_puppet):
    def replaced(puppet):
        return service.edit("set_puppet", puppet=json.dumps(puppet))

    was, before, client = service.edit("puppet")["puppet"], revision(service), service.client("dog/scene")
    service.heard(client)
    mapped = json.loads(json.dumps(was))
    mapped["handle"][0] |= {"joint": None, "joints": ["head", "spine"], "gain": -1.0}
    mapped["root"], mapped["retarget"]["scale"] = None, "auto"
    # Godot writes 8 as 8.0
    reply = replaced(mapped | {"solver": {name: value and float(value) for name, value in mapped["solver"].items()}})
    assert reply["puppet"] == mapped
    assert reply["saved"] is False
    assert reply["handles"][0]["joints"] == ["head", "spine"]
    assert revision(service) == before
    limbed = values_of(puppet_file.load(limbed_puppet)) | {"root": was["root"]}
    limbed["retarget"]["mirror"] = True
    assert replaced(limbed)["puppet"] == limbed
    assert replaced({"handle": [limbed["handle"][0] | {"gain": 3.0}]})["puppet"]["limb"] == limbed["limb"]
    assert replaced(limbed)["puppet"] == limbed
    assert service.ask("describe")["characters"][0]["mirror"] is True
    service.run(PREPARATION_SECONDS + EASE + 0.5)
    frame = service.run(0.1)[-1]
    assert frame.state == "performing"
    assert frame.character.revision != before
    assert frame.user is not None
    service.heard(client, lambda message: message.header.revision == frame.character.revision)
    service.edit("save_puppet")
    assert values_of(puppet_file.load(dog)) == limbed
    replaced(was)
    assert service.edit("revert_puppet")["puppet"] == limbed
    for wrong, where in (
        ([], "the request, puppet"),
        (limbed | {"limb": 1}, "the puppet, limb"),
        (limbed | {"handle": [limbed["handle"][0] | {"position": [9, 9, 9]}]}, "dog.toml, [[handle]] 1"),
    ):
        assert where in replaced(wrong)["where"]
    assert service.edit("puppet")["puppet"] == limbed


def test_a_take_has_one_mapping(service):
    edited = service.edit("set_handle", handle="left hand", joints="head", gain=-1.5)
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
        assert service.edit(do, **more)["found"] == "a take that is being recorded ('take')"
    assert service.edit("save_puppet") == edited | {"saved": True}
    service.ask("record_stop")
    assert row(service.edit("set_handle", handle="head", gain=1), "head")["gain"] == 1


def test_the_idle_motion_is_computed_again_while_the_stream_continues(play, dog, take):
    service = play("--puppet", dog, "--source", "osc:0", "--idle", take)
    edited = service.ask("set_handle", character="dog", handle="left foot", joints="hand_left", gain=3)
    foot = edited["handles"].index(row(edited, "left foot"))
    moved = [frame.pose.targets[foot] for frame in service.run(4.0)]
    assert_allclose(moved[0], [0.55, -1.65, 0.1], atol=0.05)
    assert np.linalg.norm(moved - moved[0], axis=1).max() > 0.3
