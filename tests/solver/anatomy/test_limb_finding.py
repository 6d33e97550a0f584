from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from solver.anatomy import limb_finding
from solver.anatomy.limb_chain import Limbs, evenly
from solver.anatomy.limb_finding import find_limbs
from solver.anatomy.solid import fill
from solver.surface.mesh import SolverMesh, weld

from ..shapes import body_of, capsules, joined

IMAGE = np.array([-1.0, 1.0, 1.0])
PERSON = ["trunk", "head", "left arm", "right arm", "left leg", "right leg"]
FOUR_LEGGED = ["left hind leg", "right hind leg", "left front leg", "right front leg"]

BODY = capsules("""
0    0.9  0      0    1.35 0     0.18
0    1.4  0      0    1.6  0     0.07
0    1.72 0      0    1.76 0.02  0.13
""")
ARM = capsules("""
0.1  1.42 0      0.25 1.45 0     0.09  *
0.25 1.45 0      0.55 1.15 0     0.055 *
0.55 1.15 0      0.8  0.85 0.25  0.05  *
""")
LEG = capsules("""
0.15 0.85 0      0.17 0.45 0.05  0.08  *
0.17 0.45 0.05   0.18 0.08 0     0.06  *
0.18 0.08 0      0.18 0.06 0.22  0.05  *
""")
(SHOULDER, ELBOW), HAND = (ARM[number][0] for number in (2, 4)), ARM[4][1]
(HIP, KNEE, ANKLE), TOES = (LEG[number][0] for number in (0, 2, 4)), LEG[4][1]
FIGURE = [*BODY, *ARM, *LEG]
DOG = capsules("""
0    1    -1     0    1     1    0.3
0    1     1     0    1.7   1.5  0.16
0    1.7   1.5   0    1.65  1.9  0.19
0.2  1     0.9   0.25 -0.2  0.9  0.12  *
0.2  1    -0.9   0.25 -0.2 -0.9  0.12  *
0    1    -1     0    1.5  -1.9  0.09
""")


@pytest.fixture(scope="module")
def person():
    return body_of(FIGURE)


@pytest.fixture(scope="module")
def whole(person):
    """What is found of the person."""
    return find_limbs(person, np.eye(3))


def found(mesh, basis=None, ends=None):
    return find_limbs(mesh, np.eye(3) if basis is None else basis, ends or {}).points


def assert_same(one, other, tolerance):
    assert list(one) == list(other)
    for name, points in one.items():
        assert_allclose(points, other[name], atol=tolerance, err_msg=name)


def assert_joints(limbs, height, wanted, within):
    """Check the joints of limbs, by numbers, and those of the right sides, which are mirror images."""
    for limb, joints in wanted.items():
        for side, sign in (("left", np.ones(3)), ("right", IMAGE)):
            for number, joint in joints.items():
                away = np.linalg.norm(limbs[f"{side} {limb}"][number] - sign * joint)
                assert away < within * height, (side, limb, number, away)


def numbered(*joints):
    return dict(enumerate(joints))


def test_joints_of_a_figure_are_where_it_was_made(person, whole):
    limbs = whole.points
    assert list(limbs) == PERSON
    height = np.ptp(person.vertices[:, 1])
    wanted = {"arm": numbered(SHOULDER, ELBOW), "leg": numbered(HIP, KNEE, ANKLE, TOES)}
    assert_joints(limbs, height, wanted, 0.075)
    assert_allclose(limbs["left arm"][-1], HAND, atol=0.06 * height)
    assert_allclose(limbs["trunk"][-1], limbs["head"][0])
    assert_allclose(limbs["head"][-1], (0, 1.88, 0.02), atol=0.03 * height)


