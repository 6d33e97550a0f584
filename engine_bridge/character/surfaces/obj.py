"""Wavefront OBJ: objects, groups and materials, polygons, texture coordinates, normals and vertex colours."""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.surfaces import mtl
from engine_bridge.character.surfaces.corners import distinct
from engine_bridge.character.surfaces.files import Folder
from engine_bridge.character.surfaces.polygons import triangulate
from engine_bridge.character.surfaces.scanning import read_corners
from engine_bridge.character.surfaces.surface import (
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
from engine_bridge.character.surfaces.text import Lines, Rows, decoded, lines_of, word
from puppetline.errors import at

CONTINUED = "\r"
"""Stands for the end of a line that goes on in the next."""

FACES = ("f", "fo")
"""Statements of a face, the second is what f was called once."""

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
    text = decoded(path, content)
    if "\\" in text:  # which is found sooner than a pair
        text = text.replace("\\\n", CONTINUED).removesuffix("\\")
    return _Statements(path, lines_of(text, CONTINUED)).surface()


class _Statements:
    """The statements of a file, collected by kind."""

    def __init__(self, path: Path, lines: Lines) -> None:
        self.path = path
        self.notes: list[str] = []
        self.vertices = _rows(path, lines, ("v",), "'v x y z' with finite numbers")
        self.coordinates = _rows(path, lines, ("vt",), "'vt u v' with numbers")
        self.normals = _rows(path, lines, ("vn",), "'vn x y z' with numbers")
        self.faces = _rows(path, lines, FACES, "'f a b c' with vertices from 1 on, as a, a/vt, a//vn or a/vt/vn")
        self.so_far = _counted(lines, ("v", "vt", "vn"), FACES)
        self.groups: dict[tuple[str, str], int] = {}
        self.group_of = np.zeros(len(self.faces), dtype=np.int64)
        self.libraries: dict[str, int] = {}
        self.group = self.material = ""
        self.smoothing = ""
        self.smoothings: set[str] = set()
        self.lines_and_points = 0
        self.unknown: list[int] = []
        self._read_others(lines)

    def _read_others(self, lines: Lines) -> None:
        """Go through all lines besides those of numbers; what they say holds for the faces after them."""
        handlers: dict[str, Callable[[int, str], None]] = {
            "g": self._group,
            "o": self._group,
            "s": self._smooth,
            "usemtl": self._usemtl,
            "mtllib": self._mtllib,
        }
        others = np.flatnonzero(~_begins(lines, ("v", "vt", "vn", *FACES)) & (lines.comments > lines.starts))
        faces_before = np.searchsorted(self.faces.lines, lines.numbers[others])
        done = 0
        for line, faces in zip(others.tolist(), faces_before.tolist(), strict=True):
            self._assign(done, faces)
            done = faces
            kind, *rest = lines.text(line).split(None, 1)
            handler, number = handlers.get(kind), int(lines.numbers[line])
            if handler:
                handler(number, rest[0] if rest else "")
            elif kind in NOT_A_SURFACE:
                self.lines_and_points += 1
            elif not SILENT.fullmatch(kind):
                self.unknown.append(number)
        self._assign(done, len(self.faces))

    def _assign(self, start: int, end: int) -> None:
        """Put faces into the group and material that hold now."""
        if start < end:
            self.group_of[start:end] = self.groups.setdefault((self.group, self.material), len(self.groups))
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
        triangles, polygon = triangulate(table[corners[0], :3], sizes)
        # polygons without texture coordinates or normals at all of their corners become pieces of their own
        starts = np.cumsum(sizes) - sizes
        has_uv, has_normal = np.minimum.reduceat(corners[1:], starts, axis=1) >= 0
        kind = 4 * groups + 2 * has_normal + has_uv
        pieces = self._pieces(table, corners, np.repeat(kind, sizes), triangles, kind[polygon])
        self._note_what_is_left_out()
        return Surface(pieces, self.notes)

    def _polygons(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Read the faces.

        Returns
        -------
        corners : (3, c) int64
            Indices of vertex, texture coordinates and normal from 0, −1 where there are none.
        sizes : (p,) int64
            How many corners each polygon has.
        groups : (p,) int64
        """
        stated, sizes = self._stated()
        owner = np.repeat(np.arange(len(sizes)), sizes)
        known = np.array([[len(self.vertices)], [len(self.coordinates)], [len(self.normals)]])
        corners, backwards = stated - 1, stated < 0
        if backwards.any():
            corners = np.where(backwards, self.so_far[:, owner] + stated, corners)
        wrong = (corners >= known) | (backwards & (corners < 0))
        no_vertex = wrong[0] | (stated[0] == 0)
        if no_vertex.any():
            corner = int(np.argmax(no_vertex))
            raise self.faces.error(owner[corner], f"vertex {stated[0, corner]} of {len(self.vertices):,}")
        if wrong.any():
            self.notes.append("The faces name texture coordinates or normals that the file does not have.")
            corners[wrong] = -1
        enough = sizes >= 3
        if enough.all():
            return corners, sizes, self.group_of
        self.notes.append(f"{count(int((~enough).sum()), 'face')} of fewer than 3 corners left out.")
        return corners[:, enough[owner]], sizes[enough], self.group_of[enough]

    def _stated(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the corners (3, c) as they stand in the file, 0 for what is not there, and how many a face has."""
        faces = self.faces
        corners, sizes = np.empty((3, faces.most), dtype=np.int64), np.empty(len(faces), dtype=np.int64)
        count, wrong = read_corners(faces.data, faces.starts, faces.ends, corners, sizes)
        if wrong >= 0:
            raise faces.error(wrong)
        return corners[:, :count], sizes

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
        if colors is None and (self.vertices.numbers[1] >= 6).any():
            self.notes.append("Vertex colours left out: some vertices have none.")
        names, materials = list(self.groups), self._materials()
        isolated = np.ones(len(table), dtype=np.bool_)
        isolated[corners[0]] = False
        vertex_of = np.empty(corners.shape[1], dtype=np.int64)
        pieces = []
        for own_corners, own_triangles in zip(_runs(kind_of_corner), _runs(kind_of_triangle), strict=True):
            group, has = divmod(int(kind_of_corner[own_corners[0]]), 4)
            own = corners[:, own_corners]
            if has:
                own[1:][[not has & 1, not has & 2]] = -1
                first, vertex_of[own_corners] = distinct(own.T)
                v, vt, vn = own[:, first]
            else:
                kept = isolated.copy()
                kept[own[0]] = True
                v, isolated = np.flatnonzero(kept), np.zeros_like(kept)
                vertex_of[own_corners] = (np.cumsum(kept) - 1)[own[0]]
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
        if isolated.any():
            self.notes.append(f"{count(int(isolated.sum()), 'vertex', 'vertices')} in no face left out.")
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


def _begins(lines: Lines, kinds: Sequence[str]) -> NDArray[np.bool_]:
    """Tell which lines begin with one of some words."""
    return np.isin(lines.words, [word(kind) for kind in kinds])


def _rows(path: Path, lines: Lines, kinds: Sequence[str], expected: str) -> Rows:
    which = _begins(lines, kinds)
    return Rows(path, expected, lines.data, lines.numbers[which], lines.rests[which], lines.comments[which])


def _counted(lines: Lines, kinds: Sequence[str], at_kinds: Sequence[str]) -> NDArray[np.int64]:
    """Return how many lines of each kind (rows) come before each line of other kinds (columns)."""
    here = _begins(lines, at_kinds)
    return np.stack([np.cumsum(_begins(lines, (kind,)))[here] for kind in kinds])


def _runs(keys: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Return where each key stands, the keys ascending."""
    order = np.argsort(keys, kind="stable")
    return np.split(order, np.nonzero(np.diff(keys[order]))[0] + 1)


def _texture_coordinates(table: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (n, 2) coordinates in glTF's sense: from the picture's upper left corner."""
    return upper_left(np.column_stack([table[:, 0], table[:, 1] if table.shape[1] > 1 else np.zeros(len(table))]))
