import sys
from itertools import pairwise

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

from engine_bridge.export import skinning
from engine_bridge.export.skinning import farthest, fit, links
from engine_bridge.performance.clip import load_timeline, perform
from engine_bridge.performance.settings import Settings
from puppetline.errors import OutputError
from solver.model.binding import Binding
from solver.motion.deformer import to_file_units

pytest.importorskip("py_dem_bones")


@pytest.fixture(scope="module")
def clip(blob_rig, record, dance, tmp_path_factory):
    """Every third frame of the dance, for which bones are found in less time."""
    timeline, notes = load_timeline(record(tmp_path_factory.mktemp("short") / "dance.log", dance()[::3]), Settings())
    return perform(blob_rig, timeline, Settings(), notes, lambda _stage, _share: None)


@pytest.fixture(scope="module")
def fitted(clip):
    """Return the skin for a number of bones or a tolerance, for which progress was reported up to the end."""
    done = {}

    def make(bones=None, tolerance=1e-9):
        if (bones, tolerance) not in done:
            shares = []
            done[bones, tolerance] = fit(
                clip.rig.model, clip.rig.mesh, clip.frames, tolerance=tolerance, bones=bones, progress=shares.append
            )
            assert shares == sorted(shares)
            assert shares[-1] == 1
        return done[bones, tolerance]

    return make


@pytest.fixture(scope="module")
def moved(clip):
    binding = Binding.of_solver_mesh(clip.rig.model, clip.rig.mesh)
    return np.array([binding.vertices(to_file_units(frame, clip.rig.model)) for frame in clip.frames], dtype=np.float64)


def played(skin, rest):
    """Positions (F, n, 3) of the vertices in a viewer, by the definition in glTF."""
    turns = Rotation.from_quat(skin.rotations.reshape(-1, 4)).as_matrix().reshape(*skin.rotations.shape[:2], 3, 3)
    arms = rest[:, None] - skin.joints[skin.bones]
    placed = np.einsum("fnkij,nkj->fnki", turns[:, skin.bones], arms) + skin.translations[:, skin.bones]
    return np.einsum("nk,fnki->fni", skin.weights.astype(np.float64), placed)


@pytest.mark.parametrize("bones", [1, 3, 8])
def test_the_errors_are_those_of_all_vertices_in_all_frames(clip, fitted, moved, bones):
    skin = fitted(bones)
    off = np.linalg.norm(played(skin, clip.rig.mesh.vertices) - moved, axis=-1)
    assert skin.error == pytest.approx(off.max(), rel=1e-3)
    assert skin.rms == pytest.approx(np.sqrt((off**2).mean()), rel=1e-3)
    assert len(skin.joints) == bones


def test_a_single_bone_is_the_best_rigid_motion(clip, fitted, moved):
    rest = clip.rig.mesh.vertices
    here = rest - rest.mean(axis=0)
    left = 0.0
    for frame in moved:
        there = frame - frame.mean(axis=0)
        turn, _ = Rotation.align_vectors(there, here)
        left += ((turn.apply(here) - there) ** 2).sum(axis=1).mean()
    assert fitted(1).rms == pytest.approx(np.sqrt(left / len(moved)), rel=1e-4)


def test_more_bones_are_closer(fitted):
    errors = [fitted(bones).rms for bones in (1, 3, 8, 16)]
    assert all(b < 0.7 * a for a, b in pairwise(errors))


@pytest.mark.parametrize("tolerance", [0.02, 0.005])
def test_the_number_of_bones_is_the_smallest_within_the_tolerance(clip, fitted, tolerance):
    skin, diagonal = fitted(tolerance=tolerance), clip.rig.mesh.diagonal
    assert skin.error <= tolerance * diagonal
    smaller = [count for count in skinning.BONE_COUNTS if count < len(skin.joints)]
    assert all(fitted(count).error > tolerance * diagonal for count in smaller)


def test_weights_and_quaternions_are_as_gltf_wants_them(fitted):
    skin = fitted(8)
    assert (skin.weights.dtype, skin.bones.dtype, skin.rotations.dtype) == (np.float32, np.uint8, np.float32)
    assert (skin.weights >= 0).all()
    np.testing.assert_allclose(skin.weights.astype(np.float64).sum(axis=1), 1, atol=1.2e-7)
    assert (skin.bones[skin.weights == 0] == 0).all()
    assert set(np.unique(skin.bones[skin.weights > 0])) == set(range(8))
    np.testing.assert_allclose(np.linalg.norm(skin.rotations, axis=-1), 1, atol=1e-6)
    assert (np.einsum("fbc,fbc->fb", skin.rotations[1:], skin.rotations[:-1]) > 0.9).all()


def test_bones_move_no_faster_than_what_they_carry(clip, fitted, moved):
    """Bones do not jitter: in each step, no bone moves much farther than the fastest vertex."""
    skin = fitted(16)
    steps = np.linalg.norm(np.diff(skin.translations, axis=0), axis=-1)
    allowed = np.linalg.norm(np.diff(moved, axis=0), axis=-1).max(axis=1, keepdims=True)
    assert (steps <= 1.5 * allowed + 1e-3 * clip.rig.mesh.diagonal).all()


def test_a_character_that_stands_still_gets_one_bone_that_stands_still(clip):
    still = np.repeat(clip.rig.model.rest_controls[None], 5, axis=0).astype(np.float32)
    skin = fit(clip.rig.model, clip.rig.mesh, still, tolerance=1e-3)
    assert len(skin.joints) == 1
    assert skin.error < 1e-6 * clip.rig.mesh.diagonal
    np.testing.assert_allclose(skin.rotations, np.broadcast_to([0, 0, 0, 1], (5, 1, 4)), atol=1e-6)


def test_without_dem_bones_it_says_how_to_get_it(clip, monkeypatch):
    monkeypatch.setitem(sys.modules, "py_dem_bones", None)
    with pytest.raises(OutputError, match=r"pip install 'puppetline\[skin\]'"):
        fit(clip.rig.model, clip.rig.mesh, clip.frames, tolerance=0.01)


def test_each_point_chosen_is_the_farthest_from_those_before():
    line = np.array([[0.0], [1.0], [10.0], [4.0], [4.0]])
    np.testing.assert_array_equal(farthest(line, 3), [0, 2, 3])
    np.testing.assert_array_equal(farthest(line, 9), [0, 2, 3, 1])


def test_links_leave_no_part_alone():
    rng = np.random.default_rng(0)
    crowds = np.concatenate(
        [rng.normal(0, 1, (30, 3)) + place for place in ([0, 0, 0], [50, 0, 0], [50, 9, 0], [0, 0, 200])]
    )
    found = links(crowds)
    graph = coo_matrix((np.ones(len(found)), found.T), shape=(120, 120))
    assert connected_components(graph, directed=False)[0] == 1
    between = {tuple(sorted(pair)) for pair in (found // 30).tolist() if pair[0] != pair[1]}
    assert between == {(0, 1), (1, 2), (0, 3)}
