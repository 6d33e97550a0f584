"""The studio's folder: uploads, characters, takes and exports. Outside it, the studio writes saved puppet files only.

A name from the page never becomes a path. Files are in folders that this program names; their own names are the page's,
reduced to letters, digits, `_` and `-`, so that people recognise them.

    uploads/ID/NAME.glb        files that the page has sent
    characters/NAME/           an open character: its mesh and its edited puppet
    takes/NAME.log             recordings of the service
    exports/ID/NAME.glb        files that can be downloaded
    pictures/NAME.png          pictures of takes
    media/NAME.mp3             sounds and pictures of the film
    film.toml                  scene file of the film
    examples/                  example characters and recordings, which take seconds to make
    service.toml, token        of the service that the studio starts
    session.json               which characters were open
"""

import json
import re
import secrets
import shutil
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any, Literal

from puppetline.errors import PuppetlineError, ServiceError
from puppetline.files import output_errors, written_whole

MAX_UPLOAD_BYTES = 256_000_000
"""Maximum size of an upload in bytes."""

MAX_UPLOADS = 64
"""Maximum number of uploads that are kept, together with the sounds and pictures of films."""

MAX_TOTAL_BYTES = 2_000_000_000
"""Maximum size of all uploads in bytes, together with the sounds and pictures of films."""

MAX_EXPORTS = 32
"""Maximum number of files to download that are kept; the oldest are deleted."""

MAX_STEM = 32
"""Maximum length of a file's name without its ending."""

SUFFIX = re.compile(r"\.[a-z0-9]{1,10}")

Kind = Literal["character", "log", "puppet", "video"]


@dataclass(frozen=True)
class Upload:
    """A checked file from the page.

    Attributes
    ----------
    id : str
    name : str
        Name that the page gave it, for people; the file's own name differs.
    path : Path
    kind : {"character", "log", "puppet", "video"}
    facts : dict
        What `puppetline inspect` reports about it.
    """

    id: str
    name: str
    path: Path
    kind: Kind
    facts: dict[str, Any] = field(repr=False)

    @property
    def bytes(self) -> int:
        """Size of the file."""
        return self.path.stat().st_size


@dataclass(frozen=True)
class Download:
    """A file that the page may download, under a name for people."""

    id: str
    name: str
    path: Path
    kind: Literal["export", "puppet", "take", "model"]

    @property
    def bytes(self) -> int:
        """Size of the file; 0 if it was deleted."""
        return self.path.stat().st_size if self.path.is_file() else 0


