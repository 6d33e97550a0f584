"""The studio with a service: from an upload to an exported file, and what happens when the service dies."""

import asyncio
import copy
import json
import shutil

import numpy as np
import psutil
import pytest

from capture.formats import read_log
from capture.recording import HEADER
from capture.sound import SAMPLE_RATE, WavWriter
from engine_bridge.export.shader_mesh import write_shader_mesh
from engine_bridge.puppet import puppet_file
from engine_bridge.service.protocol.header import NAME

from ..conftest import connected, received

COMMENT = "# the studio keeps this comment\n"


@pytest.fixture(scope="module")
def stage(studio, blob_file, limbed_puppet):
    """A studio with the small figure, opened from its puppet file, to which an example performs."""
    assert studio.upload("blob.glb", blob_file.read_bytes())[0] == 200
    text = COMMENT + limbed_puppet.read_text()
    status, reply = studio.upload("../figure one.toml", text.encode())
    assert (status, reply["kind"], reply["facts"]["character"]) == (200, "puppet", "blob.glb")
    assert studio.result("open_puppet", upload=reply["upload"])["character"] == "figure_one"
    return studio


def performing(state):
    return all(each["state"] == "performing" for each in state["characters"])


def service_of(studio):
    """Return the process of the service."""
    found = [each for each in psutil.Process().children() if "serve" in each.cmdline()]
    return next(each for each in found if str(studio.settings.folder) in " ".join(each.cmdline()))


def puppet_of(studio, character="figure_one"):
    return studio.result("puppet", character=character)["puppet"]


def moved_wrist(puppet):
    """Return a puppet with another point in its left arm."""
    moved = copy.deepcopy(puppet)
    moved["limb"][2]["points"][2] = [1.2, 1.27, 0.1]
    return moved


def test_the_first_character_moves_without_another_step_as_the_shader_mesh(stage, tmp_path):
    state = stage.until(performing)
    (character,) = state["characters"]
    assert (character["name"], character["saved"]) == ("figure_one", True)
    assert character["limbs"] == ["trunk", "head", "left arm", "right arm", "left leg", "right leg"]
    quiet = {"running": True, "starting": False, "restarts": 0, "problem": "", "text": ""}
    assert state["service"] == state["service"] | quiet
    assert (state["source"]["kind"], state["banner"]["level"]) == ("example", "none")
    assert [each["character"] for each in state["performers"]] == ["figure_one"]
    assert str(stage.settings.folder) not in str(state)
    write_shader_mesh(stage.settings.folder / "characters" / "figure_one" / "figure_one.toml", tmp_path / "own.glb")
    assert stage.download(character["model"]) == (tmp_path / "own.glb").read_bytes()


def test_an_edited_mapping_is_played_and_saved_with_comments(stage):
    folder = stage.settings.folder / "characters" / "figure_one"
    before = (folder / "figure_one.toml").read_text()
    puppet = puppet_of(stage)
    model = stage.state["characters"][0]["model"]
    puppet["limb"][2]["gain"] = 1.25
    puppet["smoothing"]["max_deviation"] = None
    puppet["character"]["mesh"] = "/etc/passwd"
    reply = stage.result("edit", character="figure_one", puppet=puppet)
    puppet["character"]["mesh"] = "blob.glb"
    assert (reply["puppet"], reply["saved"]) == (puppet, False)
    (character,) = stage.until(performing)["characters"]
    assert (character["saved"], character["model"]) == (False, model)
    assert (folder / "figure_one.toml").read_text() == before
    saved = stage.result("save_puppet", character="figure_one")
    text = stage.download(saved["file"]).decode()
    assert (saved["name"], text[: len(COMMENT)]) == ("figure_one.toml", COMMENT)
    found = puppet_file.loads(text, "saved")
    assert (found.limb[2].gain, found.smoothing.max_deviation) == (1.25, np.inf)
    assert stage.state["characters"][0]["saved"]


