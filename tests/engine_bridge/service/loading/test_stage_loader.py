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
    mesh = blob_puppet.parent / "blob.glb"
    text = blob_puppet.read_text()

    def load(old="", new="", rest=None):
        if not (tmp_path / mesh.name).exists():
            shutil.copy(mesh, tmp_path)
        (tmp_path / "dog.toml").write_text(text.replace(old, new) if old else text)
        settings = from_flags(("osc:0",), (Path("dog.toml"),), {"ease": 0.5}, {}, rest or {})
        [[player]] = load_players(settings, tmp_path, executor, [table for _, table in settings.output_tables()])
        return player

    return load


def test_a_revision_is_of_what_clients_see(cast):
    first = cast()
    assert first.character.name == "dog"
    assert cast().character.revision == first.character.revision  # after a restart, say
    assert cast("gain = 0.8", "gain = 0.7").character.revision == first.character.revision  # clients do not see gains
    assert cast('name = "head"', 'name = "nose"').character.revision != first.character.revision


def test_a_changed_look_has_a_new_revision(cast, blob, glb, tmp_path):
    glb.show(blob.vertices, blob.faces, NORMAL=blob.normals)
    glb.save(tmp_path / "blob.glb")
    first = cast()
    other = type(glb)()
    other.show(blob.vertices, blob.faces, NORMAL=-blob.normals)
    other.save(tmp_path / "blob.glb")
    assert cast().character.revision != first.character.revision


def test_everything_is_there_before_anybody_asks(cast):
    assert {"scene", "binding"} <= vars(cast().character).keys()


def test_vmc_of_a_character_without_the_limbs_of_a_humanoid_is_refused(cast):
    tail = '[[limb]]\nname = "tail"\npoints = [[0, 0, 0], [0, 0, -1]]\njoints = ["hip_center", "head"]\n[root]'
    for text in ("[root]", tail):
        told = refused(PuppetError, cast, "[root]", text, rest={"osc": [{"port": 39539, "send": ["joints", "vmc"]}]})
        assert told.where.endswith("dog.toml, [[limb]]")


def test_a_microphone_without_its_library_is_refused_before_a_character_is_loaded(tmp_path, executor, monkeypatch):
    monkeypatch.setitem(sys.modules, "sounddevice", None)  # as where the extra is not installed
    settings = from_flags(("osc:0",), (Path("missing.toml"),), {"sound": "default"}, {}, {})
    assert refused(SourceError, load_stages, settings, tmp_path, executor, ()).where == "sound"
