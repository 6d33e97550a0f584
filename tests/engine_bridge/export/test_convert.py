import json
import tracemalloc
from dataclasses import asdict, replace

import igl
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from capture.recording import Recorder
from capture.skeleton import JOINT_INDEX, JOINTS, SkeletonFrame
from capture.timeline import Timeline
from engine_bridge.character.character import make_character
from engine_bridge.export import convert as module
from engine_bridge.export.convert import convert
from engine_bridge.inspection.files import inspect
from engine_bridge.performance import frame_store
from engine_bridge.performance.clip import load_timeline
from engine_bridge.performance.rig import load_rig
from engine_bridge.performance.settings import Settings
from puppetline.errors import MeshError, OutputError, PuppetError, SkeletonLogError
from solver.model.binding import Binding
from solver.motion.deformer import to_file_units

from ..refusals import refused, refused_place


@pytest.fixture(scope="module")
def converted(take, blob_puppet, tmp_path_factory):
    output = tmp_path_factory.mktemp("converted") / "out.glb"
    stages = []
    return *convert(take, blob_puppet, output, Settings(), lambda *stage: stages.append(stage)), output, stages


def test_the_summary_says_what_the_file_and_the_clip_are(converted):
    clip, summary, output, stages = converted
    assert (summary.output, summary.bytes) == (str(output), output.stat().st_size)
    assert (summary.frames, summary.keyframes, summary.seconds) == (58, 58, pytest.approx(57 / 30))
    assert summary.targets == inspect(output)["animations"][0]["morph_targets"]
    assert 0 < summary.error <= summary.tolerance == 0.0005
    assert (summary.notes, summary.following, len(clip.motions)) == ((), 0, 0)
    assert json.loads(json.dumps(asdict(summary)))["frames"] == 58
    assert clip.timeline.fps == 30
    omitted = set(module.describe(replace(summary, keyframes=40)).splitlines())
    assert len(omitted.difference(module.describe(summary).splitlines())) == 1
    assert all(0 <= share <= 1 for _, share in stages)
    assert dict(stages) == dict.fromkeys(["Preparing the character", "Performing", "Fitting morph targets"], 1)


def test_the_stretch_is_that_of_all_edges_in_all_frames(converted):
    clip, summary, _, _ = converted
    mesh, model = clip.rig.mesh, clip.rig.model
    binding = Binding.of_solver_mesh(model, mesh)
    moved = np.array([binding.vertices(to_file_units(frame, model)) for frame in clip.frames])
    lengths = np.linalg.norm(moved[:, mesh.edges[:, 0]] - moved[:, mesh.edges[:, 1]], axis=-1)
    rest = np.linalg.norm(mesh.vertices[mesh.edges[:, 0]] - mesh.vertices[mesh.edges[:, 1]], axis=-1)
    expected = np.percentile(lengths / rest, [1, 50, 99])
    assert_allclose([summary.stretch_p1, summary.stretch_p50, summary.stretch_p99], expected, atol=0.001)


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
    rig = load_rig(write_puppet(tmp_path / "fine.toml", "fine.glb"))

    def peak(frames):
        timeline = Timeline(30.0, dance(frames), np.ones((frames, len(JOINTS)), dtype=np.float32), ())
        tracemalloc.start()
        try:
            module.convert_timeline(rig, timeline, tmp_path / "out.glb", "out", Settings(), ())
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    peak(100)  # imports
    positions = 12 * 400 * len(rig.mesh.vertices)
    assert positions > 100e6
    assert peak(500) - peak(100) < 0.2 * positions


def test_a_part_moves_as_it_does_in_the_whole(take, blob_puppet, converted, tmp_path):
    whole = converted[0]
    part, summary = convert(take, blob_puppet, tmp_path / "part.glb", Settings(start=0.5, stop=1.0))
    assert (summary.frames, summary.seconds) == (16, 0.5)
    assert_array_equal(part.frames[:], whole.frames[15:31])
    assert_array_equal(part.root, whole.root[15:31])
    assert_array_equal(part.timeline.positions, whole.timeline.positions[15:31])
    refused(SkeletonLogError, convert, take, blob_puppet, tmp_path / "none.glb", Settings(start=1000.0))
    assert not (tmp_path / "none.glb").exists()


def test_the_performer_who_was_tracked_longest_is_taken_or_the_one_asked_for(dance, record, standing, tmp_path):
    positions, seen, path = dance(20), np.ones(20, np.float32), tmp_path / "two.log"
    with Recorder(path) as recorder:
        for index, place in enumerate(positions):
            recorder.write(SkeletonFrame(index / 30, 4, place, seen))
            if index < 10:
                recorder.write(SkeletonFrame(index / 30, 7, place + 1, seen))
    longest, notes = load_timeline(path, Settings())
    assert (len(longest.positions), len(notes)) == (20, 1)
    other, _ = load_timeline(path, Settings(user=7))
    assert_allclose(other.positions, positions[:10] + 1, atol=1e-5)
    one = record(tmp_path / "one.log", standing[None])
    lost = record(tmp_path / "lost.log", np.full((9, 20, 3), np.nan))
    for log, settings in ((path, Settings(user=5)), (one, Settings()), (lost, Settings())):
        refused_place(SkeletonLogError, log, load_timeline, log, settings)


def test_an_assumption_is_noted(record, dance, blob_puppet, tmp_path):
    positions = dance(40)
    positions[:, JOINT_INDEX["head"]] = np.nan
    positions[10:30, JOINT_INDEX["foot_left"]] = np.nan
    log = record(tmp_path / "a.log", positions)
    log.write_bytes(log.read_bytes() + b'{"t": 1.4, "us')
    clip, summary = convert(log, blob_puppet, tmp_path / "a.glb", Settings(fps=12))
    for part, note in zip(("Line 42", "2.5 %", "head"), summary.notes, strict=True):
        assert part in note
    assert_allclose(np.diff(clip.timeline.times), 1 / 12)


@pytest.mark.parametrize(
    ("fault", "family"),
    [
        ("log", SkeletonLogError),
        ("mesh", MeshError),
        ("output", OutputError),
        *((fault, PuppetError) for fault in ("puppet", "handle", "missing mesh")),
    ],
)
def test_an_error_writes_nothing_and_keeps_the_old_result(take, blob_file, write_puppet, tmp_path, fault, family):
    (tmp_path / "blob.glb").write_bytes(blob_file.read_bytes() if fault != "mesh" else b"glTF")
    off = '[[handle]]\nname="x"\nposition=[99,0,0]\n' if fault == "handle" else ""
    mesh = "sub/none.glb" if fault == "missing mesh" else "blob.glb"
    puppet = write_puppet(tmp_path / "a.toml", mesh, more=off)
    if fault == "puppet":
        puppet.write_text("[")
    log = tmp_path / "a.log"
    log.write_bytes(take.read_bytes() if fault != "log" else b"1 2 3\n")
    (tmp_path / "out.glb").write_text("old")
    before = sorted(path.name for path in tmp_path.iterdir())
    error = refused(family, convert, log, puppet, tmp_path / "out.glb" if fault != "output" else tmp_path, Settings())
    assert fault != "missing mesh" or error.where == f"{puppet}, [character], mesh"
    assert sorted(path.name for path in tmp_path.iterdir()) == before
    assert (tmp_path / "out.glb").read_text() == "old"
