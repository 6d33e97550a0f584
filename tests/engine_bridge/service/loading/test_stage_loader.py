import shutil
import sys
from pathlib import Path

import pytest

from engine_bridge.service.loading.service_file import from_flags
from engine_bridge.service.loading.stage_loader import load_players, load_stages
from puppetline.errors import PuppetError, SourceError

from ...refusals import refused


@pytest.fixture
def cast(blob_puppet, tmp_path, executor):
    """Load a copy of the figure's puppet, its text changed."""
    shutil.copy(blob_puppet.with_name("blob.glb"), tmp_path)

    def load(old="", new="", rest=None):
        (tmp_path / "dog.toml").write_text(blob_puppet.read_text().replace(old or "\0", new))
        settings = from_flags(("osc:0",), (Path("dog.toml"),), {"ease": 0.5}, {}, rest or {})
        [[player]] = load_players(settings, tmp_path, executor, [table for _, table in settings.output_tables()])
        return player

    return load


def test_a_revision_is_of_what_clients_see(cast):
    """It is the same after a restart and for other gains, which clients do not see."""
    first = cast().character
    assert first.name == "dog"
    assert {"scene", "binding"} <= vars(first).keys()  # before anybody asks
    for old, new, is_same in (("", "", True), ("0.8", "0.7", True), ('name = "head"', 'name = "nose"', False)):
        assert (cast(old, new).character.revision == first.revision) == is_same


def test_a_changed_look_has_a_new_revision(cast, blob, new_glb, tmp_path):
    revisions = set()
    for side in (1, -1):
        glb = new_glb()
        glb.show(blob.vertices, blob.faces, NORMAL=side * blob.normals)
        glb.save(tmp_path / "blob.glb")
        revisions.add(cast().character.revision)
    assert len(revisions) == 2


def test_vmc_of_a_character_without_the_limbs_of_a_humanoid_is_refused(cast):
    tail = '[[limb]]\nname = "tail"\npoints = [[0, 0, 0], [0, 0, -1]]\njoints = ["hip_center", "head"]\n[root]'
    for text in ("[root]", tail):
        told = refused(PuppetError, cast, "[root]", text, rest={"osc": [{"port": 39539, "send": ["joints", "vmc"]}]})
        assert told.where.endswith("dog.toml, [[limb]]")


def test_a_microphone_without_its_library_is_refused_before_a_character_is_loaded(tmp_path, executor, monkeypatch):
    monkeypatch.setitem(sys.modules, "sounddevice", None)  # as where the extra is not installed
    settings = from_flags(("osc:0",), (Path("missing.toml"),), {"sound": "default"}, {}, {})
    assert refused(SourceError, load_stages, settings, tmp_path, executor, ()).where == "sound"
