"""Up and front of a character, proposed from its shape alone.

The left and right of a character mirror each other. Its feet are spread and away from the middle, its toes point
forwards, its head is at the front, and its face has more vertices per area than the rest. These signs determine a score
for each of the 24 orientations along the axes. Their weights are rounded results of a conditional logistic regression
over a hundred characters of several authors (people, animals, fish, dinosaurs, machines).
"""

from dataclasses import dataclass
from itertools import permutations

import numpy as np
import scipy
from numpy.typing import NDArray

from solver.surface.mesh import SolverMesh

MIN_PROBABILITIES, MIN_SPECIFIED_PROBABILITIES = (0.9, 0.55), (0.95, 0.7)
"""Minimum probabilities of up and of the front at which the shape determines them, and not the convention of the file
format: where the format only has a habit, and where it says what they are, as glTF does."""

MIN_RATIOS, MIN_SPECIFIED_RATIOS = (0.02, 0.5), (0.005, 0.15)
"""Minimum probabilities of the conventional up and front, as shares of the largest one, at which they are used if the
shape is not clear; in the order of the probabilities above. An insect might stand on its nose, but almost all files
have y or z up."""

FILE_UPS = ("y", "z")
"""Axes of which one is up if the shape is not clear."""

SAMPLE_COUNT = 6000
"""Number of surface points that are sampled."""

WEIGHTS = {
    "symmetry": 4.1,
    "stance": 8.0,
    "parting": -16.7,
    "height": 0.5,
    "ground": 5.2,
    "toes": 11.6,
    "head": 4.1,
    "face": 55.0,
    "spine": 10.8,
}
"""Weight of each sign of `_signs`, in logits per unit."""

MIN_MISMATCH = 0.003
"""Minimum distance of mirrored points from the surface, in diagonals: that of a symmetric character, by its sampling. A
flat figure mirrors itself exactly in its own plane, which says nothing."""


@dataclass(frozen=True)
class Orientation:
    """The axes of a mesh.

    Attributes
    ----------
    up, front : str
        x, -x, y, -y, z or -z. If the shape is not clear, y and z as in glTF, or z and -y.
    confidence : float
        Probability from 0 to 1 of both axes, by the shape alone.
    reasons : tuple of 2 str
        What was detected or assumed for up and front, for a person to read.
    others : tuple of (str, str, float)
        Other ups and fronts, and their probabilities by the shape alone, the likeliest first.
    """

    up: str
    front: str
    confidence: float
    reasons: tuple[str, ...]
    others: tuple[tuple[str, str, float], ...] = ()


def propose(
    mesh: SolverMesh, up: str | None = None, front: str | None = None, *, specified: bool = False
) -> Orientation:
    """Propose a character's axes.

    If the shape is clear, the result for a character turned by right angles about the origin turns with it.

    Parameters
    ----------
    mesh : SolverMesh
    up, front : str, optional
        Axes that are known; they are different.
    specified : bool
        The file's format says that y is up and z the front, as glTF does.
    """
    sure, nearly = (MIN_SPECIFIED_PROBABILITIES, MIN_SPECIFIED_RATIOS) if specified else (MIN_PROBABILITIES, MIN_RATIOS)
    known = (up, front)
    chances = {
        axes: chance
        for axes, chance in _chances(mesh).items()
        if all(given in (None, axis) for given, axis in zip(known, axes, strict=True))
    }
    ups = dict.fromkeys((axes[0] for axes in chances), 0.0)
    for (axis, _), chance in chances.items():
        ups[axis] += chance
    up, up_is_clear = _choose(ups, sure[0], nearly[0], "y")
    if not up_is_clear and up not in FILE_UPS and not ups.keys().isdisjoint(FILE_UPS):
        up = max(ups.keys() & FILE_UPS, key=lambda axis: ups[axis])
    fronts = {axis: chance for (above, axis), chance in chances.items() if above == up}
    front, front_is_clear = _choose(fronts, sure[1], nearly[1], {"y": "z", "z": "-y"}.get(up))
    unclear = "not clear from the shape: taken as"
    reasons = (
        f"{up} looks like up: {_posture(up, front)}" if up_is_clear else f"up is {unclear} {up}",
        f"{front} looks like the front" if front_is_clear else f"the front is {unclear} {front}",
    )
    total = sum(chances.values())
    others = sorted(((*axes, chance / total) for axes, chance in chances.items()), key=lambda each: -each[2])
    others = [each for each in others if each[:2] != (up, front)]
    return Orientation(up, front, chances[up, front] / total, reasons, tuple(others))


def _choose(chances: dict[str, float], sure: float, nearly: float, convention: str | None) -> tuple[str, bool]:
    """Return the most likely direction, or the conventional one if nearly as likely, and whether it is certain."""
    likeliest = max(chances, key=lambda each: chances[each])
    if chances[likeliest] >= sure * sum(chances.values()):
        return likeliest, True
    if convention is not None and chances.get(convention, 0.0) >= nearly * chances[likeliest]:
        return convention, False
    return likeliest, False


def _posture(up: str, front: str) -> str:
    """Describe the posture of a character in a program with y up."""
    if up == "y":
        return "it stands"
    if up == "-y":
        return "it is upside down"
    return {"y": "it lies on its back", "-y": "it lies on its face"}.get(front, "it lies on its side")


