"""Bodies that are made by rule: examples for `benchmarks.part_fitting` of plans that few public characters have.

Sizes, poses and what grows on a body are random.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchmarks.grown_bodies import (
    SIDES,
    Body,
    Points,
    cells,
    chain,
    ears,
    head,
    horns,
    leg,
    neck,
    straight,
    tail,
    trunk,
    wing,
)
from solver.anatomy.part_network import PARTS


def biped(body: Body, plump: float = 1.0) -> None:
    hip = body.between(0.2, 0.5)
    shoulder, width = hip + body.between(0.2, 0.38), plump * body.between(0.09, 0.2)
    trunk(body, (0, hip, 0), (0, shoulder, body.between(-0.04, 0.06)), width)
    radius = body.between(0.1, 0.28)
    way = (0, 1, body.between(-0.1, 0.25))
    skull, joints = head(body, (0, shoulder + 0.02, 0), way, 2 * radius * body.between(0.8, 1.1), radius)
    if body.happens(0.5):
        ears(body, skull, joints[3] - [0, 0.1 * radius, 0], radius, body.between(0.1, 0.35))
    if body.happens(0.4):  # a muzzle
        body.blob(skull, joints[2] + [0, -0.1 * radius, radius], 0.4 * radius)
    if body.happens(0.15):
        horns(body, skull, joints[2], radius)
    if body.happens(0.3):  # the brim of a hat
        body.blob(skull, joints[3], [1.5 * radius, 0.03, 1.5 * radius])
    thick, apart = plump * body.between(0.035, 0.1), width * body.between(0.5, 1.1)
    stride = body.between(-0.25, 0.25) if body.happens(0.3) else 0.0
    for side in SIDES:
        foot = (side * apart, 0.03 + 0.5 * thick, side * stride)
        toes = np.array([0.1 * side, -0.2, body.between(1.2, 2.5)]) * thick
        leg(body, (0.8 * side * apart, hip, 0), foot, (0, 0, body.between(0, 0.04)), thick, toes)
    _arms(body, width, shoulder, plump)
    if body.happens(0.35):
        length, radii = body.between(0.12, 0.6), (body.between(0.02, 0.08), body.between(0.01, 0.05))
        tail(body, (0, hip, -0.9 * width), (0, body.between(-0.6, 0.6), -1), length, radii, 0.5)
    if body.happens(0.15):
        span, chord, rise = body.between(0.3, 0.9), body.between(0.08, 0.2), body.between(-0.2, 0.8)
        for side in SIDES:
            wing(body, (0.05 * side, shoulder - 0.05, -width), span, chord, [(side, rise, -0.4)] * 3, 0.12)


def _arms(body: Body, width: float, shoulder: float, plump: float, ahead: float = 0.0) -> None:
    length, thick = body.between(0.15, 0.45) / plump, plump * body.between(0.025, 0.075)
    alike, way, beyond = body.happens(0.7), np.zeros(3), np.zeros(3)
    pose = int(body.rng.integers(5))
    for side in SIDES:
        if not way.any() or not alike:
            hanging, aside = (body.between(0.1, 0.5), -1, body.between(-0.1, 0.3)), (1, body.between(-0.3, 0.3), 0)
            forwards, raised = (0.3, -1, body.between(0.3, 1.2)), (body.between(0.3, 1), body.between(0.2, 1.2), 0.1)
            way = np.array([hanging, aside, forwards, raised, (0.25, -1, 0.1)][pose], float)
            bend = [body.between(-0.7, 0.2), body.between(-0.2, 0.6), body.between(0, 0.9)]
            beyond = way + bend if body.happens(0.6) else way
        image = np.array([side, 1, 1])
        ways, lengths = [way * image, beyond * image, beyond * image], [0.45 * length, 0.4 * length, 0.2 * length]
        joints = chain((0.9 * side * width, shoulder - 0.03, ahead), ways, lengths)
        body.limb("arm", joints, [1.2 * thick, thick, 0.8 * thick, thick * body.between(0.8, 1.5)])


def quadruped(body: Body, winged: bool = False) -> None:
    length, height, width = body.between(0.4, 0.9), body.between(0.2, 0.55), body.between(0.1, 0.22)
    back = height + 0.3 * width
    trunk(body, (0, back, -length / 2), (0, back + body.between(-0.03, 0.1), length / 2), width)
    root, way = np.array([0, height + 0.6 * width, length / 2 + 0.3 * width]), np.array([0, body.between(-0.1, 1.6), 1])
    if (reach := body.between(0, 0.5)) > 0.15:
        root = neck(body, root, way, reach, [0.7 * width, 0.55 * width, 0.5 * width, 0.45 * width])
    radius = body.between(0.07, 0.18)
    skull, joints = head(body, root, (0, body.between(-0.6, 0.6), 1), radius * body.between(1.8, 3.2), radius)
    _on_the_head(body, skull, joints[1] + [0, 0.7 * radius, 0], radius)
    for share in np.linspace(0, 1, 16) if body.happens(0.08) else ():  # an elephant's nose
        body.blob(skull, joints[3] + height * share * np.array([0, -0.8, 0.3]), 0.4 * radius * (1.2 - share))
    thick = body.between(0.03, 0.08)
    for place, bend in ((0.04 - length / 2, -0.03), (length / 2 - 0.04, 0.03)):
        apart, stride = width * body.between(0.5, 1.0), body.rng.normal(0, 0.06)
        for side in SIDES:
            foot = (side * apart * body.between(0.9, 1.2), 0.03, place + side * stride)
            toes = (0, -0.01, thick * body.between(0.8, 1.6))
            leg(body, (side * apart, height + 0.2 * width, place), foot, (0, 0, bend), thick, toes)
    if body.happens(0.85):
        root = np.array([0, height + 0.5 * width, -length / 2 - 0.6 * width])
        radii = (body.between(0.02, 0.1), body.between(0.01, 0.05))
        tail(body, root, (0, body.between(-1, 0.8), -1), body.between(0.12, 0.9), radii, 0.5)
    if winged:
        folded, span, chord = body.happens(0.3), body.between(0.5, 1.3), body.between(0.1, 0.25)
        for side in SIDES:
            away = [(0.3 * side, 1, -0.8), (0.2 * side, 0.2, -1), (0.1 * side, -0.2, -1)]
            spread = [
                (side, body.between(*rise), back)
                for *rise, back in ((0.2, 1, -0.1), (-0.2, 0.6, -0.3), (-0.5, 0.3, -0.5))
            ]
            root = (0.6 * side * width, height + 1.1 * width, 0.2 * length)
            wing(body, root, span, chord, away if folded else spread, body.between(0.06, 0.2))


def _on_the_head(body: Body, skull: int, top: Points, radius: float) -> None:
    if body.happens(0.7):
        ears(body, skull, top, radius, body.between(0.05, 0.25))
    if body.happens(0.2):
        horns(body, skull, top, radius)


def sprawler(body: Body) -> None:
    """Make a lizard, a crocodile or a turtle: legs to the side of a body near the ground."""
    length, width, height = body.between(0.3, 0.7), body.between(0.06, 0.2), body.between(0.02, 0.12)
    level, wide = height + width, body.between(1, 1.8)
    body.widen(trunk(body, (0, level, -length / 2), (0, level, length / 2), width), (1.0, wide, 1.0))
    root, radius = np.array([0, level, length / 2 + 0.4 * width]), width * body.between(0.5, 0.9)
    if (reach := body.between(0, 0.3)) > 0.15:
        way = np.array([0, body.between(-0.2, 0.8), 1])
        root = neck(body, root, way, reach, [0.7 * width, 0.6 * width, 0.5 * width, 0.5 * width])
    head(body, root, (0, body.between(-0.3, 0.3), 1), radius * body.between(2, 4), radius)
    thick, reach, out = body.between(0.02, 0.05), body.between(0.08, 0.25), body.between(0, 0.6)
    for place in (0.1 - length / 2, length / 2 - 0.05):
        forwards = body.between(-0.5, 0.7)
        for side in SIDES:
            hip = np.array([0.7 * side * width * wide, level - 0.2 * width, place])
            foot = hip + reach * np.array([side, 0, forwards + body.rng.normal(0, 0.15)])
            foot[1] = 0.02
            knee = np.array([0.2 * side * reach, out * reach, 0])
            leg(body, hip, foot, knee, thick, (0.3 * side * thick, -0.01, thick * body.between(1, 2.5)))
    if body.happens(0.9):
        root, radii = (0, level, -length / 2 - 0.4 * width), (0.7 * width * body.between(0.3, 1.1), 0.01)
        tail(body, root, (0, body.between(-0.3, 0.2), -1), body.between(0.08, 0.9), radii, 0.7)


def centaur(body: Body) -> None:
    quadruped(body)
    chest = body.limbs[0][1][-1]
    kept = [number for number, (part, _) in enumerate(body.limbs) if PARTS[part] != "head"]
    body.grown = [(kept.index(limb), *rest) for limb, *rest in body.grown if limb in kept]
    body.limbs = [body.limbs[number] for number in kept]
    shoulder, width = chest[1] + body.between(0.25, 0.4), body.between(0.07, 0.13)
    for share in np.linspace(0, 1, 10):
        body.blob(0, [0, chest[1] + share * (shoulder - chest[1]), chest[2]], [width, 0.06, 0.7 * width])
    radius = body.between(0.06, 0.1)
    head(body, (0, shoulder + 0.02, chest[2]), (0, 1, 0.1), 2.2 * radius, radius)
    _arms(body, width, shoulder, 1.0, chest[2])


def ghost(body: Body) -> None:
    """Make a body without legs: a ghost, a mermaid, a person in a long robe."""
    shoulder, width = body.between(0.4, 0.8), body.between(0.1, 0.22)
    trunk(body, (0, shoulder - 0.25, 0), (0, shoulder, 0), width)
    radius = body.between(0.1, 0.22)
    skull, joints = head(body, (0, shoulder + 0.02, 0), (0, 1, 0.1), 2 * radius, radius)
    if body.happens(0.3):
        ears(body, skull, joints[3] - [0, 0.1 * radius, 0], radius, body.between(0.1, 0.35))
    _arms(body, width, shoulder, body.between(1, 1.5))
    root = np.array([0, shoulder - 0.25 - 0.6 * width, 0])
    if body.happens(0.5):  # a robe
        wider = body.between(0.8, 2)
        for share in np.linspace(0, 1, 12):
            own = width * (1 + share * (wider - 1))
            body.blob(0, [0, root[1] * (1 - share) + 0.02, 0], [own, 0.05, own])
    else:
        away = body.between(0, 1.5)
        tail(body, root, (0, -1, -away), root[1] * body.between(0.8, 1.4), (0.9 * width, 0.2 * width), 0.3)


def bird(body: Body) -> None:
    width, tilt = body.between(0.12, 0.25), body.between(0, 1.3)
    way, length = np.array([0, np.sin(tilt), np.cos(tilt)]), width * body.between(1, 2.4)
    middle = np.array([0, body.between(0.12, 0.5) + width, 0])
    trunk(body, middle - way * length / 2, middle + way * length / 2, width)
    root = middle + way * (length / 2 + 0.4 * width)
    if (reach := body.between(0, 0.6)) > 0.2:
        radii = [0.5 * width, 0.35 * width, 0.3 * width, 0.3 * width]
        root = neck(body, root, np.array([0, 1, body.between(0, 1)]), reach, radii)
    radius = body.between(0.07, 0.18)
    skull, joints = head(body, root, (0, body.between(-0.2, 1), 1), 1.6 * radius, radius)
    for share in np.linspace(0, 1, 5):  # a beak
        place = joints[2] + radius * np.array([0, -0.1, 0.6 + share * body.between(0.8, 1.6)])
        body.blob(skull, place, 0.35 * radius * (1.1 - share))
    thick = body.between(0.012, 0.05)
    for side in SIDES:
        hip, foot = (
            middle + np.array([0.45 * side * width, -0.5 * width, 0]),
            (0.5 * side * width, 0.02, body.between(-0.03, 0.03)),
        )
        number = leg(body, hip, foot, (0, 0, -0.03), thick, (0, -0.01, body.between(0.05, 0.12)))
        body.blob(number, (0.5 * side * width, 0.015, 0.03), (0.05, 0.012, 0.06))
    folded, span, chord = body.happens(0.5), body.between(0.3, 0.9), body.between(0.07, 0.16)
    for side in SIDES:
        root = middle + way * 0.35 * length + [0.9 * side * width, 0.2 * width, 0]
        if folded:
            wing(body, root, length + width, 0.6 * width, [np.array([0.15 * side, -0.2, 0]) - way] * 3, 0.25)
        else:
            rises = ((-0.3, 0.9, 0.0), (-0.5, 0.5, -0.2), (-0.5, 0.3, -0.4))
            wing(body, root, span, chord, [(side, body.between(*rise), back) for *rise, back in rises], 0.15)
    if body.happens(0.8):
        joints = chain(
            middle - way * (length / 2 + 0.5 * width),
            [(0, body.between(-0.6, 0.5), -1)] * 3,
            [body.between(0.05, 0.17)] * 3,
        )
        body.limb("tail", joints, [0.05, 0.06, 0.07, body.between(0.05, 0.12)], 0.25)


def fish(body: Body) -> None:
    length, width, breadth = body.between(0.5, 0.8), body.between(0.08, 0.22), body.between(0.5, 1)
    number = body.limb(
        "trunk", straight((0, 0, -0.2 * length), (0, 0, 0.8 * length)), [0.8 * width, width, width, 0.8 * width]
    )
    body.widen(number, (1.0, breadth, 1.0))
    head(body, (0, 0, 0.8 * length), (0, 0, 1), 0.25 * length, 0.75 * width)
    level = body.happens(0.3)  # as whales have it
    end = tail(body, (0, 0, -0.2 * length), (0, 0, -1), 0.6 * length, (0.75 * width, 0.15 * width), 0.1)
    for share in np.outer(SIDES, np.linspace(0, 1, 8)).ravel():
        aside = np.array([0.2 * share, 0.0, -0.08 * abs(share)])
        radii = np.array([0.06, 0.02, 0.05])
        body.blob(
            len(body.limbs) - 1, end + (aside if level else aside[[1, 0, 2]]), radii if level else radii[[1, 0, 2]]
        )
    for share in np.linspace(0, 1, 7) if body.happens(0.8) else ():
        body.blob(number, (0, width + 0.12 * share, 0.1 - 0.1 * share), (0.02, 0.05, 0.07 * (1.1 - share)))
    if body.happens(0.75):
        drop, reach = body.between(-0.8, 0.3), body.between(0.15, 0.4)
        for side in SIDES:
            joints = chain((0.8 * side * width, -0.3 * width, 0.45 * length), [(side, drop, -0.6)] * 3, [reach / 3] * 3)
            body.limb("wing", joints, [0.04, 0.05, 0.05, 0.03], 0.3)


def crawler(body: Body, rows: int, claws: bool = False, winged: float = 0.0, wide: float = 1.0) -> None:
    """Make a spider, an insect, a crab or a scorpion."""
    height, width, length = body.between(0.08, 0.3), body.between(0.07, 0.16), body.between(0.2, 0.45)
    level = height + width
    body.widen(trunk(body, (0, level, -length / 2), (0, level, length / 2), width), (1.0, wide, 1.0))
    if wide == 1.0 or body.happens(0.5):
        radius = body.between(0.05, 0.13)
        head(body, (0, level, length / 2 + 0.6 * width), (0, body.between(-0.3, 0.3), 1), 1.8 * radius, radius)
    if wide == 1.0 and body.happens(0.7):
        root, radii = (0, level, -length / 2 - 0.4 * width), (body.between(0.03, 0.16), body.between(0.03, 0.13))
        tail(body, root, (0, body.between(-0.2, 0.6), -1), body.between(0.2, 0.8), radii, 0.6 if claws else 0.1)
    thick, reach, rise = body.between(0.012, 0.035), body.between(0.25, 0.6), body.between(0, 0.35)
    fan = np.linspace(-1, 1, rows) * body.between(0.6, 1.1)
    for place, forwards in zip(0.4 * length * np.linspace(-1, 1, rows), fan, strict=True):
        for side in SIDES:
            root = np.array([0.8 * side * width * wide, height + 0.8 * width, place])
            way = np.array([side, 0, forwards]) / np.hypot(1, forwards) * reach
            joints = root + np.outer([0, 0.35, 0.75, 1], way)
            joints[1:, 1] += [rise, 0.4 * rise - 0.3 * height, 0.01 - root[1]]
            body.limb("leg", joints, [1.3 * thick, thick, 0.8 * thick, 0.6 * thick])
    for side in SIDES if claws else ():
        lengths = np.array([0.45, 0.35, 0.3]) * body.between(0.2, 0.4)
        joints = chain(
            (0.9 * side * width, level, length / 2),
            [(side, 0.2, 0.7), (0.2 * side, 0.3, 1), (-0.3 * side, 0.1, 1)],
            lengths.tolist(),
        )
        body.limb("arm", joints, [0.025, 0.03, 0.05, 0.06])
    if body.happens(winged):
        span, chord, rise = body.between(0.3, 0.8), body.between(0.06, 0.15), body.between(0.1, 0.8)
        for side in SIDES:
            root = (0.4 * side * width, height + 1.9 * width, 0.2 * length)
            wing(body, root, span, chord, [(side, rise, body.between(-1.5, 0))] * 3, 0.15)


def octopus(body: Body) -> None:
    height, width, radius = body.between(0.1, 0.25), body.between(0.07, 0.16), body.between(0.13, 0.25)
    trunk(body, (0, height, -0.02), (0, height + 0.12, 0), width)
    head(body, (0, height + 0.14, 0), (0, 1, body.between(-0.4, 0.2)), 2 * radius, radius)
    rows, thick, reach = int(body.rng.integers(3, 5)), body.between(0.03, 0.06), body.between(0.25, 0.6)
    for angle in np.pi * (np.arange(rows) + 0.5) / rows:
        for side in SIDES:
            way = np.array([side * np.sin(angle), 0, np.cos(angle)])
            joints = np.array([0, height, 0]) + way * 0.8 * width + np.outer([0, 0.4, 0.75, 1], way * reach)
            joints[1:, 1] -= height * np.array([0.5, 0.9, 0.9]) - [0, 0, body.between(0, 0.15)]
            body.limb("leg", joints, [1.5 * thick, 1.1 * thick, 0.8 * thick, 0.4 * thick])


def snake(body: Body) -> None:
    along = np.linspace(-0.9, 0.6, 60)
    radius, wave = body.between(0.025, 0.07), body.between(0.02, 0.16)
    way = np.column_stack([wave * np.sin(along * body.between(4, 9) + body.between(0, 6)), np.full(60, radius), along])
    if body.happens(0.5):
        way[:, 1] += body.between(0, 0.5) * np.clip((along - 0.1) / 0.5, 0, 1) ** 2
    for part, points, end in (("tail", way[28::-1], 0.3 * radius), ("trunk", way[28:], radius)):
        number = len(body.limbs)
        body.limbs.append((PARTS.index(part), points[np.linspace(0, len(points) - 1, 4).round().astype(int)]))
        for point, each in zip(points, np.linspace(radius, end, len(points)), strict=True):
            body.blob(number, point, each)
    head(body, way[-1], (0, body.between(-0.3, 0.3), 1), 4 * radius, 1.5 * radius)


def wyvern(body: Body) -> None:
    width, height, length = body.between(0.08, 0.16), body.between(0.3, 0.5), body.between(0.25, 0.45)
    way, middle = np.array([0, body.between(0.2, 1), 1]), np.array([0, height, 0])
    way /= np.linalg.norm(way)
    trunk(body, middle - way * length / 2, middle + way * length / 2, width)
    root, rise = middle + way * (length / 2 + 0.3 * width), np.array([0, 1, body.between(0.3, 1.2)])
    root = neck(body, root, rise, body.between(0.12, 0.45), [0.6 * width, 0.45 * width, 0.4 * width, 0.4 * width])
    head(body, root, (0, body.between(-0.4, 0.3), 1), body.between(0.12, 0.3), body.between(0.05, 0.09))
    thick = body.between(0.03, 0.07)
    for side in SIDES:
        hip, foot = (0.8 * side * width, height - 0.2 * width, -0.15 * length), (1.1 * side * width, 0.03, 0)
        leg(body, hip, foot, (0, 0, 0.05), thick, (0, -0.01, 0.08))
    root = middle - way * (length / 2 + 0.4 * width)
    tail(body, root, (0, body.between(-0.6, 0.3), -1), body.between(0.4, 1), (0.6 * width, 0.02), 0.5)
    winged, span, chord = body.happens(0.8), body.between(0.5, 1.2), body.between(0.1, 0.25)
    for side in SIDES:
        if winged:
            rises = ((0, 1.2, -0.2), (-0.3, 0.6, -0.3), (-0.8, 0.2, -0.5))
            ways = [(side, body.between(*rise), back) for *rise, back in rises]
            wing(
                body,
                (0.7 * side * width, height + 0.7 * width, 0.2 * length),
                span,
                chord,
                ways,
                body.between(0.06, 0.2),
            )
        else:  # a raptor's arms
            root, ways = (
                (0.8 * side * width, height + 0.2 * length, 0.4 * length),
                [(0.4 * side, -1, 0.5), (0, -0.2, 1), (0, 0, 1)],
            )
            body.limb("arm", chain(root, ways, [0.08, 0.07, 0.04]), [0.03, 0.025, 0.02, 0.02])


def lump(body: Body) -> None:
    """Make a shape without limbs: a ball, an egg, a stone."""
    body.limbs.append((PARTS.index("trunk"), straight((0, -0.3, 0), (0, 0.3, 0))))
    uneven = body.between(0, 0.4)
    for place in (0.0, 0.3)[: 1 + body.happens(0.3)]:
        center = [body.between(-place, place) for _ in range(3)]
        body.blob(0, center, [0.5 + body.between(-uneven, uneven) / 2 for _ in range(3)])


PLANS: dict[str, Callable[[Body], None]] = {
    "biped": biped,
    "toy": lambda body: biped(body, plump=1.5),
    "quadruped": quadruped,
    "dragon": lambda body: quadruped(body, winged=True),
    "bird": bird,
    "fish": fish,
    "spider": lambda body: crawler(body, rows=4),
    "insect": lambda body: crawler(body, rows=3, winged=0.6),
    "crab": lambda body: crawler(body, rows=4, claws=True, wide=1.4),
    "scorpion": lambda body: crawler(body, rows=4, claws=True),
    "octopus": octopus,
    "snake": snake,
    "wyvern": wyvern,
    "sprawler": sprawler,
    "centaur": centaur,
    "ghost": ghost,
    "lump": lump,
}


def made(plan: str, rng: np.random.Generator) -> tuple[Points, Points, NDArray[np.int64], list[tuple[int, Points]]]:
    """Make a body.

    Returns
    -------
    cells : (n, 3) float64
    depths : (n,) float64
    limbs : (n,) int64
        Number of the limb of each cell.
    parts : list of (int, (4, 3) float64)
        Part and joints of each limb.
    """
    body = Body(rng)
    PLANS[plan](body)
    return *cells(body), body.limbs
