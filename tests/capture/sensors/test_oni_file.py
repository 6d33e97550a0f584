import struct

import pytest

from capture.sensors.oni_file import check_intact

from ..conftest import refused

DATA, END = 10, 11


def _record(kind, data=b"", fields=b""):
    return struct.pack("<4sIIIIQ", b"NIR\0", kind, 1, 28 + len(fields), len(data), 0) + fields + data


HEAD = b"NI10" + bytes(20)
BODY = [_record(13, fields=b"name"), _record(DATA, b"depth" * 50, b"time"), _record(DATA, b"color" * 90)]
INTACT = HEAD + b"".join(BODY) + _record(END)
STARTS = [24 + sum(map(len, BODY[:k])) for k in range(4)]
NOWHERE = struct.pack("<4sIIIIQ", b"NIR\0", DATA, 1, 0, 0, 0)  # a record without size


@pytest.mark.parametrize("behind", [b"", bytes(500)])
def test_an_intact_recording_passes_with_the_recorders_padding(tmp_path, behind):
    (tmp_path / "take.oni").write_bytes(INTACT + behind)
    check_intact("openni:", tmp_path / "take.oni")


@pytest.mark.parametrize(
    ("content", "found"),
    [
        *(
            (INTACT[:length], f"damaged at byte {start}")
            for length, start in zip((24, 60, 350, 400), STARTS, strict=True)
        ),
        (INTACT[:-1], f"damaged at byte {STARTS[-1]}"),
        (INTACT[: STARTS[1]] + bytes(30) + INTACT[STARTS[1] + 30 :], f"damaged at byte {STARTS[1]}"),
        (HEAD + NOWHERE + INTACT, "damaged at byte 24"),
        *((content, "another kind of file") for content in (b"", b"NI", b"RIFF" + INTACT)),
        (None, "cannot be read"),
    ],
)
def test_a_damaged_or_missing_recording_or_another_file_is_an_error_with_the_position(tmp_path, content, found):
    if content is not None:
        (tmp_path / "take.oni").write_bytes(content)
    assert found in refused(check_intact, "openni:", tmp_path / "take.oni").found
