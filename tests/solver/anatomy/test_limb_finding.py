import re

import numpy as np
import pytest
from numpy.testing import assert_allclose

from solver.anatomy.limb_finding import _Finder, find_limbs
from solver.anatomy.solid import fill
from solver.surface.mesh import SolverMesh, weld

from ..shapes import body_of, joined

IMAGE = np.array([-1.0, 1.0, 1.0])
PERSON = ["trunk", "head", "left arm", "right arm", "left leg", "right leg"]
FOUR_LEGGED = ["left hind leg", "right hind leg", "left front leg", "right front leg"]

SHOULDER, ELBOW, HAND = (0.25, 1.45, 0.0), (0.55, 1.15, 0.0), (0.8, 0.85, 0.25)
HIP, KNEE, ANKLE, TOES = (0.15, 0.85, 0.0), (0.17, 0.45, 0.05), (0.18, 0.08, 0.0), (0.18, 0.06, 0.22)


def both(*limbs):
    return [*limbs, *((tuple(IMAGE * start), tuple(IMAGE * end), radius) for start, end, radius in limbs)]


BODY = [((0.0, 0.9, 0.0), (0.0, 1.35, 0.0), 0.18), ((0.0, 1.4, 0.0), (0.0, 1.6, 0.0), 0.07)]
SKULL = ((0.0, 1.72, 0.0), (0.0, 1.76, 0.02), 0.13)
ARM = [((0.1, 1.42, 0.0), SHOULDER, 0.09), (SHOULDER, ELBOW, 0.055), (ELBOW, HAND, 0.05)]
LEG = [(HIP, KNEE, 0.08), (KNEE, ANKLE, 0.06), (ANKLE, TOES, 0.05)]
FIGURE = [*BODY, SKULL, *both(*ARM, *LEG)]
DOG = [
    ((0.0, 1.0, -1.0), (0.0, 1.0, 1.0), 0.30),
    ((0.0, 1.0, 1.0), (0.0, 1.7, 1.5), 0.16),
    ((0.0, 1.7, 1.5), (0.0, 1.65, 1.9), 0.19),
    *both(((0.2, 1.0, 0.9), (0.25, -0.2, 0.9), 0.12), ((0.2, 1.0, -0.9), (0.25, -0.2, -0.9), 0.12)),
    ((0.0, 1.0, -1.0), (0.0, 1.5, -1.9), 0.09),
]


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


STOUT = [((0.0, 0.95, 0.0), (0.0, 1.35, 0.0), 0.18), *BODY[1:], SKULL]
"""A body whose hips are axles."""
HIP_BELOW_AXLE, KNEE_BELOW_AXLE, POINT = (0.3, 0.85, 0.0), (0.3, 0.45, 0.05), (0.3, 0.02, -0.1)
THIN_ELBOW, WRIST, FINGERS = (0.7, 1.43, 0.0), (1.19, 1.43, 0.0), (1.3, 1.43, 0.0)


@pytest.mark.parametrize(
    ("limbs", "wanted", "within"),
    [
        (  # as of robots of plates: their first bone is no axle, and the point is the end of a shin, not of a foot
            [
                *STOUT,
                *both(*ARM, ((0.0, 0.9, 0.0), (0.3, 0.88, 0.0), 0.06)),
                *both((HIP_BELOW_AXLE, KNEE_BELOW_AXLE, 0.08), (KNEE_BELOW_AXLE, POINT, 0.04)),
            ],
            {"leg": {0: HIP_BELOW_AXLE, 1: KNEE_BELOW_AXLE, 3: POINT}},
            0.05,
        ),
        (
            [
                *BODY,
                SKULL,
                *both(((0.1, 1.42, 0.0), (0.6, 1.43, 0.0), 0.08), ((0.6, 1.43, 0.0), THIN_ELBOW, 0.035)),
                *both((THIN_ELBOW, WRIST, 0.035), ((0.85, 1.43, 0.0), FINGERS, 0.11), *LEG),
            ],
            {"arm": {1: THIN_ELBOW, 2: WRIST}},
            0.032,
        ),
    ],
    ids=["straight legs on axles that end in points", "arms thinnest at the elbow"],
)
def test_hips_are_below_axles_and_wrists_beyond_thin_elbows(limbs, wanted, within):
    mesh = body_of(limbs)
    assert_joints(found(mesh), np.ptp(mesh.vertices[:, 1]), wanted, within)


