"""Fields along the limbs of a character, which give each limb its own isolines.

Few isolines of a surface's smoothest fields cross a short arm, and these also cross other limbs. A field that is 0 on
the rest of the character and rises from bone to bone gives a limb all isolines of one field, with transforms that no
other limb uses.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from solver.model.bones import BoneRegions, Bones
from solver.surface.contacts import Contacts

Smoothing = Callable[[NDArray[np.float64], float], NDArray[np.float64]]

SURFACE_FIELD_COUNT = 3
"""Number of the surface's smoothest fields that are kept besides those of the limbs, for the trunk and its bends."""

BLUR_DIAGONALS = 0.006
"""Length over which a limb's field is smoothed, as a fraction of the diagonal: about 1 cm on a person."""

MAX_SEAM_DIAGONALS = 1e-3
"""Greatest distance at which two parts are sewn together, as a fraction of the diagonal: 2 mm on a person."""

BONE_RISE_SHARE = 0.5
"""Share of a bone's step of its field that is along the bone itself; the rest is at its joints, which bend."""


def limb_field_count(bones: Bones, regions: BoneRegions, fields: int) -> int:
    """Return the number of a model's fields that are along limbs."""
    return min(len(_limbs(bones, regions)), max(0, fields - SURFACE_FIELD_COUNT))


def limb_fields(
    smoothed: Smoothing,
    vertices: NDArray[np.float64],
    bones: Bones,
    regions: BoneRegions,
    count: int,
    shares: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Make fields that rise along the limbs of a character.

    A field is 0 outside its limb, (1 + k + s) / (1 + n) at the share s of the length of the limb's bone k of n, and 1
    on the limb's children; a vertex has the mean of its bones. s stays within the middle `BONE_RISE_SHARE`, so that the
    field rises at the joints as the shares do. Then it is smoothed.

    If there are more limbs than fields, the limbs with the fewest bones share a field in pairs, one of them with a
    negative sign. Limbs beyond two per field have none.

    Parameters
    ----------
    smoothed : callable
        Smooths (n, k) values over a length in model units, see `fields.SurfaceOperator.smoothed`.
    vertices : (n, 3) float64
        In the units of the bones.
    bones : Bones
    regions : BoneRegions
    count : int
        Number of fields, from `limb_field_count`.
    shares : (n, b) float64
        Share of each bone in the motion of each vertex.

    Returns
    -------
    (n, count) float64
    """
    if count == 0:
        return np.empty((len(vertices), 0))
    limbs = _limbs(bones, regions)[: 2 * count]
    rises = [_rise(limb, bones) for limb in limbs]
    places = _places(vertices, bones)
    fields = [np.einsum("nb,nb->n", shares, start + slope * places) for start, slope in rises]
    pairs = max(0, len(limbs) - count)
    alone = fields[: len(fields) - 2 * pairs]
    shared = fields[len(alone) :]
    both = [one - other for one, other in zip(shared[:pairs], shared[pairs:], strict=True)]
    return smoothed(np.column_stack([*alone, *both]), BLUR_DIAGONALS)


def contacts_that_hold(
    ties: Contacts, rest: NDArray[np.float64], regions: BoneRegions, bones: Bones, *, skinned: bool
) -> NDArray[np.bool_]:
    """Return which contacts between parts (k,) hold while bones move.

    Parameters
    ----------
    ties : Contacts
    rest : (n, 3) float64
        In model units.
    regions : BoneRegions
    bones : Bones
    skinned : bool
        Whether the regions are those of a skin: parts on different bones are then separated by a joint. Otherwise
        contacts between parts on neighbouring bones of a limb hold. Those of a limb and the trunk hold where the parts
        have a seam: an arm that is stuck into a body turns in it.
    """
    one, other = regions.owner[ties.links].T
    together = (one == other) | (one < 0) | (other < 0)
    if not skinned and len(bones):
        parents = bones.parents
        neighbours = (parents[one] == other) | (parents[other] == one) | (parents[one] == parents[other])
        seam = np.linalg.norm(ties.difference(len(rest)) @ rest, axis=1) < MAX_SEAM_DIAGONALS
        together |= neighbours & (seam | (bones.limbs[one] == bones.limbs[other]))
    return together


def _limbs(bones: Bones, regions: BoneRegions) -> list[int]:
    """Return the numbers of the limbs that own vertices, those with the most bones first."""
    size = np.bincount(bones.limbs[bones.limbs >= 0])
    there = np.unique(bones.limbs[np.unique(regions.owner[regions.owner >= 0])])
    return sorted((limb for limb in there.tolist() if limb >= 0), key=lambda limb: (-size[limb], limb))


def _places(vertices: NDArray[np.float64], bones: Bones) -> NDArray[np.float64]:
    """Return the place of each vertex along each bone (n, b), from 0 to 1, within the middle share of the bone."""
    axes = bones.tails - bones.heads
    along = (vertices @ axes.T - np.einsum("bx,bx->b", bones.heads, axes)) / bones.lengths**2
    return 0.5 + BONE_RISE_SHARE * (np.clip(along, 0.0, 1.0) - 0.5)


def _rise(limb: int, bones: Bones) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the (b,) value of a limb's field at the head of each bone, and by how much it rises along the bone."""
    chain = np.flatnonzero(bones.limbs == limb)
    start, slope = np.zeros(len(bones)), np.zeros(len(bones))
    start[chain], slope[chain] = np.arange(1, len(chain) + 1) / (1 + len(chain)), 1 / (1 + len(chain))
    for bone, parent in enumerate(bones.parents):
        if bones.limbs[bone] != limb and parent >= 0:
            start[bone] = start[parent] + slope[parent]
    return start, slope
