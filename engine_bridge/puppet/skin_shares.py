"""Share of each bone of a puppet in the motion of each vertex, from the skin in the character's file."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.character import Character
from engine_bridge.character.scene import tree
from engine_bridge.puppet.rig_bones import rig_bones
from engine_bridge.puppet.rig_limbs import vertex_influences
from solver.motion.limbs import Limb


def skin_shares(character: Character, limbs: Sequence[Limb]) -> NDArray[np.float64] | None:
    """Return each bone's share in the motion of each vertex.

    Parameters
    ----------
    character : Character
    limbs : sequence of Limb

    Returns
    -------
    (N, b) float64 or None
        Rows sum to 1, or to 0 for vertices that follow no bone. None if the file has no skeleton, or if its skeleton
        lacks joints for some limb.
    """
    found = rig_bones(character, limbs) if limbs else None
    if found is None or not len(found.nodes) or found.missing:
        return None
    own = dict(zip(found.nodes.tolist(), found.shares, strict=True))
    of_node = np.zeros((len(character.document.gltf["nodes"]), found.shares.shape[1]))
    for node, parent in tree(character.document):
        of_node[node] = own.get(node, of_node[parent] if parent is not None else 0.0)
    which, share = vertex_influences(character)
    return np.asarray(np.einsum("nk,nkb->nb", share, of_node[which]))
