"""Which part of a body points inside a character belong to, by a network that was fitted to characters with skeletons.

The network sees a few hundred points and says, for each, the probabilities of `PARTS` and the places of the four joints
of its limb: it votes for them (Hough voting, as Qi et al. 2019, "Deep Hough Voting"). Points are joined to their
nearest neighbours in three sets, each coarser than the one before (Qi et al. 2017, "PointNet++"); between the points of
the coarsest set there is attention (Vaswani et al. 2017). `benchmarks.part_fitting` fits the weights.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import NDArray

PARTS = ("trunk", "head", "arm", "leg", "tail", "wing")
"""Parts of a body; a neck belongs to the head."""

POINTS, MIDDLE, COARSE = 640, 224, 96
"""Number of points, and how many of them, the first ones, are in each coarser set."""

SCALE, DEPTH_SCALE = 4.0, 20.0
"""Factors that bring coordinates and depths, in largest extents, to about the same range."""

MIN_EXTENT = 0.02
"""Minimum extent along an axis, as a share of the longest."""

NEIGHBORS = {"e0": (16, 0.06), "e1": (24, 0.12), "e1b": (12, 0.15), "e2": (24, 0.25), "e1c": (12, 0.15)}
"""Number of neighbours of a point in each layer, and the unit of their distances."""

HEADS = 4
"""Number of heads of the attention."""

WEIGHTS = Path(__file__).with_name("part_weights.npz")

Weights = Mapping[str, NDArray[np.float32]]
Array = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Parts:
    """What the network says of points.

    Attributes
    ----------
    chances : (n, 6) float32
        Probability of each of `PARTS`.
    joints : (n, 4, 3) float32
        Places of the joints of a point's limb, root to tip, in the points' coordinates.
    stands : float
        Logit of the probability that the character stands as the coordinates say.
    """

    chances: Array
    joints: Array
    stands: float


@cache
def load_weights() -> Weights:
    """Return the weights of the network by their names."""
    with np.load(WEIGHTS) as stored:
        return {name: stored[name].astype(np.float32) for name in stored.files}


def parts_of(points: NDArray[np.float64], depths: NDArray[np.float64]) -> Parts:
    """Return what the network says of points inside a character.

    Parameters
    ----------
    points : (n, 3) float64
        Left, up and front, in mesh units. Their order is random: the first ones are the coarser sets.
    depths : (n,) float64
        Distance of the surface from each, in mesh units.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    middle, scale = (low + high) / 2, float((high - low).max())
    x = ((points - middle) / scale).astype(np.float32)
    extent = np.maximum((high - low) / scale, MIN_EXTENT)
    share = (SCALE * (points - low) / scale / extent - SCALE / 2).astype(np.float32)
    depth = (DEPTH_SCALE * depths[:, None] / scale - 1).astype(np.float32)
    chances, offsets, stands = _Layers(load_weights()).answer(x, depth, share)
    joints = (x[:, None] + offsets.reshape(-1, 4, 3)) * np.float32(scale) + middle.astype(np.float32)
    return Parts(chances, joints, stands)


