import json
import sys
from itertools import islice

import numpy as np
import pytest
from click.testing import CliRunner
from puppetline.examples.characters import CHARACTERS
from puppetline.examples.performances import PERFORMANCES

from engine_bridge.cli import benchmark, benchmark_process
from engine_bridge.cli.benchmark import FIGURES, RATIOS, Report
from engine_bridge.cli.benchmark_process import CHARACTER, Work, interleaved
from engine_bridge.cli.main import main
from puppetline.errors import PuppetError

UNKNOWN_ELSEWHERE = {"precompute_peak_mb", "peak_mb"}
"""Values that Windows does not report."""


@pytest.fixture(scope="module")
def measured(blob_file):
    """JSON output of the command for a small mesh and few frames."""
    with pytest.MonkeyPatch.context() as patch:
        fewer = {"TIMED_FRAMES": benchmark_process.BLOCK_FRAMES, "CONVERTED_FRAMES": 90, "PROCESSES": 1}
        for name, number in fewer.items():
            patch.setattr(benchmark, name, number)
        result = CliRunner().invoke(main, ["bench", "--mesh", str(blob_file), "--json"], catch_exceptions=False)
    return json.loads(result.stdout)


def test_works_take_turns_in_blocks_and_each_call_is_timed():
    calls = []
    works = {
        "a": Work(lambda number: calls.append(("a", number)), 2),
        "b": Work(lambda number: calls.append(("b", number)), 1),
    }
    times = interleaved(works, 3)
    assert calls == [("a", 0), ("a", 1), ("b", 0)] * 4  # the first round warms up
    assert {name: len(taken) for name, taken in times.items()} == {"a": 6, "b": 3}
    assert all((taken > 0).all() for taken in times.values())


def test_the_performance_goes_from_one_example_to_the_next_at_30_frames_a_second():
    first, second = (make() for make in islice(PERFORMANCES.values(), 2))
    count = len(first.times)
    frames = list(islice(benchmark.performance(), count + 5))
    np.testing.assert_allclose([frame.time for frame in frames], np.arange(count + 5) / 30)
    np.testing.assert_array_equal([frame.positions for frame in frames[:count]], first.positions)
    np.testing.assert_array_equal([frame.positions for frame in frames[count:]], second.positions[:5])


def test_ratios_are_quotients_of_their_figures_and_missing_with_them():
    figures = {name: float(2 + place) for place, name in enumerate(FIGURES)} | {"memcpy_ms": None}
    ratios = benchmark.ratios(figures)
    for name, (a, b, _) in RATIOS.items():
        assert ratios[name] == (None if b == "memcpy_ms" else figures[a] / figures[b])


@pytest.mark.parametrize(
    ("value", "written"),
    [(None, "–"), (0.01234, "0.0123"), (1.0, "1.00"), (12.34, "12.3"), (99.96, "100"), (1234.5, "1,234")],
)
def test_a_number_has_three_digits_that_count(value, written):
    assert benchmark.number(value) == written


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells what a process has at this moment")
def test_memory_is_what_is_held_now_and_the_peak_what_was_held_once():
    before = benchmark_process.resident_mb()
    held = np.ones(8_000_000)
    with_it = benchmark_process.resident_mb()
    assert held.all()
    assert with_it - before == pytest.approx(held.nbytes / 1e6, abs=2)
    del held
    assert benchmark_process.resident_mb() - before == pytest.approx(0, abs=2)
    assert benchmark_process.peak_mb() > with_it - 2


def test_an_error_of_the_process_is_raised_unchanged(tmp_path):
    with pytest.raises(PuppetError) as direct:
        benchmark_process.load_rig(tmp_path / CHARACTER)
    with pytest.raises(benchmark.PuppetlineError) as raised:
        benchmark.in_process(tmp_path, "frames", 1)
    assert str(raised.value) == str(direct.value)


@pytest.mark.slow
def test_every_figure_is_measured(measured):
    figures = measured["figures"]
    assert set(figures) == set(FIGURES)
    unknown = {name for name, value in figures.items() if value is None}
    assert unknown <= (set() if sys.platform == "linux" else UNKNOWN_ELSEWHERE)
    assert all(value > 0 for value in figures.values() if value is not None)


@pytest.mark.slow
def test_figures_fit_together(measured, blob):
    figures, character = measured["figures"], measured["character"]
    assert (character["vertices"], character["triangles"]) == (len(blob.vertices), len(blob.faces))
    assert character["frames"] == benchmark_process.BLOCK_FRAMES
    assert figures["p99_ms"] >= figures["frame_ms"]
    assert figures["solve_p99_ms"] >= figures["solve_ms"]
    assert figures["convert_fps"] * figures["convert_s"] == pytest.approx(90)
    assert figures["arap_iteration_ms"] / figures["solve_ms"] == pytest.approx(measured["ratios"]["arap_to_solve"])


@pytest.mark.slow
def test_the_text_is_of_the_same_report_and_names_every_figure(measured, blob_file):
    report = Report(**measured)
    heading, _, _, *lines = benchmark.describe(report).splitlines()
    assert heading.startswith(f"{blob_file.name}: ")
    assert [line.split()[0] for line in lines] == [*FIGURES, *RATIOS]


@pytest.mark.slow
def test_the_default_character_has_the_vertices_of_the_armadillo(tmp_path, example_character, monkeypatch):
    made = example_character(benchmark.EXAMPLE_CHARACTER)
    monkeypatch.setitem(CHARACTERS, benchmark.EXAMPLE_CHARACTER, lambda: made)
    monkeypatch.setattr(benchmark, "_propose", lambda *_: None)
    assert benchmark.prepare(tmp_path, None, 30) == {"name": "biped.glb", "vertices": 43_243, "triangles": 86_482}
