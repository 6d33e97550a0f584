"""Where the coordinates of a recording are in sensor coordinates, by the person in them.

Up is where the head is above the feet, and the shoulders above the hips, over the whole recording; the unit is the
common one in which the body has a human's size; the front is where feet, knees, elbows and nose point. If the front and
the names of the sides do not fit right-handed axes, the axes are left-handed; the names count.

Positions that a sensor measured stay where they are: y up or down, z away from the sensor, a performer in front of it
who faces it. Other motion is moved: in the first frame, the performer faces the sensor, with the hips 2.5 m in front of
it.
"""

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from capture.body import completed_lengths
from capture.formats.options import ReadOptions
from capture.skeleton import JOINT_INDEX, MAX_DISTANCE_METRES, PARENTS
from puppetline.errors import SkeletonLogError

Floats = NDArray[np.float64]

HIP_DISTANCE_METRES = 2.5
"""Distance from the sensor to the hips in the first frame, if no sensor measured the positions."""

METRES_PER_UNIT = {
    "metres": 1.0,
    "feet": 0.3048,
    "decimetres": 0.1,
    "CMU units of 1/0.45 inch": 0.0254 / 0.45,
    "inches": 0.0254,
    "centimetres": 0.01,
    "millimetres": 0.001,
}
"""Common units of length. They differ by more than the width of `STATURE_METRES`, 1.43, so at most one fits a body."""

STATURE_METRES = (1.4, 2.0)
"""Range of a performer's height in which a common unit is accepted."""

SENSOR_STATURE_METRES = (1.0, 2.6)
"""The same for metres, centimetres and millimetres: children, and bodies as sensors measure them."""

DEFAULT_STATURE_METRES = 1.7

STATURE_PER_BONE_LENGTH = 1.15
"""Ratio of stature to the length of the bones from the centre of the head to the ankle, which is above the sole."""

SENSOR_RANGE_METRES = (0.3, 10.0)
"""Distances of a performer from a sensor that measures them."""

MAX_FAR_SHARE = 0.05
"""Largest share of frames that are omitted because they are too far from the others."""

FACING_COSINE = 0.5
"""Cosine of the angle to the sensor within which a performer faces it, in a quarter of the frames."""

MIN_LEVEL_SHARE = 0.1
"""Smallest share of the line from left to right that is level in a frame from which the heading is known."""

Y_PREFERENCE = np.array([1.0, 1.5, 1.0])
"""Weights of the axes in the search for the one along the body: in most files, y is up or down."""

FLOOR, FLOOR_SPREAD = (-0.03, 0.15), 0.1
"""Range of the height of a body's lowest joint above a floor at 0, and how much it varies, in statures."""

MAX_RISE = 1.0
"""How far a body rises at most while its floor stays where it is, in statures."""

UPRIGHT = 0.5
"""Cosine of the angle between upright and the way from feet to head or hips to shoulders above which a body stands."""

MIN_MOTION = 0.05
"""Motion of a joint along an axis below which the heights along this axis tell nothing, in statures."""

MIN_AGREEMENT = 0.3
"""How clearly faces, feet, knees and elbows must point backwards if coordinates are left-handed, of about 3."""

FACING_AGREEMENT, FACING_DISAGREEMENT = 0.4, 0.8
"""How much more clearly they must do so if the performer faces a sensor in right-handed coordinates, and how much less
if only in left-handed ones."""

_HEIGHT = ("head", "shoulder_center", "spine", "knee_right", "ankle_right")
"""Joints at the ends of the bones that a person's height consists of."""


@dataclass(frozen=True, slots=True)
class Placement:
    """Where a file's coordinates are in sensor coordinates: metres = `unit` · `axes` · (position − `origin`) + `shift`.

    Attributes
    ----------
    axes : (3, 3) float64
        Orthogonal; the determinant is −1 for left-handed coordinates.
    unit : float
        Metres.
    origin, shift : (3,) float64
    notes : tuple of str
    """

    axes: Floats
    unit: float
    origin: Floats
    shift: Floats
    notes: tuple[str, ...]

    def apply(self, positions: Floats) -> Floats:
        """Convert positions (…, 3) of the file to sensor coordinates."""
        turned = (positions - self.origin) @ self.axes.T
        return turned * self.unit + self.shift


