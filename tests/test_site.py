"""The documentation as a site: it builds without a warning, and its pages are accessible."""

import importlib.util
import subprocess
import sys

import pytest

from .conftest import ROOT, missing

pytestmark = pytest.mark.slow

AXE = ROOT / "engine_bridge" / "studio" / "page" / "node_modules" / "axe-core" / "axe.min.js"

SERIOUS = """(rules) => axe.run({ preload: false, runOnly: rules }).then(({ violations }) => violations
    .filter(({ impact }) => ["serious", "critical"].includes(impact))
    .map(({ id, nodes }) => `${id}: ${nodes[0].html}`))"""
"""JavaScript: what axe finds with some rules, by the first place of each fault."""

BROKEN = "[...document.images].filter((each) => !each.complete || !each.naturalWidth).map(({ src }) => src)"
"""JavaScript: the images that do not load."""

ALL, COLOURS = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "best-practice"], ["color-contrast"]
"""Rules of axe; those of colours are what another colour scheme can break."""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The folder of the site, as `make docs` builds it."""
    if not importlib.util.find_spec("furo") or not AXE.exists():
        missing("browser", "Sphinx or axe-core is not installed (make docs lint)")
    folder = tmp_path_factory.mktemp("site")
    build = ["--quiet", "--fail-on-warning", "--keep-going", "--doctree-dir", folder / "doctrees"]
    command = [sys.executable, "-m", "sphinx", *build, ROOT / "docs", folder / "html"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    return folder / "html"


@pytest.mark.parametrize(("width", "scheme", "rules"), [(1280, "light", ALL), (390, "dark", COLOURS)])
def test_pages_fit_the_window_and_axe_finds_nothing_serious(site, browser, width, scheme, rules):
    context = browser.new_context(viewport={"width": width, "height": 844}, color_scheme=scheme)
    context.add_init_script(path=AXE)
    page = context.new_page()
    found = {}
    files = [file for file in site.rglob("*.html") if "_static" not in file.parts]
    for file in files:
        page.goto(file.as_uri())
        problems = page.evaluate(SERIOUS, rules)
        if page.evaluate("document.documentElement.scrollWidth > innerWidth"):
            problems.append("wider than the window")
        problems += page.evaluate(BROKEN)
        if problems:
            found[file.relative_to(site).as_posix()] = problems
    context.close()
    assert len(files) > 40
    assert found == {}
