import numpy as np
import pytest

from capture.formats import msr_action3d
from capture.formats.layouts import MSR_ACTION3D
from capture.formats.options import ReadOptions
from capture.skeleton import JOINT_INDEX, JOINTS
from puppetline.errors import SkeletonLogError

WORLD = np.column_stack([np.arange(20) / 8 - 1, 1 - np.arange(20) / 16, 2 + np.arange(20) / 32, np.ones(20)])
NO_CLOCK = "The recording has no clock; 15 frames per second are assumed."


def _write(tmp_path, *frames, end="\n"):
    log = tmp_path / "a01_s01_e01.txt"
    log.write_text("\n".join(" ".join(f"{value:.7e}" for value in row) for frame in frames for row in frame) + end)
    return log


def test_each_joint_of_the_world_form_is_found_by_its_place(tmp_path):
    log = _write(tmp_path, WORLD, WORLD, WORLD)
    assert msr_action3d.matches(log.read_bytes())
    [clip] = msr_action3d.read(log, ReadOptions())
    assert (clip.format, clip.user, clip.notes) == ("msr_action3d", 0, (NO_CLOCK,))
    assert clip.times.tolist() == [0.0, 1 / 15, 2 / 15]
    assert np.array_equal(clip.positions[2], WORLD[[MSR_ACTION3D.index(name) for name in JOINTS], :3])
    assert np.array_equal(clip.confidence, np.ones((3, 20)))


def test_the_rate_can_be_given(tmp_path):
    [clip] = msr_action3d.read(_write(tmp_path, WORLD, WORLD), ReadOptions(fps=10.0))
    assert clip.times.tolist() == [0.0, 0.1]
    assert clip.notes == ()


def test_no_confidence_makes_a_joint_inferred_and_only_an_all_zero_frame_is_lost(tmp_path):
    frame = WORLD.copy()
    frame[:3, 3] = 0.0, 0.25, 0.75
    [clip] = msr_action3d.read(_write(tmp_path, 0 * WORLD, frame), ReadOptions())
    assert np.isnan(clip.positions[0]).all()
    assert np.array_equal(clip.confidence[0], np.zeros(20))
    assert [clip.confidence[1, JOINT_INDEX[name]] for name in MSR_ACTION3D[:4]] == [0.5, 0.5, 0.75, 1.0]


def test_the_screen_form_is_unprojected(tmp_path):
    screen = np.tile([160.0, 120.0, 500.0, 1.0], (20, 1))
    screen[0] = [160 + 142.8, 120.0, 500.0, 1.0]  # half a focal length right of the centre, 2 m away
    screen[1] = [160.0, 120 + 71.4, 1000.0, 1.0]  # a quarter below it, 4 m away
    screen[2] = [139.0, 2147483648.0, 500.0, 1.0]
    screen[3] = 0.0
    log = _write(tmp_path, screen)
    assert msr_action3d.matches(log.read_bytes())
    [clip] = msr_action3d.read(log, ReadOptions())
    first, second, third, fourth, other = (clip.positions[0, JOINT_INDEX[name]] for name in MSR_ACTION3D[:5])
    assert first == pytest.approx([1.0, 0.0, 2.0])
    assert second == pytest.approx([0.0, -1.0, 4.0])
    assert other == pytest.approx([0.0, 0.0, 2.0])
    assert np.isnan([third, fourth]).all()
    assert np.count_nonzero(clip.confidence == 0) == 2
    assert "285.6 pixels" in clip.notes[1]


def test_an_incomplete_last_frame_seems_cut_off(tmp_path):
    with pytest.raises(SkeletonLogError) as caught:
        msr_action3d.read(_write(tmp_path, WORLD, WORLD[:13]), ReadOptions())
    assert caught.value.where.endswith("a01_s01_e01.txt, line 21")
    assert caught.value.found == "13 lines for the last frame"
    assert "20 lines per frame" in caught.value.expected
    assert "incomplete. Delete line 21 and all lines after it" in caught.value.fix


