"""The addon as a whole, copied into a project and enabled."""

import re


def test_the_editor_opens_with_the_plugin_on_and_has_nothing_to_complain_about(run_editor, project):
    lines = run_editor()
    assert [line for line in lines if "puppetline" in line.lower()] == []
    settings = (project / ".godot" / "global_script_class_cache.cfg").read_text()
    assert set(re.findall(r'"class": &"(\w+)"', settings)) == {"Puppet3D", "PuppetOscReceiver"}
