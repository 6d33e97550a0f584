"""What Godot's renderers draw of a character: its deformation, shadows and levels of detail."""

import numpy as np
import pytest

from engine_bridge.character.examples import MOTIONS, prepare

from .test_materials import assert_alike, picture, write_payloads


def check_motion(run_godot, folder, **screen):
    """Check the shadow of a spot light between two frames, and levels of detail."""
    results = run_godot("render_motion.gd", folder, display=True, timeout=600, **screen)
    triangles = {told["bias"]: told["triangles"] for told in results}
    start, moved, directly = (picture(folder / f"shadow {name}.png") for name in ("0.0 of 2", "0.75 of 2", "0.75 of 1"))
    assert np.abs(start - moved).mean() > 1.0
    np.testing.assert_array_equal(moved, directly)
    assert triangles[1.0] < 0.6 * triangles[100.0]
    few, all_of_them = (picture(folder / f"levels {bias}.png") for bias in (1, 100))
    away = np.abs(few - all_of_them)
    assert away.mean() < 0.3
    assert np.percentile(away, 99) <= 4.0


def test_shadows_and_levels_of_detail_move_with_each_image(run_godot, blob_puppet, tmp_path):
    write_payloads(blob_puppet, tmp_path)
    check_motion(run_godot, tmp_path)


@pytest.fixture(scope="module")
def characters(own_cache, tmp_path_factory):
    """Folders of the five example characters, at rest and bent."""
    folders = []
    for name in MOTIONS:
        folders.append(tmp_path_factory.mktemp(name))
        write_payloads(prepare(name, folders[-1])[1], folders[-1])
    return folders


def draw(start_godot, characters, renderer):
    """Return what a renderer draws of each character, by the addon and as a mesh of its vertices."""
    script = start_godot("render_characters.gd", renderer, *characters, display=True, renderer=renderer)
    script.finish(600)
    assert [line for line in script.lines if "WARNING" in line] == []
    return [[picture(folder / f"{renderer} {what}.png") for what in ("made", "own")] for folder in characters]


def assert_close(one, other, mean, most):
    """Compare pictures in steps of 255: on the average, and in all but a thousandth of the pixels."""
    away = np.abs(one - other)
    assert away.mean() <= mean
    assert np.percentile(away, 99.9) <= most


@pytest.mark.slow
def test_forward_plus_and_mobile_draw_what_compatibility_draws(start_godot, run_godot, vulkan, characters):
    """The renderers have colours of their own, by which all meshes differ; the addon adds nothing to that.

    Mobile rounds colours to 10 bits of twice the range, Forward+ keeps 16.
    """
    compatibility, *others = (
        draw(start_godot, characters, name) for name in ("gl_compatibility", "mobile", "forward_plus")
    )
    for drawn in others:
        for (made, own), (made_otherwise, own_otherwise) in zip(compatibility, drawn, strict=True):
            assert np.std(own) > 10
            assert_alike(made, own)
            assert_close(made_otherwise, own_otherwise, 0.15, 4.0)
            assert_close(made_otherwise - made, own_otherwise - own, 0.2, 4.0)
    for name in ("mobile", "forward_plus"):
        check_motion(run_godot, characters[0], renderer=name)
