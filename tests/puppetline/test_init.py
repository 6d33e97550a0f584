"""What `import puppetline` offers, and what it loads."""

import doctest
import json
import shutil
import subprocess
import sys

import pytest

import puppetline
from engine_bridge.character import examples
from engine_bridge.export.performer.convert import convert_performers
from engine_bridge.performance.settings import Settings

from ..conftest import ROOT
from ..test_documentation import blocks


def test_names_are_imported_when_they_are_used():
    program = "import puppetline, sys; print(*({'numba', 'numpy', 'capture', 'engine_bridge'} & {*sys.modules}))"
    assert subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True).stdout == "\n"
    assert {*dir(puppetline)} >= {*puppetline.__all__}
    assert all(getattr(puppetline, name).__doc__ for name in puppetline.__all__)
    with pytest.raises(AttributeError):
        puppetline.nothing  # noqa: B018


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Go to a folder with the files of the examples."""
    folder = tmp_path_factory.mktemp("files")
    log, _ = examples.prepare("dog", folder / "out")
    examples.prepare("human", folder / "out")
    shutil.copy(folder / "out" / "dog.glb", folder)
    convert_performers(log, folder / "walk.bvh", Settings())
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        yield folder


def test_examples_of_docstrings_and_of_the_page_run(files, given_clock):
    found = doctest.DocTestFinder().find(puppetline)
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    assert [runner.run(each).failed for each in found if each.examples] == [0]
    assert (files / "dog_walk.glb").stat().st_size > 10_000
    known = {}
    for block in blocks(ROOT / "docs" / "python.md", "python"):
        if "connect" not in block:  # to a service: see test_client
            exec(compile(block, "docs/python.md", "exec"), known)
    assert known["xyz"].shape == known["normals"].shape == known["dog"].rest_vertices.shape


def test_the_notebook_runs_and_its_cells_show_what_they_say(files):
    notebook = json.loads((ROOT / "examples" / "notebook.ipynb").read_text(encoding="utf-8"))
    known, shown = {}, []
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            *lines, last = cell["source"]
            exec("".join(lines), known)
            shown.append(eval(last, known))
            assert cell["outputs"] == []
    assert [type(value).__name__ for value in shown] == ["Recording", "Character", "Player", "tuple"]
