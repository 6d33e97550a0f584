"""`puppetline film`: what it prints."""

import json
import sys

import pytest


@pytest.fixture
def scene(tmp_path, blob_puppet):
    text = f'[film]\nsize = [32, 32]\nseconds = 0.2\n[[character]]\nname = "a"\npuppet = "{blob_puppet}"\n'
    (tmp_path / "scene.toml").write_text(text)
    return "scene.toml"


@pytest.mark.slow
def test_the_result_is_printed_as_lines_or_as_json(invoke, scene, tmp_path):
    text = invoke("film", scene, "-o", "film.mp4").stdout
    assert text.startswith("film.mp4: 6 frames, 0.2 s")
    assert "32 × 32 at 30 per second" in text
    values = json.loads(invoke("film", scene, "-o", "film.gif", "--draft", "--json").stdout)
    assert values["frames"] == 3
    assert values["fps"] == 15
    assert values["width"] == 16
    assert (tmp_path / "film.gif").stat().st_size == values["bytes"]


def test_a_glb_is_written_without_drawing(invoke, scene):
    assert invoke("film", scene, "-o", "film.glb").stdout.startswith("film.glb: 6 frames")


def test_without_the_extra_it_says_what_to_install(assert_refused, scene, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    assert_refused("film", scene, "-o", "film.mp4", parts=["pip install 'puppetline[film]'"])
