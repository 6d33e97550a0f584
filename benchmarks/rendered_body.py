"""Images of a depth sensor of a performer whose joints are known: the example character `human` in a plain room.

The character consists of rounded cones around bones (examples/characters/human.py), which define its joints. The bones
are rotated about these joints, and each vertex follows the bones near it, so the joints are known in each pose.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from puppetline.examples.characters import CHARACTERS
from puppetline.examples.characters.human import SCALE
from scipy.spatial.transform import Rotation

from benchmarks.rasteriser import barycentric, rasterise
from capture.sensors.depth_camera import metres
from capture.skeleton import JOINT_INDEX, to_character_axes
from capture.trackers.picture import Lens, Picture

Floats = NDArray[np.float64]

LENS = Lens(640, 480, 525.0)
HEIGHT = 1.75
"""Height of the character from the soles to the hair, in metres."""
EYE = 1.0
"""Height of the sensor, which looks horizontally, in metres."""
WALL = 5.5
"""Distance from the sensor to the wall, in metres."""

COLOR_NOISE = 3.0
"""Standard deviation of the noise of colours, of 255."""
DEPTH_NOISE = 0.0015
"""Standard deviation of the noise of depth at one metre, in metres; it grows quadratically, as in a Kinect v1."""

_OUTWARD = {
    "shoulder": (0.168, 1.372, -0.022),
    "elbow": (0.345, 1.120, -0.008),  # not defined by the character; in proportion as in people
    "wrist": (0.468, 0.915, 0.050),
    "hip": (0.085, 0.900, -0.010),
    "knee": (0.112, 0.500, 0.0),
    "ankle": (0.120, 0.100, -0.020),
}
_FEET = (0.127, 0.030, 0.050)
_HEAD = (0.0, 1.697, 0.0)  # halfway between the ears

NAMES = ("head", *(f"{joint}_{side}" for joint in _OUTWARD for side in ("left", "right")))
"""The joints that are known."""
KINECT = [JOINT_INDEX[name] for name in NAMES]
"""Their indices among all joints."""

_BONES = {"upper arm": ("shoulder", "elbow", 0.05), "forearm": ("elbow", "wrist", 0.04)}
_BONES |= {"thigh": ("hip", "knee", 0.08), "shin": ("knee", "ankle", 0.06)}
_TRUNK_RADIUS, _HEAD_RADIUS, _FOOT_RADIUS = 0.15, 0.13, 0.05
_SHARPNESS = 8  # of the border between two bones


class Body:
    """The character and its joints at rest: metres, y up, the face towards +z, the feet at y = 0."""

    def __init__(self) -> None:
        made = CHARACTERS["human"]()
        self._vertices, self.triangles, self.colors = made.vertices, made.faces, made.colors
        self._rest = {"head": np.array(_HEAD) * SCALE}
        for sign, side in ((1, "left"), (-1, "right")):
            mirror = np.array([sign * SCALE, SCALE, SCALE])
            self._rest |= {f"{joint}_{side}": np.array(place) * mirror for joint, place in _OUTWARD.items()}
            self._rest[f"foot_{side}"] = np.array(_FEET) * mirror
        self._bones = [("trunk", "", self._middle("hip"), self._middle("shoulder"), _TRUNK_RADIUS)]
        self._bones.append(("head", "", self._rest["head"], self._rest["head"], _HEAD_RADIUS))
        for side in ("left", "right"):
            for name, (start, end, radius) in _BONES.items():
                ends = self._rest[f"{start}_{side}"], self._rest[f"{end}_{side}"]
                # the forearm's bone includes the hand
                self._bones.append((name, side, ends[0], ends[1] + (ends[1] - ends[0]) * (name == "forearm"), radius))
            self._bones.append(("foot", side, self._rest[f"ankle_{side}"], self._rest[f"foot_{side}"], _FOOT_RADIUS))
        near = np.stack([_distance(self._vertices, a, b) / radius for *_, a, b, radius in self._bones], axis=1)
        weights = np.maximum(near, 0.1) ** -_SHARPNESS
        self._weights = weights / weights.sum(axis=1, keepdims=True)

    def posed(self, skeleton: Floats) -> tuple[Floats, Floats]:
        """Return vertices (n, 3) and the joints `NAMES` (13, 3), with bones in the directions of a performer's bones.

        Parameters
        ----------
        skeleton : (20, 3) float64
            In sensor coordinates.
        """
        seen = dict(zip(JOINT_INDEX, to_character_axes(skeleton), strict=True))
        trunk = ("shoulder_left", "shoulder_right", "hip_left", "hip_right")
        center = self._middle("hip")
        turn, _ = Rotation.align_vectors(_about_mean(seen, trunk), _about_mean(self._rest, trunk))
        joints = {name: turn.apply(self._rest[name] - center) + center for name in ("head", *trunk)}
        turns, moves = {("trunk", ""): turn, ("head", ""): turn}, {("trunk", ""): center, ("head", ""): center}
        origins = {("trunk", ""): center, ("head", ""): center}
        for side in ("left", "right"):
            for name, (start, end, _) in _BONES.items():
                first, last = f"{start}_{side}", f"{end}_{side}"
                bone = self._rest[last] - self._rest[first]
                before = turns.get(("upper arm" if name == "forearm" else "thigh", side), turn)
                before = turn if name in ("upper arm", "thigh") else before
                own = _shortest(before.apply(bone), seen[last] - seen[first]) * before
                turns[name, side], origins[name, side], moves[name, side] = own, self._rest[first], joints[first]
                joints[last] = joints[first] + own.apply(bone)
            ankle = f"ankle_{side}"
            turns["foot", side] = Rotation.from_euler("y", turn.as_euler("YXZ")[0])  # flat on the floor
            origins["foot", side], moves["foot", side] = self._rest[ankle], joints[ankle]
        moved = np.zeros_like(self._vertices)
        for k, (name, side, *_) in enumerate(self._bones):
            bone_at = turns[name, side].apply(self._vertices - origins[name, side]) + moves[name, side]
            moved += self._weights[:, k, None] * bone_at
        return moved, np.stack([joints[name] for name in NAMES])

    def _middle(self, joint: str) -> Floats:
        return (self._rest[f"{joint}_left"] + self._rest[f"{joint}_right"]) / 2


class Shot(NamedTuple):
    """An image and the true joints `NAMES` (13, 3), in sensor coordinates and metres."""

    picture: Picture
    joints: Floats


class Studio:
    """Renders images of a body at a distance in metres, turned to its left by an angle in degrees."""

    def __init__(self, body: Body, distance: float, angle: float, seed: int | None = None, lens: Lens = LENS) -> None:
        self._body, self._lens = body, lens
        self._turn = Rotation.from_euler("y", angle, degrees=True)
        self._shift = np.array([0.0, -EYE, distance])
        self._random = None if seed is None else np.random.default_rng(seed)
        self._room = _drawn(lens, *_room())

    def shoot(self, time: float, skeleton: Floats) -> Shot:
        """Render the body in a pose, with the noise of a sensor if there is a seed."""
        vertices, joints = (to_character_axes(self._turn.apply(p)) + self._shift for p in self._body.posed(skeleton))
        own, room = _drawn(self._lens, vertices, self._body.triangles, self._body.colors), self._room
        nearer = own[1] < room[1]
        color, depth = np.where(nearer[..., None], own[0], room[0]), np.where(nearer, own[1], room[1])
        depth = np.where(np.isfinite(depth), depth, 0)
        if self._random is not None:
            color = np.clip(color + self._random.normal(0, COLOR_NOISE, color.shape), 0, 255)
            depth += self._random.standard_normal(depth.shape) * DEPTH_NOISE * depth**2
        measured = metres(np.rint(1000 * depth).astype(np.uint16))
        picture = Picture(time, self._lens, np.rint(color).astype(np.uint8), measured)
        return Shot(picture, joints)


def _room() -> tuple[Floats, NDArray[np.int64], Floats]:
    """Return corners, triangles and the corners' colours of a floor and a wall."""
    floor = [[x, -EYE, z] for z in (0.3, WALL) for x in (-6.0, 6.0)]
    wall = [[x, y, WALL] for y in (-EYE, 6.0) for x in (-6.0, 6.0)]
    faces = np.array([[0, 2, 3], [0, 3, 1]])
    colors = np.repeat([(0.25, 0.2, 0.15), (0.55, 0.56, 0.5)], 4, axis=0)
    return np.array(floor + wall), np.vstack([faces, faces + 4]), colors


