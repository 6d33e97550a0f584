"""Points of limbs on the joints of a skeleton whose body is decided."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray

from engine_bridge.puppet.joint_graph import JointGraph
from engine_bridge.puppet.limb_shapes import ARM, END_SHARE, LEG, LimbShape
from solver.anatomy.body_decision import Body
from solver.anatomy.body_graph import LABELS, Pair
from solver.anatomy.limb_chain import evenly, leg_names
from solver.motion.limbs import distance_from_segment

MIN_TRUNK_SHARE = 1e-3
"""Minimum length of a trunk, as a share of the body's size."""

MIN_NECK_SHARE = 0.3
"""Minimum length of a neck that is a separate limb, as a share of the trunk's length."""

GIRDLE_COSINE = np.cos(np.pi / 4)
"""Cosine of the largest angle between the left-right direction and a bone that leads from the spine to a leg."""

LYING_COSINE = np.cos(np.radians(45))
"""Cosine of the angle between spine and up below which a body may be four-legged."""

MAX_HAND_HEIGHT_SHARE = 0.3
"""Maximum height of the ends of forelegs, as a share of the height of the shoulders."""

MIN_LEG_BONE_SHARE = 0.08
"""Minimum length of the bones of a leg below the third joint, as a share of the leg's length."""

HEAD_PARTS = ("neck", "head", "ear", "eye", "jaw", "face")
"""Parts below the head that count for its size."""

HEAD_SHARE = 0.3
"""Minimum height of a head without a joint above the shoulders, as a share of the trunk's length."""

MAX_WITHIN_SHARE = 0.05
"""Maximum distance from the trunk, in its lengths, of the joint of a head that begins where the trunk ends."""

MANY_PAIRS = 3
"""Number of pairs of legs from which they are rows."""

MIN_SPINE_JOINTS = 4
"""Minimum number of joints in a row without branches that is the spine of a body without legs, such as a fish."""

MAX_TIP_DISTANCE = 0.4
"""Maximum distance of a limb's end from the nearest vertex that follows it, as a share of the distance from its last
joint."""

RIGID_END_SHARE = 0.1
"""Length of the end of a rigid part, as a share of the part's."""

RIGID_KNEE_SHARE = 0.9
"""Place of the knee of a leg that is one part above a foot, as a share of the leg: it follows the thigh, and the foot
stays at its end."""

AROUND_SHARE = 0.3
"""Maximum distance of a joint from the middle of vertices that are all around it, and how far they reach beyond it at
least, as shares of their extent."""

MIDDLE_SHARE = 0.02
"""Maximum distance between the first joints of a pair that are in the middle of a body, as a share of its size."""

GIRDLE_ASIDE = 0.4
"""Minimum share of a bone to the side, with which it leads from the middle of the body to a limb."""

BACK_COSINE = -0.5
"""Cosine between the last two bones of a limb below which the last joint is at its end."""

GAP_SHARES = 0.1, 0.5
"""Distances of the only joint of a limb from its vertices, as shares of that from the end, between which the limb
begins at the vertices."""

MAX_TRIED = 16
"""About how many joints of a limb are tried as its three: their number grows with the third power."""


@dataclass(frozen=True, eq=False)
class JointChain:
    """Points (k, 3) of a limb, and the nodes on it, both root to tip; the trunk's are those above other limbs."""

    points: NDArray[np.float64]
    nodes: Sequence[int] = ()