def test_joints_of_a_figure_are_where_it_was_made(person, whole):
    limbs = whole.points
    assert list(limbs) == PERSON
    height = np.ptp(person.vertices[:, 1])
    wanted = {"arm": numbered(SHOULDER, ELBOW), "leg": numbered(HIP, KNEE, ANKLE, TOES)}
    assert_joints(limbs, height, wanted, 0.06)
    assert_allclose(limbs["left arm"][-1], HAND, atol=0.06 * height)
    assert_allclose(limbs["trunk"][0], (limbs["left leg"][0] + limbs["right leg"][0]) / 2)
    assert_allclose(limbs["trunk"][-1], limbs["head"][0])
    assert_allclose(limbs["head"][-1], (0, 1.88, 0.02), atol=0.03 * height)


DOGS = ["trunk", "neck", "head", *FOUR_LEGGED, "tail"]
WINGS = both(((0.1, 1.2, 0.2), (1.5, 2.4, -0.1), 0.1))
RIDERS_LEGS = both(((0.15, 1.5, 0.0), (0.45, 1.2, 0.3), 0.1), ((0.45, 1.2, 0.3), (0.45, 0.7, 0.2), 0.08))
RIDER = [((0.0, 1.5, -0.1), (0.0, 2.1, -0.1), 0.2), ((0.0, 2.1, -0.1), (0.0, 2.55, -0.1), 0.16), *RIDERS_LEGS]
RAISED = [
    *(both(ARM[0])),
    *ARM[1:],
    (tuple(IMAGE * SHOULDER), (-0.3, 1.85, 0.0), 0.055),
    ((-0.3, 1.85, 0.0), (-0.12, 2.2, 0.05), 0.05),
]
STRIDE = [((0.15, 0.85, 0.0), (0.17, 0.1, 0.45), 0.07), ((-0.15, 0.85, 0.0), (-0.17, 0.1, -0.45), 0.07)]
TAIL = [((0.0, 0.9, -0.1), (0.0, 0.35, -0.7), 0.09), ((0.0, 0.35, -0.7), (0.0, 0.12, -1.5), 0.06)]
FISH = [
    ((0.0, 1.0, -0.5), (0.0, 1.0, 0.7), 0.4),
    ((0.0, 1.0, 0.7), (0.0, 1.0, 1.2), 0.2),
    ((0.0, 1.0, -0.5), (0.0, 1.0, -1.4), 0.14),
    ((0.0, 1.0, -1.4), (0.0, 1.45, -1.8), 0.07),
    ((0.0, 1.0, -1.4), (0.0, 0.8, -1.65), 0.07),
    *both(((0.3, 0.85, 0.4), (0.85, 0.5, 0.2), 0.07)),
]
TAPERING = [
    ((0.0, 1.0, -1.0 - 1.8 * share), (0.0, 1.0, -1.06 - 1.8 * share), 0.28 * (1 - share) + 0.02)
    for share in np.linspace(0.0, 1.0, 31)
]
DOG_ENDS = {
    "left hind leg": (0.25, -0.2, -0.9),
    "right hind leg": (-0.25, -0.2, -0.9),
    "left front leg": (0.25, -0.2, 0.9),
    "right front leg": (-0.25, -0.2, 0.9),
}


@pytest.mark.parametrize(
    ("limbs", "names", "ends", "within"),
    [
        (DOG, DOGS, {"tail": (0, 1.5, -1.9)} | DOG_ENDS, 0.15),
        ([*DOG[:-1], *TAPERING], DOGS, {"tail": (0.0, 1.0, -2.86)} | DOG_ENDS, 0.15),
        ([*DOG, *WINGS], None, {"left wing": (1.5, 2.4, -0.1), "right wing": (-1.5, 2.4, -0.1)} | DOG_ENDS, 0.15),
        ([*DOG, *RIDER], DOGS, {}, 0),
        ([*BODY, SKULL, *RAISED, *both(*LEG)], PERSON, {"head": (0, 1.88, 0.02), "right arm": (-0.12, 2.2, 0.05)}, 0.1),
        (
            [*BODY, SKULL, *both(*ARM), *STRIDE],
            PERSON,
            {"left leg": (0.17, 0.08, 0.47), "right leg": (-0.17, 0.08, -0.47)},
            0.1,
        ),
        ([*FIGURE, *TAIL], [*PERSON, "tail"], {"tail": (0, 0.12, -1.5), "left leg": TOES}, 0.1),
        (
            FISH,
            ["trunk", "neck", "head", "left arm", "right arm", "tail"],
            {"head": (0, 1, 1.4), "left arm": (0.85, 0.5, 0.2), "tail": (0, 1.45, -1.8)},
            0.15,
        ),
    ],
    ids=[
        "dog",
        "tapering tail",
        "wings",
        "rider",
        "raised hand",
        "long stride",
        "tail on the ground",
        "fish, with its fins as arms",
    ],
)
def test_limbs_of_a_shape_end_where_they_were_made(limbs, names, ends, within):
    result = found(body_of(limbs, 0.05 if DOG[0] in limbs else 0.035))
    assert names in (None, list(result))
    for name, end in ends.items():
        assert_allclose(result[name][-1], end, atol=within, err_msg=name)


