"""Reads the bytes of a glTF file: its description, its binary chunk, and the files that it names."""

import base64
import binascii
import json
import re
import struct
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn
from urllib.parse import unquote

from engine_bridge.character import schema
from engine_bridge.character.schema import Gltf
from puppetline.errors import MeshError, at

MAGIC = b"glTF"
"""First bytes of a .glb."""

INTEGER_NUMBER = re.compile(r"-?[1-9][0-9]*\.0+|0\.0+")
"""Pattern of a number that glTF accepts as an integer although it is written with a fraction of zero."""

SPARE_NESTING_LEVELS = 200
"""Number of further levels of nesting around a description that JSON must still be able to write."""


def parse_description(path: Path, text: bytes) -> tuple[Gltf, list[str]]:
    """Return the checked description of a glTF file, and the names of its properties that were null.

    Raises
    ------
    MeshError
    """

    def refuse(name: str) -> NoReturn:
        raise ValueError(f"{name} is not a JSON number")

    try:
        values = json.loads(text, parse_constant=refuse, parse_float=_number)
        if not isinstance(values, dict):
            raise ValueError(f"a {type(values).__name__} and not an object")
        nulls = schema.drop_nulls(values)
        gltf = schema.checked(values)
        _check_writable(values)
    except (ValueError, RecursionError) as error:
        raise damaged(path, f"a description that is not glTF ({error})") from error
    if gltf["asset"]["version"].partition(".")[0] != "2":
        raise damaged(at(path, field="asset.version"), f"glTF {gltf['asset']['version'][:20]}")
    return gltf, nulls


def _number(text: str) -> float:
    return int(text.partition(".")[0]) if INTEGER_NUMBER.fullmatch(text) else float(text)


def _check_writable(values: dict[str, Any]) -> None:
    """Raise an error for numbers like 1e999, halves of surrogate pairs, and nesting that is too deep to be written.

    The description will be written deeper in the call stack, so that some more levels must be possible.
    """
    deeper: Any = values
    for _ in range(SPARE_NESTING_LEVELS):
        deeper = [deeper]
    json.dumps(deeper, ensure_ascii=False, allow_nan=False).encode()


def split_glb(path: Path, content: bytes) -> tuple[bytes, bytes]:
    """Return the JSON and the binary chunk of a .glb.

    Raises
    ------
    MeshError
    """
    version, length = struct.unpack("<II", content[4:12].ljust(8, b"\0"))
    if version != 2 or length > len(content):
        raise damaged(path, f"glTF version {version}, {length:,} bytes announced and {len(content):,} there")
    chunks: dict[bytes, bytes] = {}
    place = 12
    while place + 8 <= length:
        size, kind = struct.unpack_from("<I4s", content, place)
        chunks.setdefault(kind, content[place + 8 : place + 8 + size])
        place += 8 + size
    if b"JSON" not in chunks:
        raise damaged(path, "no JSON chunk")
    return chunks[b"JSON"], chunks.get(b"BIN\0", b"")


def buffer_bytes(path: Path, uri: str | None, binary: bytes) -> bytes:
    """Return the bytes of a buffer: the binary chunk, a data URI, or a file in the same folder or below.

    Raises
    ------
    MeshError
    """
    if uri is None:
        return binary
    if uri.startswith("data:"):
        try:
            digits = "".join(uri.partition(",")[2].split())  # some programs break lines and omit the padding
            return base64.b64decode(digits.rstrip("=") + "=" * (-len(digits.rstrip("=")) % 4), validate=True)
        except (binascii.Error, ValueError) as error:
            raise damaged(path, f"a data URI that is not base64 ({error})") from error
    file = file_beside(path, uri)
    if file and file.is_file():
        with suppress(OSError):
            return file.read_bytes()
    raise MeshError(
        path,
        found=f"a reference to {uri!r}, which is not a readable file in its folder",
        expected="all buffers in the folder of the glTF file",
        fix="Copy those files there, or export as .glb.",
    )


def file_beside(path: Path, uri: str) -> Path | None:
    """Return the path of a file that a glTF file names, in its folder or below; None for any other reference."""
    try:
        file = (path.parent / unquote(uri).replace("\\", "/")).resolve()
        if file.is_relative_to(path.parent.resolve()) and (file.is_file() or not file.exists()):
            return file
    except (OSError, ValueError):  # a name that is too long, a zero byte in it, or a cycle of links
        pass
    return None


def damaged(where: str | Path, found: str) -> MeshError:
    """Return the error for a file that is not as it was exported."""
    return MeshError(where, found=found, expected="a complete glTF 2.0 file", fix="Export or download the file again.")
