"""Files of VRM avatars: a humanoid with a new skeleton and fitted weights, in a T-pose."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from engine_bridge.export.rig_file import RigSettings, RigSummary, load_prepared_of, rename
from engine_bridge.export.vrm import add_vrm, humanoid_rows, upright
from engine_bridge.performance.clip import Progress
from engine_bridge.puppet.puppet import VrmTable
from engine_bridge.rigging.made_rig import make_rig
from engine_bridge.rigging.rig_document import rigged_document
from engine_bridge.rigging.skeleton import Skeleton
from puppetline import toml_schema
from puppetline.errors import PuppetError, at
from puppetline.files import check_writable

VRM_ENDING = ".vrm"


def write_vrm(
    source: Path,
    output: Path,
    settings: RigSettings,
    given: Mapping[str, Any],
    progress: Progress = lambda _stage, _share: None,
) -> RigSummary:
    """Write a character as an avatar in VRM 1.0.

    Its joints have the axes of the character in the T-pose, as is usual in VRM.

    Parameters
    ----------
    source : Path
        A puppet file, or a mesh, for which limbs are proposed.
    output : Path
    settings : RigSettings
        Of which an avatar has names and influences.
    given : mapping
        Keys of [vrm] that replace those in the puppet file.
    progress : callable, optional

    Raises
    ------
    PuppetlineError
        The character is not a humanoid, or the avatar has no name, authors or licence, among other reasons.
    """
    check_writable(output, VRM_ENDING, inputs=(source,))
    progress("Preparing the character", 0.0)
    prepared, notes = load_prepared_of(source, output)
    check_writable(output, VRM_ENDING, inputs=(Path(prepared.character.document.name),))
    rows = humanoid_rows(Skeleton.along_bones(prepared.puppet).joints, source)
    stated = statement(prepared.puppet.vrm, given, source)
    progress("Preparing the character", 1.0)
    fitting = partial(progress, "Fitting skin weights")
    made = make_rig(prepared, in_t_pose=True, influences=settings.influences, progress=fitting)
    table, joints = prepared.puppet.character, made.skeleton.joints
    surface = prepared.mesh.vertices if made.bind is None else made.bind.vertices(prepared.mesh.vertices)
    floor = float((surface @ table.basis[1]).min())
    placed = upright(table.basis, table.scale, joints[rows["hips"]].head, floor)
    axes = np.tile(table.basis.T, (len(joints), 1, 1))
    made = replace(made, skeleton=replace(made.skeleton, axes=axes))
    document, nodes, more = rigged_document(prepared.character, made, prepared.mesh.of_render, placed)
    head = joints[rows["head"]]
    bones = {bone: nodes[row] for bone, row in rows.items()}
    add_vrm(document.gltf, bones, placed[:3, :3] @ (head.tail - head.head), stated)
    names = rename(document, nodes, settings.names)
    document.save(output)
    notes = (*prepared.character.document.notes, *notes, *more)
    return RigSummary(str(output), names, False, made.rms, made.error, output.stat().st_size, notes)


def statement(table: VrmTable | None, given: Mapping[str, Any], where: Path) -> VrmTable:
    """Return what an avatar states about itself.

    Parameters
    ----------
    table : VrmTable or None
        Of the puppet file.
    given : mapping
        Keys that replace those in the table.
    where : Path
        Puppet file or mesh, for errors.

    Raises
    ------
    PuppetError
    """
    values = {} if table is None else table.model_dump(exclude_none=True)
    values |= given
    missing = [key for key in ("name", "authors", "licence") if key not in values]
    if missing:
        raise PuppetError(
            at(where, field="[vrm]"),
            found=f"no {' and no '.join(missing)}",
            expected="the name, authors and licence of the avatar, which every VRM states",
            fix="Write them in a table [vrm] of the puppet file, or use --name, --author and --licence.",
        )
    return toml_schema.check(VrmTable, values, at(where, field="[vrm]"), PuppetError)
