"""A character with its ladder coordinates, in a .glb whose vertices an engine's shader moves by live controls.

TEXCOORD_2 to TEXCOORD_5 of each vertex are its ladder coordinates, two fields a set, zero for fields that there are
not; the first number of TEXCOORD_6 is that of the vertex in the character's scene message, since engines reorder
vertices (docs/protocol.md).
"""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from engine_bridge.character.drawn_normals import drawn_normals
from engine_bridge.export.flattened import flatten
from engine_bridge.performance.rig import load_rig
from puppetline.errors import PuppetError, at
from puppetline.files import check_writable

MAX_FIELDS = 8
"""Ladder coordinates that fit into two vertex attributes of four numbers."""


@dataclass(frozen=True)
class ShaderMeshSummary:
    """What `write_shader_mesh` has to say about its result."""

    output: str
    vertices: int
    triangles: int
    surfaces: int
    fields: int
    bytes: int
    notes: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return it as plain values for JSON."""
        return asdict(self)


def write_shader_mesh(puppet: Path, output: Path) -> ShaderMeshSummary:
    """Write a puppet's character at rest as a .glb with ladder coordinates.

    Parameters
    ----------
    puppet, output : Path

    Raises
    ------
    PuppetlineError
        Before anything is written.
    """
    check_writable(output, ".glb", inputs=(puppet,))
    rig = load_rig(puppet)
    check_writable(output, ".glb", inputs=(Path(rig.character.document.name),))
    ladder = rig.model.ladder[rig.mesh.of_render]
    count, fields = ladder.shape
    if fields > MAX_FIELDS:
        raise PuppetError(
            at(puppet, field="[solver], fields"),
            found=f"{fields} fields",
            expected=f"at most {MAX_FIELDS}, whose ladder coordinates fit into the attributes of a vertex",
            fix=f"Set it to {MAX_FIELDS}, or let the engine take the mesh from the service.",
        )
    coordinates = np.zeros((count, MAX_FIELDS), np.float32)
    coordinates[:, :fields] = ladder
    numbers = np.column_stack([np.arange(count), np.zeros(count)]).astype(np.float32)
    sets = [*np.split(coordinates, MAX_FIELDS // 2, axis=1), numbers]
    document = flatten(rig.character, drawn_normals(rig.character), sets)
    document.save(output)
    return ShaderMeshSummary(
        output=str(output),
        vertices=count,
        triangles=len(rig.character.triangles),
        surfaces=len(rig.character.parts),
        fields=fields,
        bytes=output.stat().st_size,
        notes=tuple(rig.character.document.notes),
    )
