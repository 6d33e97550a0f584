from engine_bridge.character import preparation, shading
from engine_bridge.performance.prepared_character import cache_folder, load_prepared


def kept():
    return {path.name: path.stat().st_ino for path in cache_folder().iterdir()}


def test_the_second_start_computes_nothing(blob, write_puppet, tmp_path, monkeypatch):
    """An .obj has a .glb in the cache beside its model."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    lines = ["v {} {} {}".format(*point) for point in blob.vertices.tolist()]
    lines += ["f {} {} {}".format(*face) for face in (blob.faces + 1).tolist()]
    (tmp_path / "blob.obj").write_text("\n".join(lines))
    puppet = write_puppet(tmp_path / "blob.toml", "blob.obj")
    load_prepared(puppet)
    assert cache_folder().is_relative_to(tmp_path / "cache")
    files = kept()
    assert len(files) == 2
    for module in (preparation, shading):
        monkeypatch.setattr(module, "weld", None)  # a call would fail
    monkeypatch.setattr(preparation, "build", None)
    load_prepared(puppet)
    assert kept() == files
