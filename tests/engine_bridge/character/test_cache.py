import logging
import os

import numpy as np
import pytest

from engine_bridge.character import cache
from engine_bridge.character.cache import cache_key, load_or_compute

KEY = cache_key("some arrays")


def some_arrays():
    rng = np.random.default_rng(1)
    return {"table": rng.normal(size=(7, 3)), "few.numbers": np.arange(5), "scalar": np.array(2.5, np.float32)}


def impossible():
    raise AssertionError("made although it is there")


def same(found):
    expected = some_arrays()
    assert list(found) == list(expected)
    for name, array in expected.items():
        assert found[name].dtype == array.dtype
        np.testing.assert_array_equal(found[name], array)
    return True


@pytest.fixture
def kept(tmp_path):
    """The file with the arrays."""
    load_or_compute(tmp_path, KEY, some_arrays)
    return tmp_path / f"{KEY}.npz"


def made_anew(kept, caplog):
    """A bad file gives the right arrays, a warning that names the file, and a good file afterwards."""
    caplog.clear()
    with caplog.at_level(logging.WARNING):
        assert same(load_or_compute(kept.parent, KEY, some_arrays))
    assert len(caplog.records) == 1
    assert str(kept) in caplog.text
    assert "computing again" in caplog.text
    return same(load_or_compute(kept.parent, KEY, impossible))


def test_arrays_that_no_longer_hold_are_made_again_without_a_warning(kept, caplog):
    asked = []

    def is_current(arrays):
        asked.append(same(arrays))
        return len(asked) > 1

    with pytest.raises(AssertionError):
        load_or_compute(kept.parent, KEY, impossible, is_current)
    assert same(load_or_compute(kept.parent, KEY, impossible, is_current))
    assert (asked, caplog.records) == ([True, True], [])


def test_no_flipped_byte_of_a_file_gives_other_arrays(kept, caplog):
    whole = kept.read_bytes()
    warnings = 0
    for place in range(0, len(whole), 9):
        kept.write_bytes(whole[:place] + bytes([whole[place] ^ 0xFF]) + whole[place + 1 :])
        caplog.clear()
        with caplog.at_level(logging.WARNING):
            assert same(load_or_compute(kept.parent, KEY, some_arrays))
        warnings += len(caplog.records)
    assert warnings > len(whole) / 9 / 2  # the others hit what a zip archive does not need, such as dates


class Trap:
    """An object that runs code when it is unpickled."""

    def __reduce__(self):
        return (pytest.fail, ("the cache ran code",))


CONTENT = np.array([KEY, *some_arrays()])


@pytest.mark.parametrize(
    "damage",
    [
        *(b"", b"not an archive", b"PK\x03\x04" + bytes(100), b"\x93NUMPY\x01\x00" + bytes(80), np.arange(5)),
        *({}, {"content": CONTENT}, {"content": CONTENT, "table": np.eye(3)}, some_arrays()),
        {"content": np.array([KEY, "table"]), "table": np.array([Trap()], dtype=object)},
        {"content": np.array([cache_key("other arrays"), *some_arrays()]), **some_arrays()},
    ],
    ids=lambda damage: str(damage)[:40],
)
def test_a_file_that_is_no_archive_or_lacks_arrays_or_has_objects_or_another_key_is_made_anew(kept, caplog, damage):
    with kept.open("wb") as file:
        if isinstance(damage, bytes):
            file.write(damage)
        elif isinstance(damage, dict):
            np.savez(file, **damage)
        else:
            np.save(file, damage)
    assert made_anew(kept, caplog)


def test_a_folder_that_cannot_be_written_costs_a_warning_only(tmp_path, caplog):
    (tmp_path / "file").write_text("in the way")
    with caplog.at_level(logging.WARNING):
        assert same(load_or_compute(tmp_path / "file" / "cache", KEY, some_arrays))
    assert "could not save the results" in caplog.text


def test_a_full_disk_leaves_no_half_file(tmp_path, monkeypatch, caplog):
    def fill(file, **arrays):
        file.write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez", fill)
    assert same(load_or_compute(tmp_path, KEY, some_arrays))
    assert list(tmp_path.iterdir()) == []
    assert "No space left" in caplog.text


def test_the_files_that_were_used_last_are_kept(tmp_path, monkeypatch):
    keys = [cache_key(number) for number in range(4)]
    for age, key in enumerate(keys[:3]):
        load_or_compute(tmp_path, key, some_arrays)
        os.utime(tmp_path / f"{key}.npz", (0, 1000 - age))
    load_or_compute(tmp_path, keys[2], impossible)  # the oldest is the one used last now
    (tmp_path / "notes.txt").write_text("not of the cache")
    monkeypatch.setattr(cache, "MAX_CACHE_BYTES", 3 * (tmp_path / f"{keys[0]}.npz").stat().st_size)
    load_or_compute(tmp_path, keys[3], some_arrays)
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {f"{keys[0]}.npz", f"{keys[2]}.npz", f"{keys[3]}.npz", "notes.txt"}


def test_keys_are_equal_for_equal_things_only(monkeypatch):
    table = np.arange(12.0).reshape(4, 3)
    close = table.copy()
    close[2, 1] = np.nextafter(close[2, 1], 9)
    assert cache_key("a", table) == cache_key("a", np.asfortranarray(table))
    keys = {
        cache_key("a", table),
        cache_key("b", table),
        cache_key("a", close),
        cache_key("a", table.reshape(3, 4)),
        cache_key("a", table.view(np.int64)),
        cache_key("a", table, None),
        cache_key("a", table[:2], table[2:]),
    }
    monkeypatch.setattr(cache, "VERSION", cache.VERSION + 1)
    assert len(keys | {cache_key("a", table)}) == 8
