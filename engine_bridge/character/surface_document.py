"""Mesh files of other kinds as glTF documents, kept for the next start."""

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
"""The arrays that are kept: JSON of the glTF, the notes and the fingerprints of files named; and the binary buffer."""


def read_document(path: Path, content: bytes, cache: Path | None = None) -> Document:
    """Read a mesh file that is not glTF as a glTF document.

    With a cache, a file that was read before is not parsed again, as long as neither it nor a file that it names, such
    as a picture, has changed.

    Parameters
    ----------
    path : Path
    content : bytes
        Of that file.
    cache : Path, optional
        Folder for the documents, see `engine_bridge.character.cache.load_or_compute`.

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
    """Tell whether all files that the mesh names, or a file beside it, are there and missing as they were."""
    folder = Folder(path, [])
    return all(folder.state(name, Path(below)) == state for name, below, state in _description(kept)["files"])


def _description(kept: Arrays) -> dict[str, Any]:
    return json.loads(kept[DESCRIPTION].tobytes())
