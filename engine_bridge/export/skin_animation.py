"""Animation of a character as a skinned mesh whose bones have no names: those that a clip needs."""

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.character import Character
from engine_bridge.character.document import Document
from engine_bridge.character.schema import Animation
from engine_bridge.export.animation import Keyframes, add_channel, add_root, hold_targets
from engine_bridge.export.skinning import Skinning
from engine_bridge.rigging.joints import ROOT, Joint
from engine_bridge.rigging.made_rig import MadeRig
from engine_bridge.rigging.rig_document import rigged_document
from engine_bridge.rigging.skeleton import Skeleton
from solver.skinning.weights import Weights


def animate_skin(
    character: Character, keyframes: Keyframes, skinning: Skinning, follows: NDArray[np.int64]
) -> tuple[Document, tuple[str, ...]]:
    """Bind the meshes of a copy of a character's document to new bones, and add their animation.

    The bones are children of a joint that does not move, to which points and lines are bound.

    Parameters
    ----------
    character : Character
    keyframes : Keyframes
        Keyframes, whose weights are ignored.
    skinning : Skinning
    follows : (N,) int64
        Solver vertex of each vertex of all parts, one part after another.

    Returns
    -------
    document : Document
        Animated document.
    notes : tuple of str
        Sentences about what was replaced or omitted.
    """
    document, joints, notes = rigged_document(character, _rig(skinning), follows)
    gltf = document.gltf
    animation: Animation = {"name": keyframes.name, "channels": [], "samplers": []}
    clock = document.add(keyframes.times, bounds=True)
    for bone, joint in enumerate(joints[1:]):
        add_channel(document, animation, clock, skinning.rotations[:, bone], joint, "rotation")
        add_channel(document, animation, clock, skinning.translations[:, bone], joint, "translation")
    hold_targets(document, animation, clock, keyframes, character)
    if keyframes.root is not None:
        add_channel(document, animation, clock, keyframes.root, add_root(document), "translation")
    gltf["animations"].insert(0, animation)  # viewers play the first one
    return document, notes


def _rig(skinning: Skinning) -> MadeRig:
    """Return the bones as joints below one that does not move, all with the axes of the file."""
    places = skinning.joints.astype(np.float64)
    bones = (Joint(f"bone_{bone}", 0, bone, place, place) for bone, place in enumerate(places))
    joints = (Joint(ROOT, -1, -1, np.zeros(3), np.zeros(3)), *bones)
    skeleton = Skeleton(joints, np.tile(np.eye(3), (len(joints), 1, 1)), np.eye(3), np.zeros(3))
    rows = np.where(skinning.weights > 0, skinning.bones + 1, 0).astype(np.uint16)
    return MadeRig(skeleton, Weights(skinning.weights, rows), None, skinning.rms, skinning.error)
