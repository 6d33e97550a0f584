"""Wavefront OBJ: objects, groups and materials, polygons, texture coordinates, normals and vertex colours."""

import re
from array import array
from dataclasses import replace
from itertools import groupby, repeat
from operator import itemgetter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.surfaces import mtl
from engine_bridge.character.surfaces.files import Folder
from engine_bridge.character.surfaces.polygons import distinct_corners, triangulate
from engine_bridge.character.surfaces.surface import (
    DEFAULT_MATERIAL,
    MAX_COORDINATE,
    Piece,
    Surface,
    SurfaceMaterial,
    count,
    damaged,
    linear,
    material_for,
    upper_left,
)
from engine_bridge.character.surfaces.text import decoded, filled_lines, unreadable
from puppetline.errors import at

CONTINUED = re.compile(r"^(?:[^\n]*\\\n)+[^\n]*", re.MULTILINE)
"""Statement on several lines, all of which but the last end with a backslash."""

IGNORED_STATEMENT = re.compile(
    "bevel|bmat|con|cstype|[cs]tech|[cd]_interp|curv2?|deg|end|hole|lod|maplib|mg|parm|scrv|shadow_obj|sp|step|surf"
    "|trace_obj|trim|usemap|vp|#.*"
)
"""Statements that do not concern polygons, and comments."""

MAX_INDEX = 2**31
"""Largest index in faces that are read quickly; others are read one by one."""

LIBRARY_END = re.compile(r"(?<=\.mtl)(?=\s|\"|$)", re.IGNORECASE)
"""End of the name of a material file, which may contain spaces."""

HEAD = re.compile(rb"^[ \t]*(?:v|vn|vt|f|o|g|mtllib|usemtl)[ \t]", re.MULTILINE)

EXPECTED = {
    "v": "'v x y z' with finite numbers",
    "vt": "'vt u v' with numbers",
    "vn": "'vn x y z' with numbers",
    "f": "'f a b c' with vertices from 1 on, as a, a/vt, a//vn or a/vt/vn",
}
"""Statements of numbers, for error messages."""


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
    text = decoded(path, content).removesuffix("\\")
    lines = (CONTINUED.sub(_joined, text) if "\\" in text else text).split("\n")
    statements, before = _Statements(path), 0
    for beginning, similar in groupby(lines, itemgetter(slice(2))):
        run = list(similar)
        if not statements.read_run(before + 1, beginning.strip(), " ".join(run).split(), len(run)):
            _read_lines(statements, before, "\n".join(run))
        before += len(run)
    return statements.surface()


def _read_lines(statements: "_Statements", before: int, text: str) -> None:
    """Read lines one by one that come after a number of others."""
    for number, line in filled_lines(text):
        kind, value = [*line.split(None, 1), ""][:2]
        if kind not in EXPECTED:
            statements.read_other(before + number, kind, value)
            continue
        words = value.partition("#")[0].split()
        try:
            statements.read_numbers(before + number, kind, words)
        except (ValueError, OverflowError):
            raise unreadable(statements.path, before + number, " ".join(words), EXPECTED[kind]) from None


def _joined(lines: re.Match[str]) -> str:
    """Return a statement in one line, and blank lines in place of the others."""
    return lines[0].replace("\\\n", " ") + "\n" * lines[0].count("\n")


