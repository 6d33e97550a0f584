import json
from contextlib import nullcontext

import pytest
from click.testing import CliRunner

from engine_bridge.cli.main import main
from engine_bridge.inspection import benchmark
from engine_bridge.inspection.benchmark import CHARACTER, FIGURES, RATIOS
from engine_bridge.performance.prepared_character import load_prepared
from puppetline.errors import PuppetError, PuppetlineError


@pytest.fixture(scope="module")
def measured(blob_file):
    """JSON output of the command for a small mesh and few frames."""
    with pytest.MonkeyPatch.context() as patch:
        for name, number in {"TIMED_FRAMES": 60, "CONVERTED_FRAMES": 55}.items():
            patch.setattr(benchmark, name, number)
        result = CliRunner().invoke(main, ["bench", "--mesh", str(blob_file), "--json"], catch_exceptions=False)
    return json.loads(result.stdout)


def test_an_error_of_the_process_is_raised_unchanged(tmp_path, monkeypatch):
    monkeypatch.setattr(benchmark, "prepare", lambda *_: {})
    monkeypatch.setattr(benchmark.tempfile, "TemporaryDirectory", lambda: nullcontext(str(tmp_path)))
    with pytest.raises(PuppetError) as direct:
        load_prepared(tmp_path / CHARACTER)
    with pytest.raises(PuppetlineError) as raised:
        benchmark.bench()
    assert str(raised.value) == str(direct.value)


@pytest.mark.slow
def test_figures_fit_together(measured, blob):
    figures, ratios, character = measured["figures"], measured["ratios"], measured["character"]
    assert (character["vertices"], character["triangles"]) == (len(blob.vertices), len(blob.faces))
    assert (set(figures), set(ratios)) == (set(FIGURES), set(RATIOS))
    assert all(value > 0 for value in figures.values())
    assert figures["p99_ms"] >= figures["frame_ms"] > figures["vertices_ms"]
    assert figures["convert_fps"] * figures["convert_s"] == pytest.approx(55)
    for name, (above, below, _) in RATIOS.items():
        assert ratios[name] * figures[below] == pytest.approx(figures[above])


@pytest.mark.slow
def test_the_text_is_of_the_same_report_and_names_every_figure(measured, blob_file):
    heading, _, _, *lines = benchmark.describe(measured).splitlines()
    assert heading.startswith(f"{blob_file.name}: ")
    assert [line.split()[0] for line in lines] == [*FIGURES, *RATIOS]
