import json
from contextlib import nullcontext
from itertools import islice

import numpy as np
import pytest
from click.testing import CliRunner
from puppetline.examples.characters import CHARACTERS
from puppetline.examples.performances import PERFORMANCES

from engine_bridge.cli import benchmark
from engine_bridge.cli.benchmark import CHARACTER, FIGURES, RATIOS
from engine_bridge.cli.main import main
from engine_bridge.performance.rig import load_rig
from puppetline.errors import PuppetError, PuppetlineError


@pytest.fixture(scope="module")
def measured(blob_file):
    """JSON output of the command for a small mesh and few frames."""
    with pytest.MonkeyPatch.context() as patch:
        for name, number in {"TIMED_FRAMES": 200, "CONVERTED_FRAMES": 90}.items():
            patch.setattr(benchmark, name, number)
        result = CliRunner().invoke(main, ["bench", "--mesh", str(blob_file), "--json"], catch_exceptions=False)
    return json.loads(result.stdout)


def test_the_performance_goes_from_one_example_to_the_next_at_30_frames_a_second():
    first, second = (make() for make in islice(PERFORMANCES.values(), 2))
    count = len(first.times)
    frames = list(islice(benchmark.performance(), count + 5))
    np.testing.assert_allclose([frame.time for frame in frames], np.arange(count + 5) / 30)
    np.testing.assert_array_equal([frame.positions for frame in frames[:count]], first.positions)
    np.testing.assert_array_equal([frame.positions for frame in frames[count:]], second.positions[:5])


@pytest.mark.parametrize(
    ("value", "written"),
    [(None, "–"), (0.01234, "0.0123"), (1.0, "1.00"), (12.34, "12.3"), (99.96, "100"), (1234.5, "1,234")],
)
def test_a_number_has_three_digits_that_count(value, written):
    assert benchmark.number(value) == written


def test_an_error_of_the_process_is_raised_unchanged(tmp_path, monkeypatch):
    monkeypatch.setattr(benchmark, "prepare", lambda *_: {})
    monkeypatch.setattr(benchmark.tempfile, "TemporaryDirectory", lambda: nullcontext(str(tmp_path)))
    with pytest.raises(PuppetError) as direct:
        load_rig(tmp_path / CHARACTER)
    with pytest.raises(PuppetlineError) as raised:
        benchmark.bench()
    assert str(raised.value) == str(direct.value)


@pytest.mark.slow
def test_figures_fit_together(measured, blob):
    figures, ratios, character = measured["figures"], measured["ratios"], measured["character"]
    assert (character["vertices"], character["triangles"]) == (len(blob.vertices), len(blob.faces))
    assert (set(figures), set(ratios)) == (set(FIGURES), set(RATIOS))
    assert all(value > 0 for value in figures.values())
    assert figures["p99_ms"] >= figures["frame_ms"] >= figures["solve_ms"]
    assert figures["convert_fps"] * figures["convert_s"] == pytest.approx(90)
    for name, (of, _) in RATIOS.items():
        assert ratios[name] * figures[of] == pytest.approx(figures["arap_iteration_ms"])


@pytest.mark.slow
def test_the_text_is_of_the_same_report_and_names_every_figure(measured, blob_file):
    heading, _, _, *lines = benchmark.describe(measured).splitlines()
    assert heading.startswith(f"{blob_file.name}: ")
    assert [line.split()[0] for line in lines] == [*FIGURES, *RATIOS]


@pytest.mark.slow
def test_the_default_character_has_the_vertices_of_the_armadillo(tmp_path, example_character, monkeypatch):
    made = example_character(benchmark.EXAMPLE_CHARACTER)
    monkeypatch.setitem(CHARACTERS, benchmark.EXAMPLE_CHARACTER, lambda: made)
    monkeypatch.setattr(benchmark, "propose", lambda *_: None)
    assert benchmark.prepare(tmp_path, None, 30) == {"name": "biped.glb", "vertices": 43_243, "triangles": 86_482}
