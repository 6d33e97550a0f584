from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from engine_bridge.inspection.files import inspect
from engine_bridge.performance.clip import load_timeline, solve
from engine_bridge.performance.settings import Settings
from engine_bridge.service.clip_export import write_clip
from engine_bridge.service.protocol.clip_file import read_clip
from engine_bridge.service.protocol.scene import StreamedCharacter
from engine_bridge.service.states import STATES
from puppetline.errors import OutputError, PuppetlineError
from solver.motion.deformer import to_file_units

from ..refusals import refused, refused_place


@pytest.fixture(scope="module")
def written(take, blob_puppet, tmp_path_factory):
    output = tmp_path_factory.mktemp("clips") / "dance.clip"
    return write_clip(take, blob_puppet, output, "dancer", Settings()), output


def test_the_frames_are_those_of_convert_bit_for_bit_and_the_scene_is_the_one_that_a_service_sends(
    written, take, prepared_blob
):
    summary, output = written
    timeline, _ = load_timeline(take, Settings())
    solved = solve(prepared_blob, timeline, Settings())
    controls = to_file_units(solved.R[:], prepared_blob.model)
    controls[..., 3] += solved.root[:][:, None]
    _, scene, *frames = read_clip(output.read_bytes())
    assert_array_equal([frame.body for frame in frames], controls)
    headers = [frame.header for frame in frames]
    assert_array_equal(np.float32([each.root for each in headers]), solved.root[:])
    assert [each.sequence for each in headers] == list(range(len(frames)))
    assert {STATES[each.state] for each in headers} == {"performing"}
    assert_allclose([each.time for each in headers], timeline.times, rtol=0, atol=1e-12)
    character = StreamedCharacter.of("dancer", prepared_blob)
    assert scene.header.revision == summary.revision == character.revision
    assert StreamedCharacter.of("other", prepared_blob).revision != character.revision
    assert scene.header.length == len(character.scene)


def test_inspect_describes_a_clip_and_reports_a_damaged_one(written, tmp_path):
    summary, output = written
    facts = inspect(output)
    assert facts["kind"] == "clip"
    for key in ("character", "revision", "frames", "fps", "seconds", "vertices"):
        assert facts[key] == getattr(summary, key)
    assert summary.bytes == output.stat().st_size
    damaged = tmp_path / "damaged.clip"
    damaged.write_bytes(output.read_bytes()[:-5])
    assert refused_place(PuppetlineError, damaged, inspect, damaged) == ""


@pytest.mark.parametrize("name", ["two words", "service", "x" * 33])
def test_a_name_that_no_topic_can_have_is_refused(name, take, blob_puppet, tmp_path):
    assert refused(OutputError, write_clip, take, blob_puppet, tmp_path / "a.clip", name, Settings()).where == "--name"


def test_frames_have_the_weights_of_the_targets_that_a_voice_moves(talking, frames, dance, record_events, tmp_path):
    voices = np.linspace(0, 1, 30, dtype=np.float32)
    said = [replace(each, channels={"voice": float(v)}) for each, v in zip(frames(dance(30)), voices, strict=True)]
    log = record_events(tmp_path / "talk.log", said)
    write_clip(log, talking(limbs=True), tmp_path / "talk.clip", None, Settings())
    _, scene, *shown = read_clip((tmp_path / "talk.clip").read_bytes())
    assert scene.body.facts["targets"] == ["jaw"]
    assert scene.body.facts["character"] == "talking"
    assert_allclose([each.targets for each in shown], voices[:, None], atol=1e-5)
