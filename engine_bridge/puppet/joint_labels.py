"""What the names of joints say about a body: the labels of `solver.anatomy.body_graph`, and which is beyond another."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from capture.bone_names import LEG_PARTS, JointMeaning
from capture.channels import FINGERS
from solver.anatomy.body_graph import LABELS

ARM_PARTS = ("shoulder", "upperArm", "lowerArm", "hand", "palm", *FINGERS)
FACE_PARTS = ("eye", "jaw", "face")
PARTS: dict[str, tuple[str, ...]] = {
    "head": ("neck", "head", *FACE_PARTS),
    "arm": ARM_PARTS,
    "leg": LEG_PARTS,
    "wing": ("wing",),
    "tail": ("tail",),
    "ear": ("ear",),
    "trunk": ("hips", "spine", "chest", "upperChest", "trunk"),
}
"""Parts in the names of joints, by the labels for which they speak."""

LABEL_OF = {part: label for label, parts in PARTS.items() for part in parts}

LIMBS = np.isin(LABELS, ("arm", "leg", "wing"))
"""Which of the labels are limbs that a shoulder can carry."""

END_PARTS = ("foot", "toes", "hand", "palm")
"""Parts at the ends of legs and arms."""


def votes_of(meanings: Sequence[JointMeaning | None], children: Sequence[Sequence[int]]) -> NDArray[np.float64]:
    """Return the labels for which the names of nodes speak; a shoulder is of the limb that it carries.

    Parameters
    ----------
    meanings : sequence of JointMeaning or None
        What the name of each node says.
    children : sequence of sequence of int
        Children of each node, whose rows come later.

    Returns
    -------
    (n, 7) float64
        1 for at most one of `LABELS` in each row.
    """
    votes = np.zeros((len(meanings), len(LABELS)))
    for row, meaning in reversed([*enumerate(meanings)]):
        if meaning is None or (meaning.side and meaning.part == "spine"):  # "back_claw_L" is of a limb
            continue
        carried = votes[children[row]].sum(axis=0) * LIMBS
        if meaning.part == "shoulder" and carried.any():
            votes[row, carried.argmax()] = 1.0
            continue
        label = "leg" if meaning.side and meaning.part == "hips" and children[row] else LABEL_OF.get(meaning.part)
        if label:
            votes[row, LABELS.index(label)] = 1.0
    return votes


def quarter_of(meaning: JointMeaning | None) -> float:
    """Return 1 for a limb in front, −1 for one behind, 0 for others."""
    words = (meaning and meaning.quarter) or ""
    return float("front" in words) - float("hind" in words)


def is_end(foot: JointMeaning | None, leg: JointMeaning | None) -> bool:
    """Return whether names say that a joint is the foot of a leg, or the hand of an arm."""
    if foot is None or leg is None or foot.part not in END_PARTS or leg.part in END_PARTS:
        return False
    same = LABEL_OF.get(foot.part) == LABEL_OF.get(leg.part)
    return same and (foot.side, foot.quarter) == (leg.side, leg.quarter)


def is_beyond(one: JointMeaning | None, other: JointMeaning | None) -> bool:
    """Return whether names say that one joint is farther down the same limb than another.

    Beside a thigh, a leg is the shin; beside other joints, it may be any part of a leg.
    """
    if one is None or other is None or one.side is None or other.part == "leg":
        return False
    label, order = LABEL_OF.get(one.part), (*ARM_PARTS, *LEG_PARTS)
    if label not in ("arm", "leg") or label != LABEL_OF.get(other.part):
        return False
    same = (one.side, one.quarter) == (other.side, other.quarter)
    return same and order.index(one.part) > order.index(other.part)
