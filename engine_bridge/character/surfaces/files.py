"""Files that a mesh file names: its materials and their pictures, all in its own folder or below."""

import hashlib
import io
import warnings
from pathlib import Path

from PIL import Image

from engine_bridge.character.surfaces.surface import Picture

MAX_IMAGE_PIXELS = 8192 * 8192
"""Pixels of the largest picture that is taken."""

MAX_TOTAL_PIXELS = 8 * MAX_IMAGE_PIXELS
"""Pixels of all pictures together."""

MAX_PIXELS_PER_BYTE = 8192
"""No honest picture packs more: one bit a pixel, and deflate's best of 1032 : 1."""

KEPT_FORMATS = {"PNG": "image/png", "JPEG": "image/jpeg", "MPO": "image/jpeg"}
"""The formats that glTF has room for, by their names in Pillow; MPO is what it calls a JPEG with a second picture."""

CONVERTED_FORMATS = ("BMP", "DDS", "GIF", "PPM", "TGA", "TIFF", "WEBP")
"""Others that are read. Not all that Pillow knows: for EPS it would run another program."""

FILE_NAME_ERRORS = (OSError, ValueError, RuntimeError)
"""What is raised for a name that is too long, has a zero byte in it, or is a link in a circle."""


class Folder:
    """The folder of a mesh file, and what was said of the files in it.

    Parameters
    ----------
    mesh : Path
        The mesh file.
    notes : list of str
        Takes what has to be told of files that are named.

    Attributes
    ----------
    files : dict
        The `state` of every file that was looked for, by its name and the folder of the file that names it.
    """

    def __init__(self, mesh: Path, notes: list[str]) -> None:
        self.notes = notes
        self.files: dict[tuple[str, str], str] = {}
        self._root = mesh.parent.resolve()
        self._pictures: dict[Path, Picture | None] = {}
        self._states: dict[Path | None, str] = {}
        self._pixels = 0
        self._namesakes: dict[Path, dict[str, list[Path]]] = {}

    def find(self, name: str, below: Path, where: str) -> Path | None:
        """Find a file that the mesh, or a file beside it, names; note it where it is not there.

        A path that leads elsewhere, mostly on its maker's computer, stands for the file of the same name here. Nothing
        outside of the mesh file's folder is ever opened.

        Parameters
        ----------
        name : str
        below : Path
            The folder of the file that names it.
        where : str
            The line that names it, for a note.
        """
        self.files[name, str(below)] = self.state(name, below)
        try:
            stated, found = self._resolve(name, below)
        except FILE_NAME_ERRORS:
            self.notes.append(f"{where}: {name[:60]!r} is no file name. It is omitted.")
            return None
        if found and found != stated:
            self.notes.append(f"{name!r} is not there: {found.name!r} beside it is taken.")
        elif stated and not found:
            self.notes.append(f"{name!r} is not there.")
        elif not found:
            copied = _last(name)
            self.notes.append(
                f"{where}: {name!r} is outside of the mesh's folder and is not read. Copy {copied!r} beside the mesh."
            )
        return found

    def state(self, name: str, below: Path) -> str:
        """Say which file a name stands for and what it holds, as a text that is another where any of that is.

        Parameters as for `find`.
        """
        try:
            _, found = self._resolve(name, below)
            if found not in self._states:
                self._states[found] = f"{found} {hashlib.sha256(found.read_bytes()).hexdigest()}" if found else "none"
        except FILE_NAME_ERRORS as error:
            return type(error).__name__
        return self._states[found]

    def picture(self, name: str, below: Path, where: str) -> Picture | None:
        """Read a picture that is named; note it where it is not there or cannot be shown.

        Parameters as for `find`.
        """
        path = self.find(name, below, where)
        if path is None:
            return None
        if path not in self._pictures:
            try:
                self._pictures[path] = self._read(path)
            except Exception as error:  # Pillow's decoders raise whatever they come across
                self.notes.append(f"The picture {path.name!r} cannot be read ({error}): left out.")
                self._pictures[path] = None
        return self._pictures[path]

    def _resolve(self, name: str, below: Path) -> tuple[Path | None, Path | None]:
        """Return where a name leads, if not out of the mesh's folder, and the file that it stands for, if any."""
        stated = self._inside(below / name.replace("\\", "/"))
        return stated, stated if stated and stated.is_file() else self._namesake(below, _last(name))

    def _inside(self, path: Path) -> Path | None:
        """Return where a path leads, or None where that is not in the mesh's folder or below."""
        resolved = path.resolve()
        return resolved if resolved.is_relative_to(self._root) else None

    def _namesake(self, below: Path, name: str) -> Path | None:
        """Find a file by its name alone, in capitals or not."""
        if below not in self._namesakes:
            self._namesakes[below] = {}
            for file in sorted(below.iterdir()):
                self._namesakes[below].setdefault(file.name.casefold(), []).append(file)
        for file in self._namesakes[below].get(name.casefold(), []):
            if (path := self._inside(file)) and path.is_file():
                return path
        return None

    def _read(self, path: Path) -> Picture:
        content = path.read_bytes()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of size, which is checked here, and of flaws that it got over
            with Image.open(io.BytesIO(content), formats=("PNG", "JPEG", *CONVERTED_FORMATS)) as image:
                if image.width * image.height > min(MAX_PIXELS_PER_BYTE * len(content), MAX_IMAGE_PIXELS):
                    raise ValueError(f"{image.width} × {image.height} pixels")
                self._pixels += image.width * image.height
                if self._pixels > MAX_TOTAL_PIXELS:
                    raise ValueError(f"{self._pixels:,} pixels in all")
                image.load()
                if image.format in KEPT_FORMATS:
                    return Picture(path.stem, KEPT_FORMATS[image.format], content)
                png = io.BytesIO()
                has_alpha = "A" in image.getbands() or "transparency" in image.info
                image.convert("RGBA" if has_alpha else "RGB").save(png, "PNG")
        self.notes.append(f"The picture {path.name!r} is converted to PNG.")
        return Picture(path.stem, "image/png", png.getvalue())


def _last(name: str) -> str:
    """Return the last part of a path of any system."""
    return name.replace("\\", "/").rpartition("/")[2]
