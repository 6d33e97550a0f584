"""STL, binary and text: triangles, each with corners of its own."""

from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.surfaces.surface import Piece, Surface, count, damaged, outside
from engine_bridge.character.surfaces.text import Lines, Rows, decoded, lines_of, word
from puppetline.errors import at

FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
HEADER = 84

FOLLOWS = {
    "": ("solid",),
    "solid": ("facet", "endsolid"),
    "facet": ("outer",),
    "outer": ("vertex",),
    "vertex": ("vertex", "endloop"),
    "endloop": ("endfacet",),
    "endfacet": ("facet", "endsolid"),
    "endsolid": ("solid",),
}
"""The words that may begin the line after one that begins with this word, or the first line."""

KINDS = tuple(FOLLOWS)
SOLID, OUTER, VERTEX, ENDLOOP, ENDFACET, ENDSOLID = map(
    KINDS.index, ("solid", "outer", "vertex", "endloop", "endfacet", "endsolid")
)

CAPITALS = np.uint64(0x2020202020202020)
"""The bits that tell small letters from capitals."""


def matches(head: bytes, size: int) -> bool:
    """Tell whether a file that begins like this, of so many bytes, is an STL."""
    return _is_binary(head, size) or _is_text(head)


def _is_binary(head: bytes, size: int) -> bool:
    """Tell whether the number of facets accounts for the size, whatever the header's text says."""
    return size > HEADER and size == HEADER + FACET.itemsize * int.from_bytes(head[80:HEADER], "little")


def _is_text(head: bytes) -> bool:
    words = head[:4096].lower().split()
    return words[:1] == [b"solid"] and b"\0" not in head[:4096] and (b"facet" in words or b"endsolid" in words)


def read(path: Path, content: bytes) -> Surface:
    """Read an STL file.

    Normals in the file are passed over: the winding of a facet says the same. Each solid of a text becomes a piece.
    Lines of a text that begin with a word that is not the format's hold no corner and are left out. Its last
    ``endsolid`` may be missing.

    Raises
    ------
    MeshError
        With the line or the facet that cannot be read.
    """
    as_text = _is_text(content) and not _is_binary(content, len(content))
    return _read_text(path, content) if as_text else _read_binary(path, content)


def _read_binary(path: Path, content: bytes) -> Surface:
    facets = int.from_bytes(content[80:HEADER], "little")
    there = max(len(content) - HEADER, 0) // FACET.itemsize
    if facets > there or not facets:
        raise damaged(
            at(path, field="byte 80"),
            f"{count(facets, 'facet')} announced and data for {there:,}",
            "a whole STL file with at least one facet",
        )
    with np.errstate(invalid="ignore"):  # a signalling NaN is refused below
        corners = np.frombuffer(content, FACET, facets, HEADER)["corners"].astype(np.float64)
    wrong = outside(corners.reshape(-1, 3))
    if wrong.any():
        facet = int(np.argmax(wrong)) // 3
        raise damaged(at(path, field=f"facet {facet}"), str(corners[facet].tolist()), "finite coordinates")
    rest = len(content) - HEADER - facets * FACET.itemsize
    notes = [f"{count(rest, 'byte')} after the last facet left out."] if rest else []
    return Surface([_piece("", corners)], notes, faceted=True)


def _read_text(path: Path, content: bytes) -> Surface:
    text = decoded(path, content)
    lines = lines_of(text)
    kinds = np.zeros(len(lines), dtype=np.int64)
    for kind, name in enumerate(KINDS[1:], 1):
        kinds[(lines.words | CAPITALS) == (word(name) | CAPITALS)] = kind
    notes = []
    unknown = lines.numbers[kinds == 0]
    if len(unknown):
        notes.append(f"{count(len(unknown), 'line')} not understood and left out, the first is line {unknown[0]}.")
    lines, kinds = lines.only(kinds > 0), kinds[kinds > 0]
    _check_order(path, lines, kinds)
    if len(kinds) and kinds[-1] == ENDFACET:
        notes.append("The file ends without 'endsolid': facets may be missing.")
    elif not len(kinds) or kinds[-1] != ENDSOLID:
        raise damaged(at(path, line=text.count("\n") + 1), "the end of the file within a solid", "'endsolid'")
    own = kinds == VERTEX
    expected = "'vertex x y z' with finite numbers"
    vertices = Rows(path, expected, lines.data, lines.numbers[own], lines.rests[own], lines.ends[own])
    corners = vertices.positions()[:, :3].reshape(-1, 3, 3)
    solids = np.flatnonzero(kinds == SOLID)
    names = [lines.text(line)[len("solid") :].strip() for line in solids.tolist()]
    ends = [*(np.cumsum(own)[solids] // 3).tolist(), len(corners)]
    pieces = [
        _piece(name, corners[start:end])
        for name, (start, end) in zip(names, pairwise(ends), strict=True)
        if end > start
    ]
    if not pieces:
        raise damaged(path, "no facets", "an STL file with a surface")
    return Surface(pieces, notes, faceted=True)


def _check_order(path: Path, lines: Lines, kinds: NDArray[np.int64]) -> None:
    """Refuse the first line that does not follow from the one before, or ends a facet of other than 3 vertices."""
    follows = np.array([[name in others for name in KINDS] for others in FOLLOWS.values()])
    before = np.concatenate([[0], kinds])
    wrong = np.flatnonzero(~follows[before[:-1], kinds])
    in_order = kinds[: wrong[0]] if len(wrong) else kinds
    so_far = np.cumsum(in_order == VERTEX)
    ends = np.flatnonzero(in_order == ENDLOOP)
    sizes = so_far[ends] - so_far[np.flatnonzero(in_order == OUTER)[: len(ends)]]
    if (sizes != 3).any():
        facet = int(np.argmax(sizes != 3))
        where = at(path, line=int(lines.numbers[ends[facet]]))
        raise damaged(where, f"a facet of {sizes[facet]} vertices", "3 vertices")
    if len(wrong):
        expected = FOLLOWS[KINDS[before[wrong[0]]]]
        found = repr(lines.text(int(wrong[0])).strip()[:60])
        raise damaged(at(path, line=int(lines.numbers[wrong[0]])), found, " or ".join(map(repr, expected)))


def _piece(name: str, corners: NDArray[np.float64]) -> Piece:
    return Piece(name, corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
