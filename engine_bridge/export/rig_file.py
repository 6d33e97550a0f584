"""Files of rigged characters: a skeleton and skin weights, without an animation."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

from engine_bridge.character.character import CHARACTER_FILES
from engine_bridge.character.document import Document
from engine_bridge.export.own_skeleton import OwnSkeleton, own_skeleton
from engine_bridge.performance.clip import Progress
from engine_bridge.performance.prepared_character import PreparedCharacter, load_prepared, make_prepared
from engine_bridge.puppet.rig_bones import RigBones
from engine_bridge.rigging.file_joints import humanoid_joints
from engine_bridge.rigging.made_rig import make_rig
from engine_bridge.rigging.naming_schemes import NAMES, Scheme
from engine_bridge.rigging.rig_document import rigged_document
from puppetline.errors import PuppetError, at
from puppetline.files import check_writable

BindPoseName = Literal["rest", "t"]


@dataclass(frozen=True)
class RigSettings:
    """How a character is rigged.

    Attributes
    ----------
    names : {"vrm", "mixamo", "unreal", "rigify", "godot"} or None
        Naming scheme of humanoid joints; None for VRM's in a new skeleton, and for the file's own otherwise.
    pose : {"rest", "t"}
        Pose in which the mesh is bound to the joints.
    influences : int
        Maximum number of joints per vertex, 4 or 8.
    keep_skin : bool
        Whether a file with a skeleton along the puppet's limbs keeps it.
    """

    names: Scheme | None = None
    pose: BindPoseName = "rest"
    influences: int = 4
    keep_skin: bool = True


@dataclass(frozen=True)
class RigSummary:
    """Result of `write_rig`.

    `rms` and `error` are the root mean square and the maximum distance of vertices from the reduced model's surface in
    random poses, as fractions of the diagonal; None if the file keeps its skin.
    """

    output: str
    joints: tuple[str, ...]
    kept: bool
    rms: float | None
    error: float | None
    bytes: int
    notes: tuple[str, ...]


def write_rig(
    source: Path, output: Path, settings: RigSettings, progress: Progress = lambda _stage, _share: None
) -> RigSummary:
    """Write a .glb of a character with a skeleton and skin weights.

    Parameters
    ----------
    source : Path
        A puppet file, or a mesh, for which limbs are proposed.
    output : Path
    settings : RigSettings
    progress : callable, optional

    Raises
    ------
    PuppetlineError
        The character has no limbs, among other reasons.
    """
    check_writable(output, ".glb", inputs=(source,))
    progress("Preparing the character", 0.0)
    prepared, notes = load_prepared_of(source, output)
    check_writable(output, ".glb", inputs=(Path(prepared.character.document.name),))
    progress("Preparing the character", 1.0)
    wanted = settings.keep_skin and settings.pose == "rest" and bool(prepared.character.document.gltf["skins"])
    own = own_skeleton(prepared) if wanted else OwnSkeleton(None)
    if own.usable is not None:
        document = prepared.character.document.copy()
        names = _rename_own(document, prepared, own.usable, settings.names)
        notes += ("The file keeps its own skeleton and weights. For new ones, use --new-skin.",)
        rms = error = None
    else:
        fitting = partial(progress, "Fitting skin weights")
        made = make_rig(prepared, in_t_pose=settings.pose == "t", influences=settings.influences, progress=fitting)
        document, nodes, more = rigged_document(prepared.character, made, prepared.mesh.of_render)
        names, rms, error = rename(document, nodes, settings.names), made.rms, made.error
        notes += (*own.notes, *more)
    document.save(output)
    notes = (*prepared.character.document.notes, *notes)
    return RigSummary(str(output), names, own.usable is not None, rms, error, output.stat().st_size, notes)


def load_prepared_of(source: Path, output: Path) -> tuple[PreparedCharacter, tuple[str, ...]]:
    """Load a puppet file and its character, or propose limbs for a mesh.

    Parameters
    ----------
    source : Path
        A puppet file or a mesh.
    output : Path
        File that will be written.

    Returns
    -------
    prepared : PreparedCharacter
    notes : tuple of str
        Sentences about what was assumed, or is unclear.

    Raises
    ------
    PuppetlineError
    """
    if source.suffix.lower() not in CHARACTER_FILES:
        return load_prepared(source), ()
    from engine_bridge.puppet.proposal import new_puppet  # importing it takes a while

    proposal = new_puppet(source, output)
    if not proposal.puppet.limb:
        raise PuppetError(
            at(source),
            found="a mesh in which no limbs were found",
            expected="a character with arms, legs, wings or a tail",
            fix="Give the tips of its limbs: puppetline new MESH -o PUPPET.toml --limb 'left leg=X,Y,Z' "
            "--limb 'right leg=X,Y,Z'. Then rig the puppet file.",
        )
    prepared = make_prepared(proposal.puppet, proposal.character)
    return prepared, (*proposal.assumed, *proposal.notes)


def rename(document: Document, nodes: list[int], scheme: Scheme | None) -> tuple[str, ...]:
    """Rename the joints of a document, and return their names."""
    names = NAMES[scheme or "vrm"]
    for node in nodes:
        table = document.gltf["nodes"][node]
        table["name"] = names.get(table["name"], table["name"])
    return tuple(document.gltf["nodes"][node]["name"] for node in nodes)


def _rename_own(
    document: Document, prepared: PreparedCharacter, own: RigBones, scheme: Scheme | None
) -> tuple[str, ...]:
    """Rename the joints of the file's own skeleton that are those of a humanoid; return the names of all joints."""
    nodes = document.gltf["nodes"]
    for name, node in (humanoid_joints(prepared, own) if scheme is not None else {}).items():
        nodes[node]["name"] = NAMES[scheme or "vrm"][name]
    joints = dict.fromkeys(node for skin in document.gltf["skins"] for node in skin["joints"])
    return tuple(nodes[node].get("name", f"node {node}") for node in joints)


def describe(summary: RigSummary) -> str:
    """Return the summary of a rig as lines of text."""
    lines = [f"{summary.output}: {len(summary.joints)} joints, {summary.bytes / 1e6:.1f} MB"]
    lines.append(f"  joints         {', '.join(summary.joints)}")
    if summary.rms is not None:
        lines.append(
            f"  weights        fitted in random poses; largest error {summary.error:.2g} of the diagonal, "
            f"root mean square {summary.rms:.2g}"
        )
    lines += [f"  note: {note}" for note in summary.notes]
    return "\n".join(lines)
