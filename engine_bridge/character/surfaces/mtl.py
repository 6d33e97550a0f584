"""Wavefront MTL: the materials of an OBJ file."""

import io
import re
from pathlib import Path

import numpy as np
from PIL import Image

from engine_bridge.character.surfaces.files import Folder
from engine_bridge.character.surfaces.surface import Material, Picture, count
from engine_bridge.character.surfaces.text import decoded
from puppetline.errors import at

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
OPTION = re.compile(
    rf"-(?:[sot](?:\s+{_NUMBER}(?=\s)){{1,3}}|mm(?:\s+{_NUMBER}){{2}}"
    r"|(?:blendu|blendv|bm|boost|cc|clamp|imfchan|texres|type)\s+\S+)\s+",
    re.IGNORECASE,
)
"""One option before the file name of a map."""

NEUTRAL_OPTION = re.compile(
    r"-(?:(?:s|bm)(?:\s+\+?1(?:\.0*)?)+|[ot](?:\s+[-+]?0(?:\.0*)?)+|mm\s+0(?:\.0*)?\s+1(?:\.0*)?|(?:clamp|cc)\s+off"
    r"|(?:blendu|blendv|boost|imfchan|texres|type)\s.*)\s+",
    re.IGNORECASE,
)
"""An option that leaves a map as it is, or only says how it is sampled."""

UNSUPPORTED_MAPS = (
    "map_ks", "map_ns", "map_ke", "map_pr", "map_pm", "map_ps", "map_refl", "refl", "disp", "map_disp", "decal",
    "map_tr",
)  # fmt: skip
"""Maps that have no place here."""


def read(path: Path, folder: Folder) -> dict[str, Material]:
    """Read the materials of a file.

    Colours are taken as linear, as Blender writes them and most readers take them. A picture stands in place of Kd.

    Parameters
    ----------
    path : Path
    folder : Folder
        The mesh's, which knows its pictures and takes notes.

    Raises
    ------
    MeshError
        No text.
    """
    found: dict[str, _Statements] = {}
    current = None
    for number, line in enumerate(decoded(path, path.read_bytes()).split("\n"), 1):
        kind, *rest = line.split(maxsplit=1) or [""]
        value = rest[0].strip() if rest else ""
        if kind.lower() == "newmtl":
            current = found.setdefault(value, _Statements(path, value, folder))
        elif kind and not kind.startswith("#") and current is not None:
            current.lines[kind.lower()] = number, value
    materials = {name: statements.material() for name, statements in found.items()}
    wrong = [line for statements in found.values() for line in statements.not_understood]
    if wrong:
        folder.notes.append(f"{path.name}: {count(len(wrong), 'line')} not understood, the first is line {min(wrong)}.")
    return materials


