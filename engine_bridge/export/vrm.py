"""VRM 1.0: a rigged humanoid as an avatar (extension VRMC_vrm, https://github.com/vrm-c/vrm-specification)."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.schema import Gltf
from engine_bridge.export.vrm_expressions import GAZE, expressions
from engine_bridge.puppet.humanoid_bones import HUMANOID_BONES, REQUIRED, parent_of
from engine_bridge.puppet.puppet import VrmTable
from engine_bridge.rigging.joints import Joint
from puppetline.errors import PuppetError

VRM_LICENCE = "https://vrm.dev/licenses/1.0/"
"""The licence document that every VRM 1.0 refers to; its conditions are properties of `meta`, and restrictive unless
they are set."""

EXTENSION = "VRMC_vrm"
OF_OLD_SKELETON = ("VRM", EXTENSION, "VRMC_springBone", "VRMC_node_constraint")
"""Extensions that refer to the nodes of a skeleton."""

EYE_HEIGHT_SHARE = 0.5
"""Height of the eyes between the joint and the top of the head."""

MAX_GAZE_ANGLE = 90.0
"""Angle of the gaze, in degrees, at which the eyes are turned most."""


def humanoid_rows(joints: Sequence[Joint], where: Path) -> dict[str, int]:
    """Return the joints that are bones of a VRM humanoid.

    A bone that VRM does not require is omitted if a joint that VRM expects below it is elsewhere, such as the head of a
    character beside its neck.

    Parameters
    ----------
    joints : sequence of Joint
    where : Path
        Puppet file or mesh, for errors.

    Returns
    -------
    dict
        Row of each bone's joint, parents first.

    Raises
    ------
    PuppetError
        A required bone is missing, or not below the one that VRM expects above it.
    """
    named = {joint.name: row for row, joint in enumerate(joints) if joint.limb}
    found = {bone: named[bone] for bone in HUMANOID_BONES if bone in named}
    missing = [bone for bone in REQUIRED if bone not in found]
    if missing:
        raise _no_humanoid(where, f"no limb for {', '.join(missing)}", "Check the limbs in its puppet file.")
    while apart := _apart(found, joints):
        bone, parent = apart
        if parent in REQUIRED:
            raise _no_humanoid(where, f"{bone} that is not attached to {parent}", "Check the parents of the limbs.")
        del found[parent]
    return found


def _apart(found: dict[str, int], joints: Sequence[Joint]) -> tuple[str, str] | None:
    """Return the first bone whose joint is not below that of its parent in VRM, with this parent."""
    for bone, row in found.items():
        parent, above = parent_of(bone, found), joints[row].parent
        while parent is not None and above >= 0 and above != found[parent]:
            above = joints[above].parent
        if parent is not None and above < 0:
            return bone, parent
    return None


def _no_humanoid(where: Path, found: str, fix: str) -> PuppetError:
    return PuppetError(
        where,
        found=found,
        expected="a humanoid, because VRM contains no others: the limbs trunk, head, left arm, right arm, left leg and "
        "right leg",
        fix=f"{fix} Any other character can be a .glb.",
    )


def upright(basis: NDArray[np.float64], scale: float, hips: NDArray[np.float64], floor: float) -> NDArray[np.float64]:
    """Return the transform (4, 4) from a mesh file to VRM: metres, left +x, up +y, front +z, hips above the origin.

    Parameters
    ----------
    basis : (3, 3) float64
        Rows: the mesh file's directions of the character's left, up and front.
    scale : float
        Metres per mesh unit.
    hips : (3,) float64
        Mesh file's coordinates.
    floor : float
        Lowest height of the character, mesh units.
    """
    placed, place = np.eye(4), basis @ hips
    placed[:3, :3] = scale * basis
    placed[:3, 3] = -scale * np.array([place[0], floor, place[2]])
    return placed


def add_vrm(gltf: Gltf, bones: dict[str, int], head: NDArray[np.float64], stated: VrmTable) -> None:
    """Make a rigged humanoid a VRM; what it was as a VRM before, and animations, are omitted.

    Parameters
    ----------
    gltf : Gltf
        It is changed. The humanoid is upright, on the floor, in a T-pose and in metres.
    bones : dict
        Node of each bone, see `humanoid_rows`.
    head : (3,) float64
        From the joint of the head to its top, in metres, axes of the joint.
    stated : VrmTable
    """
    _omit(gltf)
    gltf["animations"] = []  # a VRM has none
    faces = expressions(gltf)
    turns_eyes = set(GAZE) <= faces.get("preset", {}).keys()
    most = {"inputMaxValue": MAX_GAZE_ANGLE, "outputScale": 1.0 if turns_eyes else 10.0}
    directions = ("HorizontalInner", "HorizontalOuter", "VerticalDown", "VerticalUp")
    shown = [node for node, table in enumerate(gltf["nodes"]) if "mesh" in table]
    vrm: dict[str, Any] = {
        "specVersion": "1.0",
        "meta": _meta(stated),
        "humanoid": {"humanBones": {bone: {"node": node} for bone, node in bones.items()}},
        "firstPerson": {"meshAnnotations": [{"node": node, "type": "auto"} for node in shown]},
        "lookAt": {
            "type": "expression" if turns_eyes else "bone",
            "offsetFromHeadBone": (EYE_HEIGHT_SHARE * head).tolist(),
            **{f"rangeMap{direction}": most for direction in directions},
        },
        "expressions": faces,  # also if it is empty, because three-vrm ignores lookAt without it
    }
    gltf.setdefault("extensions", {})[EXTENSION] = vrm
    gltf["extensionsUsed"].append(EXTENSION)


def _meta(stated: VrmTable) -> dict[str, Any]:
    """Return the property `meta`; conditions that are not stated are VRM's restrictive defaults."""
    meta: dict[str, Any] = {"name": stated.name, "authors": list(stated.authors), "licenseUrl": VRM_LICENCE}
    if stated.version is not None:
        meta["version"] = stated.version
    if stated.licence != VRM_LICENCE:
        meta["otherLicenseUrl"] = stated.licence
    return meta


def _omit(gltf: Gltf) -> None:
    """Remove the extensions of an earlier VRM that refer to its skeleton."""
    for table in (gltf, *gltf["nodes"]):
        left = {name: value for name, value in table.pop("extensions", {}).items() if name not in OF_OLD_SKELETON}
        if left:
            table["extensions"] = left
    for name in ("extensionsUsed", "extensionsRequired"):
        gltf[name] = [used for used in gltf[name] if used not in OF_OLD_SKELETON]
