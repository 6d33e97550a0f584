from pathlib import Path

import pytest

from capture.formats import _json
from puppetline.errors import SkeletonLogError


def write(folder: Path, text: str) -> Path:
    path = folder / "take.json"
    path.write_text(text)
    return path


def test_values_are_checked(tmp_path: Path) -> None:
    document = _json.load(write(tmp_path, '{"a": [1, -2.5, "72057594037929701"], "b": [[1, 2], [3, 4]]}'))
    one, two, three = document["a"].items()
    assert (one.number(), two.number(), three.integer()) == (1.0, -2.5, 72057594037929701)
    assert isinstance(one.number(), float)
    assert [value.integer() for value in _json.load(write(tmp_path, "[3.0, 1e3, 9007199254740991.0]")).items()] == [
        3,
        1000,
        9007199254740991,
    ]
    assert [row.numbers(2) for row in document["b"].items()] == [[1, 2], [3, 4]]
    assert "a" in document
    assert "c" not in document
    assert "c" not in document["a"]


def test_errors_name_the_place(tmp_path: Path) -> None:
    document = _json.load(write(tmp_path, '{"frames": [{"bodies": [{"x": null}]}]}'))
    with pytest.raises(SkeletonLogError) as caught:
        document["frames"].items()[0]["bodies"].items()[0]["x"].number()
    assert caught.value.where.endswith("take.json, frames[0].bodies[0].x")
    assert caught.value.found == "null"


@pytest.mark.parametrize("text", ["true", "null", '"1"', "[1]", "1e9", "-1e9", "1" * 400])
def test_values_that_are_not_numbers_are_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(SkeletonLogError, match="expected a number of ordinary size"):
        _json.load(write(tmp_path, text)).number()


@pytest.mark.parametrize(
    "text", ["true", "1.5", "9007199254740992.0", "-1.0", "-1", '"-1"', '"1.0"', '"²"', '""', "9223372036854775808"]
)
def test_values_that_are_not_integers_are_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(SkeletonLogError, match="expected an integer, 0 or more"):
        _json.load(write(tmp_path, text)).integer()


def test_long_strings_of_digits_are_not_integers(tmp_path: Path) -> None:
    with pytest.raises(SkeletonLogError, match="expected an integer"):
        _json.load(write(tmp_path, '"' + "9" * 10_000 + '"')).integer()


def test_long_values_are_not_repeated_in_full(tmp_path: Path) -> None:
    with pytest.raises(SkeletonLogError) as caught:
        _json.load(write(tmp_path, '"' + "x" * 10_000 + '"')).items()
    assert len(str(caught.value)) < 400


def test_a_file_that_is_too_large_or_not_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_json, "MAX_FILE_BYTES", 10)
    assert _json.load(write(tmp_path, "[1, 2, 34]")).items()[2].number() == 34
    with pytest.raises(SkeletonLogError, match="more than 10 bytes of JSON"):
        _json.load(write(tmp_path, "[1, 2, 345]"))
    with pytest.raises(SkeletonLogError, match="No such file"):
        _json.load(tmp_path / "absent.json")


def test_broken_json_names_its_line(tmp_path: Path) -> None:
    with pytest.raises(SkeletonLogError) as caught:
        _json.load(write(tmp_path, '{"a": 1,\n "b": [1, 2\n "c": 3}'))
    assert caught.value.where.endswith("take.json, line 3")
    assert "column 2" in caught.value.found
