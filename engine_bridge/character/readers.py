"""Readers of mesh files other than glTF, chosen by content and then by ending."""

from pathlib import Path

from engine_bridge.character.shading import shaded
from engine_bridge.character.surfaces import obj, off, ply, ply_tables, stl
from engine_bridge.character.surfaces.surface import Surface
from puppetline.errors import MeshError
from puppetline.files import read_whole

READERS = {".obj": obj.read, ".off": off.read, ".ply": ply.read, ".stl": stl.read}

SURFACE_FILES = tuple(READERS)

HEAD_BYTES = 65536
"""Number of bytes at the beginning of a file by which its format is recognised."""


def read_surface(path: Path, content: bytes | None = None) -> Surface:
    """Read a mesh file and complete its shading.

    Parameters
    ----------
    path : Path
    content : bytes, optional
        Content of that file if it has been read already.

    Returns
    -------
    Surface
        With normals, see `engine_bridge.character.shading.shaded`.

    Raises
    ------
    MeshError
        The file cannot be opened, has another format, is damaged, or has no surface.
    """
    if content is None:
        content = read_whole(path, "a mesh", MeshError)
    ending = _recognized(path, content)
    if ending is None:
        raise MeshError(
            path,
            found="no mesh in a supported format" if content else "an empty file",
            expected=f"one of the formats .glb, .gltf, {', '.join(SURFACE_FILES)}",
            fix="Export the character as .glb from your editor.",
        )
    return shaded(READERS[ending](path, content), str(path))


def _recognized(path: Path, content: bytes) -> str | None:
    """Return the ending of the format that a file has."""
    head = content[:HEAD_BYTES]
    if ply_tables.matches(head):
        return ".ply"
    if off.matches(head):
        return ".off"
    if stl.matches(head, len(content)):
        return ".stl"
    if path.suffix.lower() in READERS and content:
        return path.suffix.lower()
    return ".obj" if obj.matches(head) else None
