import numpy as np
import pytest

from capture.formats import msr_action3d
from capture.formats.layouts import MSR_ACTION3D
from capture.formats.options import ReadOptions
from capture.skeleton import JOINT_INDEX, JOINTS

WORLD = np.column_stack([np.arange(20) / 8 - 1, 1 - np.arange(20) / 16, 2 + np.arange(20) / 32, np.ones(20)])


def text_of(*frames):
    return "".join(" ".join(f"{value:.7e}" for value in row) + "\n" for frame in frames for row in frame)


def test_each_joint_of_the_world_form_is_found_by_its_place(read):
    text = text_of(WORLD, WORLD, WORLD)
    assert msr_action3d.matches(text.encode())
    [clip], [given] = read(msr_action3d, text), read(msr_action3d, text, fps=10.0)
    assert (clip.format, clip.user, len(clip.notes), given.notes) == ("msr_action3d", 0, 1, ())
    assert clip.times.tolist() == [0.0, 1 / 15, 2 / 15]
    assert given.times.tolist() == [0.0, 0.1, 0.2]
    assert np.array_equal(clip.positions[2], WORLD[[MSR_ACTION3D.index(name) for name in JOINTS], :3])
    assert np.array_equal(clip.confidence, np.ones((3, 20)))


def test_no_confidence_makes_a_joint_inferred_and_only_an_all_zero_frame_is_lost(read):
    frame = WORLD.copy()
    frame[:3, 3] = 0.0, 0.25, 0.75
    [clip] = read(msr_action3d, text_of(0 * WORLD, frame))
    assert np.isnan(clip.positions[0]).all()
    assert np.array_equal(clip.confidence[0], np.zeros(20))
    assert [clip.confidence[1, JOINT_INDEX[name]] for name in MSR_ACTION3D[:4]] == [0.5, 0.5, 0.75, 1.0]


def test_the_screen_form_is_unprojected(read):
    screen = np.tile([160.0, 120.0, 500.0, 1.0], (20, 1))
    screen[0] = [160 + 142.8, 120.0, 500.0, 1.0]  # half a focal length right of the centre, 2 m away
    screen[1] = [160.0, 120 + 71.4, 1000.0, 1.0]  # a quarter below it, 4 m away
    screen[2] = [139.0, 2147483648.0, 500.0, 1.0]
    screen[3] = 0.0
    text = text_of(screen)
    assert msr_action3d.matches(text.encode())
    [clip] = read(msr_action3d, text)
    found = [clip.positions[0, JOINT_INDEX[name]] for name in MSR_ACTION3D[:5]]
    nothing = [np.nan] * 3
    np.testing.assert_allclose(found, [[1, 0, 2], [0, -1, 4], nothing, nothing, [0, 0, 2]], atol=1e-12)
    assert np.count_nonzero(clip.confidence == 0) == 2
    assert len(clip.notes) == 2


def test_a_recording_cut_off_within_a_line_is_read_up_to_the_last_complete_frame(read, assert_same_frames):
    [expected] = read(msr_action3d, text_of(WORLD, WORLD))
    lines = text_of(WORLD, WORLD, 2 * WORLD).splitlines(keepends=True)
    for line in (40, 41, 58, 59):
        [clip] = read(msr_action3d, "".join(lines[:line]) + lines[line][:20])
        assert_same_frames(clip, expected)
        assert "line 41" in clip.notes[1]


LINES = text_of(WORLD, WORLD).splitlines()


@pytest.mark.parametrize(
    ("content", "place"),
    [
        (LINES[:33], "line 21"),
        (text_of(WORLD)[:-20], "line 20"),
        ([*LINES[:24], "1 2 3 4 5", *LINES[25:]], "line 25"),
        ([*LINES[:24], "1 2 nan 1", *LINES[25:]], "line 25"),
        (text_of(0 * WORLD), ""),
    ],
)
def test_a_damaged_recording_is_refused_with_its_line(refused_at, content, place):
    assert refused_at(msr_action3d, content) == place


@pytest.mark.parametrize("text", ["", "1 2 3 1\n" * 19, "1 2 3 4\n" * 20, "1 2 3\n" * 20, "20 1\n" + "1 2 3 1\n" * 20])
def test_other_texts_do_not_match(text):
    assert not msr_action3d.matches(text.encode())


def test_both_real_forms_of_a_recording_agree_within_a_pixel(real_logs):
    frames = 0
    for screen in (real_logs / "msr_action3d_screen").iterdir():
        world = real_logs / "msr_action3d_world" / f"{screen.stem}3D.txt"
        [a], [b] = msr_action3d.read(screen, ReadOptions()), msr_action3d.read(world, ReadOptions())
        assert np.array_equal(a.confidence, b.confidence)
        assert (np.abs(a.positions - b.positions) / b.positions[..., 2:]).max() < 1 / 285.6
        frames += len(a.times)
    assert frames == 854
