"""Conversion of signed coordinates of a pose to morph weights within [0, 1].

Blender clamps morph weights to [0, 1] on import and Unity can clamp them during playback (docs/characters.md), but the
coordinates w_k of a pose along the directions D_k of a morph basis have both signs. One more target solves this. With a
lower bound l_k ≤ 0 of each coordinate, m = max(0, max_k w_k / l_k) and u_k = w_k − m l_k,

    Σ w_k D_k = Σ u_k D_k + m Σ l_k D_k,

and u_k ≥ 0. Each u_k is divided by its span, its maximum, and its target is multiplied by the span. The rest pose has
w = 0 and therefore zero weights. Between keyframes all weights are linear, like w.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class UnitWeights:
    """Conversion of signed coordinates to weights within [0, 1], and of directions to targets for these weights.

    Attributes
    ----------
    lowest : (K,) float64
        Lower bounds l_k ≤ 0 of the coordinates.
    spans : (K,) float64
        Maximum of each u_k; positive.
    """

    lowest: NDArray[np.float64]
    spans: NDArray[np.float64]

    @classmethod
    def of_clip(cls, coordinates: NDArray[np.floating]) -> Self:
        """Return the conversion for a clip's coordinates (F, K), with which the largest weight of each target is 1."""
        lowest = np.minimum(coordinates.min(axis=0, initial=0), 0).astype(np.float64)
        spans = cls(lowest, np.ones_like(lowest))._shifted(coordinates)[0].max(axis=0, initial=0)
        return cls(lowest, np.where(spans > 0, spans, 1.0))

    @classmethod
    def within(cls, reach: NDArray[np.float64]) -> Self:
        """Return the conversion for coordinates from −reach to reach, positive numbers (K,)."""
        return cls(-reach, 2 * reach)

    @property
    def count(self) -> int:
        """Number of targets: K, plus one if any coordinate may be negative."""
        return len(self.lowest) + bool((self.lowest < 0).any())

    def weights(self, coordinates: NDArray[np.floating]) -> NDArray[np.float32]:
        """Return the weights (F, count) float32 of coordinates (F, K) within the bounds."""
        shifted, opposite = self._shifted(coordinates)
        weights = np.column_stack([shifted / self.spans, opposite])[:, : self.count]
        return np.clip(weights, 0, 1).astype(np.float32)  # rounding may exceed the range by 1e-16

    def targets(self, directions: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the targets (count, …) float64 for directions (K, …)."""
        spanned = self.spans.reshape(-1, *[1] * (directions.ndim - 1)) * directions
        opposite = np.tensordot(self.lowest, directions, axes=1)
        return np.concatenate([spanned, opposite[None]])[: self.count]

    def _shifted(self, coordinates: NDArray[np.floating]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return u (F, K) and m (F,)."""
        bounded = self.lowest < 0
        negative = np.minimum(coordinates[:, bounded], 0).astype(np.float64)
        opposite = (negative / self.lowest[bounded]).max(axis=1, initial=0)
        return coordinates - opposite[:, None] * self.lowest, opposite