def _chances(mesh: SolverMesh) -> dict[tuple[str, str], float]:
    """Return the probability of each up and front."""
    points, _ = sample(mesh, SAMPLE_COUNT)
    diagonal = float(np.linalg.norm(np.ptp(points, axis=0)))
    tree = scipy.spatial.cKDTree(points)
    mirrored = [mirroring(tree, axis, diagonal) for axis in np.eye(3)]
    detail = mesh.vertices.mean(axis=0) - points.mean(axis=0)
    logits = {}
    for up, front in permutations(range(3), 2):
        left = 3 - up - front
        middle, mismatch = mirrored[left]
        for up_sign in (1, -1):
            for front_sign in (1, -1):
                signs = _signs(
                    (points[:, left] - middle) / diagonal,
                    up_sign * points[:, up] / diagonal,
                    front_sign * points[:, front] / diagonal,
                )
                signs["symmetry"] = -np.log(mismatch)
                signs["face"] = float(np.clip(front_sign * detail[front] / diagonal, -0.1, 0.1))
                name = "-" * (up_sign < 0) + "xyz"[up], "-" * (front_sign < 0) + "xyz"[front]
                logits[name] = sum(WEIGHTS[sign] * value for sign, value in signs.items())
    highest = max(logits.values())
    odds = {name: float(np.exp(logit - highest)) for name, logit in logits.items()}
    total = sum(odds.values())
    return {name: each / total for name, each in odds.items()}


def _signs(left: NDArray[np.float64], up: NDArray[np.float64], front: NDArray[np.float64]) -> dict[str, float]:
    """Measure how well surface points fit a character that stands along these axes.

    Parameters
    ----------
    left, up, front : (n,) float64
        In diagonals; the first from the middle plane, its sign does not matter.
    """
    aside = np.abs(left)
    over_ground = up - up.min()
    height, length = max(float(np.ptp(up)), 1e-9), max(float(np.ptp(front)), 1e-9)  # a cardboard figure is flat
    share = over_ground / height
    in_the_middle = aside < 0.01
    feet, shins = over_ground < 0.03, (over_ground > 0.06) & (over_ground < 0.18)
    crown = (share > 0.75) & (aside < 0.1)
    rear = front < front.min() + 0.15 * length
    footprint = _spread(left, front)
    return {
        # feet as far apart as the body is wide
        "stance": min(_spread(left[feet], front[feet]) / footprint, 0.7) if footprint else 0.0,
        # legs do not touch the middle plane, but heads and backs do
        "parting": min(float(in_the_middle[share < 0.12].mean()), 0.1),
        "height": float(np.log(height / length)),
        # modellers put the feet at 0
        "ground": float(abs(up.min()) < 0.01 * height),
        "toes": float(np.clip(front[feet].mean() - front[shins].mean(), -0.1, 0.1)) if shins.any() else 0.0,
        "head": float(front[crown].mean() - front.mean()) / length if crown.any() else 0.0,
        # tails, rumps and backs are in the middle; faces reach around it
        "spine": min(float(in_the_middle[rear].mean()), 0.1),
    }


def _spread(left: NDArray[np.float64], front: NDArray[np.float64]) -> float:
    """Return the product of the standard deviations of points along their principal axes."""
    left, front = left - left.mean(), front - front.mean()
    squared = float(np.mean(left**2) * np.mean(front**2) - np.mean(left * front) ** 2)
    return float(np.sqrt(max(squared, 0.0)))


def mirroring(tree: "scipy.spatial.cKDTree", normal: NDArray[np.float64], diagonal: float) -> tuple[float, float]:
    """Return where the middle plane with a normal is, and the mean distance of mirrored points from the surface.

    The distance is in diagonals, at most 0.03 per point, so that a sword in one hand does not matter much.
    """
    along = tree.data @ normal
    found = []
    for middle in (0.0, along.mean(), np.median(along), (along.min() + along.max()) / 2):
        mirrored = tree.data[::3] + 2 * np.outer(middle - along[::3], normal)
        distance, _ = tree.query(mirrored, distance_upper_bound=0.03 * diagonal)
        found.append((float(np.minimum(np.asarray(distance) / diagonal, 0.03).mean()), float(middle)))
    mismatch, middle = min(found)
    return middle, max(mismatch, MIN_MISMATCH)


def sample(mesh: SolverMesh, count: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return points (count, 3) spread evenly over the surface, whatever the rotation of the mesh, and their faces."""
    return spread(mesh.vertices[mesh.faces], count)


def spread(corners: NDArray[np.float64], count: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return points (count, 3) spread evenly over triangles with these corners (t, 3, 3), and the rows of theirs."""
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    up_to = np.cumsum(areas)
    number = np.arange(count)
    face = np.searchsorted(up_to, (number + 0.5) / count * up_to[-1])
    # the R2 sequence of Roberts fills the unit square evenly
    first, second = np.sqrt(number * 0.7548776662466927 % 1), number * 0.5698402909980532 % 1
    shares = np.column_stack([1 - first, first * (1 - second), first * second])
    points: NDArray[np.float64] = np.einsum("nk,nkc->nc", shares, corners[face])
    return points, face