EARS = {"left ear": (0.5, 2.3, 1.7), "right ear": (-0.5, 2.3, 1.7), "jaw": (0.0, 1.5, 2.0)}


@pytest.mark.parametrize(
    ("limbs", "ends", "within"),
    [
        ([*DOG, *both(((0.1, 1.75, 1.6), (0.5, 2.3, 1.7), 0.06))], EARS, 0.1),
        (
            [*FIGURE, *both(((0.1, 1.2, -0.05), (1.0, 1.9, -0.5), 0.05))],
            {"left arm": (1.0, 1.9, -0.5), "right arm": (-1.0, 1.9, -0.5)},
            0.1,
        ),
        ([*DOG, *WINGS], {"head": (0.0, 1.7, 1.9)}, 0.2),
    ],
    ids=["ears and a jaw", "a second pair of arms", "the head of a bird"],
)
def test_limbs_that_the_user_gives_take_precedence(limbs, ends, within):
    mesh = body_of(limbs, 0.05 if DOG[0] in limbs else 0.035)
    result = found(mesh, ends={name: np.array(end) for name, end in ends.items()})
    for name, end in ends.items():
        assert_allclose(result[name][-1], end, atol=within)
    if ends is EARS:
        assert list(result)[-3:] == list(ends)
        assert [len(result[name]) for name in ends] == [3, 3, 2]


def test_ears_and_horns_are_neither_arms_nor_wings(whole):
    ears = both(((0.08, 1.8, 0.0), (0.35, 2.2, 0.0), 0.06))
    assert_same(
        {name: points for name, points in found(body_of([*FIGURE, *ears])).items() if name != "head"},
        {name: points for name, points in whole.points.items() if name != "head"},
        0.06,
    )
    horns = both(((0.1, 1.75, 1.6), (0.5, 2.3, 1.7), 0.06))
    assert not {"left wing", "left arm"} & found(body_of([*DOG, *horns], 0.05)).keys()
    wide = both(((0.1, 1.75, 1.35), (0.7, 2.6, 1.1), 0.08))
    assert list(found(body_of([*DOG, *wide], 0.05))) == DOGS


@pytest.mark.parametrize(("away", "left"), [(0.05, ["left wing", "right wing"]), (0.1, ["left arm", "left wing"])])
def test_an_arm_along_a_wing_is_an_edge_of_it(person, away, left):
    """The curves inside a penguin's flipper lead along both of its edges."""
    finder = _Finder(person, np.eye(3), {})
    way = np.array([[0.2, 1.4, 0.0], [0.5, 1.2, 0.0], [0.8, 1.0, 0.0]])
    beside = way[:2] + np.array([0, 0, away * finder.unit])
    limbs = {
        f"{side} {name}": points for side in ("left", "right") for name, points in (("arm", beside), ("wing", way))
    }
    assert list(finder._without_edges(limbs))[:2] == left


def test_ears_above_all_are_no_head():
    body = [((0.0, 0.4, -0.3), (0.0, 0.5, 0.0), 0.45), ((0.0, 1.1, 0.4), (0.0, 1.15, 0.4), 0.35)]
    ears = both(((0.1, 1.4, 0.4), (0.35, 2.5, 0.4), 0.08))
    limbs = find_limbs(body_of([*body, *ears], 0.05), np.eye(3))
    assert list(limbs.points) == ["trunk", "head"]
    assert_allclose(limbs.points["head"][-1], (0, 1.3, 0.4), atol=0.3)