class _Statements:
    """Statements of a file, collected by keyword."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.notes: list[str] = []
        self.folder = Folder(path, self.notes)
        self.positions, self.colors, self.coordinates, self.normals = (array("d") for _ in range(4))
        self.corners = array("q")
        self.face_sizes: list[int] = []
        self.face_lines: list[int] = []
        self.group_of_face: list[int] = []
        self.groups: dict[tuple[str, str], int] = {}
        self.libraries: dict[str, int] = {}
        self.group = self.material = self.smoothing = ""
        self.smoothings: set[str] = set()
        self.small_faces = 0
        self.lines_and_points = 0
        self.unknown: list[int] = []

    def read_run(self, line: int, kind: str, words: list[str], count: int) -> bool:
        """Read similar lines at once, in a tenth of the time: numbers, or faces of one size without negative indices.

        Parameters
        ----------
        line : int
            Number of the first line.
        kind : str
            Keyword with which the lines may begin.
        words : list of str
            All words of the lines.
        count : int
            Number of lines.

        Returns
        -------
        bool
            Whether they were read; nothing has changed otherwise.
        """
        size = len(words) // count
        if kind not in EXPECTED or size < 2 or len(words) % count or words[::size] != [kind] * count:
            return False
        words = [word for word in words if word != kind]
        if kind == "f":
            return self._read_faces(line, words, count)
        try:
            self._add_numbers(kind, np.array([*map(float, words)]).reshape(count, size - 1))
        except ValueError:
            return False
        return True

    def _read_faces(self, line: int, words: list[str], count: int) -> bool:
        """Read the corners of faces on successive lines, as `read_run`."""
        slashes, *others = set(map(str.count, words, repeat("/")))
        numbers = " ".join(words).replace("//", "/0/").replace("/", " ").split()
        if others or slashes > 2 or len(numbers) != (slashes + 1) * len(words) or not "".join(numbers).isdecimal():
            return False
        indices = np.array([*map(float, numbers)]).reshape(len(words), -1)
        if len(words) < 3 * count or indices[:, 0].min() < 1 or indices.max() > MAX_INDEX:
            return False
        corners = np.full((len(words), 3), -1)
        corners[:, : slashes + 1] = indices - 1
        self.corners.frombytes(corners.tobytes())
        self.face_sizes += [len(words) // count] * count
        self.face_lines += range(line, line + count)
        self.group_of_face += [self.groups.setdefault((self.group, self.material), len(self.groups))] * count
        self.smoothings.add(self.smoothing)
        return True

    def read_numbers(self, line: int, kind: str, words: list[str]) -> None:
        """Read a vertex, texture coordinates, a normal or a face.

        Raises
        ------
        ValueError, OverflowError
            A word is not a number, or not one that is expected there.
        """
        if kind == "f":
            self._read_face(line, words)
        else:
            words = [*words, "0"][:2] if kind == "vt" else words[: 6 if len(words) >= 6 else 3]
            self._add_numbers(kind, np.array([[*map(float, words)]]))

    def _add_numbers(self, kind: str, numbers: NDArray[np.float64]) -> None:
        """Add vertices, texture coordinates or normals, one per row; raise a ValueError if some cannot be."""
        width = 2 if kind == "vt" else 3
        kept = numbers[:, :width]
        if kept.shape[1] < width or (kind == "v" and not (np.abs(kept) <= MAX_COORDINATE).all()):
            raise ValueError("numbers that are missing or out of range")
        {"v": self.positions, "vt": self.coordinates, "vn": self.normals}[kind].frombytes(kept.tobytes())
        if kind == "v" and numbers.shape[1] >= 6:
            self.colors.frombytes(numbers[:, 3:6].tobytes())

    def _read_face(self, line: int, words: list[str]) -> None:
        so_far = len(self.positions) // 3, len(self.coordinates) // 2, len(self.normals) // 3
        first = len(self.corners)
        for word in words:
            v, vt, vn = (*(int(part or 0) for part in word.split("/")), 0, 0, 0)[: max(3, 1 + word.count("/"))]
            self.corners.extend(map(_index, (v, vt, vn), so_far))
        if min(self.corners[first::3], default=0) < 0:
            raise ValueError("no such vertex")
        if len(words) < 3:
            self.small_faces += 1
            del self.corners[first:]
            return
        self.face_sizes.append(len(words))
        self.face_lines.append(line)
        self.group_of_face.append(self.groups.setdefault((self.group, self.material), len(self.groups)))
        self.smoothings.add(self.smoothing)

    def read_other(self, line: int, kind: str, value: str) -> None:
        """Read a statement that has no numbers of a surface."""
        match kind:
            case "g" | "o":
                self.group = " ".join(value.split())
            case "s":
                group = value.partition("#")[0].strip()
                self.smoothing = "" if group in ("off", "0") else group
            case "usemtl":
                self.material = value
            case "mtllib":
                named = [name.strip('" \t') for name in LIBRARY_END.split(value)[:-1]]
                for name in named or value.split():
                    self.libraries.setdefault(name.strip('"'), line)
            case "l" | "p":
                self.lines_and_points += 1
            case _ if not IGNORED_STATEMENT.fullmatch(kind):
                self.unknown.append(line)

    def surface(self) -> Surface:
        """Return the surface of all statements."""
        if not self.positions:
            raise damaged(self.path, "no vertices", "an OBJ file with 'v x y z' lines")
        if not self.face_sizes:
            raise damaged(self.path, "vertices without faces", "an OBJ file with faces")
        positions = np.array(self.positions).reshape(-1, 3)
        corners, sizes = self._corners(len(positions)), np.array(self.face_sizes)
        triangles, polygon = triangulate(positions[corners[0]], sizes)
        # polygons that lack texture coordinates or normals at some corner become separate pieces
        starts = np.cumsum(sizes) - sizes
        has_uv, has_normal = np.minimum.reduceat(corners[1:], starts, axis=1) >= 0
        kind = 4 * np.array(self.group_of_face) + 2 * has_normal + has_uv
        pieces = self._pieces(positions, corners, np.repeat(kind, sizes), triangles, kind[polygon])
        self._note_omissions()
        return Surface(pieces, self.notes, files=self.folder.files)

    def _corners(self, vertices: int) -> NDArray[np.int64]:
        """Return the indices (3, c) of vertex, texture coordinates and normal of all corners, −1 for none."""
        corners = np.array(self.corners).reshape(-1, 3).T.copy()
        if corners[0].max() >= vertices:
            corner = int(np.argmax(corners[0] >= vertices))
            face = int(np.searchsorted(np.cumsum(self.face_sizes), corner, side="right"))
            found = f"vertex {corners[0, corner] + 1} of {vertices:,}"
            raise damaged(at(self.path, line=self.face_lines[face]), found, EXPECTED["f"])
        wrong = (corners >= [[vertices], [len(self.coordinates) // 2], [len(self.normals) // 3]]) | (corners < -1)
        if wrong.any():
            self.notes.append("Some faces name texture coordinates or normals that are not in the file.")
            corners[wrong] = -1
        return corners

    def _pieces(
        self,
        positions: NDArray[np.float64],
        corners: NDArray[np.int64],
        kind_of_corner: NDArray[np.int64],
        triangles: NDArray[np.int64],
        kind_of_triangle: NDArray[np.int64],
    ) -> list[Piece]:
        """Return the pieces, each of which has vertices of its own."""
        uvs = upper_left(np.array(self.coordinates).reshape(-1, 2))
        normals = np.array(self.normals).reshape(-1, 3)
        colors = linear(np.array(self.colors).reshape(-1, 3)) if self.colors else None
        if colors is not None and len(colors) < len(positions):
            self.notes.append("Vertex colours are omitted, because some vertices have none.")
            colors = None
        names, materials = list(self.groups), self._materials()
        isolated = np.ones(len(positions), dtype=np.bool_)
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
                    positions=positions[v],
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

    def _materials(self) -> dict[str, SurfaceMaterial]:
        """Return the materials of all faces, from the material files."""
        known: dict[str, SurfaceMaterial] = {}
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
        if self.small_faces:
            self.notes.append(f"{count(self.small_faces, 'face')} with fewer than 3 corners omitted.")
        if len(self.smoothings) > 1 and not self.normals:
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


def _index(stated: int, so_far: int) -> int:
    """Return an index from 0: −1 for an omitted index, −2 for one that counts back beyond the first."""
    if stated >= 0:
        return stated - 1
    return so_far + stated if stated >= -so_far else -2