def test_other_points_and_another_body_plan_are_edits_that_can_be_reverted(stage):
    before = puppet_of(stage)
    model = stage.state["characters"][0]["model"]
    assert stage.error("edit", character="figure_one", puppet={**before, "surprise": 1})["where"].endswith("surprise")
    moved = moved_wrist(before)
    assert stage.result("edit", character="figure_one", puppet=moved)["puppet"] == moved
    other = stage.until(performing)["characters"][0]["model"]
    assert other != model
    assert stage.download(other)[:4] == b"glTF"
    reply = stage.result("change_plan", character="figure_one", plan="no legs")
    assert puppet_of(stage) == moved
    edited = stage.result("edit", character="figure_one", puppet=reply["puppet"])
    assert edited["plan"] == reply["plan"] == "no legs"
    assert [limb["points"] for limb in edited["puppet"]["limb"]] == [limb["points"] for limb in moved["limb"]]
    reverted = stage.result("edit", character="figure_one", puppet=before)
    assert (reverted["puppet"], reverted["saved"]) == (before, True)


def test_a_recording_is_the_same_as_on_the_command_line(stage, commands, tmp_path):
    stage.result("source", example="walk")
    stage.until(performing)
    name = stage.result("record_start", name="walking")["take"]
    assert stage.state["recording"] == "walking"
    for refused in (
        {"do": "record_start"},
        {"do": "edit", "character": "figure_one", "puppet": puppet_of(stage)},
        {"do": "source", "example": "rear"},
        {"do": "close_character", "character": "figure_one"},
        {"do": "play_film"},
        {"do": "make_film"},
    ):
        assert stage.error(**refused)["found"] == "the take 'walking', which is being recorded"
    log = stage.settings.folder / "takes" / "walking.log"
    stage.until(lambda _: log.is_file() and log.read_bytes().count(b"\n") > 60)
    take = stage.result("record_stop")
    (recorded,) = read_log(log)
    assert take["name"] == name == "walking"
    assert (take["frames"], take["seconds"]) == (len(recorded.times), pytest.approx(np.ptp(recorded.times)))
    state = stage.until(lambda state: state["takes"][0]["picture"])
    assert state["recording"] is None
    assert [(each["character"], each["file"], each["at"]) for each in state["film"]["takes"]] == [
        ("figure_one", "takes/walking.log", 0.0)
    ]
    assert stage.download(state["takes"][0]["picture"]).startswith(b"\x89PNG")
    exported = stage.result("export", character="figure_one", take="walking")
    puppet = stage.settings.folder / "characters" / "figure_one" / "figure_one.toml"
    command = ["convert", log, "-o", tmp_path / "own.glb", "--puppet", puppet]
    text, numbers = (commands.run(*command, *more).stdout for more in ([], ["--json"]))
    assert stage.download(exported["file"]) == (tmp_path / "own.glb").read_bytes()
    assert exported["text"].splitlines()[1:] == text.splitlines()[1:]
    assert exported["numbers"] == json.loads(numbers) | {"output": exported["name"]}


def test_a_take_begins_after_an_edit_that_would_end_it(stage):
    before = puppet_of(stage)
    moved = moved_wrist(before)

    async def both():
        requests = {"do": "edit", "character": "figure_one", "puppet": moved}, {"do": "record_start", "name": "after"}
        return await asyncio.gather(*(stage.served.studio.answer({"id": 0, **each}) for each in requests))

    edited, begun = stage.run(both())
    assert (edited["puppet"], begun) == (moved, {"take": "after"})
    log = stage.settings.folder / "takes" / "after.log"
    stage.until(lambda _: log.read_bytes().count(b'"user"') > 2)
    assert stage.result("record_stop")["name"] == "after"
    stage.result("delete_take", take="after")
    stage.result("edit", character="figure_one", puppet=before)