class Workspace:
    """The studio's folder.

    Parameters
    ----------
    folder : Path
        Created if it does not exist. Uploads and exports of an earlier run are deleted.

    Raises
    ------
    OutputError
        The folder cannot be created.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder.absolute()
        self.uploads: dict[str, Upload] = {}
        self.downloads: dict[str, Download] = {}
        self._pending = 0
        inside = r"(?:(?:uploads|exports|characters)/[^/\s]+/|(?:takes|examples)/)?"
        self._own_folders = re.compile(re.escape(f"{self.folder}/") + inside)
        shutil.rmtree(self.folder / "uploads", ignore_errors=True)
        shutil.rmtree(self.folder / "exports", ignore_errors=True)
        with output_errors(self.folder):
            for name in ("uploads", "characters", "takes", "exports", "examples", "pictures", "media"):
                (self.folder / name).mkdir(mode=0o700, parents=True, exist_ok=True)

    def upload(self, key: str, kind: Kind | None = None) -> Upload:
        """Return an upload.

        Raises
        ------
        ServiceError
            There is no such upload, or it is of another kind.
        """
        found = self.uploads.get(key)
        if found is None:
            raise ServiceError(
                "the request, upload",
                found=f"no upload {key!r}",
                expected="the id of an upload",
                fix="Upload it again.",
            )
        if kind is not None and found.kind != kind:
            names = {"character": "a mesh", "log": "a recording", "puppet": "a puppet file", "video": "a video"}
            raise ServiceError(
                found.name, found=names[found.kind], expected=names[kind], fix=f"Choose {names[kind]} instead."
            )
        return found

    async def receive(self, name: str, size: int | None, chunks: AsyncIterator[bytes]) -> Path:
        """Write what the page sends into a new folder, and return the file; the caller checks it.

        Parameters
        ----------
        name : str
            Any text.
        size : int or None
            Announced number of bytes.
        chunks : async iterator of bytes

        Raises
        ------
        UploadError
            The file is too large, or there are too many uploads; nothing of it is kept.
        OutputError
        """
        kept = [*(each.path for each in self.uploads.values()), *(self.folder / "media").iterdir()]
        if len(kept) + self._pending >= MAX_UPLOADS:
            raise UploadError(
                name,
                found=f"{MAX_UPLOADS} uploads",
                expected="fewer uploads",
                fix="Delete uploads that you no longer need, or files in the folder media of the studio's folder.",
            )
        room = min(MAX_UPLOAD_BYTES, MAX_TOTAL_BYTES - sum(each.stat().st_size for each in kept))
        if size is not None and size > room:
            raise _too_large(name, room)
        path = self.folder / "uploads" / new_id() / file_name(name)
        self._pending += 1
        try:
            with output_errors(path.parent):
                path.parent.mkdir(mode=0o700)
                written = 0
                with path.open("wb") as file:
                    async for chunk in chunks:
                        written += len(chunk)
                        if written > room:
                            raise _too_large(name, room)
                        file.write(chunk)
        except BaseException:
            shutil.rmtree(path.parent, ignore_errors=True)
            raise
        finally:
            self._pending -= 1
        return path

    def keep(self, name: str, path: Path, kind: Kind, facts: dict[str, Any]) -> Upload:
        """Add a received file that was checked."""
        upload = Upload(path.parent.name, shown(name), path, kind, facts)
        self.uploads[upload.id] = upload
        return upload

    def keep_media(self, path: Path) -> str:
        """Move a received sound or picture to the film's, and return its path relative to the folder."""
        endings = ("" if number == 1 else f"-{number}" for number in count(1))
        names = (f"{path.stem}{ending}{path.suffix}" for ending in endings)
        kept = next(each for name in names if not (each := self.folder / "media" / name).exists())
        path.replace(kept)
        self.discard(path)
        return kept.relative_to(self.folder).as_posix()

    @property
    def media(self) -> list[str]:
        """The sounds and pictures of films, relative to the folder."""
        return [each.relative_to(self.folder).as_posix() for each in (self.folder / "media").iterdir()]

    def mesh_of(self, puppet: Upload) -> Upload:
        """Return the uploaded mesh that a puppet file names.

        Raises
        ------
        ServiceError
            It was not uploaded.
        """
        name = Path(str(puppet.facts["character"]).replace("\\", "/")).name
        meshes = [each for each in self.uploads.values() if each.kind == "character"]
        found = [each for each in meshes if each.name == name]
        if found:
            return found[-1]
        raise ServiceError(
            puppet.name,
            found=f"the mesh {name!r}, which was not uploaded",
            expected="an upload of that name",
            fix=f"Upload {name} too, or choose another mesh.",
        )

    def export(self, key: str) -> Download:
        """Return a file that was exported.

        Raises
        ------
        ServiceError
            There is no such file.
        """
        found = self.downloads.get(key)
        if found is None or found.kind != "export":
            raise ServiceError(
                "the request, file",
                found=f"no file {key!r:.80}",
                expected="the id of a film that was made",
                fix="Make the film again.",
            )
        return found

    def discard(self, path: Path) -> None:
        """Delete a received file that is not kept."""
        shutil.rmtree(path.parent, ignore_errors=True)

    def delete_upload(self, key: str) -> None:
        """Delete an upload.

        Raises
        ------
        ServiceError
            There is no such upload.
        """
        self.discard(self.upload(key).path)
        del self.uploads[key]

    def new_export(self, stem: str, suffix: str) -> Path:
        """Return the path of a new file in a new folder; the oldest exports beyond `MAX_EXPORTS` are deleted."""
        folder = self.folder / "exports"
        exports = [
            each for each in self.downloads.values() if each.kind != "model" and each.path.parent.parent == folder
        ]
        for old in exports[: max(0, len(exports) + 1 - MAX_EXPORTS)]:
            del self.downloads[old.id]
            self.discard(old.path)
        path = folder / new_id() / f"{_plain(stem)}{suffix}"
        path.parent.mkdir(mode=0o700)
        return path

    def offer(self, path: Path, name: str, kind: Literal["export", "puppet", "take", "model"]) -> Download:
        """Allow the page to download a file."""
        download = Download(new_id(), shown(name), path, kind)
        self.downloads[download.id] = download
        return download

    def offer_puppet(self, path: Path) -> Download:
        """Allow the page to download a saved puppet file; a file that is saved again keeps its id."""
        known = [each for each in self.downloads.values() if each.path == path]
        return known[0] if known else self.offer(path, path.name, "puppet")

    def withdraw(self, key: str) -> None:
        """End the page's access to a file, which is not deleted."""
        self.downloads.pop(key, None)

    def told(self, error: PuppetlineError) -> dict[str, str]:
        """Return the parts of an error for a page, without the folders of this machine."""
        return {key: self.without_folders(text) for key, text in error.parts.items()}

    def without_folders(self, text: str) -> str:
        """Return a text for a page, without the folders of this machine."""
        return self._own_folders.sub("", text)

    def character_folder(self, stem: str) -> Path:
        """Create a new folder for a character, named after its file, and return it."""
        name = _plain(stem)
        endings = ("" if number == 1 else f"-{number}" for number in count(1))
        folders = (self.folder / "characters" / f"{name[: MAX_STEM - len(ending)]}{ending}" for ending in endings)
        folder = next(each for each in folders if not each.exists())
        folder.mkdir(mode=0o700)
        return folder

    def write_session(self, values: dict[str, Any]) -> None:
        """Store which characters are open and what performs, for the next start."""
        with written_whole(self.folder / "session.json") as beside:
            beside.write_text(json.dumps(values, indent=2), encoding="utf-8")

    def read_session(self) -> dict[str, Any]:
        """Return the values that the last run stored; empty if they cannot be read."""
        try:
            values = json.loads((self.folder / "session.json").read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}
        return values if isinstance(values, dict) else {}


