import re
import struct

import pytest

from capture.sensors.oni_file import check_whole
from puppetline.errors import SourceError

DATA, END = 10, 11


def _record(kind, data=b"", fields=b""):
    return struct.pack("<4sIIIIQ", b"NIR\0", kind, 1, 28 + len(fields), len(data), 0) + fields + data


HEAD = b"NI10" + bytes(20)
BODY = [_record(13, fields=b"name"), _record(DATA, b"depth" * 50, b"time"), _record(DATA, b"color" * 90)]
WHOLE = HEAD + b"".join(BODY) + _record(END)


@pytest.fixture
def recording(tmp_path):
    def written(content):
        path = tmp_path / "take.oni"
        path.write_bytes(content)
        return path

    return written


@pytest.mark.parametrize("behind", [b"", bytes(500)])
def test_a_whole_recording_passes_with_the_room_that_the_recorder_leaves_behind_it(recording, behind):
    check_whole("openni:", recording(WHOLE + behind))


@pytest.mark.parametrize("length", [24, 40, 60, 200, len(WHOLE) - 28, len(WHOLE) - 1])
def test_one_that_was_cut_off_is_an_error_that_says_where(recording, length):
    starts = [24]
    for record in BODY:
        starts.append(starts[-1] + len(record))
    missing = next(start for start in starts if start + 28 > length)
    with pytest.raises(SourceError, match=f"take.oni, which is damaged at byte {missing};") as caught:
        check_whole("openni:", recording(WHOLE[:length]))
    assert caught.value.fix.startswith("Record it again")


def test_one_that_was_overwritten_is_an_error_that_says_where(recording):
    at = 24 + len(BODY[0])
    with pytest.raises(SourceError, match=f"damaged at byte {at};"):
        check_whole("openni:", recording(WHOLE[:at] + bytes(30) + WHOLE[at + 30 :]))


def test_a_record_that_leads_nowhere_is_an_error_and_no_endless_loop(recording):
    nowhere = struct.pack("<4sIIIIQ", b"NIR\0", DATA, 1, 0, 0, 0)
    with pytest.raises(SourceError, match="damaged at byte 24;"):
        check_whole("openni:", recording(HEAD + nowhere + WHOLE))


@pytest.mark.parametrize("content", [b"", b"NI", b"RIFF" + WHOLE])
def test_another_file_is_an_error(recording, content):
    with pytest.raises(SourceError, match=r"take\.oni, which is something else;"):
        check_whole("openni:", recording(content))


def test_a_file_that_is_not_there_or_a_folder_is_an_error(tmp_path):
    with pytest.raises(SourceError, match=re.escape("none.oni, which cannot be read (No such file or directory)")):
        check_whole("openni:", tmp_path / "none.oni")
    with pytest.raises(SourceError, match=re.escape("cannot be read (Is a directory)")):
        check_whole("openni:", tmp_path)