def test_an_export_reports_progress_and_can_be_cancelled(stage):
    async def cancelled():
        async with connected(stage.address, stage.session) as socket:
            await socket.send_json({"id": 1, "do": "export", "character": "figure_one", "example": "kung_fu"})
            event = await received(socket, lambda frame: frame.get("event") == "progress")
            await socket.send_json({"id": 2, "do": "cancel", "job": event["job"]})
            return event["job"], await received(socket, lambda frame: frame.get("id") == 1)

    number, reply = stage.run(cancelled())
    assert reply["error"]["found"] == "a job that was cancelled"
    assert next(job["state"] for job in stage.state["jobs"] if job["job"] == number) == "cancelled"
    for form, beginning in (("frames", b"glTF"), ("bvh", b"HIERARCHY\nROOT hips\n")):
        exported = stage.result("export", character="figure_one", example="walk", form=form, start=0.5, stop=1.0)
        assert exported["numbers"]["frames"] == 16
        assert stage.download(exported["file"]).startswith(beginning)


def test_a_take_that_plays_is_paused_and_a_count_in_can_be_ended(stage):
    stage.result("play_film")
    assert stage.result("pause")["paused"]
    (take,) = stage.until(lambda state: state["timeline"] is not None)["timeline"]["takes"]
    assert (take["character"], take["take"], take["at"]) == ("figure_one", "walking", 0.0)
    assert stage.error("delete_take", take="walking")["found"] == "a recording that is playing now"
    assert stage.result("stop")["stopped"] == [take]
    stage.until(lambda state: state["timeline"] is None)
    stage.result("record_start", count_in=30)
    stage.until(lambda state: state["stages"][0]["count_in"] > 0)
    assert stage.result("record_stop") == {}


def test_the_film_plays_its_takes_cut_as_they_are_and_nothing_else(stage):
    (take,) = stage.state["film"]["takes"]
    cut = [{**take, "start": 0.5, "stop": 1.0}, {**take, "at": 2.0}, {**take, "at": 1.0, "mute": True}]
    assert [each["at"] for each in stage.result("edit_film", takes=cut)["takes"]] == [0.0, 1.0, 2.0]
    stage.result("play_film", at=0.25)
    timeline = stage.until(lambda state: state["timeline"] and len(state["timeline"]["takes"]) == 2)["timeline"]
    assert [(each["take"], each["at"]) for each in timeline["takes"]] == [("walking", 0.25), ("walking", 2.0)]
    stage.result("stop")
    damaged = stage.settings.folder / "takes" / "damaged.log"
    damaged.write_bytes(HEADER + b"{}}\n")
    stage.result("edit_film", takes=[take, {**take, "file": "takes/damaged.log", "at": 5.0}])
    for found in ("a line that is not JSON", "a missing file"):
        assert found in stage.error("play_film")["found"]
        stage.until(
            lambda state: state["timeline"] and [each["take"] for each in state["timeline"]["takes"]] == ["walking"]
        )
        damaged.unlink(missing_ok=True)
    stage.result("stop")
    assert stage.result("edit_film", takes=[take])["takes"] == [take]
    assert stage.result("edit_film", scene={"music": {"loop": "calm"}})["takes"] == [take]


def test_a_take_plays_from_one_second_to_another_until_another_source_is_opened(stage):
    # the status of each second meets a loop of this length at different moments
    state = stage.result("source", take="walking", start=0.3, stop=1.0, loop=True)
    assert (state["uri"], state["start"], state["stop"]) == ("replay:walking", 0.3, 1.0)
    before = stage.until(performing)["source"]
    assert stage.error("source", uri="osc:99999")["fix"]
    assert stage.state["source"] == before
    assert stage.error("delete_take", take="walking")["found"] == "a recording that is playing now"
    stage.result("source", example="walk")
    stage.result("delete_take", take="walking")
    assert (stage.state["takes"], stage.state["film"]["takes"]) == ([], [])


