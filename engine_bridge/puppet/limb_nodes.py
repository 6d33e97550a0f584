"""Joints of a file's skeleton that the limbs of a puppet were read from."""

from collections import Counter
from itertools import pairwise
from pathlib import Path

import numpy as np

from engine_bridge.character.character import CharacterMesh
from engine_bridge.character.document import Document
from engine_bridge.character.scene import world_transforms
from engine_bridge.puppet.puppet import Puppet
from puppetline.errors import PuppetError, at
from solver.motion.limbs import distance_from_segment

MAX_DISTANCE_SHARE = 0.1
"""Maximum distance between a limb and its joints, as a share of the diagonal. A head may begin beside its joint: in 20
public characters, joints are at most 0.07 away."""


def node_labels(document: Document) -> list[str]:
    """Return how puppet files call each node: by its name, or "#12" by its number if the name is missing or double."""
    names = [node.get("name", "") for node in document.gltf["nodes"]]
    known = {name for name, count in Counter(names).items() if count == 1 and name and not name.startswith("#")}
    return [name if name in known else f"#{number}" for number, name in enumerate(names)]


def limb_nodes(puppet: Puppet, character: CharacterMesh, where: str | Path = "the puppet file") -> dict[str, list[int]]:
    """Return the nodes of the joints that limbs were read from, root to tip, by the limbs' names.

    Parameters
    ----------
    puppet : Puppet
    character : CharacterMesh
    where : str or Path, optional
        Name of the puppet file in error messages.

    Raises
    ------
    PuppetError
        The character's file has no such node, or it is far from the limb.
    """
    nodes = {label: node for node, label in enumerate(node_labels(character.document))}
    places = world_transforms(character.document)[:, :3, 3]
    allowed = MAX_DISTANCE_SHARE * float(np.linalg.norm(np.ptp(character.vertices, axis=0)))
    found: dict[str, list[int]] = {}
    for number, limb in enumerate(puppet.limb, 1):
        bones = [*pairwise(np.array(limb.points))]
        for label in limb.nodes or ():
            node = nodes.get(label)
            away = np.inf if node is None else min(distance_from_segment(places[node], *bone) for bone in bones)
            if node is None or away > allowed:
                what = f"not a joint of {puppet.character.mesh}" if node is None else f"{away:.4g} away from the limb"
                raise PuppetError(
                    at(where, field=f"[[limb]] {number} {limb.name!r}, nodes"),
                    found=f"{label!r}, which is {what}",
                    expected="joints of the mesh's skeleton along the limb",
                    fix="If the mesh was replaced, run `puppetline new` again. Otherwise, delete the line `nodes`.",
                )
            found.setdefault(limb.name, []).append(node)
    return found
