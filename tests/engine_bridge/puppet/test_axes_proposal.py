import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from engine_bridge.character.character import make_character
from engine_bridge.puppet.axes_proposal import propose_axes
from engine_bridge.puppet.puppet import CharacterTable
from solver.anatomy.limb_finding import find_limbs

from ...solver.anatomy.test_limb_finding import FIGURE, HAND
from ...solver.shapes import body_of


@pytest.fixture(scope="module")
def figure():
    body = body_of(FIGURE, 0.05)

    def turned_by(degrees):
        vertices = Rotation.from_rotvec([0, degrees, 0], degrees=True).apply(body.vertices)
        return make_character("figure", vertices, body.faces)

    return turned_by


def proposed(character, *given, **options):
    return propose_axes(character, character.solver_mesh(), *given, specified=True, **options)


def test_a_body_that_looks_between_the_axes_is_turned_and_has_its_limbs(figure):
    character = figure(-30)
    found = proposed(character)
    assert found.values == {"up": "y", "front": "z", "turn": pytest.approx(-30, abs=1)}
    assert f"it is turned by {-found.turn}° to its right" in found.orientation.reasons[1]
    basis = CharacterTable(mesh="a.glb", **found.values).basis
    hand = find_limbs(character.solver_mesh(), basis).points["left arm"][-1]
    assert_allclose(basis @ hand, HAND, atol=0.15)


def test_a_front_that_is_given_is_not_turned_but_by_the_turn_that_is_given(figure):
    assert proposed(figure(30), None, "z").values == {"up": "y", "front": "z"}
    assert proposed(figure(30), None, "x", -60).values == {"up": "y", "front": "x", "turn": -60}


def test_a_turn_that_is_given_is_about_the_up_of_the_character(figure):
    given = proposed(figure(20), turn=20)
    assert given.values == {"up": "y", "front": "z", "turn": 20}
    assert "mirror" not in given.orientation.reasons[1]
    assert proposed(figure(0)).values == {"up": "y", "front": "z"}


def test_rows_of_a_basis_are_left_up_and_front_of_the_turned_character():
    found = CharacterTable(mesh="a.glb", up="z", front="-y", turn=90).basis
    assert_allclose(found, [(0, 1, 0), (0, 0, 1), (1, 0, 0)], atol=1e-12)
    assert np.linalg.det(found) == pytest.approx(1)