DOGS = ["trunk", "head", *FOUR_LEGGED, "tail"]
WINGS = capsules("0.1 1.2 0.2  1.5 2.4 -0.1  0.1 *")
STRIDE = capsules("""
 0.15 0.85 0   0.17 0.1  0.45  0.07
-0.15 0.85 0  -0.17 0.1 -0.45  0.07
""")
FISH = capsules("""
0    1   -0.5    0    1     0.7   0.4
0    1    0.7    0    1     1.2   0.2
0    1   -0.5    0    1    -1.4   0.14
0    1   -1.4    0    1.45 -1.8   0.07
0    1   -1.4    0    0.8  -1.65  0.07
0.3  0.85 0.4    0.85 0.5   0.2   0.07 *
""")
TAPERING = [
    ((0.0, 1.0, -1.0 - 1.8 * share), (0.0, 1.0, -1.06 - 1.8 * share), 0.28 * (1 - share) + 0.02)
    for share in np.linspace(0.0, 1.0, 31)
]
DOG_ENDS = {
    f"{side} {row} leg": (x, -0.2, z)
    for side, x in (("left", 0.25), ("right", -0.25))
    for row, z in (("hind", -0.9), ("front", 0.9))
}


@pytest.mark.parametrize(
    ("limbs", "names", "ends"),
    [
        (DOG, DOGS, {"tail": (0, 1.5, -1.9)} | DOG_ENDS),
        ([*DOG[:-1], *TAPERING], DOGS, {"tail": (0.0, 1.0, -2.86)} | DOG_ENDS),
        (
            [*DOG, *WINGS],
            [*DOGS[:-1], "left wing", "right wing", "tail"],
            {"left wing": (1.5, 2.4, -0.1), "right wing": (-1.5, 2.4, -0.1)} | DOG_ENDS,
        ),
        ([*BODY, *ARM, *STRIDE], PERSON, {"left leg": (0.17, 0.08, 0.47), "right leg": (-0.17, 0.08, -0.47)}),
        (FISH, ["trunk", "head", "left wing", "right wing", "tail"], {"head": (0, 1, 1.4)}),
    ],
    ids=["dog", "tapering tail", "wings", "long stride", "fish, with its fins as wings"],
)
def test_limbs_of_a_shape_end_where_they_were_made(limbs, names, ends):
    mesh = body_of(limbs, 0.05 if limbs[0] is DOG[0] else 0.035)
    result = found(mesh)
    assert list(result) == names
    for name, end in ends.items():
        away = np.linalg.norm(result[name][-1] - end) / np.ptp(mesh.vertices, axis=0).max()
        assert away < 0.065, (name, away)


EARS = {"left ear": (0.5, 2.3, 1.7), "right ear": (-0.5, 2.3, 1.7), "jaw": (0.0, 1.5, 2.0)}


@pytest.mark.parametrize(
    ("limbs", "ends", "within"),
    [
        ([*DOG, *capsules("0.1 1.75 1.6  0.5 2.3 1.7  0.06 *")], EARS, 0.1),
        (
            [*FIGURE, *capsules("0.1 1.2 -0.05  1 1.9 -0.5  0.05 *")],
            {"left arm": (1.0, 1.9, -0.5), "right arm": (-1.0, 1.9, -0.5)},
            0.1,
        ),
        ([*DOG, *WINGS], {"head": (0.0, 1.7, 1.9)}, 0.2),
    ],
    ids=["ears and a jaw", "a second pair of arms", "the head of a bird"],
)
def test_limbs_that_the_user_gives_take_precedence(limbs, ends, within):
    mesh = body_of(limbs, 0.05 if limbs[0] is DOG[0] else 0.035)
    result = found(mesh, ends={name: np.array(end) for name, end in ends.items()})
    for name, end in ends.items():
        assert_allclose(result[name][-1], end, atol=within)
    if ends is EARS:
        assert list(result)[-3:] == list(ends)
        assert [len(result[name]) for name in ends] == [3, 3, 2]


def test_arms_in_the_body_end_where_the_user_says():
    body = [*BODY, *LEG, *capsules("0.1 1.35 0  0.12 0.95 0  0.16 *")]
    hand = np.array([0.22, 0.95, 0.1])
    limbs = found(body_of(body), ends={"left arm": hand, "right arm": hand * IMAGE})
    arm = limbs["left arm"]
    assert_allclose(arm[-1], hand)
    assert 0.1 < arm[0][0] < 0.28
    assert 1.15 < arm[0][1] < 1.5
    assert_allclose(limbs["right arm"], arm * IMAGE, atol=0.07)


