import json
import tracemalloc
from dataclasses import asdict, replace

import igl
import numpy as np
import pytest

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


@pytest.fixture(scope="module")
def converted(take, blob_puppet, tmp_path_factory):
    output = tmp_path_factory.mktemp("converted") / "out.glb"
    stages = []
    return *convert(take, blob_puppet, output, Settings(), lambda *stage: stages.append(stage)), output, stages


def test_the_summary_says_what_the_file_and_the_clip_are(converted):
    clip, summary, output, _ = converted
    assert (summary.output, summary.bytes) == (str(output), output.stat().st_size)
    assert (summary.frames, summary.seconds) == (58, pytest.approx(57 / 30))
    assert summary.targets == inspect(output)["animations"][0]["morph_targets"]
    assert 0 < summary.error <= summary.tolerance == 0.0005
    assert summary.notes == ()
    assert json.loads(json.dumps(asdict(summary)))["frames"] == 58
    assert clip.timeline.fps == 30


def test_the_text_says_how_many_keyframes_are_left_only_if_some_are_omitted(converted):
    summary = converted[1]
    assert summary.keyframes == summary.frames == 58
    assert "keyframes" not in module.describe(summary)
    line = "  keyframes      40; the other frames are interpolated within the tolerance"
    assert line in module.describe(replace(summary, keyframes=40)).splitlines()


def test_the_stretch_is_that_of_all_edges_in_all_frames(converted):
    clip, summary, _, _ = converted
    mesh, model = clip.rig.mesh, clip.rig.model
    binding = Binding.of_solver_mesh(model, mesh)
    moved = np.array([binding.vertices(to_file_units(frame, model)) for frame in clip.frames])
    lengths = np.linalg.norm(moved[:, mesh.edges[:, 0]] - moved[:, mesh.edges[:, 1]], axis=-1)
    rest = np.linalg.norm(mesh.vertices[mesh.edges[:, 0]] - mesh.vertices[mesh.edges[:, 1]], axis=-1)
    expected = np.percentile(lengths / rest, [1, 50, 99])
    np.testing.assert_allclose([summary.stretch_p1, summary.stretch_p50, summary.stretch_p99], expected, atol=0.001)


def test_each_stage_tells_of_its_progress_up_to_the_end(converted):
    stages = converted[3]
    assert list(dict.fromkeys(name for name, _ in stages)) == [
        "Preparing the character",
        "Performing",
        "Fitting morph targets",
    ]
    for name in dict.fromkeys(name for name, _ in stages):
        shares = [share for other, share in stages if other == name]
        assert shares[-1] == 1
        assert all(0 <= share <= 1 for share in shares)


def test_frames_in_a_temporary_file_give_the_same_bytes_as_in_memory(
    take, blob_puppet, converted, tmp_path, monkeypatch
):
    monkeypatch.setattr(frame_store, "MAX_MEMORY_BYTES", 1000)
    convert(take, blob_puppet, tmp_path / "again.glb", Settings())
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


def test_frames_are_made_at_the_rate_that_is_asked_for(take, blob_puppet, tmp_path):
    clip, summary = convert(take, blob_puppet, tmp_path / "a.glb", Settings(fps=12))
    assert summary.frames == 23
    np.testing.assert_allclose(np.diff(clip.timeline.times), 1 / 12)


def test_the_rest_pose_is_the_one_at_the_second_that_is_asked_for(record, dance, standing, blob_puppet, tmp_path):
    """A pose with a lifted hand is followed by one second in the character's pose."""
    lifted = standing.copy()
    lifted[JOINT_INDEX["hand_left"]] += [0.2, 0.5, 0]
    log = record(tmp_path / "a.log", np.concatenate([np.tile(lifted, (30, 1, 1)), np.tile(standing, (30, 1, 1))]))
    for rest_at, still in ((0.0, slice(0, 20)), (1.0, slice(55, 60))):
        clip, _ = convert(log, blob_puppet, tmp_path / "a.glb", Settings(rest_at=rest_at))
        moved = np.linalg.norm(clip.frames[:] - clip.rig.model.rest_controls, axis=(1, 2))
        assert moved[still].max() < 0.05 * moved.max()


def test_the_pose_at_the_start_is_the_rest_pose_of_a_recording_without_calibrations(
    take, blob_puppet, converted, tmp_path
):
    convert(take, blob_puppet, tmp_path / "again.glb", Settings(rest_at=0.0))
    assert (tmp_path / "again.glb").read_bytes() == converted[2].read_bytes()


def test_a_part_moves_as_it_does_in_the_whole(take, blob_puppet, converted, tmp_path):
    whole = converted[0]
    part, summary = convert(take, blob_puppet, tmp_path / "part.glb", Settings(start=0.5, stop=1.0))
    assert summary.frames == 16
    assert summary.seconds == 0.5
    assert np.array_equal(part.frames[:], whole.frames[15:31])
    assert np.array_equal(part.root, whole.root[15:31])
    assert np.array_equal(part.timeline.positions, whole.timeline.positions[15:31], equal_nan=True)
    with pytest.raises(SkeletonLogError, match="Choose an earlier start or a later stop"):
        convert(take, blob_puppet, tmp_path / "none.glb", Settings(start=1000.0))
    assert not (tmp_path / "none.glb").exists()


