import numpy as np
from numpy.testing import assert_allclose

from solver.anatomy import orientation, standing
from solver.anatomy.axes import basis_of
from solver.anatomy.standing import propose_standing, standing_logits

from ..shapes import body_of
from .test_limb_finding import FIGURE

WAYS = [(up, front) for up in ("x", "-x", "y", "-y", "z", "-z") for front in ("x", "-x", "y", "-y", "z", "-z")]
WAYS = [(up, front) for up, front in WAYS if up[-1] != front[-1]]


def test_a_figure_stands_likelier_as_it_was_made_than_in_any_other_way():
    logits = standing_logits(body_of(FIGURE), [basis_of(*way) for way in WAYS])
    assert WAYS[int(np.argmax(logits))] == ("y", "z")


def test_axes_that_are_given_are_kept_and_not_compared():
    given = propose_standing(body_of(FIGURE), "z", "-x")
    assert given == orientation.propose(body_of(FIGURE), "z", "-x")
    assert propose_standing(body_of(FIGURE), front="z").front == "z"


def test_rows_of_a_basis_are_left_up_and_front():
    assert_allclose(basis_of("z", "-y"), [(1, 0, 0), (0, 0, 1), (0, -1, 0)])


def test_the_likeliest_way_is_that_of_the_outline_the_points_inside_and_the_convention_together(monkeypatch):
    outline = orientation.Orientation("z", "y", 0.5, ("up", "front"), (("y", "z", 0.4), ("x", "y", 0.1)))
    monkeypatch.setattr(orientation, "propose", lambda *known, **_: outline)
    monkeypatch.setattr(standing, "standing_logits", lambda *_: [0.0, 6.0, 4.0])
    found = standing.propose_standing(body_of(FIGURE))
    odds = np.exp([np.log(0.5) / 2 + 2, 6 / 2 + np.log(0.4) / 2, 4 / 2 + np.log(0.1) / 2 - 4])
    chances = odds / odds.sum()
    assert_allclose(found.confidence, chances[1])
    assert [way[:2] for way in found.others] == [("z", "y"), ("x", "y")]
    assert_allclose([way[2] for way in found.others], chances[[0, 2]])
