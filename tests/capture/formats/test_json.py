import pytest

from capture.formats import _json
from puppetline.errors import SkeletonLogError


@pytest.fixture
def load(tmp_path):
    def written(text):
        path = tmp_path / "take.json"
        path.write_text(text)
        return _json.load(path)

    return written


def test_values_are_checked(load):
    document = load('{"a": [1, -2.5, "72057594037929701"], "b": [[1, 2], [3, 4]]}')
    one, two, three = document["a"].items()
    assert (one.number(), two.number(), three.integer()) == (1.0, -2.5, 72057594037929701)
    assert isinstance(one.number(), float)
    assert [row.numbers(2) for row in document["b"].items()] == [[1, 2], [3, 4]]
    assert ["a" in document, "c" in document, "c" in document["a"]] == [True, False, False]
    integers = [each.integer() for each in load("[0, 3.0, 1e3, 9007199254740991.0, 9223372036854775807]").items()]
    assert integers == [0, 3, 1000, 9007199254740991, 2**63 - 1]


@pytest.mark.parametrize(
    ("method", "text"),
    [("number", text) for text in ("true", "null", '"1"', "[1]", "1e9", "-1e9", "1" * 400)]
    + [("integer", text) for text in ("true", "1.5", "9007199254740992.0", "-1.0", "-1", "9223372036854775808")]
    + [("integer", f'"{text}"') for text in ("-1", "1.0", "²", "", "9" * 10_000)],
)
def test_values_of_another_kind_are_refused_with_their_place(load, method, text):
    value = load(f'{{"frames": [{{"x": {text}}}]}}')["frames"].items()[0]["x"]
    with pytest.raises(SkeletonLogError) as caught:
        getattr(value, method)()
    assert caught.value.where.endswith("take.json, frames[0].x")
    assert len(str(caught.value)) < 400  # a long value is not repeated in full


def test_a_file_that_is_too_large_or_not_there_is_refused(load, tmp_path, monkeypatch):
    monkeypatch.setattr(_json, "MAX_FILE_BYTES", 10)
    assert load("[1, 2, 34]").items()[2].number() == 34
    for read in (lambda: load("[1, 2, 345]"), lambda: _json.load(tmp_path / "absent.json")):
        with pytest.raises(SkeletonLogError):
            read()


def test_broken_json_names_its_line(load):
    with pytest.raises(SkeletonLogError) as caught:
        load('{"a": 1,\n "b": [1, 2\n "c": 3}')
    assert caught.value.where.endswith("take.json, line 3")
