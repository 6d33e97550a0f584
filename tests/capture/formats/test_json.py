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
