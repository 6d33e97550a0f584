import igl
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from engine_bridge.character.shading import is_angular, shaded, wrongly_wound
from engine_bridge.character.surfaces.surface import Piece, Surface, SurfaceMaterial
from puppetline.errors import MeshError

from ..refusals import refused


def soup(vertices, triangles):
    """Return a mesh whose triangles share no corners."""
    return vertices[triangles].reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3)


def turned(triangles, *numbers):
    triangles = triangles.copy()
    triangles[list(numbers)] = triangles[list(numbers), ::-1]
    return triangles


def test_in_an_open_part_the_smaller_area_is_wrong():
    vertices = np.array([[0.0, 0, 0], [10, 0, 0], [0, 10, 0], [1, -1, 0], [10, 1, 0]])
    small = np.array([[0, 1, 2], [0, 1, 3], [1, 2, 4]])  # two small triangles against a large one
    large = np.array([[0, 1, 2], [1, 0, 3], [1, 4, 2]])
    assert wrongly_wound(vertices, small).tolist() == [False, True, True]
    assert not wrongly_wound(vertices, large).any()


def test_a_leaf_of_two_sides_and_degenerate_faces_are_left_alone(cube):
    leaf = np.array([[0, 1, 3], [0, 3, 2], [1, 0, 2], [1, 2, 3]])
    assert not wrongly_wound(cube.vertices, leaf).any()
    with_degenerate = np.concatenate([[[0, 0, 1]], cube.triangles, [[7, 7, 7]]])
    assert not wrongly_wound(cube.vertices, with_degenerate).any()


def test_backs_that_have_their_own_vertices_look_the_other_way(ball):
    lid_off = ball.triangles[:-2]
    both = Surface([Piece("front", ball.vertices, lid_off), Piece("back", ball.vertices, lid_off[:, [1, 0, 2]])])
    front, back = shaded(both, "box").pieces
    assert_allclose(front.normals, igl.per_vertex_normals(ball.vertices, lid_off), atol=1e-12)
    assert_array_equal(back.normals, -front.normals)
    assert_array_equal(back.triangles, lid_off[:, [1, 0, 2]])
    assert not front.material.double_sided


def test_faceted_surfaces_have_the_normals_of_their_facets(cube):
    positions, triangles = soup(cube.vertices, turned(cube.triangles, 4))
    surface = shaded(Surface([Piece("", positions, triangles)], faceted=True), "cube")
    (piece,) = surface.pieces
    centre = positions.reshape(-1, 3, 3).mean(axis=1)
    outward = np.where(np.abs(centre - 0.5) > 0.49, np.sign(centre - 0.5), 0)
    assert_allclose(piece.normals, np.repeat(outward, 3, axis=0), atol=1e-12)
    assert len(surface.notes) == 1


def test_turned_triangles_stay_in_their_places_across_pieces(cube):
    triangles = turned(cube.triangles, 1, 8)
    half = [Piece(name, cube.vertices, part) for name, part in (("a", triangles[:6]), ("b", triangles[6:]))]
    surface = shaded(Surface(half, ["said before", "said before"]), "cube")
    assert_array_equal(np.concatenate([piece.triangles for piece in surface.pieces]), cube.triangles)
    assert [piece.name for piece in surface.pieces] == ["a", "b"]
    assert (surface.notes[0], len(surface.notes)) == ("said before", 2)


def test_where_the_file_has_normals_its_winding_stays(cube):
    triangles = turned(cube.triangles, 1, 8)
    normals = np.tile([0.0, 0.0, 3.0], (8, 1))
    (piece,) = shaded(Surface([Piece("", cube.vertices, triangles, normals=normals)]), "cube").pieces
    assert_array_equal(piece.triangles, triangles)
    assert_array_equal(piece.normals, normals / 3)


def test_normals_without_direction_are_computed(cube):
    normals = cube.vertices - 0.5
    normals[2], normals[5], normals[6] = 0, np.nan, [0, np.inf, 0]
    normals[3:5] *= [[1e-200], [3e200]]
    surface = shaded(Surface([Piece("", cube.vertices, cube.triangles, normals=normals)]), "cube")
    smooth = igl.per_vertex_normals(cube.vertices, cube.triangles)
    expected = np.where(np.isin(np.arange(8), [2, 5, 6])[:, None], smooth, (cube.vertices - 0.5) / np.sqrt(0.75))
    assert_allclose(surface.pieces[0].normals, expected, atol=1e-12)
    assert len(surface.notes) == 1


def test_pieces_of_open_parts_have_two_sides(cube):
    box = Piece("box", cube.vertices, cube.triangles[:-2], SurfaceMaterial(name="paint"))
    ball = Piece("ball", cube.vertices + 3, cube.triangles, SurfaceMaterial(name="paint"))
    assert [piece.material for piece in shaded(Surface([box, ball]), "cubes").pieces] == [
        SurfaceMaterial(name="paint", double_sided=True), SurfaceMaterial(name="paint")
    ]  # fmt: skip


def test_a_file_without_a_surface_or_a_size_to_speak_of_is_refused(cube):
    few = Piece("", cube.vertices, cube.triangles[:2])
    small = [Piece("", cube.vertices * size, cube.triangles) for size in (1e-320, 1e-200, 1e-31)]
    for piece in (few, *small):
        refused(MeshError, shaded, Surface([piece]), "cube")


@pytest.mark.parametrize("size", [1e-29, 1e-9, 1, 1e9, 9e17])
def test_a_ball_has_smooth_normals_whatever_its_size_and_degenerate_faces_and_a_box_of_hard_edges_has_none(
    ball, cube, size
):
    more = np.concatenate([ball.triangles, [[0, 0, 1], [3, 3, 3]], ball.triangles[[4, 7]]])
    (piece,) = shaded(Surface([Piece("", ball.vertices * size, more)]), "ball").pieces
    assert_allclose(piece.normals, igl.per_vertex_normals(ball.vertices, ball.triangles), atol=1e-9)
    assert shaded(Surface([Piece("", cube.vertices * size, cube.triangles)]), "cube").pieces[0].normals is None


@pytest.mark.parametrize(("angle", "hard"), [(39, False), (41, True)])
def test_an_edge_is_hard_from_40_degrees_on(angle, hard):
    turn = np.radians(angle)
    ridge = np.array([[0, 0, 0], [0, 1, 0], [1, 0, 0], [-np.cos(turn), 0, -np.sin(turn)]])
    assert is_angular(ridge, np.array([[0, 2, 1], [0, 1, 3]])) is hard
