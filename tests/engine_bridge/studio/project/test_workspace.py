import asyncio

import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine_bridge.studio.project import workspace as module
from engine_bridge.studio.project.workspace import UploadError, Workspace, file_name, shown
from puppetline.errors import OutputError, ServiceError

from ...refusals import refused


async def parts(*chunks):
    for chunk in chunks:
        yield chunk


def receive(workspace, name, *chunks, size=None):
    return asyncio.run(workspace.receive(name, size, parts(*chunks)))


@pytest.fixture
def workspace(tmp_path):
    return Workspace(tmp_path)


def files(workspace):
    return list((workspace.folder / "uploads").rglob("*"))


@given(st.text() | st.sampled_from(["../../etc/passwd", "..\\..\\x", "/", "", ".", "..", "a\0b", "CON.glb", "~/x"]))
def test_a_name_of_the_page_is_never_a_path(name):
    made = file_name(name)
    assert made not in ("", ".", "..")
    assert len(made) <= 43
    assert all(each.isascii() and (each.isalnum() or each in "_-.") for each in made)
    assert not made.startswith((".", "-"))
    assert made.count(".") <= 1
    assert "/" not in shown(name)
    assert shown(name).isprintable()


@pytest.mark.parametrize(
    ("name", "made"),
    [
        ("my dragon.GLB", "my_dragon.glb"),
        ("C:\\Users\\x\\take 1.log", "take_1.log"),
        ("Pferd (geflügelt).obj", "Pferd_gefl_gelt.obj"),
        ("archive.tar.gz", "archive_tar.gz"),
        (".glb", "file.glb"),
    ],
)
def test_a_safe_name_resembles_that_of_the_page(name, made):
    assert file_name(name) == made


def test_an_upload_is_written_and_kept(workspace):
    path = receive(workspace, "../my dog.obj", b"v 0 0 0\n", b"v 1 0 0\n")
    assert path.read_bytes() == b"v 0 0 0\nv 1 0 0\n"
    assert path.name == "my_dog.obj"
    assert path.parent.parent == workspace.folder / "uploads"
    upload = workspace.keep("../my dog.obj", path, "character", {})
    assert (upload.name, upload.bytes) == ("my dog.obj", 16)
    assert workspace.upload(upload.id, "character") is upload
    assert refused(ServiceError, workspace.upload, upload.id, "log").found == "a mesh"
    workspace.delete_upload(upload.id)
    assert files(workspace) == []
    assert refused(ServiceError, workspace.upload, upload.id).found.startswith("no upload")


def test_an_upload_that_is_too_large_or_breaks_off_leaves_nothing(workspace, monkeypatch):
    async def broken():
        yield b"1234"
        raise ConnectionResetError

    monkeypatch.setattr(module, "MAX_UPLOAD_BYTES", 10)
    for chunks, size in (((b"12345678", b"12345678"), None), ((b"",), 11)):
        assert refused(UploadError, receive, workspace, "a.obj", *chunks, size=size).found == "a larger file"
    refused(OutputError, lambda: asyncio.run(workspace.receive("a", None, broken())))
    assert files(workspace) == []
    assert receive(workspace, "a.obj", b"1234567890").read_bytes() == b"1234567890"


@pytest.mark.parametrize("keep", ["upload", "media"])
def test_all_uploads_together_are_bounded(workspace, monkeypatch, keep):
    monkeypatch.setattr(module, "MAX_TOTAL_BYTES", 10)
    monkeypatch.setattr(module, "MAX_UPLOADS", 2)
    path = receive(workspace, "a", b"12345678")
    if keep == "upload":
        workspace.keep("a", path, "log", {})
    else:
        workspace.keep_media(path)
    assert refused(UploadError, receive, workspace, "b", b"123").found == "a larger file"
    workspace.keep("b", receive(workspace, "b", b"12"), "log", {})
    assert refused(UploadError, receive, workspace, "c", b"").found == "2 uploads"


def test_old_exports_are_deleted(workspace, monkeypatch):
    monkeypatch.setattr(module, "MAX_EXPORTS", 2)
    made = []
    for k in range(3):
        path = workspace.new_export(f"dog {k}", ".glb")
        path.write_bytes(b"glTF")
        made.append(workspace.offer(path, path.name, "export"))
    assert [each.name for each in made] == ["dog_0.glb", "dog_1.glb", "dog_2.glb"]
    assert [each.path.exists() for each in made] == [False, True, True]
    assert list(workspace.downloads) == [each.id for each in made[1:]]


def test_characters_of_the_same_name_get_folders_of_their_own(workspace):
    names = [workspace.character_folder("a very long name of a character").name for _ in range(3)]
    assert names == [
        "a_very_long_name_of_a_character",
        "a_very_long_name_of_a_characte-2",
        "a_very_long_name_of_a_characte-3",
    ]
    assert max(map(len, names)) == 32


def test_an_error_for_the_page_names_no_folder_of_the_machine(workspace, tmp_path):
    path = receive(workspace, "cow.obj", b"")
    error = ServiceError(
        f"{path}, line 3", found=f"{path}", expected=f"{tmp_path}/takes/a.log", fix=f"{tmp_path}/characters/cow/cow.obj"
    )
    assert workspace.told(error) == {
        "where": "cow.obj, line 3",
        "found": "cow.obj",
        "expected": "a.log",
        "fix": "cow.obj",
    }


def test_a_damaged_session_counts_as_none(workspace, tmp_path):
    assert workspace.read_session() == {}
    workspace.write_session({"characters": []})
    assert Workspace(tmp_path).read_session() == {"characters": []}
    for damaged in ("[]", "{", ""):
        (tmp_path / "session.json").write_text(damaged)
        assert workspace.read_session() == {}


def test_a_folder_that_cannot_be_created_is_reported(tmp_path):
    (tmp_path / "file").write_text("")
    refused(OutputError, Workspace, tmp_path / "file" / "studio")
