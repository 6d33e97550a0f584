import tracemalloc
from dataclasses import replace

import igl
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from capture.skeleton import JOINT_INDEX, JOINTS
from capture.timeline import Timeline
from engine_bridge.character.character import make_character
from engine_bridge.character.document_reader import load_document
from engine_bridge.export import convert as module
from engine_bridge.export.convert import convert
from engine_bridge.inspection.files import inspect
from engine_bridge.performance import frame_store
from engine_bridge.performance.clip import load_timeline
from engine_bridge.performance.prepared_character import load_prepared
from engine_bridge.performance.settings import Settings
from puppetline.errors import OutputError, PuppetError, SkeletonLogError

from ..refusals import refused, refused_place


@pytest.fixture(scope="module")
def converted(take, blob_puppet, tmp_path_factory):
    output = tmp_path_factory.mktemp("converted") / "out.glb"
    stages = []
    return *convert(take, blob_puppet, output, Settings(), lambda *stage: stages.append(stage)), output, stages


def test_the_summary_says_what_the_file_and_the_clip_are(converted):
    clip, summary, output, stages = converted
    assert (summary.output, summary.bytes) == (str(output), output.stat().st_size)
    seconds = pytest.approx(57 / 30)
    assert (summary.frames, summary.keyframes, summary.seconds) == (58, 58, seconds)
    animation = {"name": "dance", "keyframes": 58, "seconds": seconds, "morph_targets": summary.targets}
    assert inspect(output)["animations"] == [animation | {"moves_nodes": True}]
    assert 0 < summary.error <= summary.tolerance == 0.0005
    assert 0 < summary.stretch_p1 < summary.stretch_p50 < summary.stretch_p99
    assert (summary.notes, summary.following) == ((), 0)
    omitted = set(module.describe(replace(summary, keyframes=40)).splitlines())
    assert len(omitted.difference(module.describe(summary).splitlines())) == 1
    assert all(0 <= share <= 1 for _, share in stages)
    assert dict(stages) == dict.fromkeys(["Preparing the character", "Performing", "Fitting morph targets"], 1)
    assert clip.motion.fps == 30
    document = load_document(output)
    for sampler in document.gltf["animations"][0]["samplers"]:  # to the bit: errors do not add up in an hour
        assert_array_equal(document.array(sampler["input"]), np.float32(np.arange(58) / 30))


def test_frames_in_a_temporary_file_and_a_rest_pose_at_the_start_give_the_same_bytes(
    take, blob_puppet, converted, tmp_path, monkeypatch
):
    monkeypatch.setattr(frame_store, "MAX_MEMORY_BYTES", 1000)
    convert(take, blob_puppet, tmp_path / "again.glb", Settings(rest_at=0.0))
    assert (tmp_path / "again.glb").read_bytes() == converted[2].read_bytes()


@pytest.mark.slow
def test_memory_hardly_grows_with_the_length_of_a_recording(dance, blob, write_puppet, tmp_path, monkeypatch):
    monkeypatch.setattr(frame_store, "MAX_MEMORY_BYTES", 1000)
    vertices, faces = igl.upsample(blob.vertices.astype(np.float64), blob.faces.astype(np.int64), 2)
    make_character("fine", vertices, faces).document.save(tmp_path / "fine.glb")
    prepared = load_prepared(write_puppet(tmp_path / "fine.toml", "fine.glb"))

    def peak(frames):
        timeline = Timeline(30.0, dance(frames), np.ones((frames, len(JOINTS)), dtype=np.float32), ())
        tracemalloc.start()
        try:
            module.convert_timeline(prepared, timeline, tmp_path / "out.glb", "out", Settings(), ())
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    peak(100)  # imports
    positions = 12 * 400 * len(prepared.mesh.vertices)
    assert positions > 100e6
    assert peak(500) - peak(100) < 0.2 * positions


def test_a_part_moves_as_it_does_in_the_whole(take, blob_puppet, converted, tmp_path):
    whole = converted[0]
    part, summary = convert(take, blob_puppet, tmp_path / "part.glb", Settings(start=0.5, stop=1.0))
    assert (summary.frames, summary.seconds) == (16, 0.5)
    for name in ("R", "targets", "bones", "root"):
        assert_array_equal(getattr(part.motion, name)[:], getattr(whole.motion, name)[15:31])
    assert_array_equal(part.positions, whole.positions[15:31])
    refused(SkeletonLogError, convert, take, blob_puppet, tmp_path / "none.glb", Settings(start=1000.0))
    assert not (tmp_path / "none.glb").exists()


def test_a_single_frame_is_held_and_errors_name_the_recording(record, standing, tmp_path):
    held, _ = load_timeline(record(tmp_path / "one.log", standing[None]), Settings())
    assert_allclose(held.positions, np.broadcast_to(standing, held.positions.shape), atol=1e-5)
    lost = record(tmp_path / "lost.log", np.full((9, 20, 3), np.nan))
    refused_place(SkeletonLogError, lost, load_timeline, lost, Settings())


def test_an_assumption_is_noted(record, dance, blob_puppet, tmp_path):
    positions = dance(40)
    positions[:, JOINT_INDEX["head"]] = np.nan
    positions[10:30, JOINT_INDEX["foot_left"]] = np.nan
    log = record(tmp_path / "a.log", positions)
    log.write_bytes(log.read_bytes() + b'{"t": 1.4, "us')
    clip, summary = convert(log, blob_puppet, tmp_path / "a.glb", Settings(fps=12))
    for part, note in zip(("Line 42", "2.5 %", "head"), summary.notes, strict=True):
        assert part in note
    assert_allclose(np.diff(clip.motion.times), 1 / 12)


def test_an_error_writes_nothing_and_keeps_the_old_result(take, blob_puppet, write_puppet, tmp_path):
    (tmp_path / "a.log").write_text("1 2 3\n")
    output, missing = tmp_path / "out.glb", write_puppet(tmp_path / "a.toml", "sub/none.glb")
    output.write_text("old")
    before = sorted(tmp_path.iterdir())
    refused(SkeletonLogError, convert, tmp_path / "a.log", blob_puppet, output, Settings())
    refused(OutputError, convert, take, blob_puppet, tmp_path, Settings())
    assert refused(PuppetError, convert, take, missing, output, Settings()).where == f"{missing}, [character], mesh"
    assert sorted(tmp_path.iterdir()) == before
    assert output.read_text() == "old"