def test_a_recording_cut_off_within_a_line_is_read_up_to_the_last_complete_frame(tmp_path, assert_same_frames):
    [expected] = msr_action3d.read(_write(tmp_path, WORLD, WORLD), ReadOptions())
    lines = _write(tmp_path, WORLD, WORLD, 2 * WORLD).read_text().splitlines(keepends=True)
    log = tmp_path / "cut.txt"
    for line in range(40, 60):
        log.write_text("".join(lines[:line]) + lines[line][:20])
        [clip] = msr_action3d.read(log, ReadOptions())
        assert_same_frames(clip, expected)
        note = "The file ends in the middle of the frame that begins in line 41. This frame is omitted."
        assert clip.notes == (NO_CLOCK, note)


def test_a_recording_cut_off_within_its_first_frame_is_refused(tmp_path):
    log = _write(tmp_path, WORLD, end="")
    log.write_text(log.read_text()[:-20])
    with pytest.raises(
        SkeletonLogError, match=r"line 20: found the end of the file after 3 columns.*4 columns.*Delete"
    ):
        msr_action3d.read(log, ReadOptions())


def test_a_line_that_does_not_fit_is_refused(tmp_path):
    log = _write(tmp_path, WORLD, WORLD)
    lines = log.read_text().splitlines()
    log.write_text("\n".join([*lines[:24], "1 2 3 4 5", *lines[25:]]) + "\n")
    with pytest.raises(SkeletonLogError, match="line 25: found 5 columns; expected 4 columns"):
        msr_action3d.read(log, ReadOptions())
    log.write_text("\n".join([*lines[:24], "1 2 nan 1", *lines[25:]]) + "\n")
    with pytest.raises(SkeletonLogError, match="line 25: found 'nan' in column 3; expected a finite number"):
        msr_action3d.read(log, ReadOptions())


def test_a_log_without_a_tracked_frame_is_refused(tmp_path):
    with pytest.raises(SkeletonLogError, match="no tracked performer in any of 1 frames"):
        msr_action3d.read(_write(tmp_path, 0 * WORLD), ReadOptions())


@pytest.mark.parametrize("text", ["", "1 2 3 1\n" * 19, "1 2 3 4\n" * 20, "1 2 3\n" * 20, "20 1\n" + "1 2 3 1\n" * 20])
def test_other_texts_do_not_match(text):
    assert not msr_action3d.matches(text.encode())


def test_real_world_recordings_have_the_numbers_of_their_files(real_logs):
    [clip] = msr_action3d.read(real_logs / "msr_action3d_world" / "a01_s01_e01_skeleton3D.txt", ReadOptions())
    assert len(clip.times) == 54
    head, hand = JOINT_INDEX["head"], JOINT_INDEX["hand_right"]
    assert clip.positions[6, head].tolist() == [-0.183981, 0.654718, 2.542371]  # line 140
    assert clip.positions[6, hand].tolist() == [0.015526, -0.262305, 2.614394]  # line 133
    assert clip.confidence[6, hand] == np.float32(0.745192)


def test_both_real_forms_of_a_recording_agree_within_a_pixel(real_logs):
    screens = sorted((real_logs / "msr_action3d_screen").iterdir())
    assert len(screens) == 20
    for screen in screens:
        world = real_logs / "msr_action3d_world" / f"{screen.stem}3D.txt"
        [a], [b] = msr_action3d.read(screen, ReadOptions()), msr_action3d.read(world, ReadOptions())
        assert np.array_equal(a.confidence, b.confidence)
        assert (np.abs(a.positions - b.positions) / b.positions[..., 2:]).max() < 1 / 285.6


@pytest.mark.parametrize(("folder", "files", "frames", "empty"), [("world", 60, 2283 + 96, 33), ("screen", 20, 854, 0)])
def test_all_real_logs_are_read(real_logs, folder, files, frames, empty):
    logs = list((real_logs / f"msr_action3d_{folder}").iterdir())
    clips = [clip for log in logs for clip in msr_action3d.read(log, ReadOptions())]
    assert len(clips) == files
    assert sum(len(clip.times) for clip in clips) == frames
    assert sum(len(clip.times) - clip.tracked_frames for clip in clips) == empty