def test_the_performer_who_was_tracked_longest_is_taken_or_the_one_asked_for(dance, blob_puppet, tmp_path):
    positions, seen = dance(20), np.ones(20, np.float32)
    with Recorder(tmp_path / "two.log") as recorder:
        for index, place in enumerate(positions):
            recorder.write(SkeletonFrame(index / 30, 4, place, seen))
            if index < 10:
                recorder.write(SkeletonFrame(index / 30, 7, place + 1, seen))
    longest, notes = load_timeline(tmp_path / "two.log", Settings())
    assert len(longest.positions) == 20
    assert notes == ("User 4 (20 tracked frames) was chosen; other performers: 7 (10 tracked frames).",)
    other, _ = load_timeline(tmp_path / "two.log", Settings(user=7))
    np.testing.assert_allclose(other.positions, positions[:10] + 1, atol=1e-5)
    with pytest.raises(SkeletonLogError) as error:
        load_timeline(tmp_path / "two.log", Settings(user=5))
    assert error.value.where.startswith(str(tmp_path / "two.log"))
    assert error.value.found == "no user 5"


def test_an_assumption_is_noted(record, dance, blob_puppet, tmp_path):
    positions = dance(40)
    positions[:, JOINT_INDEX["head"]] = np.nan
    positions[10:30, JOINT_INDEX["foot_left"]] = np.nan
    log = record(tmp_path / "a.log", positions)
    log.write_bytes(log.read_bytes() + b'{"t": 1.4, "us')
    _, summary = convert(log, blob_puppet, tmp_path / "a.glb", Settings())
    assert summary.notes == (
        "Line 42 is incomplete and was skipped.",
        "40 frames at 30 per second, 2.5 % of the joint positions held while lost",
        "The recording has no data for head; parts that only these joints move stay still.",
    )


def test_a_log_of_one_frame_or_of_none_tracked_is_refused(record, dance, standing, tmp_path):
    with pytest.raises(SkeletonLogError) as error:
        load_timeline(record(tmp_path / "one.log", standing[None]), Settings())
    assert (error.value.where, error.value.found) == (
        str(tmp_path / "one.log"),
        "a recording with a single frame at 30 frames per second",
    )
    with pytest.raises(SkeletonLogError) as error:
        load_timeline(record(tmp_path / "lost.log", np.full((9, 20, 3), np.nan)), Settings())
    assert str(tmp_path / "lost.log") in error.value.where


def test_a_puppets_mesh_that_is_missing_is_named_with_the_puppets_key(blob_file, write_puppet, tmp_path):
    path = write_puppet(tmp_path / "a.toml", "sub/none.glb")
    with pytest.raises(PuppetError) as error:
        load_rig(path)
    refused = error.value
    assert (refused.where, refused.found) == (
        f"{path}, [character], mesh",
        f"'sub/none.glb', which leads to the missing file {tmp_path / 'sub' / 'none.glb'}",
    )
    assert refused.fix == "Correct the path, or copy the mesh there."


@pytest.mark.parametrize("fault", ["log", "puppet", "mesh", "handle", "output"])
def test_an_error_writes_nothing_and_keeps_the_old_result(take, blob_file, write_puppet, tmp_path, fault):
    (tmp_path / "blob.glb").write_bytes(blob_file.read_bytes() if fault != "mesh" else b"glTF")
    puppet = write_puppet(
        tmp_path / "a.toml", "blob.glb", more="" if fault != "handle" else '[[handle]]\nname="x"\nposition=[99,0,0]\n'
    )
    if fault == "puppet":
        puppet.write_text("[")
    log = tmp_path / "a.log"
    log.write_bytes(take.read_bytes() if fault != "log" else b"1 2 3\n")
    output = tmp_path / "out.glb" if fault != "output" else tmp_path
    (tmp_path / "out.glb").write_text("old")
    before = sorted(path.name for path in tmp_path.iterdir())
    kind = {"log": SkeletonLogError, "mesh": MeshError, "output": OutputError}.get(fault, PuppetError)
    with pytest.raises(kind):
        convert(log, puppet, output, Settings())
    assert sorted(path.name for path in tmp_path.iterdir()) == before
    assert (tmp_path / "out.glb").read_text() == "old"


def test_a_place_that_cannot_be_written_is_found_out_before_any_work(take, blob_puppet, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "load_timeline", lambda *_: pytest.fail("the log was read first"))
    with pytest.raises(OutputError):
        convert(take, blob_puppet, tmp_path / "no" / "out.glb", Settings())
