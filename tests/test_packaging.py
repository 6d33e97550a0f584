"""What is installed with `pip install .`: a wheel, built here without a warning."""

import shutil
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import pytest

from .conftest import ROOT

PLACES = {
    "puppetline": "puppetline",
    "solver": "solver",
    "capture": "capture",
    "engine_bridge": "engine_bridge",
    "examples": "puppetline/examples",
}
"""The folders that are installed, and where."""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Names of the files in the wheel."""
    copy = tmp_path_factory.mktemp("project") / "copy"
    copy.mkdir()
    for file in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / file, copy)
    for folder in PLACES:
        shutil.copytree(ROOT / folder, copy / folder, ignore=shutil.ignore_patterns("__pycache__"))
    build = "from setuptools.build_meta import build_wheel; build_wheel('wheels')"
    result = subprocess.run([sys.executable, "-W", "error", "-c", build], cwd=copy, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    (file,) = (copy / "wheels").glob("*.whl")
    with ZipFile(file) as archive:
        return set(archive.namelist())


def test_the_wheel_holds_the_packages_with_their_types_and_the_example_puppets(wheel):
    def installed(folder, pattern):
        return {
            Path(PLACES[folder], file.relative_to(ROOT / folder)).as_posix() for file in (ROOT / folder).rglob(pattern)
        }

    modules = set().union(*(installed(folder, "*.py") for folder in PLACES))
    clients = installed("examples", "clients/*.py")  # programs to read and copy
    types = {f"{folder}/py.typed" for folder in PLACES if folder != "examples"}
    puppets = installed("examples", "puppets/*.toml")
    assert clients
    assert len(puppets) == 5
    assert {name for name in wheel if ".dist-info/" not in name} == modules - clients | types | puppets
