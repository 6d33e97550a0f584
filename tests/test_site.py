"""The documentation as a site: it builds without a warning, and its pages are accessible."""

import importlib.util
import subprocess
import sys

import pytest

from .conftest import ROOT, missing

pytestmark = pytest.mark.slow

AXE = ROOT / "engine_bridge" / "studio" / "page" / "node_modules" / "axe-core" / "axe.min.js"

SERIOUS = """async ([where, checked]) => {
  const options = { preload: false, resultTypes: ["violations"], ...checked };
  const { violations } = await axe.run(Array.isArray(where) ? { exclude: where } : { include: window[where] }, options);
  return violations
    .filter(({ impact }) => ["serious", "critical"].includes(impact))
    .map(({ id, nodes }) => `${id}: ${nodes[0].html}`);
}"""
"""JavaScript: what axe finds, by the first place of each fault."""

NEW_KINDS = """(known) => {
  const found = new Map(known.map((kind) => [kind, null]));
  for (const element of document.body.querySelectorAll("*")) {
    if (![...element.childNodes].some((node) => node.nodeType === Node.TEXT_NODE && node.data.trim())) continue;
    let kind = "";
    for (let each = element; each !== document.body; each = each.parentElement)
      kind += ` ${each.localName}.${each.getAttribute("class")}`;
    if (!found.has(kind)) found.set(kind, element);
  }
  window.ofNewKinds = [...found.values()].filter(Boolean);
  return [...found.keys()];
}"""
"""JavaScript: the kinds of text on all pages so far: the names and classes of an element and of all around it."""

BROKEN = "[...document.images].filter((each) => !each.complete || !each.naturalWidth).map(({ src }) => src)"
"""JavaScript: the images that do not load."""

STRUCTURE = {
    "runOnly": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "best-practice"],
    "rules": {"color-contrast": {"enabled": False}},
}
COLOURS = {"runOnly": ["color-contrast"]}
"""What axe checks: of every page, and of the first text of each kind, since the theme gives its colours to kinds."""

SHARED = [[".sidebar-drawer"], [".mobile-header"], ["footer"]]
"""What is the same on all pages, and is checked on the first."""


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


@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (390, "dark")])
def test_pages_fit_the_window_and_axe_finds_nothing_serious(site, browser, width, scheme):
    context = browser.new_context(viewport={"width": width, "height": 844}, color_scheme=scheme)
    context.add_init_script(path=AXE)
    page = context.new_page()
    found, kinds = {}, []
    files = [file for file in site.rglob("*.html") if "_static" not in file.parts]
    for file in files:
        page.goto(file.as_uri())
        problems = page.evaluate(BROKEN)
        if page.evaluate("document.documentElement.scrollWidth > innerWidth"):
            problems.append("wider than the window")
        if scheme == "light":
            problems += page.evaluate(SERIOUS, [SHARED if kinds else [], STRUCTURE])
        kinds = page.evaluate(NEW_KINDS, kinds)
        if page.evaluate("ofNewKinds.length"):
            problems += page.evaluate(SERIOUS, ["ofNewKinds", COLOURS])
        if problems:
            found[file.name] = problems
    context.close()
    assert len(files) > 40
    assert found == {}