@dataclass(frozen=True, slots=True)
class Size:
    """The height of a body in units of the file, the metres of a unit, and the note on it."""

    stature: float
    unit: float
    note: str


def size_of(path: Path, points: Floats, options: ReadOptions, *, in_image: bool = False) -> Size:
    """Return the size of the body whose points (T, 20, 3) are in the unit of the file; that of an image has no length.

    Raises
    ------
    SkeletonLogError
        The body has no size.
    """
    stature = _stature(path, points)
    return Size(stature, *_unit(stature, options, has_length=not in_image))


def without_far_frames(points: Floats, unit: float) -> tuple[Floats, tuple[str, ...]]:
    """Return points (T, 20, 3) without the few frames that are too far from the others, and a note on these.

    Decoders and trackers that fail write such frames. If there are many, they are kept. `unit` is in metres.
    """
    with warnings.catch_warnings(action="ignore"):  # a joint that is never known
        away = np.abs(points - np.nanmedian(points, axis=(0, 1))) * unit > MAX_DISTANCE_METRES
    far = np.any(away, axis=(1, 2), keepdims=True)
    if not 0 < np.mean(far) < MAX_FAR_SHARE:
        return points, ()
    count = f"{np.count_nonzero(far)} of {len(far)} frames"
    note = f"In {count}, the performer is more than {MAX_DISTANCE_METRES:g} m away. These are omitted."
    return np.where(far, np.nan, points), (note,)


def place(
    path: Path,
    points: Floats,
    front: Floats,
    size: Size,
    options: ReadOptions,
    *,
    by_sensor: bool = True,
    in_image: bool = False,
) -> Placement:
    """Find where a file's coordinates are in sensor coordinates.

    Parameters
    ----------
    path : Path
        The recording, for error messages.
    points : (T, 20, 3) float64
        In the unit and axes of the file; NaN for lost joints.
    front : (T, 3) float64
        Directions to the performer's front as far as faces and feet tell it; NaN if unknown.
    size : Size
    options : ReadOptions
        `up` replaces what is detected.
    by_sensor : bool
        Whether a sensor may have measured the positions, which then stay where they are.
    in_image : bool
        Whether x and y are those of an image, so that y is up or down; x is, if the performer's left and right are
        always above each other, as in a turned picture.

    Raises
    ------
    SkeletonLogError
        The body lies on its side in all frames.
    """
    unit = size.unit
    across = _across(points)
    weights = Y_PREFERENCE
    if in_image:
        known = np.isfinite(across).all(axis=1)
        is_turned = known.any() and bool(_is_along(across[known], np.eye(3)[1]).all())
        weights = np.eye(3)[0 if is_turned else 1]
    up, up_note = _up(points, options, None if by_sensor else size.stature, weights)
    notes: tuple[str, ...] = (size.note, up_note)
    ahead = np.cross(up, across - np.outer(across @ up, up))
    facing = {sign: by_sensor and _in_view(points, unit * _sensor_axes(up, sign), sign * ahead) for sign in (1.0, -1.0)}
    needed = MIN_AGREEMENT + (FACING_AGREEMENT if facing[1.0] else -FACING_DISAGREEMENT if facing[-1.0] else 0.0)
    handed = 1.0
    if _front_agreement(points, front, across) < -needed:
        handed = -1.0
        notes = (*notes, "The sides and the front of the performer fit left-handed axes; they are mirrored.")
    if facing[handed]:
        return Placement(_sensor_axes(up, handed), unit, np.zeros(3), np.zeros(3), notes)
    level = across - np.outer(across @ up, up)
    usable = ~_is_along(across, up)  # the performer does not lie on the side
    usable &= np.isfinite(points[:, JOINT_INDEX["hip_center"]]).all(axis=1)
    first = int(usable.argmax())
    if not usable.any():
        raise SkeletonLogError(
            path,
            found="frames in which the left-to-right line of hips and shoulders points up",
            expected="a performer who stands or sits upright",
            fix="Set the axis that points up (y or z).",
        )
    right = level[first] / np.linalg.norm(level[first])
    notes = (*notes, f"The performer faces the sensor in the first frame, {HIP_DISTANCE_METRES:g} m in front of it.")
    axes = np.stack([right, up, handed * np.cross(right, up)])
    origin = points[first, JOINT_INDEX["hip_center"]]
    return Placement(axes, unit, origin, np.array([0.0, 0.0, HIP_DISTANCE_METRES]), notes)


