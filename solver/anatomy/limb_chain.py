"""The limbs of a character at rest, as found from a file's skeleton or from its shape."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class LimbChain:
    """A chain of points inside a limb, from the body to the limb's end.

    Attributes
    ----------
    name : str
        "trunk", "neck", "head", "tail", or with the character's own side "left arm", "right leg", "left front leg",
        "right hind leg", "left wing", "left ear", "jaw".
    points : (k, 3) float64
        Root to tip, mesh file's coordinates. Arms and legs have four: shoulder, elbow, wrist and the end of the hand;
        hip, knee, ankle and the end of the foot. Legs of animals may have a hock after the knee. A leg in the middle
        has no side.
    nodes : tuple of str
        Labels of the joints of the file's skeleton that it was read from, root to tip; none from the shape.
    """

    name: str
    points: NDArray[np.float64]
    nodes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Limbs:
    """The limbs of a character, and notes on what is unclear about them.

    Attributes
    ----------
    chains : tuple of LimbChain
        Each after its parent.
    notes : tuple of str
        Sentences for a person: what is unclear or was omitted, and how to settle it.
    others : tuple of (float, tuple of LimbChain)
        Other limbs that the character may have instead, with their probabilities, the likeliest first.
    """

    chains: tuple[LimbChain, ...]
    notes: tuple[str, ...] = ()
    others: tuple[tuple[float, tuple[LimbChain, ...]], ...] = ()

    @property
    def points(self) -> dict[str, NDArray[np.float64]]:
        """The points of each limb by its name."""
        return {chain.name: chain.points for chain in self.chains}


def evenly(points: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Return (count, 3) points at equal distances along a polyline of (k, 3), its ends among them."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    wanted = np.linspace(0, along[-1], count)
    return np.column_stack([np.interp(wanted, along, column) for column in points.T])


def leg_names(pairs: int) -> tuple[str, ...]:
    """Return the names of pairs of legs, from hind to front; three pairs and more are counted from the front."""
    few = {0: (), 1: ("leg",), 2: ("hind leg", "front leg")}
    return few.get(pairs, tuple(f"leg {row}" for row in range(pairs, 0, -1)))