class _Statements:
    """What a file says of one material: line number and value by lower-case keyword."""

    def __init__(self, path: Path, name: str, folder: Folder) -> None:
        self.path = path
        self.name = name
        self.folder = folder
        self.lines: dict[str, tuple[int, str]] = {}
        self.not_understood: list[int] = []

    def material(self) -> Material:
        opacity = self._opacity()
        texture = self._picture("map_kd")
        cut_out = self._is_cut_out(texture)
        color = (1.0, 1.0, 1.0) if texture else self._color("kd") or Material.base_color[:3]
        for kind in UNSUPPORTED_MAPS:
            if kind in self.lines:
                self.folder.notes.append(f"Material {self.name!r}: {kind} is not carried.")
        return Material(
            name=self.name,
            base_color=(*color, opacity),
            metallic=self._number("pm", 0.0, most=1.0),
            roughness=self._roughness(),
            emissive=self._color("ke") or Material.emissive,
            texture=texture,
            normal_texture=self._normals(),
            alpha_mode="BLEND" if opacity < 1 else "MASK" if cut_out else "OPAQUE",
        )

    def _numbers(self, kind: str) -> list[float]:
        """Return a statement's numbers, none where it is not there or not understood."""
        line, value = self.lines.get(kind, (0, ""))
        try:
            numbers = [float(field) for field in value.removeprefix("-halo").split()]
            if not np.isfinite(numbers).all():
                raise ValueError("not finite")
        except ValueError:
            self.not_understood.append(line)
            return []
        return numbers

    def _number(self, kind: str, default: float, most: float) -> float:
        return float(np.clip((self._numbers(kind) or [default])[0], 0.0, most))

    def _color(self, kind: str) -> tuple[float, float, float] | None:
        numbers = self._numbers(kind)
        if not numbers:
            return None
        red, green, blue = np.clip(numbers[:3] if len(numbers) >= 3 else numbers[:1] * 3, 0.0, 1.0).tolist()
        return red, green, blue

    def _opacity(self) -> float:
        """Return d, or 1 − Tr; MeshLab writes Tr 1 for what is to be seen, so that nothing is quite transparent."""
        opacity = self._number("d", 1.0 - self._number("tr", 0.0, most=1.0), most=1.0)
        if opacity == 0:
            self.folder.notes.append(f"Material {self.name!r} would be invisible: made opaque.")
        return opacity or 1.0

    def _roughness(self) -> float:
        """Return Pr, or what has a highlight as wide as Ns gives.

        A Phong exponent Ns is like a microfacet width α with α² = 2 / (Ns + 2) (Walter et al., Microfacet Models for
        Refraction through Rough Surfaces, 2007, 5.2), and glTF's α is its roughness squared.
        """
        if "pr" in self.lines:
            return self._number("pr", Material.roughness, most=1.0)
        if self._color("ks") == (0.0, 0.0, 0.0) or self._numbers("illum") in ([0], [1]):
            return 1.0
        if "ns" in self.lines:
            return float((2 / (self._number("ns", 0.0, most=1e6) + 2)) ** 0.25)
        return Material.roughness

    def _map(self, kind: str) -> tuple[str, list[str]]:
        """Return the file name of a map and the options before it."""
        name, options = self.lines.get(kind, (0, ""))[1] + " ", []
        while option := OPTION.match(name):
            options.append(option.group())
            name = name[option.end() :]
        return name.strip().strip('"'), options

    def _picture(self, kind: str) -> Picture | None:
        """Return the picture of a map as it is, and note the options that would change it."""
        name, options = self._map(kind)
        where = at(self.path, line=self.lines[kind][0] if name else None)
        picture = self.folder.picture(name, self.path.parent, where) if name else None
        lost = [option.split()[0] for option in options if not NEUTRAL_OPTION.fullmatch(option)]
        if picture and lost:
            self.folder.notes.append(f"Material {self.name!r}: {', '.join(lost)} of {kind} not carried.")
        return picture

    def _normals(self) -> Picture | None:
        """Return the first map of normals, also where it is called a bump map, as many programs write it."""
        normals, taken = None, ""
        for kind in ("norm", "map_bump", "bump"):
            if not taken:
                picture = self._picture(kind)
                if picture and (kind == "norm" or _holds_normals(picture)):
                    normals, taken = picture, kind
                elif picture:
                    self.folder.notes.append(f"Material {self.name!r}: {kind} holds heights and is not carried.")
            elif kind in self.lines and self._map(kind)[0] != self._map(taken)[0]:
                self.folder.notes.append(f"Material {self.name!r}: {kind} is not carried beside {taken}.")
        return normals

    def _is_cut_out(self, texture: Picture | None) -> bool:
        """Tell whether the opacity map is the texture's own alpha channel."""
        if "map_d" not in self.lines:
            return False
        if texture and self._map("map_d")[0] == self._map("map_kd")[0]:
            with Image.open(io.BytesIO(texture.content)) as image:
                if "A" in image.getbands():
                    return True
        self.folder.notes.append(f"Material {self.name!r}: map_d is not carried.")
        return False


def _holds_normals(picture: Picture) -> bool:
    """Tell a map of normals, which is bluish, from one of heights, which is grey."""
    with Image.open(io.BytesIO(picture.content)) as image:
        red, green, blue = np.asarray(image.convert("RGB").resize((16, 16))).reshape(-1, 3).mean(axis=0)
    return bool(blue > 1.3 * max(red, green))