def _sensor_axes(up: Floats, handed: float) -> Floats:
    """Return the axes (3, 3) of a sensor whose z points away from it."""
    return np.diag([handed * up[1], up[1], 1.0])


def _in_view(points: Floats, axes: Floats, ahead: Floats) -> bool:
    """Return whether performers are in front of a sensor at the origin, at a common distance, and face it."""
    if not axes.any(axis=1).all():
        return False
    with np.errstate(invalid="ignore", divide="ignore"):
        facing = -(ahead @ axes.T)[:, 2] / np.linalg.norm(ahead @ axes.T, axis=1)
    near, far = np.nanpercentile((points @ axes.T)[:, JOINT_INDEX["hip_center"], 2], [5, 95])
    in_range = SENSOR_RANGE_METRES[0] <= near and far <= SENSOR_RANGE_METRES[1]
    return bool(in_range and np.nanpercentile(facing, 75) > FACING_COSINE)


def _across(points: Floats) -> Floats:
    """Return the vectors (T, 3) from left to right, by those of hips and shoulders that are known; NaN for none."""
    pairs = [
        points[:, JOINT_INDEX[f"{joint}_right"]] - points[:, JOINT_INDEX[f"{joint}_left"]]
        for joint in ("hip", "shoulder")
    ]
    return np.where(np.isnan(pairs).all(axis=0), np.nan, np.nansum(pairs, axis=0))


def _is_along(ways: Floats, axis: Floats) -> NDArray[np.bool_]:
    """Return in which frames vectors (T, 3) are nearly along an axis, or unknown."""
    level = np.linalg.norm(ways - np.outer(ways @ axis, axis), axis=1)
    whole = np.linalg.norm(ways, axis=1)
    return ~((level >= MIN_LEVEL_SHARE * whole) & (whole > 0))


def toes_ahead(foot: Floats, shin: Floats) -> Floats:
    """Return the direction (T, 3) of a foot without its part along the shin, as a kneeling person's toes point back."""
    with np.errstate(invalid="ignore", divide="ignore"):
        foot, shin = (way / np.linalg.norm(way, axis=1, keepdims=True) for way in (foot, shin))
    return foot - np.einsum("ti,ti->t", foot, shin)[:, None] * shin


def _front_agreement(points: Floats, front: Floats, across: Floats) -> float:
    """Return how far feet, face, knees and elbows point to the front of the trunk, from about −3 to 3; 0 if unknown."""
    trunk = points[:, JOINT_INDEX["shoulder_center"]] - points[:, JOINT_INDEX["hip_center"]]
    ahead = np.cross(trunk, across)
    with np.errstate(invalid="ignore", divide="ignore"):
        ahead = ahead / np.linalg.norm(ahead, axis=1, keepdims=True)
        evidence = [2 * np.einsum("ti,ti->t", front, ahead)]
        for sign, (upper, middle, lower) in ((1.0, ("hip", "knee", "ankle")), (-1.0, ("shoulder", "elbow", "wrist"))):
            for side in ("left", "right"):
                a, b, c = (points[:, JOINT_INDEX[f"{joint}_{side}"]] for joint in (upper, middle, lower))
                bend = b - (a + c) / 2
                length = np.linalg.norm(b - a, axis=1) + np.linalg.norm(c - b, axis=1)
                evidence.append(sign * 2 * np.einsum("ti,ti->t", bend, ahead) / length)
    medians = [float(np.nanmedian(each)) for each in evidence if np.isfinite(each).any()]
    return sum(medians)


