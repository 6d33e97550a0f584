"""What is installed with `pip install .`: a wheel and an sdist, built here without a warning."""

import json
import shutil
import subprocess
import sys
import tarfile
import tomllib
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


PAGE = "engine_bridge/studio/page/dist"
"""The built page of `puppetline studio`, which the repository does not have."""


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Return a function that builds a wheel or an sdist and returns its path."""
    copy = tmp_path_factory.mktemp("project") / "copy"
    copy.mkdir()
    for file in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / file, copy)
    for folder in PLACES:
        shutil.copytree(ROOT / folder, copy / folder, ignore=shutil.ignore_patterns("__pycache__", "node_modules"))

    def build(kind):
        call = f"from setuptools.build_meta import build_{kind}; build_{kind}('{kind}')"
        result = subprocess.run([sys.executable, "-W", "error", "-c", call], cwd=copy, capture_output=True, text=True)
        assert result.returncode == 0, result.stderr
        (file,) = (copy / kind).iterdir()
        return file

    return build


@pytest.fixture(scope="module")
def wheel(built):
    """Names of the files in the wheel."""
    with ZipFile(built("wheel")) as archive:
        return set(archive.namelist())


@pytest.fixture(scope="module")
def page():
    """Names of the files of the built page."""
    files = {path.relative_to(ROOT).as_posix() for path in (ROOT / PAGE).rglob("*") if path.is_file()}
    pictures = {f"assets/{path.name}" for path in (ROOT / PAGE).parent.glob("pictures/*.webp")}
    own = {f"assets/{name}" for name in ("studio.js", "style.css", "screen.js", "screen.css")}
    wanted = {"index.html", "screen.html", "player.js", *own, *pictures}
    assert files == {f"{PAGE}/{name}" for name in wanted}, "call make studio"
    return files


def test_the_wheel_holds_the_packages_with_their_types_tables_and_the_page(wheel, page):
    def installed(folder, pattern):
        return {
            Path(PLACES[folder], file.relative_to(ROOT / folder)).as_posix()
            for file in (ROOT / folder).rglob(pattern)
            if "node_modules" not in file.parts
        }

    modules = set().union(*(installed(folder, "*.py") for folder in PLACES))
    clients = installed("examples", "clients/*.py")  # programs to read and copy
    types = {f"{folder}/py.typed" for folder in PLACES if folder != "examples"}
    puppets = installed("examples", "puppets/*.toml")
    tables = installed("capture", "*.toml") | installed("solver", "*.toml") | installed("solver", "*.npz")
    assert clients
    assert (len(puppets), len(tables)) == (5, 6)
    assert {name for name in wheel if ".dist-info/" not in name} == modules - clients | types | puppets | tables | page


def test_the_sdist_holds_the_page(built, page):
    with tarfile.open(built("sdist")) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert page <= names


def test_the_packages_of_engines_and_web_pages_have_the_version_of_the_project():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    packages = ("integrations/unity", "integrations/web", "engine_bridge/studio/page")
    texts = [(ROOT / folder / "package.json").read_text(encoding="utf-8") for folder in packages]
    godot = (ROOT / "integrations/godot/addons/puppetline/plugin.cfg").read_text(encoding="utf-8")
    assert {json.loads(text)["version"] for text in texts} == {project}
    assert f'version="{project}"' in godot


def test_the_archives_of_engines_and_web_pages_hold_their_folders_and_nothing_else(tmp_path):
    if not (ROOT / ".git").exists() or shutil.which("make") is None:
        pytest.skip("needs make in a checkout")
    subprocess.run(["make", "-s", "archives", f"ARCHIVES={tmp_path}"], cwd=ROOT, check=True, capture_output=True)

    def committed(folder):
        command = ["git", "ls-tree", "-r", "--name-only", f"HEAD:integrations/{folder}"]
        return set(subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout.splitlines())

    def packed(pattern):
        (file,) = tmp_path.glob(pattern)
        with tarfile.open(file) as archive:
            return {name.removeprefix("package/") for name in archive.getnames()}

    with ZipFile(next(tmp_path.glob("puppetline-godot-*.zip"))) as archive:
        addon = {name for name in archive.namelist() if not name.endswith("/")}
    assert addon == {name for name in committed("godot") if name.startswith("addons/puppetline/")}
    assert {f"addons/puppetline/{name}" for name in ("plugin.cfg", "LICENSE", "README.md", "icon.png")} <= addon
    assert packed("com.puppetline.unity-*.tgz") == committed("unity")
    assert packed("puppetline-web-*.tgz") == committed("web") - {"example.html", "tsconfig.json"}