def test_a_killed_service_starts_again_and_the_state_says_so(stage):
    stage.until(performing)
    before, puppet = puppet_of(stage), puppet_of(stage)
    puppet["limb"][2]["gain"] = 0.75
    stage.result("edit", character="figure_one", puppet=puppet)
    restarts = stage.state["service"]["restarts"]
    service_of(stage).kill()
    ended = stage.until(lambda state: not state["service"]["running"])
    assert ended["service"]["starting"]
    assert ended["banner"]["level"] == "error" or ended["service"]["restarts"] == restarts
    state = stage.until(lambda state: state["service"]["running"] and performing(state))
    assert state["service"]["restarts"] == restarts + 1
    assert puppet_of(stage) == puppet
    assert stage.result("edit", character="figure_one", puppet=before)["saved"]


def test_two_characters_have_the_same_performer_if_a_recording_plays(stage, blob_file):
    upload = stage.upload("blob two.glb", blob_file.read_bytes())[1]["upload"]
    assert NAME.fullmatch(stage.result("open_character", upload=upload)["character"])
    state = stage.until(lambda state: len(state["characters"]) == 2 and performing(state))
    assert [each["stage"] for each in state["characters"]] == ["figure_one", "blob_two"]
    rows = stage.state["film"]["scene"]["character"]
    assert [each["name"] for each in rows] == ["figure_one", "blob_two"]
    assert rows[0]["position"] != rows[1]["position"]
    stage.result("source", uri="osc:0")
    stage.until(lambda state: state["banner"]["text"] == "No performer is in view of osc:0.")
    stage.result("source", example="walk")
    stage.result("close_character", character="blob_two")
    assert not (stage.settings.folder / "characters" / "blob_two").exists()
    assert stage.state["film"]["scene"]["character"] == rows[:1]
    assert [each["name"] for each in stage.until(performing)["characters"]] == ["figure_one"]


def test_a_new_run_continues_with_the_characters_of_the_last_and_hears_what_it_is_given(
    start_studio, limbed_puppet, tmp_path
):
    first = start_studio(tmp_path / "studio", first=limbed_puppet)
    (character,) = first.until(lambda state: state["characters"] and performing(state))["characters"]
    character, puppet = character["name"], puppet_of(first, character["name"])
    puppet["limb"][2]["gain"] = 0.5
    first.result("edit", character=character, puppet=puppet)
    first.result("source", example="rear")
    text = limbed_puppet.read_text()
    first.close()
    with WavWriter(tmp_path / "voice.wav") as writer:
        writer.write(np.zeros(30 * SAMPLE_RATE, np.float32))
    again = start_studio(tmp_path / "studio", sound=str(tmp_path / "voice.wav"))
    state = again.until(lambda state: state["characters"] and performing(state))
    assert puppet_of(again, character) == puppet
    assert (state["characters"][0]["saved"], state["source"]["name"]) == (False, "rear")
    assert limbed_puppet.read_text() == text
    again.result("record_start", name="talking")
    again.until(lambda _: (tmp_path / "studio" / "takes" / "talking.wav").is_file())
    assert again.error("microphone", on=False)["found"] == "the take 'talking', which is being recorded"
    assert again.result("record_stop")["sound"]
    again.result("microphone", on=False)
    again.result("record_start", name="silent")
    assert not again.result("record_stop")["sound"]
    (tmp_path / "voice.wav").unlink()
    assert again.error("microphone", on=True)["where"].startswith("sound")
    assert not again.until(performing)["microphone"]
    service = service_of(again)
    again.close()
    assert not service.is_running() or service.status() == psutil.STATUS_ZOMBIE


def test_what_cannot_be_served_or_opened_is_refused_before_the_start(commands, take, tmp_path):
    shutil.copy(take, tmp_path)
    for arguments, found in (
        (["--host", "0.0.0.0"], "no credentials"),
        (["nothing.glb"], "nothing.glb: found no such file"),
        (["dance.log"], "dance.log: found a recording"),
    ):
        done = commands.run("studio", *arguments, "--no-browser", "--folder", "studio", cwd=tmp_path)
        assert done.returncode == 1
        assert found in done.stderr
        assert not (tmp_path / "studio").exists()
