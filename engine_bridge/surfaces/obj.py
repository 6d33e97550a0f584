"""Wavefront OBJ: objects, groups and materials, polygons, texture coordinates, normals and vertex colours."""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engine_bridge.surfaces import mtl
from engine_bridge.surfaces.corners import distinct
from engine_bridge.surfaces.files import Folder
from engine_bridge.surfaces.polygons import triangulate
from engine_bridge.surfaces.surface import (
    CLAY,
    Material,
    Piece,
    Surface,
    count,
    damaged,
    linear,
    material_for,
    upper_left,
)
from engine_bridge.surfaces.text import Rows, decoded
from puppetline.errors import at

CONTINUED = "\t \t"
"""Stands for the end of a line that goes on in the next."""

SILENT = re.compile(
    "bevel|bmat|con|cstype|[cs]tech|[cd]_interp|curv2?|deg|end|hole|lod|maplib|mg|parm|scrv|shadow_obj|sp|step|surf"
    "|trace_obj|trim|usemap|vp|#.*"
)
"""Statements of the format that say nothing of polygons, and comments."""

NOT_A_SURFACE = frozenset(("l", "p"))

LIBRARY_END = re.compile(r"(?<=\.mtl)(?=\s|\"|$)", re.IGNORECASE)
"""Where the name of a material file ends, which may hold spaces."""

HEAD = re.compile(rb"^[ \t]*(?:v|vn|vt|f|o|g|mtllib|usemtl)[ \t]", re.MULTILINE)


def matches(head: bytes) -> bool:
    """Tell whether a file that begins like this has lines of an OBJ."""
    return HEAD.search(head) is not None


def read(path: Path, content: bytes) -> Surface:
    """Read an OBJ file.

    Each pair of a group (or object) and a material becomes a piece, in the order in which they first have a face.
    Where faces have no texture coordinates and no normals, the piece has the file's vertices in the file's order;
    elsewhere one vertex for each distinct corner v/vt/vn, in the order in which these appear.

    Vertex colours are taken as sRGB, as MeshLab and Blender write them.

    Raises
    ------
    MeshError
        With the line that cannot be read.
    """
    statements = _Statements(path)
    statements.read(decoded(path, content).replace("\\\n", CONTINUED).removesuffix("\\"))
    return statements.surface()


