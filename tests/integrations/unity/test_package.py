"""The package is one that Unity's package manager takes, and its files refer to each other rightly."""

import json
import re
import subprocess

import pytest

from .conftest import HERE, PACKAGE, STRICT

GUID = re.compile(r"guid: ([0-9a-f]{32})\b")
FILES = [path for path in PACKAGE.rglob("*") if "Documentation~" not in path.parts and path.suffix != ".meta"]
IMPORTED = [path for path in FILES if not path.name.endswith("~")]
"""What gets a .meta file: without one, Unity leaves out the files of a package that it may not write to."""


def guid(path):
    return GUID.search(path.with_name(f"{path.name}.meta").read_text())[1]


def test_everything_compiles_without_a_warning_and_is_documented(built):
    for name in ("core", "unity", "timeline", "editor", "tests"):
        assert (built / f"{name}.xml").stat().st_size > 500


def test_the_core_needs_nothing_of_the_engine(built):
    """The fixture compiles it without; Unity is told to as well."""
    core = json.loads((PACKAGE / "Runtime/Core/Puppetline.Core.asmdef").read_text())
    assert (core["noEngineReferences"], core["references"]) == (True, [])
    unity = json.loads((PACKAGE / "Runtime/Puppetline.Unity.asmdef").read_text())
    assert unity["references"] == [core["name"]]


def test_the_package_says_what_it_is():
    package = json.loads((PACKAGE / "package.json").read_text())
    assert (package["name"], package["license"]) == ("com.puppetline.unity", "MIT")
    assert (PACKAGE / "LICENSE.md").read_text() == (HERE.parents[2] / "LICENSE").read_text()
    for sample in package["samples"]:
        assert list((PACKAGE / sample["path"]).glob("*.unity"))


def test_links_are_to_files_that_are_installed_with_the_package():
    """Puppetline has no public address; without addresses, the package manager opens the files of the package."""
    package = json.loads((PACKAGE / "package.json").read_text())
    assert not {"documentationUrl", "changelogUrl", "licensesUrl"} & set(package)
    for page in PACKAGE.rglob("*.md"):
        for link in re.findall(r"\]\(([^)]+)\)", page.read_text()):
            assert (page.parent / link).resolve().is_relative_to(PACKAGE.resolve()), (page, link)
            assert (page.parent / link).exists(), (page, link)


def test_every_assembly_knows_what_it_uses():
    """And the one for Timeline exists only where Timeline is installed, the tests only where Unity runs tests."""
    files = {path.stem: json.loads(path.read_text()) for path in PACKAGE.rglob("*.asmdef")}
    assert {name for name, each in files.items() if each["name"] == name} == set(files)
    assert {name: each["includePlatforms"] for name, each in files.items() if each["includePlatforms"]} == {
        "Puppetline.Editor": ["Editor"],
        "Puppetline.Editor.Tests": ["Editor"],
    }
    timeline = files["Puppetline.Timeline"]
    (version,) = timeline["versionDefines"]
    assert version["name"] == "com.unity.timeline"
    assert timeline["defineConstraints"] == [version["define"]]
    assert files["Puppetline.Editor.Tests"]["defineConstraints"] == ["UNITY_INCLUDE_TESTS"]
    outside = {"Unity.Timeline", "UnityEngine.TestRunner", "UnityEditor.TestRunner"}
    assert {name for each in files.values() for name in each["references"]} <= {*files, *outside}


def test_every_file_and_folder_has_an_identity_of_its_own():
    guids = [guid(path) for path in IMPORTED]
    assert len(set(guids)) == len(guids)
    metas = {path.with_name(path.name.removesuffix(".meta")) for path in PACKAGE.rglob("*.meta")}
    assert metas == set(IMPORTED)


def test_the_sample_scene_refers_to_what_there_is():
    (scene,) = PACKAGE.rglob("*.unity")
    text = scene.read_text()
    assert set(GUID.findall(text)) == {guid(PACKAGE / "Runtime/Puppet.cs"), *map(guid, scene.parent.glob("*.cs"))}
    anchors = re.findall(r"^--- !u!\d+ &(\d+)$", text, re.MULTILINE)
    assert len(set(anchors)) == len(anchors)
    assert set(re.findall(r"{fileID: (\d+)}", text)) <= {*anchors, "0"}
    fields = re.findall(r"^        public \S+ (\w+)(?: =|;)", (PACKAGE / "Runtime/Puppet.cs").read_text(), re.MULTILINE)
    puppet = text.split("--- !u!114 &302")[1].split("---")[0]
    named = re.findall(r"^  (?!m_)(\w+):", puppet, re.MULTILINE)
    assert set(named) <= set(fields)


GUIDE = HERE.parents[2] / "docs" / "unity.md"
EXAMPLES = re.findall(r"^```csharp\n(.*?)^```$", GUIDE.read_text(), re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("number", range(len(EXAMPLES)))
def test_examples_of_the_guide_compile(mono, built, tmp_path, number):
    text = EXAMPLES[number]
    source = tmp_path / "Example.cs"
    source.write_text(text)
    unity = [f"-r:{built / name}.dll" for name in ("Puppetline.Unity", "UnityEngine") if "UnityEngine" in text]
    kind = "exe" if "static void Main" in text else "library"
    references = [f"-r:{built / 'Puppetline.Core.dll'}", *unity]
    command = [mono[0], *STRICT, f"-target:{kind}", f"-out:{tmp_path / 'example'}", *references, source]
    made = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (made.returncode, made.stdout + made.stderr) == (0, "")
