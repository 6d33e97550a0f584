"""Limbs of a character from the skeleton in its file: from its joints, what follows them, and their names."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from capture.bone_names import joint_meanings
from engine_bridge.character.character import CharacterMesh
from engine_bridge.puppet.joint_graph import joint_graph
from engine_bridge.puppet.joint_labels import LABEL_OF
from engine_bridge.puppet.joint_votes import JointVotes
from engine_bridge.puppet.limb_reader import LimbReader
from engine_bridge.puppet.part_joints import part_joints, without_ornaments
from engine_bridge.puppet.skin_joints import STRAIGHT, Joint, are_nested, joints_of
from solver.anatomy.body_decision import Body, decide, load_weights
from solver.anatomy.limb_chain import LimbChain, Limbs
from solver.surface.mesh import SolverMesh


@dataclass(frozen=True, eq=False)
class RigBody:
    """The limbs of a skeleton, and how it stands.

    Attributes
    ----------
    limbs : Limbs
        Without chains, but with a note, if they were not found.
    bodies : list of (float, Body)
        The ways to see it with their probabilities, the likeliest first.
    """

    limbs: Limbs
    bodies: list[tuple[float, Body]]


def rig_limbs(
    character: CharacterMesh,
    up: NDArray[np.float64] | None = None,
    front: NDArray[np.float64] | None = None,
    back: NDArray[np.float64] = STRAIGHT,
    surface: SolverMesh | None = None,
) -> RigBody | None:
    """Find a character's limbs by the joints of its file's skeleton.

    Parameters
    ----------
    character : CharacterMesh
    up, front : (3,) float64, optional
        Known directions of the character that is turned back.
    back : (3, 3) float64
        Rotation that turns the character back to its axes. Directions of bodies are of the character that is turned
        back, points of limbs are of the file.
    surface : SolverMesh, optional
        The character's, turned back, in which points tell limbs whose names do not.

    Returns
    -------
    RigBody or None
        None if the file has no skeleton, or only parts whose names say nothing.
    """
    if character.joints:
        return _turned(limbs_of_joints(joints_of(character, back), up, front, surface=surface), back)
    parts = without_ornaments(joints_of(character, back) if are_nested(character) else part_joints(character, back))
    meanings = joint_meanings([part.name for part in parts], [True] * len(parts))
    if not any(meaning and LABEL_OF.get(meaning.part) in ("arm", "leg", "wing") for meaning in meanings):
        return None  # names of parts need not mean anything, and a face alone is no body
    found = limbs_of_joints(parts, up, front, rigid=True)
    return _turned(found, back) if found.limbs.chains else None


def _turned(found: RigBody, back: NDArray[np.float64]) -> RigBody:
    """Return limbs whose points are those of the file."""
    chains = tuple(replace(chain, points=chain.points @ back) for chain in found.limbs.chains)
    return replace(found, limbs=replace(found.limbs, chains=chains))


def limbs_of_joints(
    joints: Sequence[Joint],
    up: NDArray[np.float64] | None = None,
    front: NDArray[np.float64] | None = None,
    rigid: bool = False,
    surface: SolverMesh | None = None,
) -> RigBody:
    """Find the limbs of a skeleton.

    Up, front and limbs are those that `solver.anatomy.body_decision` decides for the graph of the joints. Twists and
    controls within a limb are skipped.

    Parameters
    ----------
    joints : sequence of Joint
    up, front : (3,) float64, optional
        Known directions.
    rigid : bool
        Whether these are rigid parts: a single part of the trunk does not bend, and nothing is between it and a head.
    surface : SolverMesh, optional
        The character's, in which points tell limbs whose names do not.
    """
    some = ", ".join(dict.fromkeys(joint.name for joint in joints[:5]))
    unknown = Limbs((), (f"The skeleton has no limbs that are known ({some}, …); limbs are found from the shape.",))
    graph = joint_graph(joints)
    if graph is None:
        return RigBody(unknown, [])
    is_followed = any(len(joint.vertices) for joint in graph.joints)
    ask = JointVotes(graph, surface) if surface is not None and is_followed else None
    bodies = decide(graph.graph, load_weights("joints"), up, front, ask)
    reader = LimbReader(graph, bodies[0][1], rigid)
    chains = tuple(
        LimbChain(name, chain.points, tuple(graph.joints[node].label for node in chain.nodes))
        for name, chain in reader.limbs().items()
    )
    return RigBody(Limbs(chains) if chains else unknown, bodies)