class _Statements:
    """The statements of a file, collected by kind."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.notes: list[str] = []
        self.vertices = Rows(path, "'v x y z' with finite numbers")
        self.coordinates = Rows(path, "'vt u v' with numbers")
        self.normals = Rows(path, "'vn x y z' with numbers")
        self.faces = Rows(path, "'f a b c' with vertices from 1 on, as a, a/vt, a//vn or a/vt/vn")
        self.groups: dict[tuple[str, str], int] = {}
        self.group_of: list[int] = []
        self.backwards: list[tuple[int, int, int, int]] = []
        self.libraries: dict[str, int] = {}
        self.group = self.material = ""
        self.smoothing = ""
        self.smoothings: set[str] = set()
        self.lines_and_points = 0
        self.unknown: list[int] = []

    def read(self, text: str) -> None:
        """Go through all lines."""
        handlers: dict[str, Callable[[int, str], None]] = {
            "v": self._numbers_of(self.vertices),
            "vt": self._numbers_of(self.coordinates),
            "vn": self._numbers_of(self.normals),
            "f": self._face,
            "fo": self._face,  # what f was called once
            "g": self._group,
            "o": self._group,
            "s": self._smooth,
            "usemtl": self._usemtl,
            "mtllib": self._mtllib,
        }
        number = 1
        for line in text.split("\n"):
            fields = line.split(None, 1)
            if fields:
                kind = fields[0]
                handler = handlers.get(kind)
                if handler:
                    handler(number, fields[1] if len(fields) > 1 else "")
                elif kind in NOT_A_SURFACE:
                    self.lines_and_points += 1
                elif not SILENT.fullmatch(kind):
                    self.unknown.append(number)
            number += 1 + line.count(CONTINUED)

    def _numbers_of(self, rows: Rows) -> Callable[[int, str], None]:
        def add(line: int, rest: str) -> None:
            rows.add(line, rest.partition("#")[0])

        return add

    def _face(self, line: int, rest: str) -> None:
        if "-" in rest:
            self.backwards.append((len(self.faces), len(self.vertices), len(self.coordinates), len(self.normals)))
        self.faces.add(line, rest.partition("#")[0])
        self.group_of.append(self.groups.setdefault((self.group, self.material), len(self.groups)))
        self.smoothings.add(self.smoothing)

    def _group(self, _: int, rest: str) -> None:
        self.group = " ".join(rest.split())

    def _smooth(self, _: int, rest: str) -> None:
        group = rest.partition("#")[0].strip()
        self.smoothing = "" if group in ("off", "0") else group

    def _usemtl(self, _: int, rest: str) -> None:
        self.material = rest.strip()

    def _mtllib(self, line: int, rest: str) -> None:
        named = [name.strip('" \t') for name in LIBRARY_END.split(rest)[:-1]]
        for name in named or rest.split():
            self.libraries.setdefault(name.strip('"'), line)

    def surface(self) -> Surface:
        """Make pieces of all that was read."""
        if not len(self.vertices):
            raise damaged(self.path, "no vertices", "an OBJ file with 'v x y z' lines")
        table = self.vertices.positions()
        corners, sizes, groups = self._polygons()
        if not len(sizes):
            raise damaged(self.path, "vertices without faces", "an OBJ file with a surface: points and lines have none")
        triangles, polygon = triangulate(table[corners[:, 0], :3], sizes)
        # polygons without texture coordinates or normals at all of their corners become pieces of their own
        starts = np.cumsum(sizes) - sizes
        complete = np.minimum.reduceat(corners[:, 1:], starts, axis=0) >= 0
        kind = groups * 4 + complete @ np.array([1, 2])
        pieces = self._pieces(table, corners, np.repeat(kind, sizes), triangles, kind[polygon])
        self._note_what_is_left_out()
        return Surface(pieces, self.notes)

    def _polygons(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Read the faces.

        Returns
        -------
        corners : (c, 3) int64
            Indices of vertex, texture coordinates and normal from 0, −1 where there are none.
        sizes : (p,) int64
            How many corners each polygon has.
        groups : (p,) int64
        """
        fields = [text.split() for text in self.faces.texts]
        try:
            stated = _indices(list(chain.from_iterable(fields)))
        except (ValueError, OverflowError):
            raise self.faces.error(next(row for row, parts in enumerate(fields) if not _are_indices(parts))) from None
        sizes = np.fromiter(map(len, fields), np.int64, len(fields))
        owner = np.repeat(np.arange(len(sizes)), sizes)
        known = np.array([len(self.vertices), len(self.coordinates), len(self.normals)])
        if (stated[:, known == 0] != 0).any():
            self.notes.append("The faces name texture coordinates or normals that the file does not have.")
            stated[:, known == 0] = 0
        so_far = np.zeros((len(sizes), 3), dtype=np.int64)
        for face, *counts in self.backwards:
            so_far[face] = counts
        corners = np.where(stated > 0, stated - 1, np.where(stated < 0, so_far[owner] + stated, -1))
        absent = (stated == 0) & [False, True, True]
        wrong = ~absent & ((corners < 0) | (corners >= known) | (stated < -known))
        if wrong.any():
            corner, column = np.argwhere(wrong)[0]
            what = ("vertex", "texture coordinate", "normal")[column]
            raise self.faces.error(owner[corner], f"{what} {stated[corner, column]} of {known[column]:,}")
        enough = sizes >= 3
        if not enough.all():
            self.notes.append(f"{count(int((~enough).sum()), 'face')} of fewer than 3 corners left out.")
        return corners[enough[owner]], sizes[enough], np.array(self.group_of, dtype=np.int64)[enough]

    def _pieces(
        self,
        table: NDArray[np.float64],
        corners: NDArray[np.int64],
        kind_of_corner: NDArray[np.int64],
        triangles: NDArray[np.int64],
        kind_of_triangle: NDArray[np.int64],
    ) -> list[Piece]:
        """Divide the triangles, which index corners, into pieces, which have vertices."""
        uvs = _texture_coordinates(self.coordinates.table(1))
        normals = self.normals.table(3)[:, :3]
        colors = linear(table[:, 3:6]) if table.shape[1] >= 6 else None
        if colors is None and any(len(text.split()) >= 6 for text in self.vertices.texts):
            self.notes.append("Vertex colours left out: some vertices have none.")
        names, materials = list(self.groups), self._materials()
        isolated = np.setdiff1d(np.arange(len(table)), corners[:, 0])
        vertex_of = np.empty(len(corners), dtype=np.int64)
        pieces = []
        for own_corners, own_triangles in zip(_runs(kind_of_corner), _runs(kind_of_triangle), strict=True):
            group, has = divmod(int(kind_of_corner[own_corners[0]]), 4)
            own = np.where([True, bool(has & 1), bool(has & 2)], corners[own_corners], -1)
            if has:
                first, vertex_of[own_corners] = distinct(own)
                v, vt, vn = own[first].T
            else:
                v, isolated = np.union1d(own[:, 0], isolated), isolated[:0]
                vertex_of[own_corners] = np.searchsorted(v, own[:, 0])
            name, material = names[group]
            paint = None if colors is None else colors[v]
            pieces.append(
                Piece(
                    name=name,
                    positions=table[v, :3],
                    triangles=vertex_of[triangles[own_triangles]],
                    material=materials[material] if material else material_for(paint),
                    normals=normals[vn] if has & 2 else None,
                    uvs=uvs[vt] if has & 1 else None,
                    colors=paint,
                )
            )
        if len(isolated):
            self.notes.append(f"{count(len(isolated), 'vertex', 'vertices')} in no face left out.")
        return [self._without_pictures(piece) for piece in pieces]

    def _materials(self) -> dict[str, Material]:
        """Read the material files and return every material that a face has."""
        folder = Folder(self.path, self.notes)
        known: dict[str, Material] = {}
        for name, line in self.libraries.items():
            path = folder.find(name, self.path.parent, at(self.path, line=line))
            if path:
                known |= mtl.read(path, folder)
        used = list(dict.fromkeys(material for _, material in self.groups if material))
        unknown = [name for name in used if name not in known]
        if unknown:
            named = ", ".join(map(repr, unknown[:5])) + (", …" if len(unknown) > 5 else "")
            self.notes.append(f"{count(len(unknown), 'material')} not described: {named}.")
        return {name: known.get(name, replace(CLAY, name=name)) for name in used}

    def _without_pictures(self, piece: Piece) -> Piece:
        """Take pictures from a piece that has no texture coordinates to lay them on."""
        material = piece.material
        if piece.uvs is not None or not (material.texture or material.normal_texture):
            return piece
        self.notes.append(f"{piece.name!r} has no texture coordinates for the picture of material {material.name!r}.")
        return replace(piece, material=replace(material, texture=None, normal_texture=None))

    def _note_what_is_left_out(self) -> None:
        if len(self.smoothings) > 1 and not len(self.normals):
            self.notes.append("Smoothing groups are not carried: export the mesh with normals to keep its hard edges.")
        if self.lines_and_points:
            self.notes.append(f"{count(self.lines_and_points, 'statement')} of lines or points left out.")
        if self.unknown:
            number = count(len(self.unknown), "line")
            self.notes.append(f"{number} not understood and left out, the first is line {self.unknown[0]}.")


