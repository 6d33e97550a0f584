"""Draws pictures of takes in the background."""

import asyncio
import contextlib
import logging
from collections.abc import Callable
from pathlib import Path

from engine_bridge.studio.backend.film_editing import FilmEditing
from engine_bridge.studio.long_work.worker import Worker
from engine_bridge.studio.messages.state import TakeState
from engine_bridge.studio.project.open_characters import Characters
from engine_bridge.studio.project.take_list import TakeList
from puppetline.errors import PuppetlineError

log = logging.getLogger(__name__)


class TakeDrawing:
    """Draws takes that have no picture yet.

    Parameters
    ----------
    takes : TakeList
    film : FilmEditing
    characters : Characters
        A take is drawn with the character that plays it in the film, or one that was there, or any other.
    worker : Worker
    changed : callable
        Called after each picture.
    """

    def __init__(
        self, takes: TakeList, film: FilmEditing, characters: Characters, worker: Worker, changed: Callable[[], None]
    ) -> None:
        self._takes, self._film, self._characters = takes, film, characters
        self._worker, self._changed = worker, changed
        self._drawing: asyncio.Task[None] | None = None
        self._failed: set[str] = set()

    def begin(self) -> None:
        """Draw what is missing, after what is being drawn."""
        self._drawing = asyncio.create_task(self._draw(self._drawing))

    async def close(self) -> None:
        """End the work."""
        if self._drawing is not None:
            self._drawing.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._drawing

    async def _draw(self, before: asyncio.Task[None] | None) -> None:
        if before is not None:
            await before
        for take in self._takes.states:
            if take.name in self._failed:
                continue
            try:
                await self._draw_take(take)
            except PuppetlineError as error:
                self._failed.add(take.name)
                log.warning("a take has no picture", extra={"fields": {"take": take.name, "why": str(error)}})
            self._changed()

    async def _draw_take(self, take: TakeState) -> None:
        sound, wave = self._takes.sound(take.name), self._takes.picture(take.name, wave=True)
        if not take.wave and sound.exists():
            await self._worker.run("draw_wave", sound, wave)
        puppet = self._puppet_for(take)
        if not take.picture and take.seconds and puppet is not None:
            await self._worker.run("draw_take", puppet, self._takes.path(take.name), self._takes.picture(take.name))

    def _puppet_for(self, take: TakeState) -> Path | None:
        files = {each.name: each.live_file for each in self._characters.all}
        names = [*self._film.players(take.name), *take.parts, *files]
        return next((files[name] for name in names if name in files), None)
