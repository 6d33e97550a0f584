import dataclasses

import numpy as np
import pytest

from engine_bridge.character import preparation, shading
from engine_bridge.performance.rig import cache_folder, load_rig


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


def same_fields(one, other):
    """Compare two dataclasses, bit for bit."""
    for field in dataclasses.fields(one):
        a, b = getattr(one, field.name), getattr(other, field.name)
        assert type(a) is type(b)
        if dataclasses.is_dataclass(a):
            assert same_fields(a, b)
        else:
            np.testing.assert_array_equal(a, b)
    return True


def same(one, other):
    """Compare two rigs, bit for bit."""
    assert same_fields(one.mesh, other.mesh)
    assert same_fields(one.model, other.model)
    assert one.character.document.gltf == other.character.document.gltf
    assert one.character.document.blob == other.character.document.blob
    assert one.character.document.notes == other.character.document.notes
    return one.puppet == other.puppet


def kept():
    return {path.name: path.stat().st_ino for path in cache_folder().iterdir()}


def test_the_second_start_gives_the_same_and_computes_nothing(puppet, tmp_path, monkeypatch):
    first = load_rig(puppet)
    assert cache_folder().is_relative_to(tmp_path / "cache")
    files = kept()
    assert len(files) == (1 if first.character.document.name.endswith(".glb") else 2)
    for module in (preparation, shading):
        monkeypatch.setattr(module, "weld", None)  # a call would fail
    monkeypatch.setattr(preparation, "build", None)
    assert same(load_rig(puppet), first)
    assert kept() == files


def test_a_mesh_file_that_changes_is_prepared_anew(puppet):
    first = load_rig(puppet)
    files = kept()
    mesh = puppet.with_name(first.puppet.character.mesh)
    raised = first.character.vertices[7] + [0, 0.01, 0]
    if mesh.suffix == ".obj":
        lines = mesh.read_text().splitlines()
        lines[7] = "v {} {} {}".format(*raised)
        mesh.write_text("\n".join(lines))
    else:
        document = first.character.document.copy()
        document.blob[7 * 12 : 8 * 12] = raised.astype(np.float32).tobytes()
        document.save(mesh)
    second = load_rig(puppet)
    np.testing.assert_allclose(second.mesh.vertices[second.mesh.of_render[7]], raised, rtol=1e-6)
    assert len(kept()) == 2 * len(files)
    assert kept().items() > files.items()


def test_other_parameters_share_what_does_not_depend_on_them(puppet):
    first = load_rig(puppet)
    files = kept()
    puppet.write_text(puppet.read_text().replace("fields = 5", "fields = 4"))
    second = load_rig(puppet)
    assert (len(first.model.weights), len(second.model.weights)) == (5, 4)
    assert len(kept()) == len(files) + 1
