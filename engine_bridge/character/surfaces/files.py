"""Finds and reads files that a mesh file names: materials and images in its folder or below."""

import hashlib
import io
import warnings
from pathlib import Path

from PIL import Image

from engine_bridge.character.surfaces.surface import ImageFile

MAX_IMAGE_PIXELS = 8192 * 8192
"""Maximum number of pixels of an image."""

MAX_TOTAL_PIXELS = 8 * MAX_IMAGE_PIXELS
"""Maximum number of pixels of all images of a mesh."""

MAX_PIXELS_PER_BYTE = 8192
"""Maximum number of pixels per byte of an image file: eight at one bit each, times deflate's maximum ratio of 1032."""

KEPT_FORMATS = {"PNG": "image/png", "JPEG": "image/jpeg", "MPO": "image/jpeg"}
"""Image formats that glTF supports, by their names in Pillow; MPO is a JPEG with a second image."""

CONVERTED_FORMATS = ("BMP", "DDS", "GIF", "PPM", "TGA", "TIFF", "WEBP")
"""Image formats that are converted to PNG. Others are excluded: for EPS, Pillow would run another program."""

FILE_NAME_ERRORS = (OSError, ValueError, RuntimeError)
"""Errors raised for a name that is too long or has a zero byte in it, or for a cycle of links."""


class Folder:
    """The folder of a mesh file, and the files in it that were looked up.

    Parameters
    ----------
    mesh : Path
        Path of the mesh file.
    notes : list of str
        Receives notes about files.

    Attributes
    ----------
    files : dict
        `state` of every file that was looked up, by its name and the folder of the file that names it.
    """

    def __init__(self, mesh: Path, notes: list[str]) -> None:
        self.notes = notes
        self.files: dict[tuple[str, str], str] = {}
        self._root = mesh.parent.resolve()
        self._images: dict[Path, ImageFile | None] = {}
        self._states: dict[Path | None, str] = {}
        self._pixels = 0
        self._namesakes: dict[Path, dict[str, list[Path]]] = {}

    def find(self, name: str, below: Path, where: str) -> Path | None:
        """Find a file that the mesh, or a material file, names; add a note if it is missing.

        A path outside the mesh file's folder, usually on its author's computer, refers to the file of the same name in
        the folder. Files outside the folder are never opened.

        Parameters
        ----------
        name : str
        below : Path
            Folder of the file that names it.
        where : str
            File and line that name it, for a note.
        """
        self.files[name, str(below)] = self.state(name, below)
        try:
            stated, found = self._resolve(name, below)
        except FILE_NAME_ERRORS:
            self.notes.append(f"{where}: {name[:60]!r} is not a file name and is ignored.")
            return None
        if found and found != stated:
            self.notes.append(f"{name!r} is missing; using {found.name!r} in the mesh's folder.")
        elif stated and not found:
            self.notes.append(f"{name!r} is missing.")
        elif not found:
            copied = _last(name)
            self.notes.append(
                f"{where}: {name!r} is outside the mesh's folder and is not read. Copy {copied!r} into that folder."
            )
        return found

    def state(self, name: str, below: Path) -> str:
        """Return a string that changes whenever the file of a name, or its content, changes.

        Parameters as for `find`.
        """
        try:
            _, found = self._resolve(name, below)
            if found not in self._states:
                self._states[found] = f"{found} {hashlib.sha256(found.read_bytes()).hexdigest()}" if found else "none"
        except FILE_NAME_ERRORS as error:
            return type(error).__name__
        return self._states[found]

    def image(self, name: str, below: Path, where: str) -> ImageFile | None:
        """Read an image that a file names; add a note if it is missing or unreadable.

        Parameters as for `find`.
        """
        path = self.find(name, below, where)
        if path is None:
            return None
        if path not in self._images:
            try:
                self._images[path] = self._read(path)
            except Exception as error:  # Pillow's decoders raise errors of many types
                self.notes.append(f"The image {path.name!r} cannot be read ({error}) and is omitted.")
                self._images[path] = None
        return self._images[path]

    def _resolve(self, name: str, below: Path) -> tuple[Path | None, Path | None]:
        """Return the path of a name if it is in the mesh's folder, and the file that it refers to, if any."""
        stated = self._inside(below / name.replace("\\", "/"))
        return stated, stated if stated and stated.is_file() else self._namesake(below, _last(name))

    def _inside(self, path: Path) -> Path | None:
        """Return a resolved path, or None if it is not in the mesh's folder or below."""
        resolved = path.resolve()
        return resolved if resolved.is_relative_to(self._root) else None

    def _namesake(self, below: Path, name: str) -> Path | None:
        """Find a file in a folder by its name, ignoring case."""
        if below not in self._namesakes:
            self._namesakes[below] = {}
            for file in sorted(below.iterdir()):
                self._namesakes[below].setdefault(file.name.casefold(), []).append(file)
        for file in self._namesakes[below].get(name.casefold(), []):
            if (path := self._inside(file)) and path.is_file():
                return path
        return None

    def _read(self, path: Path) -> ImageFile:
        content = path.read_bytes()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about the size, which is checked here, and about minor flaws
            with Image.open(io.BytesIO(content), formats=("PNG", "JPEG", *CONVERTED_FORMATS)) as image:
                if image.width * image.height > min(MAX_PIXELS_PER_BYTE * len(content), MAX_IMAGE_PIXELS):
                    raise ValueError(f"{image.width} × {image.height} pixels")
                self._pixels += image.width * image.height
                if self._pixels > MAX_TOTAL_PIXELS:
                    raise ValueError(f"{self._pixels:,} pixels in all")
                image.load()
                if image.format in KEPT_FORMATS:
                    return ImageFile(path.stem, KEPT_FORMATS[image.format], content)
                png = io.BytesIO()
                has_alpha = "A" in image.getbands() or "transparency" in image.info
                image.convert("RGBA" if has_alpha else "RGB").save(png, "PNG")
        self.notes.append(f"The image {path.name!r} is converted to PNG.")
        return ImageFile(path.stem, "image/png", png.getvalue())


def _last(name: str) -> str:
    """Return the last part of a path of any operating system."""
    return name.replace("\\", "/").rpartition("/")[2]
