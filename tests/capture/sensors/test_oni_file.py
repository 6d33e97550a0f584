import re
import struct

import pytest

from capture.sensors.oni_file import check_intact
from puppetline.errors import SourceError

DATA, END = 10, 11


def _record(kind, data=b"", fields=b""):
    return struct.pack("<4sIIIIQ", b"NIR\0", kind, 1, 28 + len(fields), len(data), 0) + fields + data


HEAD = b"NI10" + bytes(20)
BODY = [_record(13, fields=b"name"), _record(DATA, b"depth" * 50, b"time"), _record(DATA, b"color" * 90)]
INTACT = HEAD + b"".join(BODY) + _record(END)


@pytest.fixture
def written(tmp_path):
    def written(content):
        path = tmp_path / "take.oni"
        path.write_bytes(content)
        return path

    return written


@pytest.mark.parametrize("behind", [b"", bytes(500)])
def test_an_intact_recording_passes_with_the_recorders_padding(written, behind):
    check_intact("openni:", written(INTACT + behind))


@pytest.mark.parametrize("length", [24, 40, 60, 200, len(INTACT) - 28, len(INTACT) - 1])
def test_an_incomplete_recording_is_an_error_with_the_position(written, length):
    starts = [24]
    for record in BODY:
        starts.append(starts[-1] + len(record))
    missing = next(start for start in starts if start + 28 > length)
    with pytest.raises(SourceError, match=f"take.oni, which is damaged at byte {missing};") as caught:
        check_intact("openni:", written(INTACT[:length]))
    assert caught.value.fix.startswith("Record it again")


def test_an_overwritten_record_is_an_error_with_the_position(written):
    at = 24 + len(BODY[0])
    with pytest.raises(SourceError, match=f"damaged at byte {at};"):
        check_intact("openni:", written(INTACT[:at] + bytes(30) + INTACT[at + 30 :]))


def test_a_record_without_size_is_an_error(written):
    nowhere = struct.pack("<4sIIIIQ", b"NIR\0", DATA, 1, 0, 0, 0)
    with pytest.raises(SourceError, match="damaged at byte 24;"):
        check_intact("openni:", written(HEAD + nowhere + INTACT))


@pytest.mark.parametrize("content", [b"", b"NI", b"RIFF" + INTACT])
def test_a_file_of_another_kind_is_an_error(written, content):
    with pytest.raises(SourceError, match=r"take\.oni, which is another kind of file;"):
        check_intact("openni:", written(content))


def test_a_missing_file_or_a_folder_is_an_error(tmp_path):
    with pytest.raises(SourceError, match=re.escape("none.oni, which cannot be read (No such file or directory)")):
        check_intact("openni:", tmp_path / "none.oni")
    with pytest.raises(SourceError, match=re.escape("which cannot be read (Is a directory)")):
        check_intact("openni:", tmp_path)
