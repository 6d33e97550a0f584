import numpy as np
import pytest
from numpy.testing import assert_allclose

from engine_bridge.character.character import make_character
from engine_bridge.puppet.handle_proposal import propose_handles
from engine_bridge.puppet.puppet import CharacterTable
from solver.surface.mesh import SolverMesh

from ..conftest import capsules
from .test_proposal import HUMANOID, assert_on_the_right_sides

TABLE = CharacterTable(mesh="a")
QUADRUPED = {"head": "head", "left hind foot": "foot_left", "right hind foot": "foot_right"}
QUADRUPED |= {"left front foot": "hand_left", "right front foot": "hand_right", "tail": "head"}

DOG = capsules("""
0.0 1.0 -1.0  0.0 1.0 1.0  0.30
0.0 1.0 1.0  0.0 1.7 1.5  0.20
0.0 1.7 1.5  0.0 1.65 1.8  0.16
0.1 1.0 0.9  0.3 -0.2 1.0  0.15
-0.1 1.0 0.9  -0.3 -0.2 0.95  0.15
0.1 1.0 -0.9  0.3 -0.2 -0.9  0.15
-0.1 1.0 -0.9  -0.3 -0.2 -0.95  0.15
0.0 1.0 -1.0  0.0 1.5 -1.9  0.12
""")

WINGED = [*DOG, ((0.1, 1.2, 0.4), (1.3, 2.4, 0.3), 0.12), ((-0.1, 1.2, 0.4), (-1.3, 2.4, 0.3), 0.12)]

MOUSE = capsules("""
0.0 0.9 0.0  0.0 1.4 0.0  0.35
0.0 2.2 0.0  0.0 2.3 0.0  0.45
0.3 2.4 0.0  0.95 3.0 0.0  0.16
-0.3 2.4 0.0  -0.95 3.0 0.0  0.16
0.2 1.4 0.0  1.1 1.0 0.1  0.14
-0.2 1.4 0.0  -1.1 1.0 0.1  0.14
0.2 0.9 0.0  0.35 -0.2 0.1  0.16
-0.2 0.9 0.0  -0.35 -0.2 0.1  0.16
0.0 0.8 -0.1  0.0 0.6 -1.6  0.12
""")
"""A character with a tail, whose ears are as long as its arms."""


def places(handles):
    return {handle.name: np.array(handle.position) for handle in handles}


@pytest.fixture
def solver_mesh(make_shape):
    def make(limbs, step=0.09):
        shape = make_shape(limbs, step)
        return make_character("made", shape.vertices.astype(float), shape.faces).solver_mesh()

    return make


def test_a_quadruped_gets_four_feet_a_head_and_a_tail_that_swings_against_it_and_wings_follow_the_elbows(solver_mesh):
    handles = propose_handles(solver_mesh(WINGED), TABLE)
    wings = {"left wing": "elbow_left", "right wing": "elbow_right"}
    assert {handle.name: handle.joint for handle in handles} == QUADRUPED | wings
    named = places(handles)
    assert_on_the_right_sides(named, np.eye(3))
    assert named["head"][2] > 1.7
    assert named["tail"][2] < -1.8
    assert min(named[f"{side} front foot"][2] for side in ("left", "right")) > 0.5
    assert max(named[f"{side} hind foot"][2] for side in ("left", "right")) < -0.5
    assert min(named["left wing"][1], named["right wing"][1]) > 2.3
    assert {handle.name: handle.gain for handle in handles}["tail"] == -0.7


def test_without_a_tail_the_rump_is_held(solver_mesh):
    round_behind = [((0.0, 1.0, -0.8), (0.0, 1.0, 1.0), 0.30), *DOG[1:-1]]
    handles = propose_handles(solver_mesh(round_behind), TABLE)
    expected = {name: joint for name, joint in QUADRUPED.items() if name != "tail"}
    assert {handle.name: handle.joint for handle in handles} == {**expected, "rump": None}
    assert_allclose(places(handles)["rump"], [0, 1, -1.1], atol=0.15)


def test_ears_are_no_arms_however_long(solver_mesh):
    handles = propose_handles(solver_mesh(MOUSE), TABLE)
    assert {handle.name: handle.joint for handle in handles} == {**HUMANOID, "tail": "head"}
    named = places(handles)
    assert_on_the_right_sides(named, np.eye(3))
    assert max(named["left hand"][1], named["right hand"][1]) < 1.3
    assert abs(named["head"][0]) < 0.2
    assert named["tail"][2] < -1.5


@pytest.mark.parametrize("limbs", [WINGED, MOUSE], ids=["winged", "mouse"])
@pytest.mark.parametrize(("up", "front"), [("z", "-y"), ("-x", "y")])
def test_a_character_that_is_turned_gets_the_same_handles_turned(solver_mesh, limbs, up, front):
    mesh, table = solver_mesh(limbs), CharacterTable(mesh="a", up=up, front=front)
    turned = SolverMesh(mesh.vertices @ table.basis, mesh.faces, mesh.of_render)
    expected = places(propose_handles(mesh, TABLE))
    found = places(propose_handles(turned, table))
    assert list(found) == list(expected)
    for name, place in expected.items():
        assert_allclose(found[name], place @ table.basis, atol=1e-5)


def test_a_mesh_without_feet_gets_a_fixed_base(solver_mesh):
    snowman = propose_handles(
        solver_mesh([((0.0, 0.0, 0.0), (0.0, 0.1, 0.0), 1.0), ((0.0, 1.5, 0.0), (0.0, 1.6, 0.0), 0.6), *MOUSE[4:6]]),
        TABLE,
    )
    hands = {"left hand": "hand_left", "right hand": "hand_right"}
    assert {handle.name: handle.joint for handle in snowman} == {"head": "head", **hands, "base": None}
    assert places(snowman)["base"][1] < -0.9
    assert places(snowman)["head"][1] > 0.5
