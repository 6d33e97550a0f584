"""The addon as a whole, copied into a project and enabled."""

import re
import subprocess
from pathlib import Path

ADDON = Path(__file__).parents[3] / "integrations" / "godot" / "addons" / "puppetline"


def test_the_editor_opens_with_the_plugin_on_and_has_nothing_to_complain_about(run_editor, project):
    lines = run_editor()
    assert [line for line in lines if "puppetline" in line.lower()] == []
    settings = (project / ".godot" / "global_script_class_cache.cfg").read_text()
    assert set(re.findall(r'"class": &"(\w+)"', settings)) == {
        "Puppet3D",
        "PuppetAttachment3D",
        "PuppetClip",
        "PuppetColliders3D",
        "PuppetOscReceiver",
        "PuppetRecorder",
        "PuppetSkeleton3D",
    }


def test_the_folder_has_what_a_project_that_copies_it_needs():
    root = ADDON.parents[3]
    assert (ADDON / "LICENSE").read_text() == (root / "LICENSE").read_text()
    scripts = [path for pattern in ("*.gd", "*.gdshaderinc") for path in (root / "integrations/godot").rglob(pattern)]
    listed = subprocess.run(["git", "ls-files", "*.uid"], cwd=root, capture_output=True, text=True, check=True).stdout
    assert set(listed.split()) == {f"{path.relative_to(root)}.uid" for path in scripts}
    names = [(root / name).read_text() for name in listed.split()]
    assert len(set(names)) == len(names)