class _Layers:
    """The layers of the network, by the names of their weights."""

    def __init__(self, weights: Weights) -> None:
        self._weights = weights

    def answer(self, x: Array, depth: Array, share: Array) -> tuple[Array, Array, float]:
        """Return the probabilities (n, 6), the offsets of the joints (n, 12) and the logit of standing so."""
        fine = self._perceptron("emb", np.hstack([SCALE * x, depth, share], dtype=np.float32))
        fine = _positive(fine + self._edges("e0", x, x, fine, fine))
        x1, x2 = x[:MIDDLE], x[:COARSE]
        middle = _positive(self._edges("e1", x1, x, fine))
        middle = _positive(middle + self._edges("e1b", x1, x1, middle, middle))
        where = np.hstack([SCALE * x2, share[:COARSE]], dtype=np.float32)
        coarse = self._edges("e2", x2, x1, middle) + self._linear("pos", where)
        tokens = np.vstack([self._weights["tok"][0], coarse])
        number = 0
        while f"blocks.{number}.o.weight" in self._weights:
            tokens = self._attended(f"blocks.{number}", tokens)
            number += 1
        tokens = self._normed("n", tokens)
        middle = self._perceptron("u1", np.hstack([_spread(x1, x2, tokens[1:]), middle]))
        middle = _positive(middle + self._edges("e1c", x1, x1, middle, middle))
        fine = self._perceptron("u0", np.hstack([_spread(x, x1, middle), fine]))
        answer = self._linear("head", fine)
        stands = self._linear("glob.2", _positive(self._linear("glob.0", tokens[:1])))[0, -1]
        return _softmax(answer[:, : len(PARTS)]), answer[:, len(PARTS) :], float(stands)

    def _linear(self, name: str, values: Array) -> Array:
        found = values @ self._weights[f"{name}.weight"].T
        bias = self._weights.get(f"{name}.bias")
        return found if bias is None else found + bias

    def _perceptron(self, name: str, values: Array) -> Array:
        return _positive(self._linear(f"{name}.2", _positive(self._linear(f"{name}.0", values))))

    def _normed(self, name: str, values: Array) -> Array:
        away = values - values.mean(axis=-1, keepdims=True)
        scale = np.sqrt((away * away).mean(axis=-1, keepdims=True) + np.float32(1e-5))
        return away / scale * self._weights[f"{name}.weight"] + self._weights[f"{name}.bias"]

    def _edges(self, name: str, at: Array, x: Array, values: Array, own: Array | None = None) -> Array:
        """Return the largest of what the neighbours of points say, by their values and where they are."""
        count, unit = NEIGHBORS[name]
        near = scipy.spatial.cKDTree(x).query(at, count)[1]
        way = (x[near] - at[:, None]) / np.float32(unit)
        way = np.concatenate([way, np.linalg.norm(way, axis=-1, keepdims=True)], axis=-1)
        said = (self._linear(f"{name}.a", values)[near] + self._linear(f"{name}.p", way)).max(axis=1)
        if own is not None:
            said += self._linear(f"{name}.q", own)
        return self._normed(f"{name}.n", self._linear(f"{name}.m", _positive(said)))

    def _attended(self, name: str, tokens: Array) -> Array:
        count, width = tokens.shape
        every = self._linear(f"{name}.qkv", self._normed(f"{name}.n1", tokens)).reshape(count, 3, HEADS, -1)
        query, key, value = every.transpose(1, 2, 0, 3)
        seen = _softmax(query @ key.transpose(0, 2, 1) / np.float32(np.sqrt(width / HEADS))) @ value
        tokens = tokens + self._linear(f"{name}.o", seen.transpose(1, 0, 2).reshape(count, width))
        inner = self._linear(f"{name}.m.0", self._normed(f"{name}.n2", tokens))
        gate = (np.float32(0.5) * (1 + scipy.special.erf(inner / np.float32(np.sqrt(2))))).astype(np.float32)
        return tokens + self._linear(f"{name}.m.2", inner * gate)


def _positive(values: Array) -> Array:
    return np.maximum(values, np.float32(0))


def _softmax(values: Array) -> Array:
    odds = np.exp(values - values.max(axis=-1, keepdims=True))
    return odds / odds.sum(axis=-1, keepdims=True)


def _spread(at: Array, x: Array, values: Array) -> Array:
    """Return values at points: those of the three nearest places, weighted by their closeness."""
    away, near = scipy.spatial.cKDTree(x).query(at, 3)
    share = 1 / (np.asarray(away) + 1e-4)
    share = (share / share.sum(axis=1, keepdims=True)).astype(np.float32)
    return np.einsum("nk,nkc->nc", share, values[near])
