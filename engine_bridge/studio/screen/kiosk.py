"""A kiosk as its screen and its visitors' phones see it."""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from engine_bridge.puppet import puppet_file
from engine_bridge.service.kiosk.clip import visitors_folder
from engine_bridge.service.kiosk.kiosk_table import KioskTable
from engine_bridge.service.loading import service_file
from engine_bridge.service.loading.service_file import character_names
from engine_bridge.studio.screen.phone_address import phone_address
from engine_bridge.studio.screen.shared_films import FilmFolder
from puppetline.errors import PuppetlineError


@dataclass(frozen=True)
class VisitorsKiosk:
    """The kiosk of a service file.

    Attributes
    ----------
    table : KioskTable
    folder : Path
        Folder that the table's files are relative to.
    visitors : Path
        Folder of visitors' films.
    puppets : dict of str to Path
        Puppet files of the characters by their names.
    """

    table: KioskTable
    folder: Path
    visitors: Path
    puppets: dict[str, Path]

    @classmethod
    def of_service_file(cls, path: Path) -> Self:
        """Return the kiosk of a service file.

        Raises
        ------
        ServiceError
            The file has an error.
        """
        settings, folder = service_file.load(path), path.parent
        puppets = {
            name: folder / character.puppet
            for stage in settings.stage
            for name, character in zip(character_names(stage), stage.character, strict=True)
        }
        return cls(settings.kiosk or KioskTable(), folder, visitors_folder(folder / settings.takes), puppets)

    @property
    def phone_address(self) -> str | None:
        """The beginning of the addresses that phones open; None without a network."""
        return phone_address(self.table.phone_address, self.table.phone_port) if self.table.phone_port else None

    @property
    def branding(self) -> dict[str, Path]:
        """The files of the screen by what they are: the logo and the film for when no performer is in view."""
        screen = self.table.screen
        given = {"logo": screen.logo, "film": screen.film}
        return {kind: self.folder / name for kind, name in given.items() if name is not None}

    @property
    def files(self) -> list[Path]:
        """All files that the screen shows: its branding, and the characters' puppet files and meshes."""
        files = [*self.branding.values(), *self.puppets.values()]
        for puppet in self.puppets.values():
            with suppress(PuppetlineError):  # a file with an error is the service's to report
                files.append(puppet.parent / puppet_file.load(puppet).character.mesh)
        return files

    def film_file(self, code: str, ending: str) -> Path | None:
        """Return the film (``".mp4"``), poster (``".jpg"``) or ``".gif"`` of a code; None if there is none."""
        return FilmFolder(self.visitors).film_file(code, ending)
