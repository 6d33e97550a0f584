"""Wavefront MTL: the materials of an OBJ file."""

import io
import re
from pathlib import Path

import numpy as np
from PIL import Image

from engine_bridge.character.surfaces.files import Folder
from engine_bridge.character.surfaces.surface import ImageFile, SurfaceMaterial, count
from engine_bridge.character.surfaces.text import decoded
from puppetline.errors import at

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
OPTION = re.compile(
    rf"-(?:[sot](?:\s+{_NUMBER}(?=\s)){{1,3}}|mm(?:\s+{_NUMBER}){{2}}"
    r"|(?:blendu|blendv|bm|boost|cc|clamp|imfchan|texres|type)\s+\S+)\s+",
    re.IGNORECASE,
)
"""Option before the file name of a map."""

NEUTRAL_OPTION = re.compile(
    r"-(?:(?:s|bm)(?:\s+\+?1(?:\.0*)?)+|[ot](?:\s+[-+]?0(?:\.0*)?)+|mm\s+0(?:\.0*)?\s+1(?:\.0*)?|(?:clamp|cc)\s+off"
    r"|(?:blendu|blendv|boost|imfchan|texres|type)\s.*)\s+",
    re.IGNORECASE,
)
"""Option that does not change a map, or only its sampling."""

UNSUPPORTED_MAPS = (
    "map_ks", "map_ns", "map_ke", "map_pr", "map_pm", "map_ps", "map_refl", "refl", "disp", "map_disp", "decal",
    "map_tr",
)  # fmt: skip
"""Maps that are ignored with a note."""


def read(path: Path, folder: Folder) -> dict[str, SurfaceMaterial]:
    """Read the materials of a file.

    Colours are linear, as Blender writes them and most readers interpret them. An image replaces Kd.

    Parameters
    ----------
    path : Path
    folder : Folder
        Folder of the mesh, which reads images and receives notes.

    Raises
    ------
    MeshError
        The file is not text.
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
        folder.notes.append(f"{path.name}: {count(len(wrong), 'line')} not understood; the first is line {min(wrong)}.")
    return materials


class _Statements:
    """Statements of a material: line number and value by lower-case keyword."""

    def __init__(self, path: Path, name: str, folder: Folder) -> None:
        self.path = path
        self.name = name
        self.folder = folder
        self.lines: dict[str, tuple[int, str]] = {}
        self.not_understood: list[int] = []

    def material(self) -> SurfaceMaterial:
        opacity = self._opacity()
        texture = self._image_of("map_kd")
        cut_out = self._is_cut_out(texture)
        color = (1.0, 1.0, 1.0) if texture else self._color("kd") or SurfaceMaterial.base_color[:3]
        for kind in UNSUPPORTED_MAPS:
            if kind in self.lines:
                self.folder.notes.append(f"SurfaceMaterial {self.name!r}: {kind} is ignored.")
        return SurfaceMaterial(
            name=self.name,
            base_color=(*color, opacity),
            metallic=self._number("pm", 0.0, most=1.0),
            roughness=self._roughness(),
            emissive=self._color("ke") or SurfaceMaterial.emissive,
            texture=texture,
            normal_texture=self._normals(),
            alpha_mode="BLEND" if opacity < 1 else "MASK" if cut_out else "OPAQUE",
        )

    def _numbers(self, kind: str) -> list[float]:
        """Return a statement's numbers; an empty list if it is missing or not understood."""
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
        """Return d, or 1 − Tr. A result of 0 becomes 1, because MeshLab writes Tr 1 for opaque materials."""
        opacity = self._number("d", 1.0 - self._number("tr", 0.0, most=1.0), most=1.0)
        if opacity == 0:
            self.folder.notes.append(f"SurfaceMaterial {self.name!r} would be invisible and was made opaque.")
        return opacity or 1.0

    def _roughness(self) -> float:
        """Return Pr, or the roughness with a highlight as wide as that of Ns.

        A Phong exponent Ns is like a microfacet width α with α² = 2 / (Ns + 2) (Walter et al., Microfacet Models for
        Refraction through Rough Surfaces, 2007, 5.2), and glTF's α is its roughness squared.
        """
        if "pr" in self.lines:
            return self._number("pr", SurfaceMaterial.roughness, most=1.0)
        if self._color("ks") == (0.0, 0.0, 0.0) or self._numbers("illum") in ([0], [1]):
            return 1.0
        if "ns" in self.lines:
            return float((2 / (self._number("ns", 0.0, most=1e6) + 2)) ** 0.25)
        return SurfaceMaterial.roughness

    def _map(self, kind: str) -> tuple[str, list[str]]:
        """Return the file name of a map and the options before it."""
        name, options = self.lines.get(kind, (0, ""))[1] + " ", []
        while option := OPTION.match(name):
            options.append(option.group())
            name = name[option.end() :]
        return name.strip().strip('"'), options

    def _image_of(self, kind: str) -> ImageFile | None:
        """Return the unchanged image of a map; add a note about options that would change it."""
        name, options = self._map(kind)
        where = at(self.path, line=self.lines[kind][0] if name else None)
        image = self.folder.image(name, self.path.parent, where) if name else None
        lost = [option.split()[0] for option in options if not NEUTRAL_OPTION.fullmatch(option)]
        if image and lost:
            self.folder.notes.append(f"SurfaceMaterial {self.name!r}: {', '.join(lost)} of {kind} ignored.")
        return image

    def _normals(self) -> ImageFile | None:
        """Return the first normal map, which many programs write as a bump map."""
        normals, taken = None, ""
        for kind in ("norm", "map_bump", "bump"):
            if not taken:
                image = self._image_of(kind)
                if image and (kind == "norm" or _holds_normals(image)):
                    normals, taken = image, kind
                elif image:
                    self.folder.notes.append(f"SurfaceMaterial {self.name!r}: {kind} has heights and is ignored.")
            elif kind in self.lines and self._map(kind)[0] != self._map(taken)[0]:
                self.folder.notes.append(f"SurfaceMaterial {self.name!r}: {kind} is ignored in favour of {taken}.")
        return normals

    def _is_cut_out(self, texture: ImageFile | None) -> bool:
        """Return whether the opacity map is the texture's alpha channel."""
        if "map_d" not in self.lines:
            return False
        if texture and self._map("map_d")[0] == self._map("map_kd")[0]:
            with Image.open(io.BytesIO(texture.content)) as image:
                if "A" in image.getbands():
                    return True
        self.folder.notes.append(f"SurfaceMaterial {self.name!r}: map_d is ignored.")
        return False


def _holds_normals(file: ImageFile) -> bool:
    """Return whether a map has normals, which are bluish, and not heights, which are grey."""
    with Image.open(io.BytesIO(file.content)) as image:
        red, green, blue = np.asarray(image.convert("RGB").resize((16, 16))).reshape(-1, 3).mean(axis=0)
    return bool(blue > 1.3 * max(red, green))
