"""Mesh files that are not glTF: the reader for each, found by content and then by ending."""

from pathlib import Path

from engine_bridge.character.shading import shaded
from engine_bridge.character.surfaces import obj, off, ply, ply_tables, stl
from engine_bridge.character.surfaces.surface import Surface
from puppetline.errors import MeshError
from puppetline.files import read_whole

READERS = {".obj": obj.read, ".off": off.read, ".ply": ply.read, ".stl": stl.read}

SURFACE_FILES = tuple(READERS)

HEAD_BYTES = 65536
"""Bytes from which a format is recognised."""


def read_surface(path: Path, content: bytes | None = None) -> Surface:
    """Read a mesh file, ready to be shown.

    Parameters
    ----------
    path : Path
    content : bytes, optional
        Of that file, where it has been read already.

    Returns
    -------
    Surface
        With normals, see `engine_bridge.character.shading.shaded`.

    Raises
    ------
    MeshError
        A file that cannot be opened, that is of another kind or damaged, or that holds no surface.
    """
    if content is None:
        content = read_whole(path, "a mesh", MeshError)
    ending = _recognized(path, content)
    if ending is None:
        raise MeshError(
            path,
            found="no mesh that is known here" if content else "an empty file",
            expected=f".glb, .gltf, {', '.join(SURFACE_FILES)}",
            fix="Export the character as .glb from your editor.",
        )
    return shaded(READERS[ending](path, content), str(path))


def _recognized(path: Path, content: bytes) -> str | None:
    """Find the ending that a file should have."""
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