def _drawn(
    lens: Lens, points: Floats, triangles: NDArray[np.int64], albedo: NDArray[np.floating]
) -> tuple[Floats, Floats]:
    """Return colours, 0 to 255, and depth in metres, infinite for nothing, both by the same depth buffer."""
    screen = lens.project(points)
    # −1/z is linear in the picture, and the smaller the nearer
    shown, inverse = rasterise(np.column_stack([screen, -1 / points[:, 2]]), triangles, lens.width, lens.height)
    row, column = np.nonzero(shown >= 0)
    corner = triangles[shown[row, column]]
    share = barycentric(screen[corner], np.column_stack([column + 0.5, row + 0.5]))
    linear = np.zeros((lens.height, lens.width, 3))
    linear[row, column] = np.einsum("pk,pkc->pc", share, (albedo * _light(points, triangles)[:, None])[corner])
    depth = np.full(shown.shape, np.inf)
    depth[row, column] = -1 / inverse[row, column]
    return 255 * np.clip(linear, 0, 1) ** (1 / 2.2), depth


def _light(points: Floats, triangles: NDArray[np.int64]) -> Floats:
    """Return the brightness of each point, lit by a lamp above the sensor and by the room."""
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    flat = np.cross(b - a, c - a)
    flat *= -np.sign(np.einsum("tx,tx->t", flat, a))[:, None]  # towards the sensor
    normals = np.stack([np.bincount(triangles.ravel(), np.repeat(x, 3), len(points)) for x in flat.T], axis=1)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return 0.45 + 0.17 * normals[:, 1] + 0.75 * np.clip(normals @ [0.48, 0.67, -0.57], 0, 1)


def _distance(points: Floats, start: Floats, end: Floats) -> Floats:
    """Return the distance of points (n, 3) to a bone."""
    bone = end - start
    along = np.clip((points - start) @ bone / max(bone @ bone, 1e-12), 0, 1)
    return np.linalg.norm(points - start - along[:, None] * bone, axis=1)


def _about_mean(joints: dict[str, Floats], names: tuple[str, ...]) -> Floats:
    places = np.stack([joints[name] for name in names])
    return places - places.mean(axis=0)


def _shortest(a: Floats, b: Floats) -> Rotation:
    """Return the smallest rotation that brings one direction to another."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    axis = np.cross(a, b)
    sine = np.linalg.norm(axis)
    return Rotation.from_rotvec(axis / max(sine, 1e-12) * np.arctan2(sine, a @ b))
