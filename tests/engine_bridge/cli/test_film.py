"""`puppetline film` and `puppetline demo --film`: what they print and refuse."""

import json
import sys

import pytest

SCENE = '[film]\nsize = [32, 32]\nseconds = 0.2\n[[character]]\nname = "a"\npuppet = "PUPPET"\n'


@pytest.fixture
def scene(tmp_path, blob_puppet):
    (tmp_path / "scene.toml").write_text(SCENE.replace("PUPPET", str(blob_puppet)))
    return "scene.toml"


@pytest.mark.slow
def test_the_result_is_printed_as_lines_or_as_json(run, scene, opengl, tmp_path):
    text = run("film", scene, "-o", "film.mp4").stdout
    assert text.startswith("film.mp4: 6 frames, 0.2 s")
    assert "32 × 32 at 30 per second" in text
    values = json.loads(run("film", scene, "-o", "film.gif", "--draft", "--json").stdout)
    assert (values["frames"], values["fps"], values["width"]) == (3, 15, 16)
    assert (tmp_path / "film.gif").stat().st_size == values["bytes"]


def test_a_mistake_in_the_scene_is_one_line(run, tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE + "colour = 1\n")
    result = run("film", "scene.toml", "-o", "film.mp4", code=1)
    assert result.stderr.startswith(
        "puppetline: scene.toml, [[character]] 1 'a', colour: found the unknown key 'colour'"
    )
    assert len(result.stderr.splitlines()) == 1


def test_options_of_videos_are_refused_for_a_glb(run, scene):
    assert (
        "--draft, --start and --stop are for videos" in run("film", scene, "-o", "film.glb", "--draft", code=2).stderr
    )


def test_a_glb_needs_no_graphics_library(run, scene, monkeypatch):
    assert run("film", scene, "-o", "film.glb").stdout.startswith("film.glb: 6 frames")


@pytest.mark.parametrize("module", ["av", "moderngl"])
def test_without_the_extra_the_message_says_what_to_install(tmp_path, blob_puppet, monkeypatch, module):
    from engine_bridge.film.film import make_video
    from puppetline.errors import OutputError

    (tmp_path / "scene.toml").write_text(SCENE.replace("PUPPET", str(blob_puppet)))
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(OutputError, match=r"film: found no .*pip install 'puppetline\[film\]'"):
        make_video(tmp_path / "scene.toml", tmp_path / "film.mp4", 0, None, False, lambda *_: None)


def test_the_example_film_goes_with_no_character(run):
    assert "--film goes with no CHARACTER" in run("demo", "dog", "--film", code=2).stderr
