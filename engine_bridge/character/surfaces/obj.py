"""Wavefront OBJ: objects, groups and materials, polygons, texture coordinates, normals and vertex colours."""

import re
from collections.abc import Iterable
from dataclasses import replace
from itertools import accumulate
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.surfaces import mtl
from engine_bridge.character.surfaces.corners import distinct_corners
from engine_bridge.character.surfaces.files import Folder
from engine_bridge.character.surfaces.polygons import triangulate
from engine_bridge.character.surfaces.surface import (
    DEFAULT_MATERIAL,
    Material,
    Piece,
    Surface,
    count,
    damaged,
    linear,
    material_for,
    upper_left,
)
from engine_bridge.character.surfaces.text import Rows, decoded, parsed
from puppetline.errors import at

LINE_CONTINUATION = "\r"
"""Placeholder for the end of a line that continues on the next line."""

IGNORED_STATEMENT = re.compile(
    "bevel|bmat|con|cstype|[cs]tech|[cd]_interp|curv2?|deg|end|hole|lod|maplib|mg|parm|scrv|shadow_obj|sp|step|surf"
    "|trace_obj|trim|usemap|vp|#.*"
)
"""Statements that do not concern polygons, and comments."""

NOT_A_SURFACE = frozenset(("l", "p"))

LIBRARY_END = re.compile(r"(?<=\.mtl)(?=\s|\"|$)", re.IGNORECASE)
"""End of the name of a material file, which may contain spaces."""

HEAD = re.compile(rb"^[ \t]*(?:v|vn|vt|f|o|g|mtllib|usemtl)[ \t]", re.MULTILINE)

CORNER = re.compile(r"(?:[-+]?\d{1,18})?(?:/(?:[-+]?\d{1,18})?){0,2}", re.ASCII)
"""Corner of a face: indices of a vertex, texture coordinates and a normal, any of which may be omitted."""

MAX_INDEX = 10**18
"""Limit of indices, because NumPy reads numbers of more than 64 bits as other numbers."""

MISSING_NUMBER = re.compile(r"(?<![-+\d])(?=/)|(?<=/)(?![-+\d])")
"""Position before or after a slash where a corner has no number."""


def matches(head: bytes) -> bool:
    """Return whether the beginning of a file has lines of an OBJ file."""
    return HEAD.search(head) is not None


def read(path: Path, content: bytes) -> Surface:
    """Read an OBJ file.

    Each pair of a group (or object) and a material becomes a piece, in the order of their first faces. A piece without
    texture coordinates and normals has the file's vertices in the file's order. Any other piece has one vertex per
    distinct corner v/vt/vn, in the order of their first appearance.

    Vertex colours are sRGB, as MeshLab and Blender write them.

    Raises
    ------
    MeshError
        The file has no surface or a line that cannot be read; the message has the line.
    """
    text = decoded(path, content)
    if "\\" in text:  # faster than a search for pairs
        text = text.replace("\\\n", LINE_CONTINUATION).removesuffix("\\")
    return _Statements(path, text).surface()