def test_a_limb_that_only_the_user_sees_goes_straight_from_the_trunk(person, whole):
    end = np.array([0.0, 1.2, -0.18])
    tail = found(person, ends={"tail": end})["tail"]
    assert_allclose(tail[-1], end)
    assert_allclose(np.linalg.norm(np.cross(tail - tail[0], end - tail[0]), axis=1), 0, atol=1e-9)
    trunk = whole.points["trunk"]
    assert np.linalg.norm(np.cross(tail[0] - trunk[0], trunk[-1] - trunk[0])) < 0.02


SLENDER = capsules("""
0.1  1.42 0     0.25 1.45 0     0.09  *
0.25 1.45 0     0.55 1.43 0     0.045 *
0.55 1.43 0     0.95 1.4  0     0.026 *
""")
SLEEVE = capsules("""
0.1  1.42 0     0.45 1.43 0     0.09  *
0.45 1.43 0     0.95 1.4  0     0.035 *
""")
WIDE_FOOT = capsules("""
0.12 0.9  0     0.28 0.1  0     0.08  *
0.09 0.06 0     0.5  0.06 0     0.06  *
""")
"""A leg that ends in a block which is wider than long."""

LOOSE_SHOES = LEG[:2] + capsules("""
 0.17 0.45 0.05   0.18 0.25 0     0.06  *
 0.12 0.06 -0.02  0.18 0.06 0.22  0.06  *
-0.18 0.25 0     -0.15 0.06 0     0.06
-0.12 0.06 0      0.12 0.06 0     0.06
""")
OUTSTRETCHED = (0.95, 1.4, 0.0)


@pytest.mark.parametrize(
    ("limbs", "foot", "hand"),
    [
        ([*SLENDER, *LEG], TOES, OUTSTRETCHED),
        ([*SLEEVE, *LEG], TOES, OUTSTRETCHED),
        ([*ARM, *LOOSE_SHOES], TOES, None),
        ([*ARM, *WIDE_FOOT], (0.28, 0.0, 0.0), None),
    ],
    ids=["slender forearms", "forearms beyond wide sleeves", "shoes that touch", "wide feet"],
)
def test_legs_end_at_the_feet_and_arms_at_the_hands(limbs, foot, hand):
    mesh = body_of([*BODY, *limbs], 0.02)
    names = found(mesh)
    assert list(names) == PERSON
    tips = {"leg": {-1: foot}} | ({} if hand is None else {"arm": {-1: hand}})
    assert_joints(names, np.ptp(mesh.vertices[:, 1]), tips, 0.08)


def test_a_limb_that_is_not_found_is_reported():
    limbs = find_limbs(body_of(capsules("0 0 0  0 1e-6 0  1"), 0.1), np.eye(3))
    assert list(limbs.points) == ["trunk", "head"]
    assert ["legs" in note for note in limbs.notes] == [True, False]


@pytest.mark.parametrize(("scale", "image", "tolerance"), [(1.0, np.ones(3), 1e-9), (64.0, IMAGE, 0.03)])
def test_a_character_that_is_turned_moved_or_mirrored_with_vertices_in_another_order_has_the_same_limbs(
    person, whole, scale, image, tolerance
):
    turn, place = np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]]), (scale - 1) * np.array([0.1, -0.2, 0.3])
    order = np.random.default_rng(1).permutation(len(person.vertices))
    faces = np.argsort(order)[person.faces[:, :: int(image[0])]]
    vertices = scale * (person.vertices * image)[order] @ turn + place
    changed, limbs = found(SolverMesh(vertices, faces, np.arange(len(order))), turn), whole.points
    swapped = {"left": "right", "right": "left"} if image is IMAGE else {}
    expected = {name: limbs[" ".join(swapped.get(word, word) for word in name.split())] for name in limbs}
    assert_same(
        {name: (points - place) @ turn.T / scale * image for name, points in changed.items()}, expected, tolerance
    )


