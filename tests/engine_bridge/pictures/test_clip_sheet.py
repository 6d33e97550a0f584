import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from capture.skeleton import JOINT_INDEX, OPPOSITE
from engine_bridge.character.materials import preview_colors
from engine_bridge.pictures import clip_sheet

from ..export.conftest import solved_places


@pytest.fixture
def drawn(monkeypatch):
    """What is passed to the renderer (poses, views and colours), and the labels."""
    seen = {"poses": [], "views": [], "colors": []}

    def render(vertices, _faces, view, size, colors):
        for name, value in (("poses", vertices), ("views", view), ("colors", colors)):
            seen[name].append(value)
        return np.zeros((size[1], size[0], 3), np.uint8)

    monkeypatch.setattr(clip_sheet, "render", render)
    monkeypatch.setattr(clip_sheet, "write_contact_sheet", lambda _images, labels, *_rest: seen.update(labels=labels))
    return seen


def solved_pose(clip, index):
    """Return the rendered vertices of a frame, without root motion."""
    return solved_places(clip.motion.prepared, clip.motion.R[[index]])[0][clip.motion.prepared.mesh.of_render]


def test_a_clip_sheet_shows_twelve_frames_from_first_to_last_and_follows_the_root(
    clip_of, blob_puppet, drawn, tmp_path
):
    clip = clip_of(blob_puppet)
    clip_sheet.draw(clip, tmp_path / "a.png", "title")
    chosen = [0, 5, 10, 15, 20, 25, 31, 36, 41, 46, 51, 57]
    assert drawn["labels"] == [f"{index / 30:.2f} s" for index in chosen]
    for index, pose in zip(chosen, drawn["poses"], strict=True):
        assert_allclose(pose, solved_pose(clip, index) + clip.motion.root[index], atol=1e-5)
    assert_array_equal(drawn["colors"][0], preview_colors(clip.motion.prepared.character))
    roots, centers = clip.motion.root[chosen], np.array([view.center for view in drawn["views"]])
    assert np.ptp(roots[:, 0]) > 0.1
    assert_allclose(centers - centers[0], roots - roots[0], atol=1e-6)
    assert {view.radius for view in drawn["views"]} == {drawn["views"][0].radius}


def test_the_floor_of_a_character_with_limbs_is_where_it_stands_at_rest(clip_of, limbed_puppet, drawn, tmp_path):
    clip = clip_of(limbed_puppet)
    clip_sheet.draw(clip, tmp_path / "a.png", "title")
    character = clip.motion.prepared.character
    rest = (character.vertices @ clip.motion.prepared.puppet.character.basis.T)[:, 1].min()
    assert [view.ground for view in drawn["views"]] == pytest.approx([rest] * 12)
    assert min(pose[:, 1].min() for pose in drawn["poses"]) != pytest.approx(rest)


def test_without_a_root_the_character_stays_and_a_short_clip_is_shown_whole(
    clip_of, blob_file, write_puppet, record, dance, drawn, tmp_path
):
    puppet = write_puppet(blob_file.with_name("rootless.toml"), blob_file.name, root=False)
    clip, shares = clip_of(puppet, record(tmp_path / "short.log", dance(3))), []
    clip_sheet.draw(clip, tmp_path / "a.png", "title", shares.append)
    assert shares == [1 / 3, 2 / 3, 1]
    assert_allclose(drawn["poses"], [solved_pose(clip, index) for index in range(3)], atol=1e-5)


def test_a_character_with_another_up_axis_is_shown_upright(clip_of, blob_file, write_puppet, drawn, tmp_path):
    puppet = write_puppet(blob_file.with_name("lying.toml"), blob_file.name, character='up = "z"\nfront = "-y"\n')
    clip = clip_of(puppet)
    clip_sheet.draw(clip, tmp_path / "a.png", "title")
    left, up, front = drawn["poses"][0].T
    assert_allclose(np.stack([left, -front, up], axis=1), solved_pose(clip, 0) + clip.motion.root[0], atol=1e-5)


def test_the_performer_is_seen_from_the_characters_side_and_mirrored_like_it(
    clip_of, blob_puppet, blob_file, write_puppet, drawn, monkeypatch, tmp_path
):
    figures = []

    def draw(joints, view, size):
        figures.append((joints, (view.azimuth, view.elevation)))
        return np.zeros((size[1], size[0], 3), np.uint8)

    monkeypatch.setattr(clip_sheet.stick_figure, "draw", draw)
    mirroring = write_puppet(blob_file.with_name("mirrors.toml"), blob_file.name, more="[retarget]\nmirror = true\n")
    for puppet in (blob_puppet, mirroring):
        clip = clip_of(puppet)
        clip_sheet.draw(clip, tmp_path / "a.png", "title")
    hips = clip.positions[57] - clip.positions[57, JOINT_INDEX["hip_center"]]
    assert_allclose(figures[11][0], hips * [-1, 1, -1], atol=1e-9)
    assert_allclose(figures[23][0], hips[OPPOSITE] * [1, 1, -1], atol=1e-9)
    assert {view for _, view in figures} == {(25.0, 12.0)}
