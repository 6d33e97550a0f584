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
        assert str(error.value) == f"{path}: found a file that cannot be read ({why}); expected a mesh. Look for it."


def test_a_result_replaces_the_old_file_only_when_the_block_has_ended(tmp_path):
    path = tmp_path / "out.glb"
    path.write_text("old")
    with written_whole(path) as beside:
        beside.write_text("new")
        assert path.read_text() == "old"
        assert (beside.parent, beside.suffix) == (tmp_path, ".glb")
    assert (path.read_text(), names(tmp_path)) == ("new", ["out.glb"])


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


def test_a_block_that_writes_nothing_is_an_error_and_leaves_the_old_file(tmp_path):
    path = tmp_path / "out.glb"
    path.write_text("old")
    with pytest.raises(OutputError), written_whole(path):
        pass
    assert path.read_text() == "old"


def test_an_error_of_the_operating_system_is_an_output_error(tmp_path):
    with pytest.raises(OutputError) as error, written_whole(tmp_path / "gone" / "out.glb") as beside:
        beside.write_text("new")
    assert error.value.found == "a file that cannot be written (No such file or directory)"
    with pytest.raises(OutputError), written_whole(tmp_path) as beside:
        beside.write_text("a file cannot replace a folder")
    assert names(tmp_path) == []


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


def test_a_file_that_exists_is_not_new(tmp_path):
    check_new(tmp_path / "a", "Choose another name.")
    (tmp_path / "a").touch()
    with pytest.raises(OutputError) as error:
        check_new(tmp_path / "a", "Choose another name.")
    assert str(error.value) == f"{tmp_path / 'a'}: found an existing file; expected a new name. Choose another name."


def test_a_good_place_is_left_as_it_was(tmp_path):
    path = tmp_path / "out.glb"
    check_writable(path, ".glb")
    assert names(tmp_path) == []
    path.write_text("old")
    check_writable(path, ".glb")
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


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="no folder here that refuses files to everyone")
def test_a_folder_that_takes_no_files_is_found_out_before_the_work():
    with pytest.raises(OutputError, match="a file that cannot be written") as error:
        check_writable(Path("/proc/out.glb"), ".glb")
    assert error.value.where == "/proc/out.glb"


def test_a_file_that_is_read_from_is_not_replaced_under_any_of_its_names(tmp_path):
    source = tmp_path / "dog.glb"
    source.write_text("the only copy")
    other_name = tmp_path / "link.glb"
    other_name.symlink_to(source)
    for output in (source, other_name, tmp_path / ".." / tmp_path.name / "dog.glb"):
        with pytest.raises(OutputError, match="an input file"):
            check_writable(output, ".glb", inputs=(tmp_path / "take.log", source))
    assert source.read_text() == "the only copy"