def test_a_person_cut_out_of_paper_has_the_same_limbs(person, whole):
    limbs, expected = found(weld(person.vertices * [1, 1, 0], person.faces)), whole.points
    assert list(limbs) == PERSON
    for name in PERSON:
        assert_allclose(limbs[name][:, :2], expected[name][:, :2], atol=0.12, err_msg=name)


CARD = np.array([(-1, 0, 0), (1, 0, 0), (1, 2, 0), (-1, 2, 0)], dtype=float)
NEEDLE = np.array([(0, 0, 0), (1, 0.3, 0.5), (1, 0.301, 0.5), (1, 0.3, 0.501)])


@pytest.mark.parametrize("vertices", [np.concatenate([CARD, CARD[:, ::-1]]), np.tile(NEEDLE, (2, 1))])
def test_cards_that_cross_and_needles_are_filled_where_their_vertices_are(vertices):
    faces = np.array([(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7)])
    solid = fill(vertices, faces, np.zeros(len(vertices), np.int32))
    away = np.abs(vertices[:, None] - solid.centers).max(axis=2).min(axis=1)
    assert away.max() < 0.501 * solid.size


def test_parts_that_overlap_are_one_body(whole):
    pieces = [body_of([limb], 0.03) for limb in FIGURE]
    mesh = weld(*joined(*((piece.vertices, piece.faces) for piece in pieces)))
    assert mesh.parts == len(FIGURE)
    limbs, expected = found(mesh), whole.points
    assert list(limbs) == PERSON
    for name in ("left leg", "right leg", "left arm", "right arm"):
        assert_allclose(limbs[name], expected[name], atol=0.12, err_msg=name)


@pytest.mark.parametrize("pairs", [3, 4])
def test_every_leg_of_a_body_with_many_is_a_limb_in_rows_from_the_front(pairs):
    rows = np.linspace(0.9, -0.9, pairs)
    knees, tips = ([np.array([x, y, far * z]) for z in rows] for x, y, far in ((0.8, 1.0, 1.0), (1.2, 0.05, 1.3)))
    legs = [(np.array([0.25, 0.6, 0.6 * z]), knee, 0.07) for z, knee in zip(rows, knees, strict=True)]
    legs += [(knee, tip, 0.06) for knee, tip in zip(knees, tips, strict=True)]
    legs += [(start * IMAGE, end * IMAGE, radius) for start, end, radius in legs]

    limbs = found(body_of([*capsules("0 0.6 -0.8  0 0.6 0.8  0.3\n0 0.6 0.8  0 0.65 1.25  0.2"), *legs]))

    for row, (knee, tip) in enumerate(zip(knees, tips, strict=True), 1):
        for side, image in (("left", 1), ("right", IMAGE)):
            points = limbs[f"{side} leg {row}"]
            assert np.linalg.norm(evenly(points, 200) - image * knee, axis=1).min() < 0.2
            assert np.linalg.norm(points[-1] - image * tip) < 0.15
            assert np.linalg.norm(points[0] - image * [0.15, 0.6, 0.6 * rows[row - 1]]) < 0.2
    assert sum("leg" in name for name in limbs) == 2 * pairs


def test_other_limbs_that_a_character_may_have_are_returned_with_their_probabilities(person, whole, monkeypatch):
    given = limb_finding.counted_bodies

    def counted(voted, inside):
        body = given(voted, inside)[0]
        return [
            replace(body, chance=0.6),
            *(replace(body, chance=chance, limbs=body.limbs | {"arm": []}) for chance in (0.3, 0.01)),
        ]

    monkeypatch.setattr(limb_finding, "counted_bodies", counted)
    limbs = find_limbs(person, np.eye(3))
    assert_same(limbs.points, whole.points, 1e-12)
    ((chance, chains),) = limbs.others
    assert chance == 0.3
    assert_same(Limbs(chains).points, {name: each for name, each in whole.points.items() if "arm" not in name}, 1e-12)
