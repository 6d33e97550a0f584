"""What Godot's renderers draw of a character: its deformation, shadows and levels of detail."""

import numpy as np
import pytest

from engine_bridge.character.examples import MOTIONS, prepare

from .test_materials import assert_alike, picture, write_payloads


def check_motion(run_godot, folder, **shown):
    """Check the shadow of a spot light between two frames, and levels of detail."""
    results = run_godot("render_motion.gd", folder, timeout=600, **shown)
    triangles = {told["bias"]: told["triangles"] for told in results}
    start, moved, directly = (picture(folder / f"shadow {name}.png") for name in ("0.0 of 2", "0.75 of 2", "0.75 of 1"))
    assert np.abs(start - moved).mean() > 1.0
    np.testing.assert_array_equal(moved, directly)
    assert triangles[1.0] < 0.6 * triangles[100.0]
    few, all_of_them = (picture(folder / f"levels {bias}.png") for bias in (1, 100))
    away = np.abs(few - all_of_them)
    assert away.mean() < 0.3
    assert np.percentile(away, 99) <= 4.0


def test_shadows_and_levels_of_detail_move_with_each_image(run_godot, screen, blob_puppet, tmp_path):
    write_payloads(blob_puppet, tmp_path)
    check_motion(run_godot, tmp_path, screen=screen())


@pytest.mark.slow
@pytest.mark.parametrize("renderer", ["gl_compatibility", "mobile", "forward_plus"])
def test_each_renderer_draws_characters_as_it_draws_meshes_of_their_vertices(
    start_godot, run_godot, screen, vulkan, tmp_path, renderer
):
    folders = [tmp_path / name for name in MOTIONS]
    shown = {"screen": screen(), "renderer": renderer}
    for folder in folders:
        folder.mkdir()
        write_payloads(prepare(folder.name, folder)[1], folder)
    script = start_godot("render_characters.gd", renderer, *folders, **shown)
    script.finish(600)
    assert [line for line in script.lines if "WARNING" in line] == []
    for folder in folders:
        made, own = (picture(folder / f"{renderer} {what}.png") for what in ("made", "own"))
        assert np.std(own) > 10
        assert_alike(made, own)
    if renderer != "gl_compatibility":
        check_motion(run_godot, folders[0], **shown)