class _Statements:
    """Statements of a file, collected by keyword."""

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        self.notes: list[str] = []
        self.folder = Folder(path, self.notes)
        self.vertices = Rows(path, "'v x y z' with finite numbers")
        self.coordinates = Rows(path, "'vt u v' with numbers")
        self.normals = Rows(path, "'vn x y z' with numbers")
        self.faces = Rows(path, "'f a b c' with vertices from 1 on, as a, a/vt, a//vn or a/vt/vn")
        self.groups: dict[tuple[str, str], int] = {}
        self.group_of: list[int] = []
        self.libraries: dict[str, int] = {}
        self.group = self.material = self.smoothing = ""
        self.smoothings: set[str] = set()
        self.lines_and_points = 0
        self.unknown: list[int] = []
        self._read(text)

    def _read(self, text: str) -> None:
        """Collect the statements of all lines."""
        rows = {"v": self.vertices, "vt": self.coordinates, "vn": self.normals, "f": self.faces, "fo": self.faces}
        lines = text.split("\n")
        numbers: Iterable[int] = range(1, len(lines) + 1)
        if LINE_CONTINUATION in text:
            numbers = accumulate((1 + line.count(LINE_CONTINUATION) for line in lines), initial=1)
        for number, line in zip(numbers, lines, strict=False):
            kind, _, value = line.partition(" ")
            if kind not in rows:  # it may be indented, or end with a tab
                kind, _, value = " ".join(line.split(None, 1)).partition(" ")
            if kind in rows:
                rows[kind].lines.append(number)
                rows[kind].texts.append(value.partition("#")[0] if "#" in value else value)
            elif kind:
                self._assign()
                self._other(number, kind, value)
        self._assign()

    def _assign(self) -> None:
        """Assign the faces since the last other statement to the current group and material."""
        new = len(self.faces) - len(self.group_of)
        if new:
            self.group_of += [self.groups.setdefault((self.group, self.material), len(self.groups))] * new
            self.smoothings.add(self.smoothing)

    def _other(self, line: int, kind: str, value: str) -> None:
        """Read a statement that is neither a vertex attribute nor a face."""
        match kind:
            case "g" | "o":
                self.group = " ".join(value.split())
            case "s":
                group = value.partition("#")[0].strip()
                self.smoothing = "" if group in ("off", "0") else group
            case "usemtl":
                self.material = value.strip()
            case "mtllib":
                named = [name.strip('" \t') for name in LIBRARY_END.split(value)[:-1]]
                for name in named or value.split():
                    self.libraries.setdefault(name.strip('"'), line)
            case _ if kind in NOT_A_SURFACE:
                self.lines_and_points += 1
            case _ if not IGNORED_STATEMENT.fullmatch(kind):
                self.unknown.append(line)

    def surface(self) -> Surface:
        """Return the surface of all statements."""
        if not len(self.vertices):
            raise damaged(self.path, "no vertices", "an OBJ file with 'v x y z' lines")
        table = self.vertices.positions()
        corners, sizes, groups = self._polygons()
        if not len(sizes):
            raise damaged(self.path, "vertices without faces", "an OBJ file with faces")
        triangles, polygon = triangulate(table[corners[0], :3], sizes)
        # polygons that lack texture coordinates or normals at some corner become separate pieces
        starts = np.cumsum(sizes) - sizes
        has_uv, has_normal = np.minimum.reduceat(corners[1:], starts, axis=1) >= 0
        kind = 4 * groups + 2 * has_normal + has_uv
        pieces = self._pieces(table, corners, np.repeat(kind, sizes), triangles, kind[polygon])
        self._note_omissions()
        return Surface(pieces, self.notes, files=self.folder.files)

    def _polygons(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Read the faces.

        Returns
        -------
        corners : (3, c) int64
            Indices of vertex, texture coordinates and normal from 0, −1 for none.
        sizes : (p,) int64
            Number of corners of each polygon.
        groups : (p,) int64
        """
        stated, sizes = self._stated(), self.faces.widths
        owner = np.repeat(np.arange(len(sizes)), sizes)
        known = np.array([[len(self.vertices)], [len(self.coordinates)], [len(self.normals)]])
        backwards = stated < 0
        corners = stated - 1
        if backwards.any():
            rows = (self.vertices, self.coordinates, self.normals)
            so_far = np.array([np.searchsorted(kind.lines, self.faces.lines) for kind in rows])
            corners = np.where(backwards, so_far[:, owner] + stated, corners)
        wrong = (corners >= known) | (backwards & (corners < 0))
        no_vertex = wrong[0] | (stated[0] == 0)
        if no_vertex.any():
            corner = int(np.argmax(no_vertex))
            raise self.faces.error(owner[corner], f"vertex {stated[0, corner]} of {len(self.vertices):,}")
        if wrong.any():
            self.notes.append("Some faces name texture coordinates or normals that are not in the file.")
            corners[wrong] = -1
        enough = sizes >= 3
        if not enough.all():
            self.notes.append(f"{count(int((~enough).sum()), 'face')} with fewer than 3 corners omitted.")
        return corners[:, enough[owner]], sizes[enough], np.array(self.group_of, dtype=np.int64)[enough]

    def _stated(self) -> NDArray[np.int64]:
        """Return the corners (3, c) as in the file, 0 for omitted indices."""
        text = " ".join(" ".join(self.faces.texts).split())
        if "//" in text or "/ " in text or " /" in text or text.endswith("/"):
            text = MISSING_NUMBER.sub("0", text)
        letters = np.frombuffer(text.encode("utf-8"), np.uint8)
        slashes = np.cumsum(letters == ord("/"))
        ends = slashes[np.append(np.flatnonzero(letters == ord(" ")), -1)] if text else np.empty(0, dtype=np.int64)
        parts = np.diff(ends, prepend=0) + 1
        numbers = parsed(text.replace("/", " "), np.int64)
        is_read = numbers is not None and len(numbers) == parts.sum() and parts.max(initial=0) <= 3
        if numbers is None or not is_read or np.abs(numbers).max(initial=0) >= MAX_INDEX:
            is_face = (all(map(CORNER.fullmatch, face.split())) for face in self.faces.texts)
            raise self.faces.error(next((row for row, fits in enumerate(is_face) if not fits), 0))
        stated = np.zeros((3, len(parts)), dtype=np.int64)
        first = np.cumsum(parts) - parts
        for part in range(3):
            there = parts > part
            stated[part, there] = numbers[first[there] + part]
        return stated

    def _pieces(
        self,
        table: NDArray[np.float64],
        corners: NDArray[np.int64],
        kind_of_corner: NDArray[np.int64],
        triangles: NDArray[np.int64],
        kind_of_triangle: NDArray[np.int64],
    ) -> list[Piece]:
        """Return the pieces, each of which has vertices of its own."""
        uvs = _texture_coordinates(self.coordinates.table(1))
        normals = self.normals.table(3)[:, :3]
        colors = linear(table[:, 3:6]) if table.shape[1] >= 6 else None
        if colors is None and (self.vertices.widths >= 6).any():
            self.notes.append("Vertex colours are omitted, because some vertices have none.")
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
                first, vertex_of[own_corners] = distinct_corners(own.T)
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
            self.notes.append(f"{count(int(isolated.sum()), 'vertex', 'vertices')} without a face omitted.")
        return [self._without_images(piece) for piece in pieces]

    def _materials(self) -> dict[str, Material]:
        """Return the materials of all faces, from the material files."""
        known: dict[str, Material] = {}
        for name, line in self.libraries.items():
            path = self.folder.find(name, self.path.parent, at(self.path, line=line))
            if path:
                known |= mtl.read(path, self.folder)
        used = list(dict.fromkeys(material for _, material in self.groups if material))
        unknown = [name for name in used if name not in known]
        if unknown:
            named = ", ".join(map(repr, unknown[:5])) + (", …" if len(unknown) > 5 else "")
            self.notes.append(f"{count(len(unknown), 'material')} missing in the material files: {named}.")
        return {name: known.get(name, replace(DEFAULT_MATERIAL, name=name)) for name in used}

    def _without_images(self, piece: Piece) -> Piece:
        """Remove images from a piece without texture coordinates."""
        material = piece.material
        if piece.uvs is not None or not (material.texture or material.normal_texture):
            return piece
        self.notes.append(f"{piece.name!r} has no texture coordinates for the image of material {material.name!r}.")
        return replace(piece, material=replace(material, texture=None, normal_texture=None))

    def _note_omissions(self) -> None:
        if len(self.smoothings) > 1 and not len(self.normals):
            self.notes.append("Smoothing groups are ignored. Export the mesh with normals to keep its hard edges.")
        if self.lines_and_points:
            self.notes.append(f"{count(self.lines_and_points, 'statement')} of lines or points omitted.")
        if self.unknown:
            number = count(len(self.unknown), "line")
            self.notes.append(f"{number} not understood and omitted; the first is line {self.unknown[0]}.")


def _runs(keys: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Return the indices of each key, in ascending order of the keys."""
    order = np.argsort(keys, kind="stable")
    return np.split(order, np.nonzero(np.diff(keys[order]))[0] + 1)


def _texture_coordinates(table: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return texture coordinates (n, 2) from the upper left corner of the image, as in glTF."""
    return upper_left(np.column_stack([table[:, 0], table[:, 1] if table.shape[1] > 1 else np.zeros(len(table))]))
