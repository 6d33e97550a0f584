"""Share of each bone of a puppet in the motion of each vertex, from the skin in the character's file."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.character import Character
from engine_bridge.character.scene import tree
from engine_bridge.puppet.rig_bones import rig_bones
from engine_bridge.puppet.rig_limbs import vertex_influences
from solver.motion.limbs import Limb, parents_first


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
    shares = np.einsum("nk,nkb->nb", share, of_node[which])
    _keep_feet(shares, character.vertices, limbs)
    return shares


def _keep_feet(shares: NDArray[np.float64], vertices: NDArray[np.float64], limbs: Sequence[Limb]) -> None:
    """Let vertices of a standing foot follow it alone, and only near the ankle also the bone before it.

    In many files soles also follow the shin or the hips a little, and would sink into the floor with them.
    """
    last = -1
    for limb in parents_first(limbs):
        last += len(limb.points) - 1
        if not limb.stands or len(limb.points) < 3:
            continue
        of_foot = np.flatnonzero(shares.argmax(axis=1) == last)
        own = shares[of_foot, last - 1 : last + 1]
        ankle, tip = np.asarray(limb.points[-2]), np.asarray(limb.points[-1])
        away = np.linalg.norm(vertices[of_foot] - ankle, axis=1) / np.linalg.norm(tip - ankle)
        shin = np.maximum(1 - away, 0) * own[:, 0] / own.sum(axis=1)
        shares[of_foot] = 0.0
        shares[of_foot, last - 1], shares[of_foot, last] = shin, 1 - shin