class LimbReader:
    """Places the points of limbs on the joints of the branches that were chosen."""

    def __init__(self, graph: JointGraph, body: Body, rigid: bool) -> None:
        self.rigid = rigid
        self.graph, self.joints, self.meanings, self.body = graph.graph, graph.joints, graph.meanings, body
        self.ways = {node: way for _, pair in body.pairs for node, way in self._outside(pair).items()}

    def limbs(self) -> dict[str, JointChain]:
        """Return the points of each limb by its name, each after its parent."""
        found, lies = self.arms_and_legs()
        paired = any(limb in found for limb in ("left arm", "left leg", "left hind leg", "left leg 1"))
        wings = self.curved_pair("wing")
        head, tail = (self.body.singles.get(label, []) for label in ("head", "tail"))
        named = head and (self.said("tail", tail) or (self.said("head", head) and not self.rigid))
        if not paired and not wings and not named:
            return self.spine()
        trunk = self.trunk(found | wings, head, tail)
        if trunk is None:
            return {}
        limbs = {"trunk": trunk} | self.head(trunk, head, found, lies or not paired)
        if "head" in limbs:
            limbs |= self.curved_pair("ear") | self.jaw()
        elif not head and "left arm" in found and not lies:
            limbs |= self.head_of_trunk(trunk)
        ordered = sorted(found, key=lambda name: (-_rank(name), name))
        limbs |= {name: found[name] for name in ordered}
        if tail:
            limbs["tail"] = self.curved(self.told("tail", tail), 3)
        return limbs | wings

    def _outside(self, pair: Pair) -> dict[int, list[int]]:
        """Return the ways of a pair without first joints in the middle of the body: what follows those is the trunk."""
        ways = [self.graph.ways[node] for node in (pair.one, pair.other)]
        while min(map(len, ways)) > 1 and all(map(self._is_girdle, ways)):
            if abs((self.place(ways[0][0]) - self.place(ways[1][0])) @ self.body.left) > MIDDLE_SHARE * self.graph.size:
                break
            ways = [way[1:] for way in ways]
        return dict(zip((pair.one, pair.other), ways, strict=True))

    def _is_girdle(self, way: Sequence[int]) -> bool:
        """Return whether a first joint only leads aside, to what has vertices."""
        aside = abs(_unit(self.place(way[1]) - self.place(way[0])) @ self.body.left) > GIRDLE_ASIDE
        return (aside or not len(self.joints[way[0]].vertices)) and any(
            len(self.joints[node].vertices) for node in way[1:]
        )

    def said(self, label: str, way: Sequence[int]) -> bool:
        """Return whether a name on a way says a label."""
        return bool(len(way) and self.graph.votes[list(way), LABELS.index(label)].any())

    def told(self, label: str, way: Sequence[int]) -> list[int]:
        """Return the part of a way from the first joint on whose name says a label; all of it if none does."""
        column = LABELS.index(label)
        told = [row for row, node in enumerate(way) if self.graph.votes[node, column] and self.part(node) != "shoulder"]
        return list(way[told[0] :]) if told else list(way)

    def part(self, node: int) -> str | None:
        """Return the part of a body that a node's name says."""
        meaning = self.meanings[node]
        return meaning.part if meaning else None

    def arms_and_legs(self) -> tuple[dict[str, JointChain], bool]:
        """Return arms and legs by their names, and whether the arms are legs or there are rows of legs."""
        legs = sorted((pair for label, pair in self.body.pairs if label == "leg"), key=self._ahead)
        arms = self.sides(self.rows_of("arm"), self.arm)
        rows = dict(zip(leg_names(len(legs)), legs, strict=True))
        if len(legs) >= MANY_PAIRS:
            return self.sides(rows, self.row_leg) | arms, True
        if len(legs) == 2:
            found = self.sides(rows, self.leg)
            if arms or self._stands_on(found, "front leg", "hind leg"):
                return found | arms, True
            return self.sides({"leg": legs[0]}, self.upright_leg) | self.sides({"arm": legs[1]}, self.arm), False
        found = self.sides(rows, self.upright_leg) | arms
        if legs and arms and self._stands_on(found, "arm", "leg"):
            walking = self.sides({"hind leg": legs[0], "front leg": self.rows_of("arm")["arm"]}, self.leg)
            return walking | {name: arm for name, arm in arms.items() if not name.endswith("arm")}, True
        return found, False

    def rows_of(self, label: str) -> dict[str, Pair]:
        """Return the pairs of a label by their names: "arm", "arm 2"."""
        pairs = [pair for own, pair in self.body.pairs if own == label]
        return {label + (f" {row}" if row > 1 else ""): pair for row, pair in enumerate(pairs, 1)}

    def _ahead(self, pair: Pair) -> float:
        ends = [self.graph.tips[self.graph.ways[node][-1]] for node in (pair.one, pair.other)]
        return float(np.mean(ends, axis=0) @ self.body.front)

    def sides(self, rows: dict[str, Pair], read: Callable[[int], JointChain]) -> dict[str, JointChain]:
        """Return left and right limbs by name."""
        return {
            f"{side} {name}": read(node)
            for name, pair in rows.items()
            for side, node in (("left", pair.one), ("right", pair.other))
        }

    def _stands_on(self, limbs: dict[str, JointChain], before: str, behind: str) -> bool:
        """Return whether the limbs before reach the ground, and the spine is not upright."""
        up = self.body.up
        hips, shoulders = (
            np.mean([limbs[f"{side} {name}"].points[0] for side in ("left", "right")], axis=0)
            for name in (behind, before)
        )
        soles, hands = (
            np.mean([limbs[f"{side} {name}"].points[-1] for side in ("left", "right")], axis=0)
            for name in (behind, before)
        )
        upright = _unit(shoulders - hips) @ up > LYING_COSINE
        return bool(not upright and (hands - soles) @ up < MAX_HAND_HEIGHT_SHARE * ((shoulders - soles) @ up))

    def arm(self, node: int) -> JointChain:
        """Return shoulder, elbow, wrist and end of an arm; an arm may be called a leg, as a dinosaur's."""
        if self.said("leg", self.ways[node]):
            return self.of_three(self.leg_way(node), replace(ARM, parts=LEG.parts))
        found = self.of_three(self.ways[node], ARM)
        bone, back = np.diff(found.points[-3:], axis=0)
        shorter = back @ back < bone @ bone
        if len(found.nodes) > 2 and shorter and _unit(bone) @ _unit(back) < BACK_COSINE:
            return JointChain(found.points[[0, 1, 3, 2]], found.nodes)  # the last joint is at the end of the hand
        return found

    def upright_leg(self, node: int) -> JointChain:
        """Return hip, knee, ankle and end of a leg."""
        return self.of_three(self.leg_way(node), LEG)

    def leg(self, node: int) -> JointChain:
        """Return a leg with all of its bends, without a girdle that leads sideways."""
        chain = self.leg_way(node)
        while len(chain) > 3 and self._leads_aside(chain):
            chain = chain[1:]
        return self.of_bends(chain)

    def of_bends(self, chain: Sequence[int]) -> JointChain:
        """Return a leg with the bends of a way."""
        if len(chain) < 3:
            return self.of_three(chain, LEG)
        bends = self.bends(chain)
        return self.with_end(bends, self.graph.subtrees[bends[-1]])

    def row_leg(self, node: int) -> JointChain:
        """Return one of many legs, without a last bone that is a stub: the joint of a foot may be at its tip."""
        leg = self.of_bends(self.leg_way(node))
        lengths = np.linalg.norm(np.diff(leg.points, axis=0), axis=1)
        stub = len(lengths) > 3 and lengths[-1] < MIN_LEG_BONE_SHARE * lengths.sum()
        return JointChain(np.delete(leg.points, -2, axis=0), leg.nodes[:-1]) if stub else leg

    def leg_way(self, node: int) -> list[int]:
        """Return the nodes of a leg without toes."""
        way = [each for each in self.ways[node] if self.part(each) != "toes"] or self.ways[node]
        named = [each for each in way if self.graph.votes[each, LABELS.index("leg")] or self.part(each) == "shoulder"]
        return named if len(named) > 2 else way

    def _leads_aside(self, way: Sequence[int]) -> bool:
        return bool(abs(_unit(self.place(way[1]) - self.place(way[0])) @ self.body.left) > GIRDLE_COSINE)

    def place(self, node: int) -> NDArray[np.float64]:
        """Return where a node is (3,)."""
        return self.graph.places[node]

    def bends(self, nodes: Sequence[int]) -> list[int]:
        """Return the joints of a leg without those that follow others closely, which are twists and controls."""
        size = sum(float(np.linalg.norm(self.place(after) - self.place(node))) for node, after in pairwise(nodes))
        kept = [*nodes[:3]]
        for node in nodes[3:]:
            if np.linalg.norm(self.place(node) - self.place(kept[-1])) > MIN_LEG_BONE_SHARE * size:
                kept.append(node)
        return kept

    def of_three(self, way: Sequence[int], shape: LimbShape) -> JointChain:
        """Return a limb with the three joints of a way that fit best by their names and the lengths between them."""
        if len(way) == 1:
            root = self.place(way[0])
            tip = self.end(root, root, self.graph.subtrees[way[0]])
            root = self.start(root, tip, self.graph.subtrees[way[0]])
            share = np.cumsum([0.0, *shape.shares[1:]]) / shape.shares[1:].sum()
            return JointChain(root + share[:, None] * (tip - root), (way[0],))
        nodes = max(self._choices(way, shape), key=lambda nodes: self._fit(way, nodes, shape))
        if len(nodes) < 3 and self.rigid and self.part(nodes[1]) in ("foot", "toes"):
            knee = self.place(nodes[0]) + RIGID_KNEE_SHARE * (self.place(nodes[1]) - self.place(nodes[0]))
            foot = self.with_end(nodes, self.graph.subtrees[nodes[1]])
            return JointChain(np.insert(foot.points, 1, knee, axis=0), nodes)
        if len(nodes) < 3:
            return self.without_end(*nodes)
        end = [nodes[2], *(other for other in self.graph.children[self.graph.parents[nodes[2]]] if other != nodes[2])]
        same = [node for node in end if self.part(node) == self.part(nodes[2]) or node == nodes[2]]
        held = same if self.part(nodes[2]) else [nodes[2]]  # a palm may have several joints side by side
        return self.with_end(nodes, [below for node in held for below in self.graph.subtrees[node]])

    def _choices(self, way: Sequence[int], shape: LimbShape) -> Iterator[tuple[int, ...]]:
        """Yield pairs and threes of joints; of many, some and those with a name of the limb."""
        step = len(way) // MAX_TRIED + 1
        named = {node for node in way if any(self.part(node) in parts for parts in shape.parts)}
        tried = [node for k, node in enumerate(way) if k % step == 0 or node == way[-1] or (node in named and step < 8)]
        yield from combinations(tried, 3)
        yield from ((one, way[-1]) for one in tried[:-1])

    def _fit(self, way: Sequence[int], nodes: tuple[int, ...], shape: LimbShape) -> float:
        points = np.array([*(self.place(node) for node in way), self.graph.tips[way[-1]]])
        return shape.fit(points, [list(way).index(node) for node in nodes], [self.part(node) for node in nodes])

    def with_end(self, nodes: Sequence[int], held: Sequence[int]) -> JointChain:
        """Return a limb from its joints to the end of the vertices of some joints."""
        points = [self.place(node) for node in nodes]
        return JointChain(np.array([*points, self.end(points[-2:][0], points[-1], held)]), nodes)

    def without_end(self, upper: int, lower: int) -> JointChain:
        """Return an arm without a joint for the hand, or a leg without one for the foot."""
        first, second = self.place(upper), self.place(lower)
        tip = self.end(first, second, self.graph.subtrees[lower])
        return JointChain(np.array([first, second, second + (1 - END_SHARE) * (tip - second), tip]), (upper, lower))

    def end(self, before: NDArray[np.float64], root: NDArray[np.float64], held: Sequence[int]) -> NDArray[np.float64]:
        """Return the far end of the vertices of some nodes, along their direction from a joint."""
        vertices = np.concatenate([np.zeros((0, 3)), *(self.joints[node].vertices for node in held)])
        if not len(vertices):
            places = np.array([root, *(self.place(node) for node in held)])
            far = places[np.linalg.norm(places - root, axis=1).argmax()]
            if np.linalg.norm(far - root) > 0:
                return np.asarray(far)
            return root + 0.3 * (root - before)
        direction = _unit((vertices.min(axis=0) + vertices.max(axis=0)) / 2 - root)  # regardless of where details are
        reach = max(float(np.quantile((vertices - root) @ direction, 0.95)), 0.0)
        if self.rigid:  # the line to the middle leads askew from a root at a corner
            far = vertices[(vertices - root) @ direction > (1 - RIGID_END_SHARE) * reach]
            return np.asarray((far.min(axis=0) + far.max(axis=0)) / 2)
        tip = root + reach * direction
        away = np.linalg.norm(vertices - tip, axis=1)
        outside = away.min() > MAX_TIP_DISTANCE * reach > 0  # as between two long ears
        return np.asarray(vertices[away.argmin()] if outside else tip)

    def start(self, root: NDArray[np.float64], tip: NDArray[np.float64], held: Sequence[int]) -> NDArray[np.float64]:
        """Return where the vertices of some nodes begin on the way to a limb's end, if a joint is far from them."""
        along = [(self.joints[node].vertices - root) @ _unit(tip - root) for node in held]
        gap = float(min((each.min() for each in along if len(each)), default=0.0))
        share = gap / max(float(np.linalg.norm(tip - root)), 1e-12)
        return root + share * (tip - root) if GAP_SHARES[0] < share < GAP_SHARES[1] else root

    def trunk(self, limbs: dict[str, JointChain], head: Sequence[int], tail: Sequence[int]) -> JointChain | None:
        """Return the points of the trunk: the hips, its middle, and the root of the neck."""
        legs = [limbs[name].points[0] for name in limbs if name.endswith(("leg", "leg 1")) and "front" not in name]
        rows = [name for name in limbs if "leg" in name]
        if any(name[-1].isdigit() for name in rows):
            last = max(int(name[-1]) for name in rows)
            legs = [limbs[name].points[0] for name in rows if name.endswith(str(last))]
        arms = [limbs[name].points[0] for name in limbs if name.endswith(("arm", "front leg", "leg 1", "wing"))]
        ways = self.necks(head, limbs)
        neck = ways[0] if ways and not (arms and self.part(ways[0]) == "head") else None
        high = self.place(neck) if neck is not None else np.mean(arms, axis=0) if arms else None
        if high is None:
            return None
        if legs:
            low = np.mean(legs, axis=0)
        elif tail:
            low = self.place(self.told("tail", tail)[0])  # a snake's body leads on into its tail
        else:
            low = self.bottom(high, head)
        if np.linalg.norm(high - low) < MIN_TRUNK_SHARE * self.graph.size:  # as of parts without places
            return None
        middle = (low + high) / 2
        spine = [self.place(node) for node in np.flatnonzero(self.graph.votes[:, LABELS.index("trunk")]).tolist()]
        if self.rigid and len(spine) < 2:
            return JointChain(np.array([low, high]))
        nearest = min(spine, key=lambda place: float(np.linalg.norm(place - middle)), default=middle)
        if np.linalg.norm(nearest - middle) > np.linalg.norm(high - low) / 4:
            nearest = middle
        return JointChain(np.array([low, nearest, high]))

    def bottom(self, high: NDArray[np.float64], head: Sequence[int]) -> NDArray[np.float64]:
        """Return the end of a trunk without legs and tail that is farthest from the head, or from its other end."""
        own, top = self.of_trunk(head) or [0], self.graph.tips[head[-1]] if len(head) else high
        ends = np.concatenate([self.graph.places[own], self.graph.tips[own]])
        return np.asarray(ends[np.linalg.norm(ends - top, axis=1).argmax()])

    def head_of_trunk(self, trunk: JointChain) -> dict[str, JointChain]:
        """Return the head of a body whose skeleton has no joint for it: what follows the trunk above the shoulders."""
        held = [self.joints[node].vertices for node in self.of_trunk([])]
        root, length = trunk.points[-1], np.linalg.norm(trunk.points[-1] - trunk.points[0])
        over = (np.concatenate([np.zeros((0, 3)), *held]) - root) @ self.body.up
        height = float(over.max(initial=0.0))
        if height <= HEAD_SHARE * length:
            return {}
        return {"head": JointChain(np.array([root, root + height * self.body.up]))}

    def of_trunk(self, head: Sequence[int]) -> list[int]:
        """Return the nodes with vertices that are not on the head and the limbs of pairs."""
        firsts = [*head[:1], *(node for _, pair in self.body.pairs for node in (pair.one, pair.other))]
        beyond = {node for first in firsts for node in self.graph.subtrees[first]}
        return [node for node in range(len(self.joints)) if node not in beyond and len(self.joints[node].vertices)]

    def necks(self, head: Sequence[int], limbs: dict[str, JointChain]) -> list[int]:
        """Return the joints of neck and head: those with such names, else those beyond the front limbs."""
        if self.said("head", head):
            way = self.told("head", head)
            necks = [node for node in range(len(self.joints)) if self.part(node) == "neck" and node not in way]
            return [*necks, *way]
        fronts = [limbs[name].points[0] for name in limbs if name.endswith(("arm", "front leg", "leg 1", "wing"))]
        if not fronts or not len(head):
            return list(head)
        tip = self.graph.tips[head[-1]]
        most = np.linalg.norm(np.mean(fronts, axis=0) - tip)
        carriers = {node for _, pair in self.body.pairs for node in self.graph.ancestors(pair.one)}
        beyond = [node for node in head if np.linalg.norm(self.place(node) - tip) < most]
        return beyond or [node for node in head[-1:] if node not in carriers]

    def head(
        self, trunk: JointChain, head: Sequence[int], limbs: dict[str, JointChain], with_neck: bool
    ) -> dict[str, JointChain]:
        """Return the head from the trunk's end, after a neck if that is long."""
        way = self.necks(head, limbs)
        if not way:
            return {}
        named = [node for node in way if self.part(node) == "head"]
        own = named[0] if named else max(way, key=lambda node: self.graph.masses[node])
        necks = way[: way.index(own)]
        carrying = {
            node for label, pair in self.body.pairs if label != "ear" for node in self.graph.ancestors(pair.one)
        }
        root, start = self.place(own), self.place(necks[0]) if necks else trunk.points[-1]
        if carrying & set(necks):
            start, necks = root, []  # the neck carries the arms, as a trunk does
        if self.rigid and not necks:
            start = root
        tip = self.end(start, root, [each for each in self.graph.subtrees[own] if self._is_of_head(each, own)])
        length = trunk.points[-1] - trunk.points[0]
        if (root - start) @ length < 0:  # it begins behind the front legs
            within = distance_from_segment(root, trunk.points[0], trunk.points[-1])
            root = start if within < MAX_WITHIN_SHARE * np.linalg.norm(length) else root
            start, necks = root, []
        if not with_neck or np.linalg.norm(root - start) < MIN_NECK_SHARE * np.linalg.norm(length):
            return {"head": JointChain(np.array([start, tip]), [*necks, own])}
        points = np.array([start, *(self.place(node) for node in necks[1:]), root])
        return {"neck": JointChain(evenly(points, 3), necks), "head": JointChain(np.array([root, tip]), [own])}

    def _is_of_head(self, node: int, own: int) -> bool:
        """Return whether a joint counts for a head's size; one that hangs down as a beard does only by its name."""
        held, above = (self.joints[each].vertices - self.place(own) for each in (node, own))
        hangs = len(held) and len(above) and held.mean(axis=0) @ above.mean(axis=0) < 0
        return node == own or self.part(node) in HEAD_PARTS or (self.part(node) is None and not hangs)

    def jaw(self) -> dict[str, JointChain]:
        """Return the jaw, if vertices follow it."""
        jaws = [node for node in range(len(self.joints)) if self.part(node) == "jaw"]
        if not any(len(self.joints[node].vertices) for node in jaws):
            return {}
        row = [node for node in jaws if node == jaws[0] or jaws[0] in self.graph.ancestors(node)]
        return {"jaw": self.curved(row, 1)}

    def curved_pair(self, label: str) -> dict[str, JointChain]:
        """Return wings or ears by their names."""
        count = {"wing": 3, "ear": 2}[label]
        return self.sides(self.rows_of(label), lambda node: self.curved(self.told(label, self.ways[node]), count))

    def curved(self, way: Sequence[int], bones: int) -> JointChain:
        """Return a limb along joints with a number of bones."""
        chain = self.with_end(way, self.graph.subtrees[way[-1]])
        return JointChain(evenly(self.straightened(chain, way[-1]), bones + 1), way)

    def straightened(self, chain: JointChain, last: int) -> NDArray[np.float64]:
        """Return a limb's points; its end continues the last bone if the vertices there are all around their joint."""
        root, above, held = chain.points[-2], self.graph.parents[last], self.joints[last].vertices
        if above < 0 or not len(held):
            return chain.points
        bone, middle = _unit(root - self.place(above)), (held.min(axis=0) + held.max(axis=0)) / 2 - root
        around, reach = AROUND_SHARE * np.ptp(held, axis=0).max(), float(np.quantile((held - root) @ bone, 0.95))
        if np.linalg.norm(middle) > around or reach < around:
            return chain.points
        return np.vstack([chain.points[:-1], root + reach * bone])

    def spine(self) -> dict[str, JointChain]:
        """Return trunk and tail of a body whose only joints are a row from front to back; none for another body."""
        row, count = list(range(len(self.joints))), len(self.joints)
        way = self.place(row[0]) - self.place(row[-1])
        in_a_row = all(len(children) < 2 for children in self.graph.children)
        lies = way @ self.body.front > LYING_COSINE * np.linalg.norm(way)
        if not in_a_row or count < MIN_SPINE_JOINTS or not lies:
            return {}
        chain = self.with_end(row[1:], row[-1:])
        front = self.end(chain.points[1], chain.points[0], row[:1])
        return {"trunk": JointChain(np.array([chain.points[0], front])), "tail": chain}


def _rank(name: str) -> int:
    """Return the order of limbs in a puppet: arms and front legs first."""
    if name.endswith(("arm", "front leg")):
        return 100
    return -int(name[-1]) if name[-1].isdigit() else -100


def _unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-12))
