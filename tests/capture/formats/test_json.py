import math

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


@pytest.mark.parametrize(
    "text",
    [
        '{"head": [0.5, 1, NaN], "ok": true, "who": null}\n{"head": [2, 3, 4]}\n',
        "{'head': (0.5, 1, nan), 'ok': True, 'who': None}\n\n{'head': [2, 3, 4]}\n",
        "{'head': array([np.float64(0.5), 1, nan], dtype=float32), 'ok': True, 'who': None}\n{'head': [2, 3, 4]}\n",
        '{"head": [0.5, 1, NaN], "ok": true, "who": null}\n{"head": [2, 3, 4]}\n{"head": [5, 6',
        '{"head": [0.5, 1, NaN], "ok": true, "who": null},\n{"head": [2, 3, 4]},\n',
    ],
)
def test_lines_may_be_documents_as_json_or_as_python_prints_them(load, text):
    first, second = load(text).data
    assert (first["head"][:2], first["ok"], first["who"]) == ([0.5, 1], True, None)
    assert math.isnan(first["head"][2])
    assert second == {"head": [2, 3, 4]}


def test_a_line_that_is_no_document_is_refused_with_its_place(load):
    with pytest.raises(SkeletonLogError, match="column"):
        load("{'head': (1, 2, 3)}\nsome words\n{'head': (1, 2, 3)}\n")
