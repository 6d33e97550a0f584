"""Conversion of mesh files in other formats to glTF documents, with a cache."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from engine_bridge.character.assembly import assemble
from engine_bridge.character.cache import Arrays, cache_key, load_or_compute
from engine_bridge.character.document import Document
from engine_bridge.character.shading import shaded
from engine_bridge.character.surfaces import obj, off, ply, ply_tables, stl
from engine_bridge.character.surfaces.files import Folder
from engine_bridge.character.surfaces.surface import Surface
from puppetline.errors import MeshError
from puppetline.files import read_whole

DESCRIPTION, BUFFER = "description", "buffer"
"""Names of the cached arrays: JSON with the glTF description, notes and hashes of named files; the binary buffer."""


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


def read_document(path: Path, content: bytes, cache: Path | None = None) -> Document:
    """Read a mesh file that is not glTF as a glTF document.

    With a cache, a file is parsed again only if it or a file that it names, such as an image, has changed.

    Parameters
    ----------
    path : Path
    content : bytes
        Content of that file.
    cache : Path, optional
        Folder for documents, see `engine_bridge.character.cache.load_or_compute`.

    Raises
    ------
    MeshError
        See `engine_bridge.character.surface_document.read_surface`.
    """
    key = cache_key("document of a mesh file", str(path), np.frombuffer(content, np.uint8))
    kept = load_or_compute(cache, key, lambda: _parsed(path, content), lambda kept: _is_current(path, kept))
    description = _description(kept)
    document = Document(description["gltf"], kept[BUFFER].tobytes(), str(path))
    document.notes += description["notes"]
    return document


def _parsed(path: Path, content: bytes) -> Arrays:
    surface = read_surface(path, content)
    document = assemble(surface, path.stem, str(path))
    description = {
        "gltf": document.gltf,
        "notes": document.notes,
        "files": [(*named, state) for named, state in surface.files.items()],
    }
    return {
        DESCRIPTION: np.frombuffer(json.dumps(description).encode(), np.uint8),
        BUFFER: np.frombuffer(bytes(document.blob), np.uint8),
    }


def _is_current(path: Path, kept: Arrays) -> bool:
    """Return whether all files that the mesh names are unchanged, or still missing."""
    folder = Folder(path, [])
    return all(folder.state(name, Path(below)) == state for name, below, state in _description(kept)["files"])


def _description(kept: Arrays) -> dict[str, Any]:
    return json.loads(kept[DESCRIPTION].tobytes())
