"""A character with its isoline coordinates, as a .glb for an engine's shader that moves vertices by live controls.

TEXCOORD_2 to TEXCOORD_5 of each vertex are its isoline coordinates, two fields per set, zero for missing fields. The
first number of TEXCOORD_6 is the vertex's number in the character's scene message, because engines reorder vertices
(docs/protocol.md).
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from engine_bridge.character.materials import drawn_normals
from engine_bridge.export.flattened import flatten
from engine_bridge.performance.prepared_character import load_prepared
from puppetline.errors import PuppetError, at
from puppetline.files import check_writable

MAX_FIELDS = 8
"""Maximum number of fields, whose isoline coordinates fit into two vertex attributes of four numbers."""


@dataclass(frozen=True)
class ShaderMeshSummary:
    """Result of `write_shader_mesh`."""

    output: str
    vertices: int
    triangles: int
    surfaces: int
    fields: int
    bytes: int
    notes: tuple[str, ...]


def write_shader_mesh(puppet: Path, output: Path) -> ShaderMeshSummary:
    """Write a puppet's character at rest as a .glb with isoline coordinates.

    Parameters
    ----------
    puppet, output : Path

    Raises
    ------
    PuppetlineError
        Before anything is written.
    """
    check_writable(output, ".glb", inputs=(puppet,))
    prepared = load_prepared(puppet)
    check_writable(output, ".glb", inputs=(Path(prepared.character.document.name),))
    isoline_coordinates = prepared.model.isoline_coordinates[prepared.mesh.of_render]
    count, fields = isoline_coordinates.shape
    if fields > MAX_FIELDS:
        raise PuppetError(
            at(puppet, field="[solver], fields"),
            found=f"{fields} fields",
            expected=f"at most {MAX_FIELDS} fields, whose isoline coordinates fit into the attributes of a vertex",
            fix=f"Set fields to {MAX_FIELDS}, or let the engine load the mesh from the service.",
        )
    coordinates = np.zeros((count, MAX_FIELDS), np.float32)
    coordinates[:, :fields] = isoline_coordinates
    numbers = np.column_stack([np.arange(count), np.zeros(count)]).astype(np.float32)
    sets = [*np.split(coordinates, MAX_FIELDS // 2, axis=1), numbers]
    document = flatten(prepared.character, drawn_normals(prepared.character), sets)
    document.save(output)
    return ShaderMeshSummary(
        output=str(output),
        vertices=count,
        triangles=len(prepared.character.triangles),
        surfaces=len(prepared.character.parts),
        fields=fields,
        bytes=output.stat().st_size,
        notes=tuple(prepared.character.document.notes),
    )
