"""Hashes that decide whether a result is up to date."""

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import puppetline
from engine_bridge.character import cache
from engine_bridge.performance.prepared_character import PreparedCharacter
from engine_bridge.performance.settings import Settings


@dataclass(frozen=True)
class FileState:
    """Content of a file, and the values that identify it without reading it.

    Attributes
    ----------
    bytes : int
        Size.
    modified : int
        Time of the last modification, in nanoseconds.
    sha256 : str
        Hash of the content, as hexadecimal digits.
    """

    bytes: int
    modified: int
    sha256: str

    @classmethod
    def of(cls, path: Path) -> "FileState":
        """Read the state of a file.

        Raises
        ------
        OSError
        """
        with path.open("rb") as file:
            before = path.stat()  # a change while the file is read gives it another time
            digest = hashlib.file_digest(file, "sha256")
        return cls(before.st_size, before.st_mtime_ns, digest.hexdigest())

    def is_of(self, path: Path) -> bool:
        """Return whether a file has this content. A file of the same size and time of modification is not read."""
        try:
            now = path.stat()
            if now.st_size != self.bytes:
                return False
            return now.st_mtime_ns == self.modified or FileState.of(path).sha256 == self.sha256
        except OSError:
            return False


def identity(prepared: PreparedCharacter, settings: Settings, users: str) -> str:
    """Return a hash of all that determines a result apart from the recording.

    These are the character with all files that its mesh refers to, the values of the puppet file, the settings, and the
    version of the program.

    Parameters
    ----------
    prepared : PreparedCharacter
    settings : Settings
    users : str
        Which performers of a recording are converted.
    """
    document = prepared.character.document
    chosen = asdict(settings) | {"tolerance": settings.max_error, "users": users}
    digest = hashlib.sha256(
        _text(chosen, puppetline.__version__, cache.VERSION, prepared.puppet.model_dump(mode="json"))
    )
    digest.update(_text(document.gltf))
    digest.update(document.blob)
    return digest.hexdigest()


def performer_identity(settings: Settings, users: str, ending: str) -> str:
    """Return such a hash for animations of performers, in files with this ending."""
    chosen = asdict(settings) | {"users": users}
    return hashlib.sha256(_text(chosen, puppetline.__version__, ending)).hexdigest()


def result_key(identity: str, log: FileState, name: str) -> str:
    """Return the key of a recording's results: a hash of `identity`, the recording, and its name."""
    return hashlib.sha256(_text(identity, log.sha256, name)).hexdigest()


def _text(*values: Any) -> bytes:
    return json.dumps(values, sort_keys=True).encode()