def test_a_doubtful_head_is_said():
    two_heads = [
        limb
        for x, y, z in ((0.25, 1.7, 0.0), (-0.2, 1.82, -0.25))
        for limb in [((0.0, 1.3, 0.0), (x, y - 0.05, z), 0.07), ((x, y, z), (x, y + 0.04, z + 0.02), 0.13)]
    ]
    limbs = find_limbs(body_of([BODY[0], *two_heads, *both(*ARM, *LEG)]), np.eye(3))
    said = re.fullmatch(
        r"The head could be at (\S+) or at (\S+): the first was taken. If that is wrong: --limb 'head=(\S+)'",
        next(note for note in limbs.notes if note.startswith("The head")),
    )
    first, second, given = (np.array(place.split(","), float) for place in said.groups())
    assert_allclose(second, given)
    assert_allclose([first[0], second[0]], [0.25, -0.25], atol=0.15)


def test_arms_in_the_body_go_straight_to_where_the_user_says():
    body = [*BODY, SKULL, *both(*LEG), *both(((0.1, 1.35, 0.0), (0.12, 0.95, 0.0), 0.16))]
    hand = np.array([0.22, 0.95, 0.1])
    ends = {"left arm": hand, "right arm": hand * IMAGE}
    limbs = find_limbs(body_of(body), np.eye(3), ends).points
    arm = limbs["left arm"]
    assert_allclose(arm[-1], hand, atol=0.04)
    assert_allclose(np.linalg.norm(np.cross(arm - arm[0], arm[-1] - arm[0]), axis=1), 0, atol=1e-9)
    assert 0.1 < arm[0][0] < 0.28
    assert 1.15 < arm[0][1] < 1.5
    assert_allclose(limbs["right arm"], arm * IMAGE, atol=0.05)


HANDS_DOWN = [((0.1, 1.42, 0.0), SHOULDER, 0.09), (SHOULDER, (0.6, 0.05, 0.0), 0.06)]
GUN = [((0.5, 1.2, 0.15), (0.55, -0.25, 0.15), 0.05)]
SLENDER = [(SHOULDER, (0.55, 1.43, 0.0), 0.045), ((0.55, 1.43, 0.0), (0.95, 1.4, 0.0), 0.026)]

SLEEVE = [((0.1, 1.42, 0.0), (0.45, 1.43, 0.0), 0.09), ((0.45, 1.43, 0.0), (0.95, 1.4, 0.0), 0.035)]
WIDE_FOOT = [((0.12, 0.9, 0.0), (0.28, 0.1, 0.0), 0.08), ((0.09, 0.06, 0.0), (0.5, 0.06, 0.0), 0.06)]
"""A leg that ends in a block which is wider than long."""

LOOSE_SHOES = [
    *both((HIP, KNEE, 0.08), (KNEE, (0.18, 0.25, 0.0), 0.06), ((0.12, 0.06, -0.02), (0.18, 0.06, 0.22), 0.06)),
    *(((-0.18, 0.25, 0.0), (-0.15, 0.06, 0.0), 0.06), ((-0.12, 0.06, 0.0), (0.12, 0.06, 0.0), 0.06)),
]
CHIBI = [
    *(((0.0, 0.35, 0.0), (0.0, 0.45, 0.0), 0.16), ((0.0, 0.45, 0.0), (0.0, 0.65, 0.0), 0.08)),
    *(((0.0, 0.85, 0.0), (0.0, 0.87, 0.0), 0.3), ((0.0, 1.1, 0.0), (0.0, 1.6, 0.0), 0.08)),
    *both(((0.1, 0.5, 0.0), (0.5, 0.3, 0.0), 0.06), ((0.1, 0.3, 0.0), (0.14, 0.05, 0.0), 0.08)),
    *both(((0.2, 0.95, 0.0), (0.8, 1.15, 0.0), 0.07)),
]


