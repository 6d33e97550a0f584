"""What is installed has the licences that docs/licences.md says, and no copyleft but those that it explains."""

import re
import sys
import tomllib
from importlib import import_module, metadata

import pytest
from packaging.requirements import Requirement

from .conftest import ROOT

PAGE = (ROOT / "docs" / "licences.md").read_text(encoding="utf-8")

COPYLEFT = {"libigl", "zeroconf"}
"""Packages with a copyleft; the page says why each is acceptable."""

OF_DEVELOPERS = {"bench", "docs", "test", "dev"}
"""Extras that are for work on Puppetline."""

DECLARED = {
    "MIT": "MIT",
    "MIT-0": "MIT-0",
    "MIT-CMU": "MIT-CMU",
    "BSD": "BSD|Enthought|Kiwi licensing|NumPy Developers|matplotlib project",
    "Apache-2.0": "Apache",
    "PSF-2.0": "PSF|Python Software Foundation|matplotlib versions",
    "Unlicense": "free and unencumbered",
    "MPL-2.0": "MPL",
    "LGPL-2.1": "LGPL-2.1",
    "OFL-1.1": "SIL OFL",
}
"""What the metadata of packages call each licence."""


def installed(extras):
    """Return the distributions that Puppetline with some extras brings, of those that are installed."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = [*project["dependencies"], *(each for name in extras for each in project["optional-dependencies"][name])]
    found = {}
    while wanted:
        requirement = Requirement(wanted.pop())
        name = re.sub("[-_.]+", "-", requirement.name).lower()
        if (
            name in found
            or name == "puppetline"
            or (requirement.marker and not requirement.marker.evaluate({"extra": ""}))
        ):
            continue
        try:
            found[name] = metadata.distribution(name)
        except metadata.PackageNotFoundError:  # an extra that this environment does not have
            assert extras, name
            continue
        wanted += found[name].requires or []
    return found


def declared(distribution):
    """Return the texts in which a distribution says its licence."""
    said = distribution.metadata
    classifiers = [each for each in said.get_all("Classifier") or () if each.startswith("License")]
    return " ".join((said.get("License-Expression") or "", (said.get("License") or "")[:200], *classifiers))


def licence_on_page(name):
    """Return the licence that the page gives to a package."""
    row = re.search(rf"^\| (\S+) \| [^|]*(?<![\w-]){re.escape(name)}(?![\w-])", PAGE, re.MULTILINE)
    extra = re.search(rf"(?<![\w-]){re.escape(name)} \(([\w.-]+)", PAGE)
    found = extra or row
    assert found, f"{name} is not in docs/licences.md"
    return found[1]


EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"].keys()


@pytest.mark.parametrize("extras", [(), tuple(EXTRAS - OF_DEVELOPERS)], ids=["bare", "extras"])
def test_each_package_has_the_licence_of_the_page(extras):
    found = installed(extras)
    assert "numpy" in found
    for name, distribution in found.items():
        assert re.search(DECLARED[licence_on_page(name)], declared(distribution)), (name, declared(distribution))
    assert {name for name, each in found.items() if re.search("GPL|MPL|EPL|CDDL", declared(each))} == COPYLEFT


def test_each_native_library_in_a_wheel_is_on_the_page():
    names = set()
    for distribution in installed(EXTRAS - OF_DEVELOPERS).values():
        for file in distribution.files or ():
            if re.search(r"^[^/]+\.libs/", str(file)):
                names.add(re.match(r"lib(.+?)(-r0)?(-[0-9a-f]{8})+\.", file.name)[1])
    lines = PAGE.partition("## Libraries in the wheels")[2].partition("\n## ")[0].replace(" -", " xcb-")
    assert names
    assert names <= set(re.findall(r"[\w-]+", lines))


def test_the_page_of_the_studio_keeps_the_notices_of_what_it_bundles():
    bundle = (ROOT / "engine_bridge/studio/page/dist/assets/studio.js").read_text(encoding="utf-8")
    assert re.search(r"@license\s+\* Copyright [\d-]+ Three.js Authors\s+\* SPDX-License-Identifier: MIT", bundle)


def test_the_parts_of_libigl_with_other_licences_are_not_loaded():
    for path in (*(ROOT / "solver").rglob("*.py"), *(ROOT / "engine_bridge").rglob("*.py")):
        if "igl" in (text := path.read_text(encoding="utf-8")) and "node_modules" not in path.parts:
            assert not re.search(r"igl[. ]*(import )?(copyleft|triangle\b)", text), path
    import_module("igl")
    assert not {"igl.copyleft", "igl.triangle"} & sys.modules.keys()