def _up(points: Floats, options: ReadOptions, stature: float | None, weights: Floats) -> tuple[Floats, str]:
    """Return the unit vector that points up, of the axes with these weights (3,), and the note on it.

    In an image, one axis alone has a weight; there, the y of a body that does not stand is down.

    Without a stature, which is in units of the points, only the direction from feet to head counts, and no floor.
    """
    if options.up is not None:
        return np.eye(3)["xyz".index(options.up)], f"Up is {options.up}, as given."
    ankles = (points[:, JOINT_INDEX["ankle_left"]] + points[:, JOINT_INDEX["ankle_right"]]) / 2
    body = np.zeros(3)
    for upper, lower in (("head", ankles), ("shoulder_center", points[:, JOINT_INDEX["hip_center"]])):
        with warnings.catch_warnings(action="ignore"):  # joints that are always lost
            way = np.nanmedian(points[:, JOINT_INDEX[upper]] - lower, axis=0)
            body += np.nan_to_num(way / np.linalg.norm(way))
    axis = int((np.abs(body) * weights).argmax())
    in_image = np.count_nonzero(weights) == 1
    if in_image and axis == 1 and abs(body[axis]) < UPRIGHT * np.linalg.norm(body):
        return -np.eye(3)[axis], "Up is assumed to be −y, as in images: the body does not stand."
    sign = 1.0 if body[axis] > 0 else -1.0
    name = f"{'−' if sign < 0 else ''}{'xyz'[axis]}"
    if stature is not None and not _has_floor(sign * points[..., axis] / stature, 2.0):
        with warnings.catch_warnings(action="ignore"):  # frames without joints
            lowest = np.nanmin(points / stature, axis=1)
        rises = np.ptp(np.nanpercentile(lowest[:, axis], [5, 95])) > MAX_RISE  # only climbers do, in most files along y
        for other in (1, 2):  # a lying body, or one that crawls
            floor = np.nanmedian(lowest[:, other]) if other == 1 and rises else 0.0
            if other != axis and _has_floor(points[..., other] / stature - floor, 2.0 if rises else 1.0):
                note = f"Up is assumed to be {'xyz'[other]}, from the floor on which the body lies."
                return np.eye(3)[other], note
    lies = " If the performer lies, set the axis that points up (y or z)." if axis == 0 and not in_image else ""
    return sign * np.eye(3)[axis], f"Up is assumed to be {name}, the direction from feet to head.{lies}"


def _has_floor(heights: Floats, tolerance: float) -> bool:
    """Return whether the lowest of moving joints always stay close above 0; heights (T, 20) are in statures."""
    with warnings.catch_warnings(action="ignore"):  # frames without joints
        lowest = np.nanmin(heights, axis=1)
        low, middle, high = np.nanpercentile(lowest, [5, 50, 95])
        is_moving = np.nanmax(np.ptp(heights, axis=0)) > MIN_MOTION
    below, above = FLOOR
    return bool(is_moving and tolerance * below < middle < tolerance * above and high - low < tolerance * FLOOR_SPREAD)


def _unit(stature: float, options: ReadOptions, *, has_length: bool) -> tuple[float, str]:
    """Return the metres per unit of the file, and the note on them."""
    if options.unit is not None:
        return options.unit, f"One unit is {options.unit:g} m, as given."
    sensors = {name: METRES_PER_UNIT[name] for name in ("metres", "centimetres", "millimetres")}
    for units, (low, high) in ((METRES_PER_UNIT, STATURE_METRES), (sensors, SENSOR_STATURE_METRES)):
        for name, unit in units.items() if has_length else ():
            if low <= stature * unit <= high:
                return unit, f"Lengths are assumed to be {name}; the body is then {stature * unit:.2f} m tall."
    unit = DEFAULT_STATURE_METRES / stature
    scaled = f"It is scaled to {DEFAULT_STATURE_METRES:g} m, {unit:.4g} m per unit."
    return unit, f"The body has a human's height in no common unit. {scaled}"


def _stature(path: Path, points: Floats) -> float:
    """Return the body's height in file units, from the lengths of bones, which do not depend on the pose."""
    with warnings.catch_warnings(action="ignore"):  # a bone that is never known
        measured = {joint: float(np.nanmedian(bone_length(points, joint, parent))) for joint, parent in PARENTS.items()}
    lengths = completed_lengths(measured)
    stature = STATURE_PER_BONE_LENGTH * sum(lengths[joint] for joint in _HEIGHT)
    if not stature > 1e-9:
        raise SkeletonLogError(
            path,
            found="a body without size",
            expected="bones with a length",
            fix="Export the motion again with the offsets of its skeleton.",
        )
    return stature


def bone_length(points: Floats, one: str, other: str) -> Floats:
    """Return the distances (T,) between two joints of points (T, 20, 3)."""
    return np.linalg.norm(points[:, JOINT_INDEX[one]] - points[:, JOINT_INDEX[other]], axis=1)