def _indices(fields: Sequence[str]) -> NDArray[np.int64]:
    """Read corners like ``7``, ``7/2``, ``7//3`` and ``-1/2/3`` as (c, 3), 0 for what is not there."""
    text = " ".join(fields)
    if "_" in text or any(field.count("/") > 2 for field in fields):
        raise ValueError("no corner")
    indices = np.zeros((len(fields), 3), dtype=np.int64)
    if "/" in text:
        padded = [part or "0" for field in fields for part in f"{field}//".split("/", 3)[:3]]
        indices[:] = np.array(list(map(int, padded)), dtype=np.int64).reshape(-1, 3)
    else:
        indices[:, 0] = list(map(int, fields))
    return indices


def _are_indices(fields: Sequence[str]) -> bool:
    try:
        _indices(fields)
    except (ValueError, OverflowError):
        return False
    return True


def _runs(keys: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Return where each key stands, the keys ascending."""
    order = np.argsort(keys, kind="stable")
    return np.split(order, np.nonzero(np.diff(keys[order]))[0] + 1)


def _texture_coordinates(table: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (n, 2) coordinates in glTF's sense: from the picture's upper left corner."""
    return upper_left(np.column_stack([table[:, 0], table[:, 1] if table.shape[1] > 1 else np.zeros(len(table))]))