class UploadError(PuppetlineError):
    """Raised for an upload that is too large, or for too many uploads."""


def file_name(name: str) -> str:
    """Return a safe file name that resembles a name from the page: ``my dragon.GLB`` becomes ``my_dragon.glb``."""
    last = re.split(r"[/\\]", name)[-1]
    stem, dot, ending = last.rpartition(".") if "." in last else (last, "", "")
    suffix = f"{dot}{ending.lower()}"
    return _plain(stem) + (suffix if SUFFIX.fullmatch(suffix) else "")


def shown(name: str) -> str:
    """Return a name from the page without folders and control characters, shortened, for people to read."""
    last = re.split(r"[/\\]", name)[-1]
    return "".join(each for each in last if each.isprintable())[:80] or "file"


def new_id() -> str:
    """Return an id that cannot be guessed."""
    return secrets.token_urlsafe(12)


def _plain(stem: str) -> str:
    return re.sub(r"[^A-Za-z0-9_-]+", "_", stem).strip("_-")[:MAX_STEM] or "file"


def _too_large(name: str, room: int) -> UploadError:
    return UploadError(
        shown(name),
        found="a larger file",
        expected=f"at most {room / 1e6:,.0f} MB",
        fix="Reduce the file, or delete uploads or files in media that you no longer need.",
    )
