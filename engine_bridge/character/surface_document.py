"""Conversion of mesh files in other formats to glTF documents, with a cache."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from engine_bridge.character.assembly import assemble
from engine_bridge.character.cache import Arrays, cache_key, load_or_compute
from engine_bridge.character.document import Document
from engine_bridge.character.readers import read_surface
from engine_bridge.character.surfaces.files import Folder

DESCRIPTION, BUFFER = "description", "buffer"
"""Names of the cached arrays: JSON with the glTF description, notes and hashes of named files; the binary buffer."""


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
        See `engine_bridge.character.readers.read_surface`.
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
