import pytest

from engine_bridge.character import preparation, shading
from engine_bridge.performance.prepared_character import cache_folder, load_prepared

from ...oracles import assert_same_fields


@pytest.fixture(params=["glb", "obj"])
def puppet(request, blob, blob_file, write_puppet, tmp_path, monkeypatch):
    """A puppet file for the figure as a .glb or an .obj, with an empty cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    mesh = tmp_path / f"blob.{request.param}"
    if request.param == "glb":
        mesh.write_bytes(blob_file.read_bytes())
    else:
        lines = ["v {} {} {}".format(*point) for point in blob.vertices.tolist()]
        lines += ["f {} {} {}".format(*face) for face in (blob.faces + 1).tolist()]
        mesh.write_text("\n".join(lines))
    return write_puppet(tmp_path / "blob.toml", mesh.name)


def assert_same(one, other):
    """Compare two prepared characters, bit for bit."""
    assert_same_fields(one.mesh, other.mesh)
    assert_same_fields(one.model, other.model)
    for part in ("gltf", "blob", "notes"):
        assert getattr(one.character.document, part) == getattr(other.character.document, part)
    assert one.puppet == other.puppet


def kept():
    return {path.name: path.stat().st_ino for path in cache_folder().iterdir()}


def test_the_second_start_gives_the_same_and_computes_nothing(puppet, tmp_path, monkeypatch):
    first = load_prepared(puppet)
    assert cache_folder().is_relative_to(tmp_path / "cache")
    files = kept()
    assert len(files) == (1 if first.character.document.name.endswith(".glb") else 2)
    for module in (preparation, shading):
        monkeypatch.setattr(module, "weld", None)  # a call would fail
    monkeypatch.setattr(preparation, "build", None)
    assert_same(load_prepared(puppet), first)
    assert kept() == files
