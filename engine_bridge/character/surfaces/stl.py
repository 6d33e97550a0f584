"""STL, binary and text: triangles with separate corners."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.surfaces.surface import Piece, Surface, count, damaged, outside
from engine_bridge.character.surfaces.text import decoded, filled_lines, position, unreadable
from puppetline.errors import at

FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
HEADER_BYTES = 84


def matches(head: bytes, size: int) -> bool:
    """Return whether a file with this beginning and size in bytes is an STL file."""
    return _is_binary(head, size) or _is_text(head)


def _is_binary(head: bytes, size: int) -> bool:
    """Return whether the number of facets matches the size, regardless of the text in the header."""
    return size > HEADER_BYTES and size == HEADER_BYTES + FACET.itemsize * int.from_bytes(
        head[80:HEADER_BYTES], "little"
    )


def _is_text(head: bytes) -> bool:
    words = head[:4096].lower().split()
    return words[:1] == [b"solid"] and b"\0" not in head[:4096] and (b"facet" in words or b"endsolid" in words)


def read(path: Path, content: bytes) -> Surface:
    """Read an STL file.

    Normals in the file are ignored, because the winding of a facet determines them. Each solid of a text file becomes a
    piece. Lines of a text file that begin with an unknown word are omitted. Its last ``endsolid`` may be missing.

    Raises
    ------
    MeshError
        The file has no facet or a part that cannot be read; the message has the line or the facet.
    """
    as_text = _is_text(content) and not _is_binary(content, len(content))
    return _read_text(path, content) if as_text else _read_binary(path, content)


def _read_binary(path: Path, content: bytes) -> Surface:
    facets = int.from_bytes(content[80:HEADER_BYTES], "little")
    there = max(len(content) - HEADER_BYTES, 0) // FACET.itemsize
    if facets > there or not facets:
        raise damaged(
            at(path, field="byte 80"),
            f"{count(facets, 'facet')} announced and data for {there:,}",
            "a complete STL file with at least one facet",
        )
    with np.errstate(invalid="ignore"):  # a signalling NaN is refused below
        corners = np.frombuffer(content, FACET, facets, HEADER_BYTES)["corners"].astype(np.float64)
    wrong = outside(corners.reshape(-1, 3))
    if wrong.any():
        facet = int(np.argmax(wrong)) // 3
        raise damaged(at(path, field=f"facet {facet}"), str(corners[facet].tolist()), "finite coordinates")
    rest = len(content) - HEADER_BYTES - facets * FACET.itemsize
    notes = [f"{count(rest, 'byte')} after the last facet omitted."] if rest else []
    return Surface([_piece("", corners.reshape(-1, 3))], notes, faceted=True)


def _read_text(path: Path, content: bytes) -> Surface:
    solids, unknown, last = _solids(path, decoded(path, content))
    notes = []
    if unknown:
        notes.append(f"{count(len(unknown), 'line')} not understood and omitted; the first is line {unknown[0]}.")
    if last == "endfacet":
        notes.append("The file ends without 'endsolid'; facets may be missing.")
    pieces = [_piece(name, np.array(corners)) for name, corners in solids if corners]
    if not pieces:
        raise damaged(path, "no facets", "an STL file with facets")
    return Surface(pieces, notes, faceted=True)


def _solids(path: Path, text: str) -> tuple[list[tuple[str, list[list[float]]]], list[int], str]:
    """Return each solid's name and corners, the numbers of unknown lines, and the last known word."""
    solids: list[tuple[str, list[list[float]]]] = []
    facet: list[list[float]] = []
    unknown = []
    number, last = 0, ""
    for number, line in filled_lines(text):
        word, value = [*line.split(None, 1), ""][:2]
        match word.lower():
            case "solid":
                solids.append((value, []))
            case "vertex":
                try:
                    facet.append(position(value.split()))
                except ValueError:
                    raise unreadable(path, number, value, "'vertex x y z' with finite numbers") from None
            case "endfacet":
                if len(facet) != 3:
                    raise damaged(at(path, line=number), f"a facet with {len(facet)} vertices", "3 vertices")
                solids[-1][1].extend(facet)
                facet = []
            case "facet" | "outer" | "endloop" | "endsolid":
                pass
            case _:
                unknown.append(number)
                continue
        last = word.lower()
    if facet or last not in ("endfacet", "endsolid"):
        raise damaged(at(path, line=number), "the end of the file within a solid", "'endsolid'")
    return solids, unknown, last


def _piece(name: str, corners: NDArray[np.float64]) -> Piece:
    return Piece(name, corners, np.arange(len(corners)).reshape(-1, 3))
