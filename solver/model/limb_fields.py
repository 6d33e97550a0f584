"""Fields along the limbs of a character: each limb has isolines of its own.

The smoothest fields of a surface hardly tell a short arm from the chest beside it: few of their isolines cross it, and
those lie on other limbs as well. Where bones say what a limb is, a field that is 0 on the rest of the character and
rises from bone to bone gives it all the isolines of one field, each with a transform that nothing else uses.
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from solver.model.bones import BoneRegions, Bones
from solver.model.fields import smoothed
from solver.surface.contacts import Contacts

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

SMOOTHEST = 3
"""Number of the surface's own fields that are kept beside those of the limbs: they carry the trunk and its bends."""

BLUR = 0.006
"""Length over which a field rises where a limb begins, as a fraction of the diagonal: about 1 cm on a person."""

SEAM = 1e-3
"""Greatest distance at which two parts are sewn together, as a fraction of the diagonal: 2 mm on a person."""

WITHIN = 0.5
"""Part of a bone's share of its field that is left to the bone itself where a skin says where joints bend."""


def limb_field_count(bones: Bones, regions: BoneRegions, fields: int) -> int:
    """Return how many of a model's fields run along limbs."""
    return min(len(_limbs(bones, regions)), max(0, fields - SMOOTHEST))


def limb_fields(
    L: "csr_matrix",
    mass: NDArray[np.float64],
    vertices: NDArray[np.float64],
    bones: Bones,
    regions: BoneRegions,
    count: int,
    shares: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Make fields that rise along the limbs of a character.

    A field is 0 where the limb is not, (1 + k + s) / (1 + n) on its bone k of n at the share s of the bone's length,
    and 1 on what hangs on the limb; then it is smoothed over `BLUR`. Where there is a skin, each vertex has the mean
    of its bones, and s keeps to the middle `WITHIN`: the field rises at the joints as the skin says, or jumps.

    Where there are more limbs than fields, those of the fewest bones share a field in pairs, one with the sign turned
    round; limbs beyond two a field get none.

    Parameters
    ----------
    L : (n, n) sparse float64
        Operator of the surface, model units, from `solver.model.fields.for_fields`.
    mass : (n,) float64
        Area of each vertex.
    vertices : (n, 3) float64
        In the units of the bones.
    bones : Bones
    regions : BoneRegions
        Of the bones on that surface.
    count : int
        Number of fields, from `limb_field_count`.
    shares : (n, b) float64, optional
        Of each bone in the motion of each vertex, by a skin.

    Returns
    -------
    (n, count) float64
    """
    within = 1.0 if shares is None else WITHIN
    if shares is None:
        shares = np.eye(len(bones) + 1)[regions.owner, :-1]
    limbs = _limbs(bones, regions)[: 2 * count]
    fields = [_along(limb, vertices, bones, shares, within) for limb in limbs]
    pairs = max(0, len(limbs) - count)
    alone = fields[: len(fields) - 2 * pairs]
    shared = fields[len(alone) :]
    both = [one - other for one, other in zip(shared[:pairs], shared[pairs:], strict=True)]
    return smoothed(L, mass, vertices, np.column_stack([*alone, *both]), BLUR)


def move_together(
    ties: Contacts, rest: NDArray[np.float64], regions: BoneRegions, bones: Bones, *, skinned: bool
) -> NDArray[np.bool_]:
    """Say which contacts between parts (k,) hold while bones move.

    Parameters
    ----------
    ties : Contacts
    rest : (n, 3) float64
        In model units.
    regions : BoneRegions
    bones : Bones
    skinned : bool
        The regions are those of a skin: whoever made it decided which part follows which bone, and between two parts
        on different bones there is a joint. Otherwise parts on neighbouring bones of a limb hold together, and those
        of a limb and the trunk do where they have a seam: an arm that is stuck into a body turns in it.
    """
    one, other = regions.owner[ties.links].T
    together = (one == other) | (one < 0) | (other < 0)
    if not skinned and len(bones):
        parents = bones.parents
        neighbours = (parents[one] == other) | (parents[other] == one) | (parents[one] == parents[other])
        seam = np.linalg.norm(ties.difference(len(rest)) @ rest, axis=1) < SEAM
        together |= neighbours & (seam | (bones.limbs[one] == bones.limbs[other]))
    return together


def _limbs(bones: Bones, regions: BoneRegions) -> list[int]:
    """Return the numbers of the limbs to which surface belongs, those of the most bones first."""
    size = np.bincount(bones.limbs[bones.limbs >= 0])
    there = np.unique(bones.limbs[np.unique(regions.owner[regions.owner >= 0])])
    return sorted((limb for limb in there.tolist() if limb >= 0), key=lambda limb: (-size[limb], limb))


def _along(
    limb: int, vertices: NDArray[np.float64], bones: Bones, shares: NDArray[np.float64], within: float
) -> NDArray[np.float64]:
    """Return what the field of a limb (n,) is before it is smoothed."""
    chain = np.flatnonzero(bones.limbs == limb)
    start, slope = np.zeros(len(bones)), np.zeros(len(bones))
    start[chain], slope[chain] = np.arange(1, len(chain) + 1) / (1 + len(chain)), 1 / (1 + len(chain))
    for bone, parent in enumerate(bones.parents):
        if bones.limbs[bone] != limb and parent >= 0:
            start[bone] = start[parent] + slope[parent]
    axes = bones.tails - bones.heads
    along = (vertices @ axes.T - np.einsum("bx,bx->b", bones.heads, axes)) / bones.lengths**2
    place = 0.5 + within * (np.clip(along, 0.0, 1.0) - 0.5)
    return np.einsum("nb,nb->n", shares, start + slope * place)
