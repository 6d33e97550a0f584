"""The documentation as a site: it builds without a warning, and its pages are accessible."""

import importlib.util
import re
import subprocess
import sys

import pytest

from .conftest import ROOT, missing

pytestmark = pytest.mark.slow

AXE = ROOT / "engine_bridge" / "studio" / "page" / "node_modules" / "axe-core" / "axe.min.js"

SERIOUS = """(checked) => axe.run({ preload: false, ...checked }).then(({ violations }) => violations
    .filter(({ impact }) => ["serious", "critical"].includes(impact))
    .map(({ id, nodes }) => `${id}: ${nodes[0].html}`))"""
"""JavaScript: what axe finds, by the first place of each fault."""

BROKEN = "[...document.images].filter((each) => !each.complete || !each.naturalWidth).map(({ src }) => src)"
"""JavaScript: the images that do not load."""

STRUCTURE = {
    "runOnly": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "best-practice"],
    "rules": {"color-contrast": {"enabled": False}},
}
COLOURS = {"runOnly": ["color-contrast"]}
"""What axe checks: of every page, and of those that show a kind of element, since the theme gives it its colours."""


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


@pytest.fixture(scope="module")
def pages(site):
    """The files of all pages, and those that, from small to large, show a kind of element for the first time."""
    files = sorted(
        (file for file in site.rglob("*.html") if "_static" not in file.parts), key=lambda file: file.stat().st_size
    )
    shown, first = set(), []
    for file in files:
        kinds = set(re.findall(r'<(\w+)[^>]*? class="([^"]*)"', file.read_text(encoding="utf-8")))
        if not kinds <= shown:
            first.append(file)
            shown |= kinds
    return files, first


@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (390, "dark")])
def test_pages_fit_the_window_and_axe_finds_nothing_serious(pages, browser, width, scheme):
    context = browser.new_context(viewport={"width": width, "height": 844}, color_scheme=scheme)
    context.add_init_script(path=AXE)
    page = context.new_page()
    found = {}
    files, first = pages
    for file in files:
        page.goto(file.as_uri())
        problems = page.evaluate(BROKEN)
        if page.evaluate("document.documentElement.scrollWidth > innerWidth"):
            problems.append("wider than the window")
        for checked in [STRUCTURE] * (scheme == "light") + [COLOURS] * (file in first):
            problems += page.evaluate(SERIOUS, checked)
        if problems:
            found[file.name] = problems
    context.close()
    assert len(files) > 40
    assert found == {}
