import os
from pathlib import Path

import pytest

from puppetline.errors import MeshError, OutputError
from puppetline.files import check_new, check_writable, read_whole, written_whole


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_file_is_read_whole_or_an_error_states_the_reason(tmp_path):
    (tmp_path / "a.obj").write_bytes(b"v 0\r\n\0")
    assert read_whole(tmp_path / "a.obj", "a mesh", MeshError) == b"v 0\r\n\0"
    for path, why in ((tmp_path / "none.obj", "No such file or directory"), (tmp_path, "Is a directory")):
        with pytest.raises(MeshError) as error:
            read_whole(path, "a mesh", MeshError, "Look for it.")
        assert (error.value.where, error.value.expected, error.value.fix) == (str(path), "a mesh", "Look for it.")
        assert why in error.value.found


def test_a_result_replaces_the_old_file_when_the_block_has_ended_and_its_data_are_on_the_disk(tmp_path, monkeypatch):
    path, synced = tmp_path / "out.glb", []
    path.write_text("old")
    monkeypatch.setattr(os, "fsync", lambda file: synced.append((os.fstat(file).st_size, path.read_text())))
    with written_whole(path) as beside:
        beside.write_text("newer")
        assert (beside.parent, beside.suffix) == (tmp_path, ".glb")
    assert (synced, path.read_text(), names(tmp_path)) == ([(5, "old")], "newer", ["out.glb"])


@pytest.mark.parametrize("fault", [RuntimeError, KeyboardInterrupt, SystemExit])
def test_an_exception_in_the_block_leaves_only_the_old_file(tmp_path, fault):
    path = tmp_path / "out.glb"
    path.write_text("old")

    def write():
        with written_whole(path) as beside:
            beside.write_text("half of the n")
            raise fault

    with pytest.raises(fault):
        write()
    assert (path.read_text(), names(tmp_path)) == ("old", ["out.glb"])


def test_what_cannot_be_written_is_an_error_and_leaves_the_old_file(tmp_path):
    path = tmp_path / "out.glb"
    path.write_text("old")
    with pytest.raises(OutputError), written_whole(path):
        pass
    with pytest.raises(OutputError) as error, written_whole(tmp_path / "gone" / "out.glb") as beside:
        beside.write_text("new")
    assert error.value.found == "a file that cannot be written (No such file or directory)"
    with pytest.raises(OutputError), written_whole(tmp_path) as beside:
        beside.write_text("a file cannot replace a folder")
    assert (path.read_text(), names(tmp_path)) == ("old", ["out.glb"])


def test_two_processes_that_write_one_file_do_not_meet_halfway(tmp_path, monkeypatch):
    with written_whole(tmp_path / "out") as mine:
        monkeypatch.setattr(os, "getpid", lambda: -1)
        with written_whole(tmp_path / "out") as other:
            assert other != mine
            other.write_text("other")
        mine.write_text("mine")


def test_an_interrupt_while_a_place_is_checked_leaves_no_file(tmp_path, monkeypatch):
    touch = Path.touch

    def interrupted(path):
        touch(path)
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "touch", interrupted)
    with pytest.raises(KeyboardInterrupt):
        check_writable(tmp_path / "out.glb", ".glb")
    assert names(tmp_path) == []


def test_a_good_place_is_left_as_it_was_and_a_file_that_is_there_is_not_new(tmp_path):
    path = tmp_path / "out.glb"
    check_writable(path, ".glb")
    check_new(path, "Choose another name.")
    assert names(tmp_path) == []
    path.write_text("old")
    check_writable(path, ".glb")
    with pytest.raises(OutputError) as error:
        check_new(path, "Choose another name.")
    assert (error.value.where, error.value.fix) == (str(path), "Choose another name.")
    assert (path.read_text(), names(tmp_path)) == ("old", ["out.glb"])


def test_each_bad_path_states_a_fix(tmp_path):
    file = tmp_path / "file"
    file.write_text("")
    folder = tmp_path / "no" / "such"
    taken = tmp_path / "folder.glb"
    taken.mkdir()
    device = tmp_path / "device.glb"
    device.symlink_to(os.devnull)
    for path, found, fix in (
        (tmp_path, "a folder or device", "Add a file name to the path."),
        (tmp_path / "out.gltf", "the ending '.gltf'", "Call it out.glb."),
        (taken, "a folder or device", "Add a file name to the path."),
        (device, "a folder or device", "Add a file name to the path."),
        (folder / "out.glb", f"no folder {folder}", f"Create it: mkdir -p {folder}"),
        (file / "out.glb", f"no folder {file}", "Choose another folder."),
    ):
        with pytest.raises(OutputError) as error:
            check_writable(path, ".glb")
        assert (error.value.where, error.value.found, error.value.fix) == (str(path), found, fix)


def test_a_file_that_is_read_from_is_not_replaced_under_any_of_its_names(tmp_path):
    source = tmp_path / "dog.glb"
    source.write_text("the only copy")
    other_name = tmp_path / "link.glb"
    other_name.symlink_to(source)
    for output in (source, other_name, tmp_path / ".." / tmp_path.name / "dog.glb"):
        with pytest.raises(OutputError) as error:
            check_writable(output, ".glb", inputs=(tmp_path / "take.log", source))
        assert error.value.found == "an input file"
    assert source.read_text() == "the only copy"
