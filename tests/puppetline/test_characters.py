from pathlib import Path

import numpy as np
import pytest

import puppetline as pl
from capture.formats.options import ReadOptions
from engine_bridge.character.character import load_character
from engine_bridge.character.evaluation import Evaluation
from engine_bridge.export.convert import convert
from engine_bridge.film import film, scene
from engine_bridge.performance.settings import Settings


@pytest.fixture
def figure(limbed_puppet):
    return pl.load(limbed_puppet)


def test_poses_are_those_of_the_file_that_convert_writes(figure, take, tmp_path):
    recording = pl.load_recording(take)
    figure.convert(recording, tmp_path / "frames.glb", form="frames")
    written = load_character(tmp_path / "frames.glb")
    motion = figure.motion(rest=recording)
    shown = [figure.vertices(motion.step(frame)) for frame in recording.frames(fps=30)]
    times = np.arange(len(shown)) / 30
    for (vertices, normals), expected in zip(
        shown, Evaluation(written.document, written.parts).positions(times), strict=True
    ):
        assert (vertices.dtype, vertices.shape) == (np.float32, figure.rest_vertices.shape)
        np.testing.assert_allclose(vertices, expected, atol=2e-5)
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5)


def test_files_are_those_of_the_commands(figure, limbed_puppet, take, tmp_path):
    summary = figure.convert(take, tmp_path / "one.glb")
    convert(take, limbed_puppet, tmp_path / "two.glb", Settings())
    assert summary.output == str(tmp_path / "one.glb")
    assert (tmp_path / "one.glb").read_bytes() == (tmp_path / "two.glb").read_bytes()
    assert figure.convert(take, tmp_path / "dance.bvh").frames == 58
    for name, form in (("dance.fbx", None), ("dance.glb", "morphs")):
        with pytest.raises(pl.PuppetlineError) as error:
            figure.convert(take, tmp_path / name, form=form)
        assert error.value.where == str(tmp_path / name)
    with pytest.raises(pl.PuppetlineError):
        pl.propose(figure.mesh, plan="biped")


def test_a_film_shows_the_character_with_the_recording(figure, take, tmp_path, monkeypatch):
    def made(path, output, *_):
        loaded = scene.load(path)
        (character,), (played,) = loaded.character, loaded.take
        again = pl.load(path.parent / character.puppet)
        return again.limbs, Path(played.file), played.user, loaded.film.fps, played.start, played.stop

    monkeypatch.setattr(film, "make_video", made)
    output = tmp_path / "film.mp4"
    assert figure.convert(take, output, fps=24, start=0.5, stop=1.5) == (figure.limbs, take, 1, 24, 0.5, 1.5)
    with pytest.raises(pl.PuppetlineError):
        figure.convert(take, output, rest_at=1.0)
    with pytest.raises(pl.PuppetlineError):
        figure.convert(pl.load_recording(take, unit=0.01), output)


def test_a_proposal_is_saved_and_loaded_and_takes_the_axes_that_it_is_given(blob_file, tmp_path):
    proposed = pl.propose(blob_file, front="-z")
    assert proposed.puppet.character.front == "-z"
    assert not any("front" in note for note in proposed.notes)
    (tmp_path / "folder").mkdir()
    proposed.save(tmp_path / "folder" / "saved.toml")
    loaded = pl.load(str(tmp_path / "folder" / "saved.toml"))
    assert loaded.mesh.samefile(blob_file)
    assert (loaded.limbs, loaded.handles) == (proposed.limbs, proposed.handles)
    assert loaded.puppet.limb == proposed.puppet.limb
    assert repr(loaded) == f"<puppetline.Character blob.glb: 6 limbs, {len(loaded.rest_vertices):,} vertices>"


def test_a_recording_keeps_what_its_reader_was_told(take):
    assert pl.load_recording(take, unit=0.01).options == ReadOptions(unit=0.01)