@pytest.mark.parametrize(
    ("limbs", "feet", "hands"),
    [
        ([*BODY, SKULL, *both(*HANDS_DOWN, *LEG)], [TOES, IMAGE * TOES], [(0.6, 0.05, 0.0), (-0.6, 0.05, 0.0)]),
        ([*FIGURE, *GUN], [TOES, IMAGE * TOES], None),
        (
            [
                *BODY,
                SKULL,
                *both(*ARM),
                *(((-0.1, 0.9, 0.0), (-0.05, 0.0, 0.45), 0.08), ((-0.1, 0.9, 0.0), (-0.2, 0.0, -0.4), 0.08)),
            ],
            [(-0.05, 0.0, 0.45), (-0.2, 0.0, -0.4)],
            None,
        ),
        ([*BODY, SKULL, *both(*ARM[:1], *SLENDER, *LEG)], [TOES, IMAGE * TOES], [(0.95, 1.4, 0.0), (-0.95, 1.4, 0.0)]),
        ([*BODY, SKULL, *both(*SLEEVE, *LEG)], [TOES, IMAGE * TOES], [(0.95, 1.4, 0.0), (-0.95, 1.4, 0.0)]),
        ([*BODY, SKULL, *both(*ARM), *LOOSE_SHOES], [TOES, IMAGE * TOES], None),
        (CHIBI, None, [(0.5, 0.3, 0.0), (-0.5, 0.3, 0.0)]),
        ([*BODY, SKULL, *both(*ARM, *WIDE_FOOT)], [(0.28, 0.0, 0.0), (-0.28, 0.0, 0.0)], None),
    ],
    ids=[
        *("hands on the ground", "a gun below the feet", "a stride beside the middle", "slender forearms"),
        *("forearms beyond wide sleeves", "shoes that touch", "a big head with a hat", "wide feet"),
    ],
)
def test_legs_end_at_the_feet_and_arms_at_the_hands(limbs, feet, hands):
    mesh = body_of(limbs, 0.02)
    names = found(mesh)
    assert list(names) == PERSON
    height = np.ptp(mesh.vertices[:, 1])
    for limb, ends in (("leg", feet), ("arm", hands)):
        for side, end in zip(("left", "right"), ends or (), strict=False):
            assert np.linalg.norm(names[f"{side} {limb}"][-1] - end) < 0.08 * height, (side, limb)


def test_a_sword_is_left_out_of_the_arm_and_said(whole):
    point = np.add(HAND, (0.1, -0.1, 1.3))
    armed = find_limbs(body_of([*FIGURE, (HAND, tuple(point), 0.02)], 0.02), np.eye(3))
    assert len(armed.notes) == 1
    assert armed.notes[0].startswith("Something long and thin at the end of the left arm is not part of it.")
    assert "--limb 'left arm=" in armed.notes[0]
    assert_allclose(armed.points["left arm"][-1], whole.points["left arm"][-1], atol=0.12)
    assert whole.notes == ()


def test_a_limb_that_is_not_found_is_reported():
    limbs = find_limbs(body_of([((0.0, 0.0, 0.0), (0.0, 1e-6, 0.0), 1.0)], 0.1), np.eye(3))
    assert list(limbs.points) == ["trunk", "head"]
    assert ["legs" in note for note in limbs.notes] == [True, False]


@pytest.mark.parametrize(("scale", "image", "tolerance"), [(1.0, np.ones(3), 1e-9), (64.0, IMAGE, 0.02)])
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


@pytest.mark.parametrize("pairs", [3, 6])
def test_every_leg_of_a_body_with_many_is_a_limb_in_rows_from_the_front(pairs):
    rows = np.linspace(0.9, -0.9, pairs)
    knees, tips = ([np.array([x, y, far * z]) for z in rows] for x, y, far in ((0.8, 1.0, 1.0), (1.2, 0.05, 1.3)))
    legs = [((0.25, 0.6, 0.6 * z), tuple(knee), 0.07) for z, knee in zip(rows, knees, strict=True)]
    legs += [(tuple(knee), tuple(tip), 0.06) for knee, tip in zip(knees, tips, strict=True)]
    body = [((0.0, 0.6, -0.8), (0.0, 0.6, 0.8), 0.3), ((0.0, 0.6, 0.8), (0.0, 0.65, 1.25), 0.2)]

    limbs = found(body_of([*body, *both(*legs)]))

    for row, (knee, tip) in enumerate(zip(knees, tips, strict=True), 1):
        for side, image in (("left", 1), ("right", IMAGE)):
            points = limbs[f"{side} leg {row}"]
            assert np.linalg.norm(points[1] - image * knee) < 0.15
            assert np.linalg.norm(points[-1] - image * tip) < 0.15
            assert np.linalg.norm(points[0] - image * [0.15, 0.6, 0.6 * rows[row - 1]]) < 0.15
    assert sum("leg" in name for name in limbs) == 2 * pairs


def test_a_single_leg_beside_two_arms_is_not_taken_for_a_pair(person):
    finder = _Finder(person, np.eye(3), {})
    del finder.legs["right leg"]
    limbs = finder.limbs().keys()
    assert {"left leg", "left arm", "right arm"} <= limbs
    assert "right leg" not in limbs
