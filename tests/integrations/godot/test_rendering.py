"""What Godot's renderers draw of a character: its deformation, shadows and levels of detail."""

import shutil

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
    assert np.percentile(away, 99) <= 2.0


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


@pytest.mark.slow
@pytest.mark.parametrize("renderer", ["forward_plus", "mobile"])
def test_vulkan_renderers_draw_what_compatibility_draws(run_godot, vulkan, characters, tmp_path, renderer):
    screen = {"display": True, "renderer": renderer}
    run_godot("render_characters.gd", "compatibility", *characters, display=True, timeout=600)
    run_godot("render_characters.gd", renderer, *characters, timeout=600, **screen)
    for folder in characters:
        drawn = {what: picture(folder / f"{renderer} {what}.png") for what in ("normals", "own", "made")}
        known = {what: picture(folder / f"compatibility {what}.png") for what in drawn}
        assert_alike(drawn["normals"], known["normals"])
        assert_alike(drawn["made"], drawn["own"])
        assert np.abs(drawn["made"] - known["made"]).mean() < 5.0
    shutil.copytree(characters[0], tmp_path / "motion")
    check_motion(run_godot, tmp_path / "motion", renderer=renderer)
