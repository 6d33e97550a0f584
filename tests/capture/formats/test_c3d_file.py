import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from capture.formats import c3d_file, read_log
from capture.formats.options import ReadOptions
from puppetline.errors import SkeletonLogError

from .test_markers import AXES, body, trc

c3d = pytest.importorskip("c3d")


def write(path, frames=4, namespaces=("",)):
    """Write the markers of bodies with the library itself, as a laboratory has them: millimetres, z up, 1 m apart."""
    at = {
        space + name: np.add(place, [0, 0, k]) for k, space in enumerate(namespaces) for name, place in body().items()
    }
    writer = c3d.Writer(point_rate=100)
    writer.set_point_labels([f"{name:8}" for name in at])
    for frame in range(frames):
        points = np.zeros((len(at), 5), np.float32)
        points[:, :3] = 1000 * np.add(list(at.values()), [0.1 * frame, 0, 0]) @ AXES.T
        writer.add_frames([(points, np.zeros((0, 1), np.float32))])
    with path.open("wb") as file:
        writer.write(file)
    return path


def test_markers_are_those_of_the_same_motion_as_trc(tmp_path):
    (tmp_path / "a.trc").write_text("\n".join(trc(body(), frames=4)))
    (clip,), (same,) = (read_log(path) for path in (write(tmp_path / "a.c3d"), tmp_path / "a.trc"))
    assert_allclose(clip.times, same.times)
    assert_allclose(clip.positions, same.positions, atol=1e-5)


def test_a_damaged_file_is_an_error(tmp_path):
    whole = write(tmp_path / "a.c3d").read_bytes()
    for size in (600, 1500, len(whole) // 2):
        (tmp_path / "b.c3d").write_bytes(whole[:size])
        try:
            clips = c3d_file.read(tmp_path / "b.c3d", ReadOptions())
        except SkeletonLogError:
            continue
        assert np.isfinite(clips[0].positions[clips[0].confidence > 0]).all()


def test_a_file_without_markers_is_called_so(tmp_path):
    content = bytearray(write(tmp_path / "a.c3d").read_bytes())
    used = content.rindex(b"USED") + 8  # after the offset of the next parameter, the type and the number of dimensions
    content[2:4] = content[used : used + 2] = b"\0\0"
    (tmp_path / "b.c3d").write_bytes(content.replace(b"LABELS", b"LABELZ"))
    with pytest.raises(SkeletonLogError, match="4 frames of 0 markers"):
        read_log(tmp_path / "b.c3d")


def test_namespaces_are_performers(tmp_path):
    [alone] = read_log(write(tmp_path / "a.c3d"))
    clips = read_log(write(tmp_path / "b.c3d", namespaces=("A:", "B:")))
    assert [clip.user for clip in clips] == [0, 1]
    for clip in clips:
        assert_allclose(clip.positions, alone.positions, atol=1e-3)


def _end_of_parameters(content, start):
    """Return where the last parameter ends; each has the distance to the next one after its name."""
    at = start
    while (length := abs(int.from_bytes(content[at : at + 1], "little", signed=True))) > 0:
        after = at + 2 + length
        step = int.from_bytes(content[after : after + 2], "little")
        if not step:
            break
        at = after + step
    return at


def with_integer_scales(content):
    for start in (at for at in range(len(content)) if content[at : at + 6] == b'SCALE"'):
        content[start + 7 : start + 13] = b"\x02\0" + (-1).to_bytes(2, "little", signed=True) + b"\0\0"


def with_the_number_of_frames_in_a_table_of_one_row(content):
    start = content.index(b"POINT") - 2
    own = b"\x05\xfbTRIAL" + b"\x03\0\0"
    field = b"\x12\x05ACTUAL_START_FIELD" + b"\x0b\0" + b"\x02\x02\x01\x02" + b"\1\0\0\0" + b"\0"
    del content[(end := _end_of_parameters(content, start)) : end + len(own + field)]
    content[start:start] = own + field


def with_two_rates_of_forces(content):
    content[18:20] = b"\5\0"  # in the header, samples of forces per frame


CHANGES = [with_integer_scales, with_the_number_of_frames_in_a_table_of_one_row, with_two_rates_of_forces]


@pytest.mark.parametrize("change", CHANGES)
def test_what_laboratories_write_otherwise_makes_no_difference(tmp_path, change):
    content = bytearray(write(tmp_path / "a.c3d").read_bytes())
    change(content)
    (tmp_path / "b.c3d").write_bytes(content)
    [clip], [expected] = (read_log(tmp_path / name) for name in ("b.c3d", "a.c3d"))
    assert_array_equal(clip.positions, expected.positions)
